"""What can still be done is a matter of rank: tables over every set of lost wheels."""

from __future__ import annotations

from itertools import combinations

import numpy as np
import pytest

from omnimj.control.detection.detector import FaultEstimate
from omnimj.control.recovery.modes import (
    CAPPING,
    COMPENSATING,
    NORMAL,
    PIVOTING,
    SLOWING,
    STOPPING,
    RecoveryAction,
    choose_action,
)
from omnimj.control.robot_constants import robot_constants
from omnimj.parameters import read_robot

ROBOT = read_robot()
FORCES = robot_constants(ROBOT).forces
NONE = np.zeros(4, bool)
WELL = FaultEstimate(np.zeros(4), NONE, NONE, NONE, NONE, np.zeros(2), np.zeros(4), -np.inf)


def wheels(*numbers):
    found = NONE.copy()
    found[[n - 1 for n in numbers]] = True
    return found


def means(before=None, **changes):
    return choose_action(WELL._replace(**changes), FORCES, before or RecoveryAction())


def test_a_healthy_robot_drives_without_recovery():
    assert means() == RecoveryAction(NORMAL)


@pytest.mark.parametrize("wheel", [1, 2, 3, 4])
def test_a_weak_dead_slipping_held_or_runaway_wheel_has_its_own_recovery_mode(wheel):
    lost = np.where(wheels(wheel), 0.5, 0.0)
    assert means(losses=lost).mode == means(dead=wheels(wheel)).mode == COMPENSATING
    assert means(slipping=wheels(wheel)).mode == CAPPING
    assert means(held=wheels(wheel)) == RecoveryAction(PIVOTING, wheel - 1, ())
    assert means(runaway=wheels(wheel)) == RecoveryAction(PIVOTING, wheel - 1, (wheel,))


@pytest.mark.parametrize("pair", list(combinations((1, 2, 3, 4), 2)))
def test_of_two_dead_motors_one_is_shorted_and_turned_about(pair):
    found = means(dead=wheels(*pair), velocity=np.array((0.3, 0.1)))
    assert found.mode == PIVOTING
    assert found.brake == (found.pivot + 1,)
    assert found.pivot + 1 in pair
    assert means(found, dead=wheels(*pair), velocity=np.array((-0.3, -0.1))) == found, "the choice is kept"


@pytest.mark.parametrize("velocity", [(0.5, 0.0), (-0.5, 0.0)])
def test_the_wheel_behind_is_chosen_since_it_stays_there(velocity):
    found = means(dead=wheels(1, 3), velocity=np.array(velocity))
    assert ROBOT.wheel_positions[found.pivot] @ np.array(velocity) < 0.0


@pytest.mark.parametrize("three", list(combinations((1, 2, 3, 4), 3)))
def test_three_dead_motors_are_braked_and_the_robot_stops(three):
    assert means(dead=wheels(*three)) == RecoveryAction(STOPPING, -1, three)


def test_two_held_wheels_or_a_held_and_two_dead_ones_stop_it_too():
    assert means(held=wheels(1, 2)).mode == STOPPING
    assert means(held=wheels(1), dead=wheels(2, 3)).mode == STOPPING


def test_a_held_wheel_does_for_the_brake_of_a_dead_one():
    assert means(held=wheels(3), dead=wheels(1)) == RecoveryAction(PIVOTING, 2, ())


@pytest.mark.parametrize("pair", list(combinations((1, 2, 3, 4), 2)))
def test_when_two_wheels_slip_the_others_can_not_hold_the_robot(pair):
    assert means(slipping=wheels(*pair)).mode == SLOWING
    assert means(slipping=~NONE).mode == SLOWING
