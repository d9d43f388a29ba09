"""The whole cascade: never an exception, never a current beyond the limits, zero for bad data."""

import dataclasses
import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from published_map import rotation

from omnimj.control import Controller, Reason, Target, target_at
from omnimj.control.cascade.heading import LARGEST_BIAS, is_standing
from omnimj.parameters import read_robot
from omnimj.physics.kinematics import rolling_matrix
from omnimj.signals import Measurement, Reference

ROBOT = read_robot()
LIMIT, RATE = ROBOT.control.current_limit, ROBOT.control.current_rate_limit * 1e-3
FIELDS = [("time", None), ("yaw_rate", None), ("yaw", None)]
FIELDS += [("current", i) for i in range(4)] + [("wheel_speed", i) for i in range(4)]
FIELDS += [("acceleration", i) for i in range(2)]


def measured(yaw=0.0, yaw_rate=0.0, wheel_speed=(0.0,) * 4):
    return Measurement(0.0, np.zeros(4), np.array(wheel_speed), np.zeros(2), yaw_rate, yaw)


def corrupted(measurement, name, index, value):
    old = getattr(measurement, name)
    if index is None:
        return dataclasses.replace(measurement, **{name: value})
    new = old.copy()
    new[index] = value
    return dataclasses.replace(measurement, **{name: new})


def target(x=0.0, y=0.0, yaw_rate=0.0, heading=0.0):
    return Target(np.array([x, y]), yaw_rate, heading)


def log_of(controller, state):
    return dict(zip(controller.log_names, state.log, strict=True))


def first_step(measurement, wanted, **options):
    controller = Controller(ROBOT, **options)
    command, state = controller.step(controller.start(measurement), measurement, wanted)
    return command, state, log_of(controller, state)


def test_wheel_targets_are_the_rolling_speeds_of_the_demand_in_the_body_frame():
    heading, velocity, rate = 1.2, np.array([0.4, -0.3]), 0.5
    _, _, log = first_step(
        measured(yaw=heading, yaw_rate=rate), target(velocity[0], velocity[1], rate, heading)
    )
    twist = rotation(heading).T @ np.array([*velocity, rate])
    found = [log[f"target_wheel_speed_{i}"] for i in range(1, 5)]
    rolling = rolling_matrix(ROBOT.wheel_positions, ROBOT.drive_directions) @ twist / ROBOT.wheel.radius
    # the heading has moved on by a step of the gyro when it is used
    np.testing.assert_allclose(found, rolling, atol=0.02)
    assert log["heading_estimate"] == pytest.approx(heading, abs=1e-3)


def test_yaw_loop_answers_the_gyro_and_heading_hold_the_heading():
    still = {"yaw_loop": False, "heading_hold": False}
    turning = measured(yaw_rate=0.1)
    assert first_step(turning, target(x=0.5), **still)[2]["target_yaw_rate"] == 0.0
    at_once, in_the_end = (one["target_yaw_rate"] for one in yaw_answers(turning, 1000))
    gain, lag = ROBOT.control.yaw_rate_proportional, ROBOT.control.yaw_rate_lag
    assert at_once == pytest.approx(-0.1 * gain / lag, rel=0.05)
    assert in_the_end == pytest.approx(-0.1 * gain, rel=0.001)
    hold = first_step(measured(yaw=6.2), target(heading=0.1), yaw_loop=False, heading_hold=True)[2]
    error = 0.1 - (6.2 - 2.0 * math.pi)
    assert hold["target_yaw_rate"] == pytest.approx(ROBOT.control.heading_proportional * error)


def yaw_answers(measurement, steps):
    """Logs of the first and of the last step of a robot that goes on to measure the same."""
    controller = Controller(ROBOT)
    state, logs = controller.start(measurement), []
    for _ in range(steps):
        _, state = controller.step(state, measurement, target(x=0.5))
        logs.append(log_of(controller, state))
    return logs[0], logs[-1]


def test_a_bad_measurement_leaves_the_slow_yaw_error_as_it_is_and_standstill_ends_it():
    controller = Controller(ROBOT)
    state, turning = controller.start(measured()), measured(yaw_rate=0.1)
    for _ in range(100):
        _, state = controller.step(state, turning, target(x=0.5))
    slow = state.record["slow_yaw_error"][0]
    assert slow < -0.05
    _, state = controller.step(state, corrupted(turning, "yaw_rate", None, math.nan), target(x=0.5))
    assert state.record["slow_yaw_error"][0] == slow
    _, state = controller.step(state, measured(), target())
    assert state.record["slow_yaw_error"][0] == 0.0


def test_without_heading_feedback_the_planned_heading_rotates_the_demand():
    _, _, log = first_step(measured(yaw=1.0), target(x=0.5), heading_feedback=False)
    assert (log["target_twist_x"], log["target_twist_y"]) == (0.5, 0.0)


def test_state_holds_the_command_and_the_log_its_reason():
    command, state, log = first_step(measured(), target(x=1.0))
    np.testing.assert_array_equal(state.current, command.current)
    assert [Reason(int(log[f"limit_reason_{i}"])) for i in (1, 4)] == [Reason.NONE, Reason.RATE]


def test_state_in_is_untouched_and_the_same_input_gives_the_same_output():
    controller = Controller(ROBOT)
    state = controller.start(measured())
    for _ in range(5):
        _, state = controller.step(state, measured(), target(x=0.3))
    before = [state.heading, state.gyro_bias, *(a.copy() for a in (state.integral, state.current, state.log))]
    outputs = [controller.step(state, measured(), target(x=0.3))[0].current for _ in range(2)]
    np.testing.assert_array_equal(outputs[0], outputs[1])
    now = (state.heading, state.gyro_bias, state.integral, state.current, state.log)
    for old, new in zip(before, now, strict=True):
        np.testing.assert_array_equal(old, new)


@pytest.mark.parametrize("bad", [math.nan, math.inf, -math.inf])
@pytest.mark.parametrize(("name", "index"), FIELDS)
def test_any_field_that_is_not_finite_gives_zero_current_and_the_next_good_one_recovers(name, index, bad):
    controller = Controller(ROBOT, heading_hold=True)
    state = controller.start(measured(yaw=0.3))
    for _ in range(20):
        _, state = controller.step(state, measured(yaw=0.3), target(x=0.5, heading=0.3))
    assert state.current.any()
    command, after = controller.step(state, corrupted(measured(yaw=0.3), name, index, bad), target(x=0.5))
    assert not command.current.any() and not after.integral.any()
    assert after.heading == state.heading
    assert log_of(controller, after)["limit_reason_1"] == Reason.BAD_MEASUREMENT
    command, _ = controller.step(after, measured(yaw=0.3), target(x=0.5, heading=0.3))
    assert command.current.any() and np.all(np.abs(command.current) <= RATE)


@pytest.mark.parametrize("field", ["current", "wheel_speed", "acceleration"])
@pytest.mark.parametrize("size", [0, 1, 3, 5])
def test_a_measurement_with_missing_or_surplus_values_gives_zero_current(field, size):
    command, _, _ = first_step(dataclasses.replace(measured(), **{field: np.zeros(size)}), target(x=0.5))
    assert not command.current.any()


@pytest.mark.parametrize("wanted", [target(x=math.nan), target(y=math.inf), target(yaw_rate=math.nan)])
def test_a_target_that_is_not_finite_gives_zero_current(wanted):
    command, state, log = first_step(measured(), wanted)
    assert not command.current.any() and not state.integral.any()
    assert log["limit_reason_1"] == Reason.COMMAND_NOT_FINITE


def test_start_on_a_bad_heading_is_no_error():
    assert Controller(ROBOT).start(measured(yaw=math.nan)).heading == 0.0


ANY_FLOAT = st.floats(allow_nan=True, allow_infinity=True)
CORRUPTION = st.tuples(st.sampled_from(FIELDS), ANY_FLOAT)
STEPS = st.lists(
    st.tuples(st.lists(CORRUPTION, max_size=2), st.tuples(*[ANY_FLOAT] * 4)), min_size=1, max_size=15
)


@given(STEPS, st.booleans(), st.booleans())
def test_random_corruption_never_raises_and_never_leaves_the_limits(steps, heading_hold, heading_feedback):
    controller = Controller(ROBOT, heading_hold=heading_hold, heading_feedback=heading_feedback)
    state = controller.start(measured())
    for corruptions, (x, y, yaw_rate, heading) in steps:
        measurement = measured()
        for (name, index), value in corruptions:
            measurement = corrupted(measurement, name, index, value)
        last = state.current
        command, state = controller.step(state, measurement, target(x, y, yaw_rate, heading))
        assert np.all(np.abs(command.current) <= LIMIT)
        assert np.all((np.abs(command.current - last) <= RATE + 1e-12) | (command.current == 0.0))
        assert math.isfinite(state.heading) and np.all(np.isfinite(state.integral))
        assert np.all(np.isfinite(state.gyro_bias)) and abs(state.gyro_bias.bias) <= LARGEST_BIAS
    # once the data is good again the robot drives again
    for _ in range(3):
        command, state = controller.step(state, measured(), target(x=0.5))
    assert np.all(np.isfinite(command.current)) and command.current.any()


def test_a_standing_robot_gets_no_current_and_a_pushed_one_does():
    quiet = measured(yaw_rate=0.015, wheel_speed=(0.1, -0.1, 0.05, 0.0))
    assert first_step(quiet, target())[2]["target_yaw_rate"] == 0.0
    assert first_step(measured(yaw_rate=0.03), target())[2]["target_yaw_rate"] < 0.0
    assert (
        first_step(measured(yaw_rate=0.01, wheel_speed=(0.3, 0, 0, 0)), target())[2]["target_yaw_rate"] < 0.0
    )
    away = first_step(measured(yaw=0.02), target(), heading_hold=True)[2]
    assert away["target_yaw_rate"] < 0.0


@pytest.mark.parametrize("velocity", [(1e-9, 0.0, 0.0), (0.0, -1e-9, 0.0), (0.0, 0.0, 1e-9)])
def test_a_robot_with_a_velocity_command_is_never_standing(velocity):
    assert is_standing(0.0, 0.0, 0.0, 0.0, 0.0, np.zeros(4))
    assert not is_standing(*velocity, 0.0, 0.0, np.zeros(4))


def test_targets_come_from_the_reference_and_stand_still_after_its_end():
    time = np.arange(3, dtype=float) * 1e-3
    reference = Reference(time, np.ones((3, 2)), np.full(3, 0.5), np.array([0.0, 0.1, 0.2]), np.zeros((3, 2)))
    assert target_at(reference, 1).heading == 0.1
    late = target_at(reference, 3)
    assert late.velocity.tolist() == [0.0, 0.0] and (late.yaw_rate, late.heading) == (0.0, 0.2)
