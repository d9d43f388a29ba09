"""What the twin's tests share: constants and floors."""

import pytest

from omnimj.parameters import read_floors, read_rig, read_robot


@pytest.fixture(scope="session")
def robot():
    return read_robot()


@pytest.fixture(scope="session")
def rig():
    return read_rig()


@pytest.fixture(scope="session")
def floors():
    return read_floors()
