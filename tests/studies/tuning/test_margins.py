"""Margins in closed form against the discretised loop, the file's own figures, and a robot that swings."""

from __future__ import annotations

import dataclasses
import math

import numpy as np
import pytest
from other_robots import STRAIGHT, mecanum, write_mecanum_of_the_guide
from scipy.signal import cont2discrete

from omnimj.control.cascade.controller import Controller
from omnimj.errors import InputError
from omnimj.parameters import Control, Robot, read_floors, read_robot
from omnimj.plant.planar import PlanarRobot
from omnimj.signals import Reference
from omnimj.simulate.driving import drive
from omnimj.studies.tuning.margins import (
    AIR,
    FLOORS,
    HEADING,
    SPEED,
    YAW_RATE,
    Margin,
    margins,
    overshoots,
    smallest_margin,
)

ROBOT, ALL = read_robot(), read_floors()
MEASURED = [ALL[name] for name in FLOORS]
H = 1e-3


def of(robot: Robot, **gains: float) -> tuple[Margin, ...]:
    return margins(robot, dataclasses.replace(robot.control, **gains), MEASURED)


def sampled_wheel(floor: str | None, mobility: float) -> tuple[np.ndarray, np.ndarray]:
    """One wheel's current, speed, angle, bristle and body's speed, sampled exactly: x⁺ = A x + B i."""
    motor, wheel = ROBOT.motor, ROBOT.wheel
    inertia = wheel.inertia + motor.reflected_inertia
    torque = motor.torque_constant * motor.gear_ratio * motor.gear_efficiency
    friction = motor.viscous * motor.gear_ratio**2 * motor.gear_efficiency
    load = 0.0 if floor is None else ROBOT.body.mass * 9.81 / 4.0
    numbers = MEASURED[0].numbers if floor is None else ALL[floor].numbers
    stiff, damped = load * numbers["sigma_0"], load * (numbers["sigma_1"] + numbers["sigma_2"])
    r = wheel.radius
    force = np.array([0.0, damped * r, 0.0, stiff, -damped])
    a = np.zeros((5, 5))
    a[0, 0] = -1.0 / motor.current_loop
    a[1] = (np.array([torque, -friction, 0.0, 0.0, 0.0]) - r * force) / inertia
    a[2, 1] = 1.0
    a[3, [1, 4]] = r, -1.0
    a[4] = mobility * force
    b = np.array([[1.0 / motor.current_loop], [0.0], [0.0], [0.0], [0.0]])
    return cont2discrete((a, b, np.eye(5), np.zeros((5, 1))), H)[:2]  # type: ignore[index]


def sampled_loop(control: Control, floor: str | None, mobility: float, z: np.ndarray) -> np.ndarray:
    """L(z) of one wheel by exact sampling of its state space, and of the laws as the kernels step them."""
    sampled_a, sampled_b = sampled_wheel(floor, mobility)
    angle = np.array([np.linalg.solve(one * np.eye(5) - sampled_a, sampled_b)[2, 0] for one in z])
    decay = math.exp(-H / ROBOT.sensors.speed_filter)
    sensed = (1.0 - 1.0 / z) / H * (1.0 - decay) / (1.0 - decay / z)
    return (control.speed_proportional + control.speed_integral * H / (z - 1.0)) * angle * sensed


@pytest.mark.parametrize("floor", [None, *FLOORS])
@pytest.mark.parametrize("gains", [(0.3, 3.0), (0.6, 1.0), (0.15, 6.0)])
def test_wheel_loops_have_the_crossover_and_the_margin_of_the_exactly_sampled_loop(floor, gains, measured):
    control = dataclasses.replace(ROBOT.control, speed_proportional=gains[0], speed_integral=gains[1])
    found = [
        m
        for m in margins(ROBOT, control, MEASURED)
        if m.loop == SPEED and m.where.startswith(floor or AIR) and m.crossover > 0.0
    ]
    assert found
    for one in found:
        mobility = mobility_of(one.where)
        z = np.exp(np.array([2j * np.pi * one.crossover * H]))
        loop = complex(sampled_loop(control, floor, mobility, z)[0])
        measured("loop gain at the closed form's crossover, off 1", abs(abs(loop) - 1.0), 0.01)
        assert abs(loop) == pytest.approx(1.0, abs=0.01)
        phase = math.degrees(np.angle(-loop))
        measured("phase margin, closed form less sampled [°]", abs(phase - one.phase), 1.0)
        assert phase == pytest.approx(one.phase, abs=1.0)


def mobility_of(where: str) -> float:
    """Of the modes of four wheels at right angles: along, in yaw, against each other [1/kg]."""
    m, a = ROBOT.body, 0.25
    mass = where.rpartition(", ")[2].removesuffix(" kg per wheel")
    return {"7.92": 2.0 / m.mass, "2.2": 4.0 * a * a / m.yaw_inertia}.get(mass, 0.0)


@pytest.mark.parametrize("gains", [(0.3, 3.0), (0.6, 1.0), (0.25, 6.5)])
def test_a_step_overshoots_as_much_as_the_exactly_sampled_loop_does(gains, measured):
    control = dataclasses.replace(ROBOT.control, speed_proportional=gains[0], speed_integral=gains[1])
    found = overshoots(ROBOT, control, MEASURED)
    assert len(found) == 2 * len(FLOORS)
    for where, overshoot in found.items():
        a, b = sampled_wheel(where.partition(",")[0], mobility_of(where))
        decay = math.exp(-H / ROBOT.sensors.speed_filter)
        x, last, seen, integral, speeds = np.zeros(5), 0.0, 0.0, 0.0, []
        for _ in range(1000):
            seen = decay * seen + (1.0 - decay) * (x[2] - last) / H
            last, error = x[2], 1.0 - seen
            x = a @ x + b[:, 0] * (gains[0] * error + integral)
            integral += gains[1] * H * error
            speeds.append(x[1])
        off = abs(max(speeds) - 1.0 - overshoot)
        measured("overshoot of a step, closed form less sampled", off, 0.01)
        assert off < 0.01, where


@pytest.mark.parametrize("gain", [0.3, 0.6, 1.0, 1.6])
def test_a_wheel_loop_has_margin_left_where_its_exactly_sampled_loop_is_stable_and_only_there(gain):
    """Also where the loop leads at its crossover, as wheels that push against each other do."""
    control = dataclasses.replace(ROBOT.control, speed_proportional=gain)
    for one in margins(ROBOT, control, MEASURED):
        if one.loop != SPEED:
            continue
        floor = None if one.where == AIR else one.where.partition(",")[0]
        a, b = sampled_wheel(floor, mobility_of(one.where))
        decay = math.exp(-H / ROBOT.sensors.speed_filter)
        # x, then the angle before, the filtered speed and the integral: x⁺ = A x + B (K_P (−seen) + integral)
        whole = np.zeros((8, 8))
        seen = np.zeros(8)
        seen[[2, 5, 6]] = (1.0 - decay) / H, -(1.0 - decay) / H, decay
        whole[:5, :5], whole[:5, 7] = a, b[:, 0]
        whole[:5] -= gain * np.outer(b[:, 0], seen)
        whole[5, 2], whole[6], whole[7, 7] = 1.0, seen, 1.0
        whole[7] -= control.speed_integral * H * seen
        # the angle itself may run away, as may a bristle that nothing pulls back: neither is the loop's
        poles = np.abs(np.linalg.eigvals(whole))
        assert (one.phase > 0.0) == bool((poles < 1.0 + 1e-6).all()), (one, poles.max())


@pytest.mark.parametrize("angle", [0.25 * math.pi, 0.35 * math.pi, STRAIGHT])
def test_wheels_that_push_the_body_more_have_the_loops_of_a_body_that_weighs_less(angle):
    """A mecanum wheel pushes across its rollers: along y by cot γ of what it does along x."""
    robot = mecanum(0.2, 0.2, angle)
    m, j = robot.body.mass, robot.body.yaw_inertia
    x, y = 4.0 / m, 4.0 / (math.tan(angle) ** 2 * m)
    arm = 0.2 + 0.2 / math.tan(angle)
    wanted = sorted({round(p, 9) for p in (x, y, 4.0 * arm * arm / j)})
    masses = {
        float(one.where.rpartition(", ")[2].split()[0])
        for one in margins(robot, robot.control, MEASURED[:1])
        if one.loop == SPEED and one.where.endswith("kg per wheel")
    }
    assert sorted(1.0 / w for w in masses) == pytest.approx([w for w in wanted if w > 1e-9], rel=0.01)


def test_the_mecanum_platform_of_the_guide_lacks_margin_with_the_omni_robots_yaw_gain(tmp_path):
    found = {
        gain: smallest_margin(
            margins(
                robot := read_robot(write_mecanum_of_the_guide(tmp_path / "m.toml", gain)),
                robot.control,
                MEASURED,
            ),
            YAW_RATE,
        ).phase
        for gain in (3.0, 6.0)
    }
    assert found[6.0] < 40.0 < found[3.0]


def test_the_shipped_robot_has_the_figures_that_its_file_states():
    found = margins(ROBOT, ROBOT.control, MEASURED)
    (air,) = (m for m in found if m.where == AIR)
    assert air.crossover == pytest.approx(28.0, abs=1.0) and air.phase == pytest.approx(43.0, abs=1.0)
    turning = [m for m in found if m.loop == YAW_RATE]
    assert min(m.crossover for m in turning) > 7.5 and max(m.crossover for m in turning) < 8.5
    assert all(m.phase >= 61.0 for m in turning)
    rolling = [m for m in found if m.loop == SPEED and m.where != AIR and "each other" not in m.where]
    assert len(rolling) == 2 * len(FLOORS) and all(m.phase >= 52.0 for m in rolling)
    assert all(1.5 < m.crossover < 6.3 for m in rolling)
    heading = [m for m in found if m.loop == HEADING]
    assert all(m.crossover == pytest.approx(4.4 / (2.0 * np.pi), rel=0.02) for m in heading)


@pytest.mark.slow
def test_a_robot_whose_yaw_loop_has_no_margin_left_swings_and_one_with_half_of_that_gain_does_not():
    critical = 7.0
    while smallest_margin(of(ROBOT, yaw_rate_proportional=critical), YAW_RATE).phase > 0.0:
        critical *= 1.02
    assert 14.0 < critical < 140.0
    swing = {share: turning(share * critical) for share in (0.5, 1.5)}
    assert swing[1.5] > 5.0 * swing[0.5], (critical, swing)


def turning(gain: float) -> float:
    """RMS yaw rate of a robot that is to drive straight, sensors without noise but with their filters."""
    quiet = dataclasses.replace(
        ROBOT.sensors, encoder_noise=0.0, current_noise=0.0, accelerometer_noise=0.0, gyro_bias=0.0
    )
    control = dataclasses.replace(ROBOT.control, yaw_rate_proportional=gain)
    robot = dataclasses.replace(ROBOT, sensors=quiet, control=control)
    rows = 1200
    time = H * np.arange(rows, dtype=np.float64)
    speed = np.minimum(time * 1.0, 0.4)
    velocity = np.column_stack((speed, np.zeros(rows)))
    position = np.column_stack((np.cumsum(speed) * H, np.zeros(rows)))
    reference = Reference(time, velocity, np.zeros(rows), np.zeros(rows), position)
    plant = PlanarRobot(robot, "pvc")
    trace = drive(plant, Controller(robot), reference)
    return float(np.sqrt(np.mean(np.square(trace["yaw_rate"][600:]))))


def test_a_loop_that_never_reaches_one_has_no_crossover_and_all_the_margin_there_is():
    weak = smallest_margin(of(ROBOT, yaw_rate_proportional=0.5), YAW_RATE)
    assert (weak.crossover, weak.phase) == (0.0, 180.0)
    off = of(ROBOT, yaw_rate_proportional=0.0, heading_proportional=0.0)
    assert {m.loop for m in off} == {SPEED}


def test_margins_are_those_of_any_number_of_wheels():
    robot = dataclasses.replace(ROBOT, wheels=ROBOT.wheels[:3])
    found = margins(robot, robot.control, MEASURED)
    assert {m.loop for m in found} == {SPEED, YAW_RATE, HEADING}
    assert all(math.isfinite(m.phase) for m in found)


def test_a_floor_without_a_bristle_of_its_own_is_refused():
    with pytest.raises(
        InputError, match=r"floor ice: found law 'magic_formula'; margins need the law 'lugre'"
    ):
        margins(ROBOT, ROBOT.control, [ALL["ice"]])
