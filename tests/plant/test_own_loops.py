"""Plants in a loop of one's own: floors by name, a seed per run, and clear words for slips of the pen."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from omnimj.errors import InputError, UnknownNameError
from omnimj.parameters import read_floors, read_rig, read_robot
from omnimj.plant.mujoco.twin import RigTwin, RobotTwin
from omnimj.plant.planar import PlanarRobot
from omnimj.plant.planar_rig import PlanarRig
from omnimj.signals import CurrentCommand

KINDS: dict[type, Any] = {
    RobotTwin: read_robot(),
    PlanarRobot: read_robot(),
    RigTwin: read_rig(),
    PlanarRig: read_rig(),
}
KIND = pytest.mark.parametrize("kind", KINDS, ids=lambda kind: kind.__name__)


def currents(kind, value=0.5) -> CurrentCommand:
    return CurrentCommand(np.full(KINDS[kind].wheel_count, value))


def readings(plant, kind, steps=20, seed=None):
    first = plant.reset() if seed is None else plant.reset(seed=seed)
    return [first.current, *(plant.step(currents(kind)).current for _ in range(steps))]


@KIND
def test_a_floor_is_given_by_its_name_or_as_such(kind):
    floors, constants = read_floors(), KINDS[kind]
    by_name = readings(kind(constants, "pvc"), kind)
    np.testing.assert_array_equal(by_name, readings(kind(constants, floors["pvc"]), kind))
    assert not np.array_equal(by_name, readings(kind(constants, "pvc", seed=1), kind))
    with pytest.raises(UnknownNameError, match="floor: unknown floor 'pcv'; did you mean 'pvc'"):
        kind(constants, "pcv")


@KIND
def test_a_reset_repeats_the_noise_or_takes_that_of_another_seed(kind):
    plant = kind(KINDS[kind], "pvc", seed=1)
    first, other = readings(plant, kind), readings(plant, kind, seed=2)
    assert not np.array_equal(first, other)
    np.testing.assert_array_equal(other, readings(plant, kind))
    np.testing.assert_array_equal(other, readings(kind(KINDS[kind], "pvc", seed=2), kind))
    np.testing.assert_array_equal(first, readings(plant, kind, seed=1))
    with pytest.raises(InputError, match="seed: found -1"):
        plant.reset(seed=-1)


@KIND
def test_a_step_before_the_first_reset_is_refused(kind):
    with pytest.raises(InputError, match="has not been reset; call reset"):
        kind(KINDS[kind], "pvc").step(currents(kind))


@KIND
@pytest.mark.parametrize("given", [[0.1] * 5, 0.3, [], "fast", None])
def test_a_command_of_another_length_is_refused(kind, given):
    plant = kind(KINDS[kind], "pvc")
    plant.reset()
    with pytest.raises(InputError, match=r"command: found .*(needed)"):
        plant.step(CurrentCommand(given))


def test_one_current_does_not_stand_for_all_wheels():
    plant = RobotTwin(read_robot(), "pvc")
    plant.reset()
    with pytest.raises(InputError, match="command: found 1 currents; 4 are needed, one per wheel"):
        plant.step(CurrentCommand(np.array([0.1])))
