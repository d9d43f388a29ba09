"""Stability of the yaw-rate loop of robots with drawn structure, from the eigenvalues of the sampled loop.

The closed form of `studies.tuning.margins` knows neither late sensors nor gears that brake more than they
drive. Here every state of the loop in yaw is stepped: x⁺ = M x, stable where all eigenvalues lie within 1.
"""

from __future__ import annotations

import dataclasses
import math

import numpy as np
import pytest
from scipy.signal import cont2discrete

from omnimj.parameters import Control, Floor, Robot, read_floors, read_robot
from omnimj.studies.random_structure import DELAYS, RandomStructure, draw_structure
from omnimj.studies.tuning.margins import FLOORS, YAW_RATE, margins, smallest_margin

ROBOT, ALL = read_robot(), read_floors()
H, ARM, KEPT = 1e-3, 0.25, 5
CURRENT, SPEED, ANGLE, BRISTLE, BODY = range(5)
SEEN, FILTERED, GYRO, SLOW, INTEGRAL = 5, 6, 7, 8, 9
SPEEDS, RATES = 10, 10 + KEPT  # readings of the last samples, the newest first
SIZE = 10 + 2 * KEPT
STRUCTURES = [draw_structure(np.random.default_rng(seed), ROBOT) for seed in range(60)]
DRIVING, BRAKING = False, True


def sampled_body(robot: Robot, floor: Floor, gear: float) -> tuple[np.ndarray, np.ndarray]:
    """Motor, wheel and body in yaw, about rest, all four wheels alike; `gear`: wheel over motor torque."""
    motor, wheel = robot.motor, robot.wheel
    inertia, load = wheel.inertia + motor.reflected_inertia, robot.body.mass * 9.81 / 4.0
    stiff, damped = (
        load * floor.numbers["sigma_0"],
        load * (floor.numbers["sigma_1"] + floor.numbers["sigma_2"]),
    )
    force = np.array([0.0, damped * wheel.radius, 0.0, stiff, -damped])
    a, b = np.zeros((5, 5)), np.zeros((5, 1))
    a[CURRENT, CURRENT], b[CURRENT, 0] = -1.0 / motor.current_loop, 1.0 / motor.current_loop
    a[SPEED] = -wheel.radius * force / inertia
    a[SPEED, CURRENT] += motor.torque_constant * gear / inertia
    a[ANGLE, SPEED] = 1.0
    a[BRISTLE, [SPEED, BODY]] = wheel.radius, -1.0
    a[BODY] = 4.0 * ARM**2 / robot.body.yaw_inertia * force
    return cont2discrete((a, b, np.eye(5), np.zeros((5, 1))), H)[:2]  # type: ignore[index]


def late(size: int, first: int, delay: float) -> np.ndarray:
    """Row that reads a kept signal `delay` samples late, interpolated between samples."""
    row, whole = np.zeros(size), int(delay)
    row[[first + whole, first + whole + 1]] = 1.0 - (delay - whole), delay - whole
    return row


def closed_loop(robot: Robot, control: Control, floor: Floor, gear: float, delays: tuple[float, float]):
    """M of the whole loop, as sensors and kernels step it; delays of wheel speeds and gyro [s]."""
    a, b = sampled_body(robot, floor, gear)
    sensors = robot.sensors
    speed_decay = math.exp(-H / sensors.speed_filter)
    gyro_decay = math.exp(-2.0 * math.pi * sensors.gyro_bandwidth * H)
    eye, m = np.eye(SIZE), np.zeros((SIZE, SIZE))
    # what the sensors read of the state, then the laws of the controller on it
    m[FILTERED] = speed_decay * eye[FILTERED] + (1.0 - speed_decay) / H * (eye[ANGLE] - eye[SEEN])
    m[GYRO] = gyro_decay * eye[GYRO] + (1.0 - gyro_decay) / ARM * eye[BODY]
    m[SEEN] = eye[ANGLE]
    for first, newest in ((SPEEDS, FILTERED), (RATES, GYRO)):
        m[first] = m[newest]
        m[first + 1 : first + KEPT] = eye[first : first + KEPT - 1]
    read = [late(SIZE, first, delay / H) @ m for first, delay in zip((SPEEDS, RATES), delays, strict=True)]
    ratio = control.yaw_rate_lag
    decay = math.exp(-2.0 * math.pi * control.yaw_rate_corner / ratio * H)
    m[SLOW] = decay * eye[SLOW] - (1.0 - decay) * read[1]
    answered = -read[1] / ratio + (1.0 - 1.0 / ratio) * m[SLOW]
    error = ARM / robot.wheel.radius * control.yaw_rate_proportional * answered - read[0]
    m[INTEGRAL] = eye[INTEGRAL] + control.speed_integral * H * error
    command = control.speed_proportional * error + eye[INTEGRAL]
    m[:5, :5] += a
    m[:5] += np.outer(b[:, 0], command)
    return m


def is_stable(m: np.ndarray) -> bool:
    """Angle and bristle of a robot that has turned away stay where they are: eigenvalues of 1."""
    return bool((np.abs(np.linalg.eigvals(m)) < 1.0 + 1e-6).all())


def drawn_loop(structure: RandomStructure, floor: str, braking: bool, gain: float, **control: float):
    """M of a robot with drawn structure; `gain` multiplies that of the loop."""
    factors, sensors = structure.factors, ROBOT.sensors
    sensors = dataclasses.replace(
        sensors,
        gyro_bandwidth=sensors.gyro_bandwidth * factors["sensors.gyro_bandwidth"],
        speed_filter=sensors.speed_filter * factors["sensors.speed_filter"],
    )
    share = ROBOT.motor.gear_efficiency * factors["motor.gear_efficiency"]
    gear = ROBOT.motor.gear_ratio * (1.0 / structure.back_driving_efficiency if braking else share)
    gains = dataclasses.replace(ROBOT.control, **control)
    gains = dataclasses.replace(gains, yaw_rate_proportional=gain * gains.yaw_rate_proportional)
    delays = structure.delays["wheel_speed"], structure.delays["yaw_rate"]
    return closed_loop(dataclasses.replace(ROBOT, sensors=sensors), gains, ALL[floor], gear, delays)


def worst_structure() -> RandomStructure:
    """Every bound of the draw at once that makes the loop less stable."""
    factors = dict(STRUCTURES[0].factors)
    factors |= {"sensors.gyro_bandwidth": 0.5, "sensors.speed_filter": 2.0, "motor.gear_efficiency": 1.1}
    late_by = {kind: most for kind, (most, _) in DELAYS.items()}
    return dataclasses.replace(STRUCTURES[0], factors=factors, delays=late_by, back_driving_efficiency=0.4)


@pytest.mark.parametrize("floor", FLOORS)
def test_yaw_loop_loses_its_stability_at_the_gain_at_which_its_closed_form_loses_its_margin(floor):
    """Two routes to the critical gain of the nominal robot: eigenvalues and frequency response."""
    gear = ROBOT.motor.gear_ratio * ROBOT.motor.gear_efficiency

    def stable(gain: float) -> bool:
        control = dataclasses.replace(ROBOT.control, yaw_rate_proportional=gain)
        return is_stable(closed_loop(ROBOT, control, ALL[floor], gear, (0.0, 0.0)))

    def has_margin(gain: float) -> bool:
        control = dataclasses.replace(ROBOT.control, yaw_rate_proportional=gain)
        return smallest_margin(margins(ROBOT, control, [ALL[floor]]), YAW_RATE).phase > 0.0

    found = [critical(one) for one in (stable, has_margin)]
    assert found[0] == pytest.approx(found[1], rel=0.03)
    assert found[0] > 10.0 * ROBOT.control.yaw_rate_proportional


def critical(stable) -> float:
    low, high = 1.0, 1000.0
    while high > 1.005 * low:
        middle = math.sqrt(low * high)
        low, high = (middle, high) if stable(middle) else (low, middle)
    return low


@pytest.mark.parametrize("floor", FLOORS)
@pytest.mark.parametrize("braking", [DRIVING, BRAKING])
def test_yaw_loop_of_every_drawn_structure_stands_twice_its_gain_and_that_of_the_worst_its_own(
    floor, braking
):
    for structure in STRUCTURES:
        assert is_stable(drawn_loop(structure, floor, braking, 2.0)), structure
    assert is_stable(drawn_loop(worst_structure(), floor, braking, 1.05))


@pytest.mark.parametrize("floor", FLOORS)
def test_the_same_gain_for_fast_errors_makes_a_seventh_of_braking_robots_unstable(floor):
    """What the lag is for: the loop with a gain of 6 at all frequencies."""
    stiff = {"yaw_rate_proportional": 6.0, "yaw_rate_lag": 1.0}
    lost = [not is_stable(drawn_loop(one, floor, BRAKING, 1.0, **stiff)) for one in STRUCTURES]
    assert np.mean(lost) > 1.0 / 7.0
