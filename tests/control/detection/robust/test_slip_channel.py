"""The slip channel: velocity, bristles and counters against closed forms and other integrations."""

from __future__ import annotations

import math

import numpy as np
import pytest
from other_robots import mecanum, star
from scipy.integrate import solve_ivp

from omnimj.control.detection.robust.blocks import LINE, align, alignment_delays, initial_line
from omnimj.control.detection.robust.slip import (
    CREEP_SLOPE,
    SOFT_FLOOR,
    STATE,
    STIFF_FLOOR,
    bristle_after,
    correct_velocity,
    healthy_creep_bounds,
    next_creep,
    predict_velocity,
    speed_deviation,
)
from omnimj.control.detection.robust.thresholds import Thresholds
from omnimj.control.detection.robust.wheel_monitors import (
    ALLOWED,
    GRIP,
    HEALTH,
    INITIAL_MONITORS,
    MONITORS,
    MOST,
    SLIPPING,
    _is_alone,
    update_slip_monitor,
)
from omnimj.control.robot_constants import LOAD, TIME, robot_constants, wheel_geometry
from omnimj.parameters import read_robot

ROBOT = read_robot()
C, SHAPE = robot_constants(ROBOT, 1e-3), wheel_geometry(ROBOT)


def test_a_body_that_coasts_while_it_turns_keeps_its_velocity_in_the_world():
    x, cov, turning = np.array([0.6, 0.2, 0.0, 0.0]), np.eye(STATE) * 1e-4, 0.8
    steps = 200
    for _ in range(steps):
        predict_velocity(C, x, cov, np.zeros(2), np.zeros(2), turning)
    angle = turning * steps * C[TIME]
    turn = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
    assert turn @ x[:2] == pytest.approx([0.6, 0.2], abs=0.01)


def test_rolling_wheels_bring_the_velocity_home_whatever_it_was():
    twist = np.array([0.5, -0.3, 0.2])
    speed = SHAPE.forces.T @ twist / ROBOT.wheel.radius
    x, cov = np.zeros(STATE), np.eye(STATE) * 0.05
    for _ in range(100):
        correct_velocity(C, SHAPE.forces, speed, twist[2], np.zeros((4, 2)), np.ones(4), -1, x, cov)
    assert x[:2] == pytest.approx(twist[:2], abs=2e-3)


def test_a_wheel_that_is_left_out_has_no_say():
    speed = np.array([100.0, 0.0, 0.0, 0.0])
    x, cov = np.zeros(STATE), np.eye(STATE) * 0.05
    for _ in range(50):
        correct_velocity(C, SHAPE.forces, speed, 0.0, np.zeros((4, 2)), np.ones(4), 0, x, cov)
    assert x[:2] == pytest.approx([0.0, 0.0], abs=1e-9)


def test_two_wheels_leave_the_velocity_along_one_axis_as_doubtful_as_it_was():
    x, cov = np.zeros(STATE), np.eye(STATE) * 0.05
    believed = np.array([0.0, 1.0, 0.0, 1.0])  # wheels 2 and 4 drive along x
    correct_velocity(C, SHAPE.forces, np.zeros(4), 0.0, np.zeros((4, 2)), believed, -1, x, cov)
    assert speed_deviation(cov, 1.0, 0.0) < 0.02 < speed_deviation(cov, 0.0, 1.0) == pytest.approx(0.05**0.5)


@pytest.mark.parametrize("slip", [0.3, -0.05, 1e-4])
def test_the_bristle_is_that_of_lugre(slip):
    z = solve_ivp(
        lambda _, z: slip - 44.0 * abs(slip) / 0.032 * z, (0, 0.01), [0.001], rtol=1e-10, atol=1e-14
    )
    assert bristle_after(0.001, slip, 44.0, 0.032, 0.01) == pytest.approx(z.y[0, -1], rel=1e-6)


@pytest.mark.parametrize(("stiffness", "holds"), [SOFT_FLOOR, STIFF_FLOOR])
def test_creep_of_a_floor_is_that_of_lugre_turned_round(stiffness, holds):
    """F = (σ_0 z + σ s) F_N forward by another integrator, then s back from F alone."""

    def slip(t):
        return 0.05 * math.sin(6.0 * t)

    def bristle(t, z):
        return slip(t) - stiffness * abs(slip(t)) / holds * z

    times = np.arange(0.005, 1.0, 0.01)
    z = solve_ivp(bristle, (0, 1), [0.0], t_eval=times, rtol=1e-9, atol=1e-12).y[0]
    after, found = 0.0, []
    for t, deflection in zip(times, z, strict=True):
        creep, after = next_creep(
            stiffness * deflection + CREEP_SLOPE * slip(t), after, stiffness, holds, 0.01
        )
        found.append(creep)
    assert found == pytest.approx([slip(t) for t in times], abs=0.003)


def test_bounds_of_healthy_creep_are_odd_in_force():
    for force in (2.0, 8.0, 15.0):
        up, down = np.zeros(4), np.zeros(4)
        for _ in range(50):
            least, most = healthy_creep_bounds(force / C[LOAD], up, 0.01)
            assert healthy_creep_bounds(-force / C[LOAD], down, 0.01) == pytest.approx((-most, -least))
            assert least <= most


def counted(force, slip, blocks, row=None):
    row = np.array(INITIAL_MONITORS) if row is None else row
    assert len(row) == MONITORS
    for _ in range(blocks):
        update_slip_monitor(C, C[LOAD], force, slip, 0.0, 0.0, True, row)
    return row


@pytest.mark.parametrize("holds", [0.05, 0.12])
def test_a_wheel_that_pulls_as_its_slip_says_never_slips(holds):
    for slip in (0.02, 0.05, 0.2):
        assert counted(C[LOAD] * (holds + 2.45 * slip), slip, 200)[SLIPPING] == 0.0


def test_a_wheel_that_pulls_a_third_of_it_slips_by_its_way():
    slip, blocks = 0.2, 1
    force = 0.3 * C[LOAD] * (0.12 + 2.45 * slip)
    row = counted(force, slip, blocks)
    assert 0.3 * slip * 0.01 < row[SLIPPING] < slip * 0.01
    row = counted(force, slip, 20)
    assert row[SLIPPING] == MOST and row[GRIP] == pytest.approx(0.3, abs=0.08)


def test_a_slip_is_healed_by_pulling_without_slipping_and_by_nothing_else():
    row = counted(6.0, 0.25, 20)
    assert row[HEALTH] == 0.0
    assert counted(0.5, 0.0, 50, row=row.copy())[HEALTH] == 0.0  # hardly a load: says nothing
    assert counted(6.0, 0.25, 50, row=row.copy())[HEALTH] == 0.0  # still slips
    assert counted(10.0, 0.02, 50, row=row.copy())[HEALTH] > Thresholds().healthy


def test_slip_within_what_a_healthy_wheel_may_show_is_forgotten():
    row = counted(2.0, 0.3, 10)
    assert row[SLIPPING] > 0.0
    assert counted(8.0, ALLOWED, 400, row=row)[SLIPPING] == pytest.approx(0.0, abs=1e-9)


def test_channels_are_aligned_to_the_slowest():
    waits = alignment_delays(ROBOT, 1e-3)
    assert waits[:4] == pytest.approx(5.0) and waits[4:8] == pytest.approx(
        0.0
    )  # 4 ms of filter, 1 ms of counting
    line, out = initial_line(4), np.zeros(11)
    for k in range(2 * LINE):
        align(line, waits, np.full(4, k), np.full(4, k), np.full(2, k), float(k), k == 0, out)
    assert 2 * LINE - 1 - out == pytest.approx(waits)


@pytest.mark.parametrize(
    ("layout", "believed", "alone"),
    [
        (read_robot(), (1, 1, 1, 1), False),
        (read_robot(), (1, 1, 0, 1), True),
        (read_robot(), (0, 0, 1, 0), False),
        (read_robot(), (1, 0, 0, 0), True),
        (star(3), (1, 1, 1), False),
        (star(3), (1, 1, 0), True),
        (star(6), (1, 0, 1, 0, 1, 0), False),
        (mecanum(), (1, 1, 1, 1), False),
        (mecanum(), (1, 1, 0, 1), True),
    ],
)
def test_a_wheel_is_alone_where_the_others_do_not_tell_its_velocity(layout, believed, alone):
    forces = wheel_geometry(layout).forces
    assert _is_alone(forces, np.array(believed, float), 0) == alone
