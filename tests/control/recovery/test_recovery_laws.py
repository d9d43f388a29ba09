"""Pivot, time scaling, dither and position correction: laws that hold for any numbers."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from steady_driving import settled_ratio

from omnimj.control.gains import RecoveryGains
from omnimj.control.records import packed
from omnimj.control.recovery.demand import (
    PIVOT_SPEED,
    next_time_scaling,
    pivot_yaw_rate,
    place_correction,
    time_scaling_of_pivot,
    time_scaling_on_slippery_floor,
)
from omnimj.control.recovery.dither import (
    DITHER_FREQUENCY,
    PAUSE,
    PERIODS,
    PROBE_FREQUENCY,
    PROBE_SPEED,
    QUIET,
    SELF_TEST,
    Dither,
    next_self_test,
    null_space_speeds,
    probe_speed,
    update_dither,
)
from omnimj.control.recovery.force_allocation import steady_creep
from omnimj.control.robot_constants import robot_constants
from omnimj.parameters import read_floors, read_robot
from omnimj.physics.native import kernel

ROBOT = read_robot()
CONSTANTS = robot_constants(ROBOT)
FORCES = CONSTANTS.forces
GAINS = RecoveryGains()
H = 1e-3
speeds = st.floats(-1.5, 1.5)


@given(speeds, speeds, st.integers(0, 3))
def test_a_robot_that_turns_about_a_held_wheel_commands_no_rolling_of_it(v_x, v_y, wheel):
    yaw_rate = pivot_yaw_rate(CONSTANTS, wheel, 0.0, v_x, v_y)
    rolling = FORCES[:, wheel] @ np.array((v_x, v_y, yaw_rate))
    assert np.hypot(v_x, v_y) < 0.02 or abs(rolling) < 1e-12


@given(st.floats(-1e3, 1e3), st.integers(0, 3))
def test_a_robot_that_is_to_stand_is_not_turned_whatever_a_wheel_does(speed, wheel):
    assert pivot_yaw_rate(CONSTANTS, wheel, speed, 0.0, 0.0) == 0.0


@given(st.floats(0.0, 1.0), st.floats(0.0, 1.0), st.floats(0.0, 1.5), st.floats(0.05, 10.0))
def test_no_change_of_time_scaling_demands_more_than_the_floor_allows(scaling, goal, speed, allowed):
    after = next_time_scaling(scaling, H, goal, speed, allowed)
    assert min(scaling, goal) - 1e-12 <= after <= max(scaling, goal) + 1e-12
    plan = max(speed / max(scaling, 1e-3), 0.1)
    assert abs(after - scaling) * plan / H <= allowed * (1.0 + 1e-9)


@given(st.floats(0.005, 1.0), st.floats(0.0, 3.0))
def test_on_a_slippery_floor_the_scaled_plan_demands_half_the_grip_or_crawls(grip, hardest):
    scaling, allowed = time_scaling_on_slippery_floor(grip, hardest, 9.81, GAINS.grip_share)
    assert allowed == pytest.approx(0.5 * grip * 9.81)
    assert scaling**2 * hardest <= allowed * (1.0 + 1e-9) or scaling == pytest.approx(0.15)


@given(st.floats(0.05, 1.0), st.floats(0.0, 2.0))
def test_the_centre_of_a_pivoting_robot_keeps_below_its_speed(scaling, speed):
    assert (
        time_scaling_of_pivot(scaling, speed) * speed / scaling <= PIVOT_SPEED * (1.0 + 1e-9) or speed == 0.0
    )


def test_wheels_against_each_other_push_the_body_nowhere():
    n = null_space_speeds(FORCES)
    assert np.abs(n).max() == 1.0
    assert pytest.approx(np.zeros(3), abs=1e-12) == FORCES @ n
    assert not null_space_speeds(FORCES[:, :3]).any(), "three wheels have no such direction"


def dithered(steps, may, speed, acceleration):
    """Signs of the square wave under a steady demand."""
    d, signs = packed(Dither()), np.empty(steps)
    _dither(d, may, speed, acceleration, signs)
    return signs


@kernel
def _dither(d, may, speed, acceleration, signs):
    unloaded = np.zeros(4)
    for k in range(signs.size):
        signs[k] = update_dither(d[0], H, may, speed, acceleration, unloaded)


def test_the_square_wave_comes_in_bursts_of_whole_periods_while_a_robot_drives_steadily():
    steps = round((QUIET + PERIODS / DITHER_FREQUENCY + 0.9 * PAUSE) / H)
    signs = dithered(steps, True, 0.3, 0.0)
    assert not signs[: round(QUIET / H) - 2].any()
    assert abs(signs.sum()) <= 2, "as long forward as back"
    assert (signs != 0).sum() == pytest.approx(PERIODS / DITHER_FREQUENCY / H, abs=3)


@pytest.mark.parametrize(
    ("may", "speed", "acceleration"), [(False, 0.3, 0.0), (True, 0.0, 0.0), (True, 0.3, 1.0)]
)
def test_a_robot_that_is_faulty_stands_or_speeds_up_is_not_dithered(may, speed, acceleration):
    assert not dithered(8000, may, speed, acceleration).any()


def test_a_slipping_wheel_is_probed_to_and_fro_while_the_robot_drives_steadily():
    cycle = [probe_speed(k * H, 0.3, 0.0, 0.5) for k in range(round(1.0 / PROBE_FREQUENCY / H))]
    assert set(cycle) == {PROBE_SPEED, -PROBE_SPEED} and sum(cycle) == pytest.approx(0.0, abs=1e-9)
    assert probe_speed(0.0, 0.0, 0.0, 0.0) == probe_speed(0.0, 0.3, 1.0, 0.0) == 0.0
    assert probe_speed(0.0, 0.3, 0.0, -3.0) == 0.0 and probe_speed(0.0, 0.3, 0.0, 3.0) == PROBE_SPEED


def test_a_self_test_goes_as_far_as_it_comes_back_and_ends():
    left, signs = SELF_TEST, []
    for _ in range(3000):
        sign, left = next_self_test(left, H)
        signs.append(sign)
    assert abs(sum(signs)) <= 2
    assert not any(signs[-1000:])
    assert next_self_test(0.0, H) == (0.0, 0.0)


@given(st.floats(-0.5, 0.5), st.floats(-0.5, 0.5), speeds, speeds)
def test_a_place_is_driven_back_slowly_and_only_while_the_robot_is_to_move(e_x, e_y, v_x, v_y):
    law = GAINS.place_proportional, GAINS.place_speed
    back = place_correction(e_x, e_y, v_x, v_y, *law)
    assert np.hypot(*back) <= 0.2 + 1e-12
    assert back[0] * e_x >= 0.0
    assert back[1] * e_y >= 0.0
    assert place_correction(e_x, e_y, 0.0, 0.0, *law) == (0.0, 0.0)


@pytest.mark.parametrize("floor", ["natural_stone", "pvc", "paperboard"])
@pytest.mark.parametrize("slip", [-0.1, -0.03, 0.03, 0.1])
def test_the_creep_of_every_measured_floor_is_predicted_within_two_centimetres_a_second(floor, slip):
    traction = settled_ratio(read_floors()[floor].traction, slip, 0.0) * CONSTANTS.load
    assert steady_creep(CONSTANTS.load, traction) == pytest.approx(slip, abs=0.025)
