"""The slip channel: velocity, bristles and counters against closed forms and other integrations."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from omnimj.control.robust.blocks import LINE, align, delays, no_line
from omnimj.control.robust.constants import LOAD, TIME, geometry, numbers
from omnimj.control.robust.counters import (
    ALLOWED,
    COUNTERS,
    GRIP,
    NO_COUNTS,
    ROLLING,
    SLIPPING,
    count_slip,
)
from omnimj.control.robust.slip import (
    HOLDS,
    SLOPE,
    STATE,
    correct,
    creep,
    next_bristle,
    predict,
    spread_of,
)
from omnimj.parameters import read_robot

ROBOT = read_robot()
C, SHAPE = numbers(ROBOT, 1e-3), geometry(ROBOT)


def test_a_body_that_coasts_while_it_turns_keeps_its_velocity_in_the_world():
    x, cov, turning = np.array([0.6, 0.2, 0.0, 0.0]), np.eye(STATE) * 1e-4, 0.8
    steps = 200
    for _ in range(steps):
        predict(C, x, cov, np.zeros(2), turning)
    angle = turning * steps * C[TIME]
    turn = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
    assert turn @ x[:2] == pytest.approx([0.6, 0.2], abs=0.01)


def test_rolling_wheels_bring_the_velocity_home_whatever_it_was():
    twist = np.array([0.5, -0.3, 0.2])
    speed = SHAPE.forces.T @ twist / ROBOT.wheel.radius
    x, cov, zero = np.zeros(STATE), np.eye(STATE) * 0.05, np.zeros(4)
    for _ in range(100):
        correct(C, SHAPE.forces, speed, twist[2], zero, np.ones(4), -1, x, cov)
    assert x[:2] == pytest.approx(twist[:2], abs=2e-3)


def test_a_wheel_that_is_left_out_has_no_say():
    speed = np.array([100.0, 0.0, 0.0, 0.0])
    x, cov = np.zeros(STATE), np.eye(STATE) * 0.05
    for _ in range(50):
        correct(C, SHAPE.forces, speed, 0.0, np.zeros(4), np.ones(4), 0, x, cov)
    assert x[:2] == pytest.approx([0.0, 0.0], abs=1e-9)


def test_two_wheels_leave_the_velocity_along_one_axis_as_doubtful_as_it_was():
    x, cov = np.zeros(STATE), np.eye(STATE) * 0.05
    believed = np.array([0.0, 1.0, 0.0, 1.0])  # wheels 2 and 4 drive along x
    correct(C, SHAPE.forces, np.zeros(4), 0.0, np.zeros(4), believed, -1, x, cov)
    assert spread_of(cov, 1.0, 0.0) < 0.02 < spread_of(cov, 0.0, 1.0) == pytest.approx(0.05**0.5)


@pytest.mark.parametrize("slip", [0.3, -0.05, 1e-4])
def test_the_bristle_is_that_of_lugre(slip):
    z = solve_ivp(
        lambda _, z: slip - 44.0 * abs(slip) / 0.032 * z, (0, 0.01), [0.001], rtol=1e-10, atol=1e-14
    )
    assert next_bristle(0.001, slip, 44.0, 0.032, 0.01) == pytest.approx(z.y[0, -1], rel=1e-6)


def test_creep_is_odd_and_undone_by_its_slope():
    for slip in (0.02, 0.1):
        force = C[LOAD] * (HOLDS + SLOPE * slip)
        assert creep(C, force) == pytest.approx(slip) and creep(C, -force) == pytest.approx(-slip)
    assert creep(C, 0.9 * HOLDS * C[LOAD]) == 0.0


def counted(force, slip, blocks, scale=1.0, row=None):
    row = np.array(NO_COUNTS) if row is None else row
    assert len(row) == COUNTERS
    for _ in range(blocks):
        count_slip(C, force, slip, 0.0, 0.0, scale, True, row)
    return row


def test_a_wheel_that_pulls_as_its_slip_says_never_slips():
    for slip in (0.02, 0.05, 0.2):
        force = C[LOAD] * (0.12 + 2.45 * slip)
        assert counted(force, slip, 200)[SLIPPING] == 0.0


def test_a_wheel_that_pulls_a_third_of_it_slips_by_its_way():
    slip = 0.2
    force = 0.3 * C[LOAD] * (0.12 + 2.45 * slip)
    row = counted(force, slip, 20)
    assert 0.5 * slip * 0.2 < row[SLIPPING] < slip * 0.2
    assert row[GRIP] == pytest.approx(0.3, abs=0.08)


def test_a_slip_is_healed_by_pulling_without_slipping_and_by_nothing_else():
    row = counted(6.0, 0.25, 20)
    assert row[ROLLING] == 0.0
    assert counted(0.5, 0.0, 50, row=row.copy())[ROLLING] == 0.0  # hardly a load: says nothing
    assert counted(10.0, 0.02, 50, row=row.copy())[ROLLING] >= 25.0


def test_slip_within_what_a_healthy_wheel_may_show_is_forgotten():
    row = counted(2.0, 0.3, 10)
    assert row[SLIPPING] > 0.0
    assert counted(8.0, ALLOWED, 400, row=row)[SLIPPING] == 0.0


def test_channels_are_aligned_to_the_slowest():
    waits = delays(ROBOT, 1e-3)
    assert waits[:4] == pytest.approx(5.0) and waits[4:8] == pytest.approx(
        0.0
    )  # 4 ms of filter, 1 ms of counting
    line, out = no_line(4), np.zeros(11)
    for k in range(2 * LINE):
        align(line, waits, np.full(4, k), np.full(4, k), np.full(2, k), float(k), k == 0, out)
    assert 2 * LINE - 1 - out == pytest.approx(waits)
