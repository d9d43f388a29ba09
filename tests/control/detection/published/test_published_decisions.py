"""Tables, weights and torque constant of the published method, as numbers on paper."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from published_map import published_jacobian

from omnimj.control.detection.detector import DetectorOptions
from omnimj.control.detection.published.decision import (
    PRINTED_THRESHOLDS,
    above_threshold,
    first_to_cross,
    isolate_rig_fault,
    isolate_robot_fault,
    select_thresholds,
)
from omnimj.control.detection.published.residuals import (
    interval_at_speed,
    low_pass,
    outside_interval,
    root_mean_square,
)
from omnimj.control.detection.published.weighted_kinematics import (
    LARGEST_LOSS,
    SMALLEST_SLIP_WEIGHT,
    WeightedKinematics,
    motor_weights,
    slip_weights,
    torque_constant_loss,
)
from omnimj.errors import InputError
from omnimj.parameters import read_robot
from omnimj.physics.kinematics import rolling_matrix

ROBOT = read_robot()
A = rolling_matrix(ROBOT.wheel_positions, ROBOT.drive_directions)
RADIUS = ROBOT.wheel.radius


@pytest.mark.parametrize(
    ("speed", "force", "fault"),
    [(False, False, None), (True, False, "slip"), (True, True, "motor"), (False, True, None)],
)
def test_every_row_of_table_5_1_gives_its_verdict(speed, force, fault):
    assert isolate_rig_fault(speed, force) == fault


@pytest.mark.parametrize("printed", [True, False])
@pytest.mark.parametrize(
    ("own", "other", "fault"), [(False, False, "slip"), (True, False, "motor"), (False, True, None)]
)
def test_every_row_of_table_5_2_gives_its_verdict(own, other, fault, printed):
    assert isolate_robot_fault(own, other, printed) == fault


def test_a_motor_fault_on_both_axes_has_a_row_only_when_repaired():
    assert isolate_robot_fault(True, True, printed=True) is None
    assert isolate_robot_fault(True, True, printed=False) == "motor"


def test_as_printed_a_residual_must_be_positive_to_cross():
    assert above_threshold([4.0, -4.0, 0.0, 3.9], 3.9, printed=True) == [True, False, False, False]
    assert above_threshold([4.0, -4.0, 0.0, 3.9], 3.9, printed=False) == [True, True, False, False]


def test_the_first_to_cross_keeps_its_event_until_all_are_below():
    assert first_to_cross(-1, [False, False, False, False], [0.0] * 4) == -1
    assert first_to_cross(-1, [False, True, True, False], [0.0, 4.0, -5.0, 0.0]) == 2
    assert first_to_cross(2, [True, False, False, False], [9.0, 0.0, 1.0, 0.0]) == 2
    assert first_to_cross(2, [False, False, False, False], [0.0] * 4) == -1


@pytest.mark.parametrize(("height", "loss"), [(0.0, 0.0), (2.5, 0.57), (6.5, 0.80)])
def test_eq_6_2_goes_through_the_two_levels_it_was_made_from(height, loss):
    assert torque_constant_loss(height, printed=True) == pytest.approx(loss, abs=0.01)
    assert torque_constant_loss(height, printed=False) == pytest.approx(loss, abs=0.01)


def test_eq_6_2_as_printed_takes_the_torque_constant_through_zero_at_8_34_newton():
    assert torque_constant_loss(8.33, printed=True) < 1.0 < torque_constant_loss(8.35, printed=True)


@given(st.floats(-50.0, 1e3))
def test_eq_6_2_repaired_leaves_a_torque_constant(height):
    assert 0.0 <= torque_constant_loss(height, printed=False) <= LARGEST_LOSS


def test_eq_6_3_weighs_a_faulty_motor_by_what_it_lost():
    assert motor_weights(np.array([1.0, 0.43, 1.0, 1.0])) == pytest.approx([1.0, 1.0 / 0.43, 1.0, 1.0])


def test_eq_6_4_shares_100_among_residuals_of_one_sign():
    residuals = np.array([4.0, 1.0, 2.0, 3.0])
    for printed in (True, False):
        assert slip_weights(residuals, printed) == pytest.approx([40.0, 10.0, 20.0, 30.0])
        assert slip_weights(-residuals, printed) == pytest.approx([40.0, 10.0, 20.0, 30.0])


def test_eq_6_4_as_printed_turns_negative_with_mixed_signs_and_repaired_does_not():
    residuals = np.array([4.0, -1.0, 0.0, -1.0])
    assert slip_weights(residuals, printed=True).tolist() == [200.0, -50.0, 0.0, -50.0]
    repaired = slip_weights(residuals, printed=False)
    assert repaired == pytest.approx([100.0 * 4 / 6, 100.0 / 6, SMALLEST_SLIP_WEIGHT, 100.0 / 6])


def test_without_a_fault_the_repaired_kinematics_are_those_of_rolling():
    assert WeightedKinematics(ROBOT, False).healthy.speed_per_twist == pytest.approx(A / RADIUS, abs=1e-12)


def test_without_a_fault_the_printed_kinematics_command_half_and_a_quarter():
    expected = A @ np.diag([0.5, 0.5, 0.25]) / RADIUS
    assert WeightedKinematics(ROBOT, True).healthy.speed_per_twist == pytest.approx(expected, abs=1e-12)


@given(st.lists(st.floats(0.1, 100.0), min_size=4, max_size=4))
def test_weights_move_wheel_speeds_along_pure_slip_only(weights):
    """Eqs. 3.12-3.15: any weights give the same twist, through the map that they are made for."""
    kinematics = WeightedKinematics(ROBOT, False)
    speeds = kinematics.reconfiguration(np.array(weights), kinematics.healthy).speed_per_twist * RADIUS
    forward = np.diag([0.5, 0.5, 0.25]) @ published_jacobian(0.0, 0.25)
    assert forward @ speeds == pytest.approx(np.eye(3), abs=1e-9)
    away = speeds - A
    n = np.array([1.0, -1.0, 1.0, -1.0])
    assert away - np.outer(n, n @ away / 4.0) == pytest.approx(0.0, abs=1e-9)


@pytest.mark.parametrize("weights", [[np.nan] * 4, [0.0, 1.0, 1.0, 1.0], [np.inf] * 4, [0.0] * 4])
@pytest.mark.parametrize("printed", [True, False])
def test_weights_that_make_no_kinematics_change_nothing(weights, printed):
    kinematics = WeightedKinematics(ROBOT, printed)
    assert kinematics.reconfiguration(np.array(weights), kinematics.healthy) is kinematics.healthy


def test_printed_thresholds_are_those_of_the_text():
    assert select_thresholds(DetectorOptions("printed", "printed")) is PRINTED_THRESHOLDS
    assert select_thresholds(DetectorOptions("repaired", "printed")) is PRINTED_THRESHOLDS
    numbers = (
        PRINTED_THRESHOLDS.rig_wheel_speed,
        PRINTED_THRESHOLDS.rig_force,
        PRINTED_THRESHOLDS.wheel_speed,
        PRINTED_THRESHOLDS.force,
    )
    assert numbers == (2.07, 1.32, 3.9, 3.5)


def test_a_file_without_the_variant_is_refused(tmp_path):
    path = tmp_path / "thresholds.toml"
    path.write_text("[other]\n")
    with pytest.raises(InputError, match=r"\[repaired\] is missing"):
        select_thresholds(DetectorOptions(), path)


@given(st.floats(-5.0, 5.0), st.floats(-5.0, 0.0), st.floats(0.0, 5.0))
def test_what_lies_inside_an_interval_leaves_no_residual(value, low, high):
    found = outside_interval(value, low, high)
    assert found == pytest.approx(value - min(max(value, low), high))


def test_direction_decides_friction_and_rest_leaves_it_open():
    assert interval_at_speed(1.0, 2.0, 3.0) == (1.0, 1.0)
    assert interval_at_speed(1.0, 2.0, -3.0) == (2.0, 2.0)
    assert interval_at_speed(1.0, 2.0, 0.1) == (1.0, 2.0)


def test_the_lag_is_first_order_and_none_at_zero():
    assert low_pass(0.0, 1.0, 0.015, 0.015) == pytest.approx(1.0 - np.exp(-1.0))
    assert low_pass(0.0, 1.0, 0.001, 0.0) == 1.0


def test_the_rms_of_no_samples_is_zero():
    assert root_mean_square(0.0, 0.0) == 0.0
    assert root_mean_square(8.0, 2.0) == 2.0
