"""What the tests of identification share."""

import pytest

from omnimj.parameters import read_floors, read_rig


@pytest.fixture(scope="session")
def rig():
    return read_rig()


@pytest.fixture(scope="session")
def floors():
    return read_floors()
