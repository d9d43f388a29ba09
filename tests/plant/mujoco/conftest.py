"""What the twin's tests share: constants and floors."""

import dataclasses

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


@pytest.fixture(scope="session")
def soft(floors):
    """Floors with a rolling resistance of 0.05, named as those from which they are made."""
    return {
        name: dataclasses.replace(floor, numbers={**floor.numbers, "rolling_resistance": 0.05})
        for name, floor in floors.items()
    }
