"""The gyro's bias is what it reads while the robot stands still, and nothing else is taken for it."""

from __future__ import annotations

import dataclasses
import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from nightly import representative
from sampled_sensors import sample

from omnimj.control import Controller, ControlState, Target
from omnimj.control.cascade.heading import (
    BIAS_MEMORY,
    LARGEST_BIAS,
    REST_TURN,
    SETTLING_TIME,
    GyroBias,
    update_gyro_bias,
    yaw_rate_row,
)
from omnimj.parameters import read_robot
from omnimj.physics.kinematics import rolling_matrix
from omnimj.plant.sensors import RobotSensors
from omnimj.signals import Measurement

ROBOT = read_robot()
SENSORS = ROBOT.sensors
H = 1.0 / SENSORS.sample_rate
STAY = Target(np.zeros(2), 0.0, 0.0)
DRIVE = Target(np.array([0.5, 0.0]), 0.0, 0.0)


def wheels_at(yaw_rate: float) -> np.ndarray:
    """Wheel speeds of a robot that rolls round [rad/s]."""
    rolling = rolling_matrix(ROBOT.wheel_positions, ROBOT.drive_directions)
    return rolling @ [0.0, 0.0, yaw_rate] / ROBOT.wheel.radius


def readings(seed: int, seconds: float, bias: float, yaw_rate: float = 0.0) -> list[Measurement]:
    """Readings of the robot's sensors while it turns at a constant rate."""
    spread = dataclasses.replace(SENSORS, gyro_bias=0.0)
    robot = dataclasses.replace(ROBOT, sensors=spread)
    sensors = RobotSensors(robot.sensors, robot.motor, 4, H, seed)
    turning, still = wheels_at(yaw_rate), np.zeros(4)
    found = []
    for k in range(round(seconds / H)):
        m = sample(sensors, k * H, still, turning, np.zeros(2), yaw_rate, yaw_rate * k * H)
        found.append(dataclasses.replace(m, yaw_rate=m.yaw_rate + bias))
    return found


def learnt(
    measurements: list[Measurement], state: ControlState | None = None, target: Target = STAY
) -> tuple[float, ControlState]:
    """The bias after these measurements, and the controller's state."""
    controller = Controller(ROBOT)
    state = controller.start(measurements[0]) if state is None else state
    for m in measurements:
        _, state = controller.step(state, m, target)
    assert dict(zip(controller.log_names, state.log, strict=True))["gyro_bias"] == state.gyro_bias.bias
    return state.gyro_bias.bias, state


def standard_error(seconds: float) -> float:
    """σ √((1 + d)/(1 − d)/N): white noise behind a first-order filter of decay d, averaged over N samples."""
    decay = math.exp(-2.0 * math.pi * SENSORS.gyro_bandwidth * H)
    return SENSORS.gyro_noise * math.sqrt((1.0 + decay) / (1.0 - decay) * H / seconds)


@pytest.mark.parametrize("bias", representative(-0.004, 0.0, 0.001))
def test_the_estimate_is_the_bias_within_its_standard_error(bias):
    errors = [learnt(readings(seed, 2.2, bias))[0] - bias for seed in range(12)]
    error = standard_error(2.2 - SETTLING_TIME)
    assert np.abs(errors).max() < 3.5 * error
    assert 0.5 * error < np.std(errors) < 2.0 * error


def test_nothing_is_learnt_before_the_rest_has_settled():
    before = round(SETTLING_TIME / H)
    measurements = readings(0, 1.0, 0.005)
    assert learnt(measurements[: before - 1])[0] == 0.0
    assert learnt(measurements[: before + 20])[0] != 0.0


def test_the_estimate_does_not_move_while_driving_and_rests_add_up():
    rest, drive = readings(1, 1.2, 0.003), readings(2, 1.0, 0.003, yaw_rate=0.3)
    first, state = learnt(rest)
    kept, state = learnt(drive, state, DRIVE)
    assert kept == first
    kept, state = learnt(drive, state, STAY)  # asked to stand, but still turning
    assert kept == first
    _, state = learnt(readings(3, 1.2, 0.003), state)
    assert state.gyro_bias.averaged == pytest.approx(2.0, abs=0.01)


@pytest.mark.parametrize("rate", representative(0.002, -0.018, -0.005, 0.012, keep=2))
def test_a_robot_that_is_pushed_round_slowly_is_not_taken_for_bias(rate):
    # gyro and wheel speeds are within their noise of standing: only the encoders' counts show it
    assert np.abs(wheels_at(rate)).max() < 0.1
    for seed in range(3):
        assert learnt(readings(seed, 2.0, 0.0, yaw_rate=rate))[0] == 0.0


@pytest.mark.parametrize("rate", representative(0.002, -0.018, -0.005, 0.012, keep=2))
def test_a_push_in_the_middle_of_a_rest_costs_no_more_than_the_turn_that_ends_the_rest(rate):
    dead_band = (
        SENSORS.encoder_hysteresis / ROBOT.motor.gear_ratio * yaw_rate_row(ROBOT) @ np.sign(wheels_at(1.0))
    )
    for seed in range(3):
        before, state = learnt(readings(seed, 1.0 + SETTLING_TIME, 0.001))
        after, state = learnt(readings(seed + 10, 2.0, 0.001, yaw_rate=rate), state)
        assert state.gyro_bias.averaged < 1.0 + (REST_TURN + dead_band) / abs(rate) + 0.05
        assert abs(after - before) < REST_TURN + dead_band + 1e-4  # turned in the 1 s that is averaged


def test_a_rest_interrupted_by_a_bad_measurement_starts_again():
    measurements = readings(0, 0.3, 0.005)
    first, state = learnt(measurements)
    assert first != 0.0
    bad = dataclasses.replace(measurements[-1], yaw_rate=math.nan)
    _, state = learnt([bad], state)
    kept, _ = learnt(measurements[:150], state)
    assert kept == first


def test_loop_and_heading_are_free_of_the_bias_that_was_learnt():
    controller = Controller(ROBOT, yaw_loop=True)
    quiet = Measurement(0.0, np.zeros(4), np.zeros(4), np.zeros(2), 0.004, 0.0)
    _, state = learnt([quiet] * 1000)
    assert state.gyro_bias.bias == pytest.approx(0.004, rel=1e-9)
    _, after = controller.step(state, quiet, DRIVE)
    log = dict(zip(controller.log_names, after.log, strict=True))
    assert log["target_yaw_rate"] == pytest.approx(0.0, abs=1e-9)
    for _ in range(2000):
        _, after = controller.step(after, quiet, DRIVE)
    assert abs(after.heading) < 1e-5  # with the bias it would be 0.4 mrad


READING = st.floats(-1e3, 1e3)


@given(st.lists(st.tuples(READING, st.integers(1, 400)), min_size=1, max_size=6))
def test_whatever_the_gyro_reads_at_rest_the_bias_stays_within_its_bound(stretches):
    rest, turn, still = GyroBias(), yaw_rate_row(ROBOT), np.zeros(4)
    for reading, steps in stretches:
        for _ in range(steps):
            rest = update_gyro_bias(rest, turn, True, reading, still, H)
            assert abs(rest.bias) <= LARGEST_BIAS


@pytest.mark.parametrize("faulty", [0.3, -0.06, 2.0])
def test_a_faulty_gyro_is_not_learnt_at_all(faulty):
    assert learnt(readings(0, 1.0, faulty))[0] == 0.0


def test_the_memory_is_limited():
    rest, turn, still = GyroBias(), yaw_rate_row(ROBOT), np.zeros(4)
    for reading, seconds in ((0.001, 2.0 * BIAS_MEMORY), (0.003, BIAS_MEMORY)):
        for _ in range(round(seconds / H)):
            rest = update_gyro_bias(rest, turn, True, reading, still, H)
    # after one more memory's length of another bias, 1/e of the old one is left
    assert rest.averaged == pytest.approx(BIAS_MEMORY)
    assert rest.bias == pytest.approx(0.003 - 0.002 * math.exp(-1.0), rel=1e-3)


def test_the_turn_of_the_wheels_is_the_turn_of_the_robot():
    assert yaw_rate_row(ROBOT) @ wheels_at(0.7) == pytest.approx(0.7)
    rolling = rolling_matrix(ROBOT.wheel_positions, ROBOT.drive_directions)
    assert yaw_rate_row(ROBOT) @ (rolling @ [0.3, -0.8, 0.0]) == pytest.approx(0.0, abs=1e-12)
