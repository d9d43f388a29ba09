"""The slip channel: velocity, bristles and monitors against closed forms and other integrations."""

from __future__ import annotations

import math

import numpy as np
import pytest
from other_robots import mecanum, star
from scipy.integrate import solve_ivp

from omnimj.control.detection.robust.blocks import LINE, Block, align, alignment_delays
from omnimj.control.detection.robust.evidence import robust_parameters
from omnimj.control.detection.robust.slip import (
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
    MOST,
    ContactSlip,
    WheelMonitors,
    _is_dead_reckoning,
    initial_monitors,
    update_slip_monitor,
)
from omnimj.control.robot_constants import CREEP_SLOPE, robot_constants
from omnimj.parameters import read_robot

ROBOT = read_robot()
PARAMETERS = robust_parameters(ROBOT, 1e-3)
PERIOD, FORCES, LOAD = PARAMETERS.period, PARAMETERS.robot.forces, PARAMETERS.robot.load
ALL, NO_AXIS, NO_CREEP = np.ones(4, bool), np.zeros(2, bool), np.zeros((4, 2))


def block(speed=(0.0,) * 4, yaw_rate=0.0):
    """A block without currents and accelerations."""
    zero = np.zeros(4)
    return Block(zero, np.array(speed, float), np.zeros(2), yaw_rate, zero, 0.0, zero, 0.01)


def test_a_body_that_coasts_while_it_turns_keeps_its_velocity_in_the_world():
    x, cov, turning = np.array([0.6, 0.2, 0.0, 0.0]), np.eye(STATE) * 1e-4, 0.8
    steps = 200
    for _ in range(steps):
        predict_velocity(PARAMETERS, block(yaw_rate=turning), NO_AXIS, x, cov)
    angle = turning * steps * PERIOD
    turn = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
    assert turn @ x[:2] == pytest.approx([0.6, 0.2], abs=0.01)


def test_an_axis_with_a_failed_accelerometer_is_predicted_without_it_and_its_variance_grows_faster():
    x, cov = np.zeros(STATE), np.eye(STATE) * 1e-6
    pushed = block()._replace(acceleration=np.array([1.0, 1.0]))
    predict_velocity(PARAMETERS, pushed, np.array([True, False]), x, cov)
    assert x[:2] == pytest.approx([0.0, PERIOD]) and cov[0, 0] > 10.0 * cov[1, 1]


def test_rolling_wheels_correct_any_velocity():
    twist = np.array([0.5, -0.3, 0.2])
    rolling = block(FORCES.T @ twist / ROBOT.wheel.radius, twist[2])
    x, cov = np.zeros(STATE), np.eye(STATE) * 0.05
    for _ in range(100):
        correct_velocity(PARAMETERS, rolling, NO_CREEP, ALL, -1, x, cov)
    assert x[:2] == pytest.approx(twist[:2], abs=2e-3)


def test_a_wheel_that_is_left_out_does_not_change_the_velocity():
    x, cov = np.zeros(STATE), np.eye(STATE) * 0.05
    for _ in range(50):
        correct_velocity(PARAMETERS, block((100.0, 0.0, 0.0, 0.0)), NO_CREEP, ALL, 0, x, cov)
    assert x[:2] == pytest.approx([0.0, 0.0], abs=1e-9)


def test_two_wheels_leave_the_velocity_along_one_axis_as_uncertain_as_it_was():
    x, cov = np.zeros(STATE), np.eye(STATE) * 0.05
    along_x = np.array([False, True, False, True])
    correct_velocity(PARAMETERS, block(), NO_CREEP, along_x, -1, x, cov)
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
            least, most = healthy_creep_bounds(force / LOAD, up, 0.01)
            assert healthy_creep_bounds(-force / LOAD, down, 0.01) == pytest.approx((-most, -least))
            assert least <= most


def counted(force, slip, blocks, before: WheelMonitors | None = None, held=0.0) -> WheelMonitors:
    """Monitors of one wheel after some equal blocks."""
    monitors = WheelMonitors(*(a.copy() for a in (initial_monitors(1) if before is None else before)))
    for _ in range(blocks):
        contact = ContactSlip(LOAD, force, slip, 0.0, 0.0, held)
        update_slip_monitor(PARAMETERS.robot.floor, PERIOD, contact, 0.0, True, monitors, 0)
    return monitors


@pytest.mark.parametrize("friction", [0.05, 0.12])
def test_a_wheel_that_pulls_as_its_traction_curve_at_its_slip_never_slips(friction):
    for slip in (0.02, 0.05, 0.2):
        assert counted(LOAD * (friction + 2.45 * slip), slip, 200).slipped[0] == 0.0


def test_a_wheel_that_pulls_a_third_of_it_slips_by_its_way():
    slip = 0.2
    force = 0.3 * LOAD * (0.12 + 2.45 * slip)
    assert 0.3 * slip * PERIOD < counted(force, slip, 1).slipped[0] < slip * PERIOD
    late = counted(force, slip, 20)
    assert late.slipped[0] == MOST and late.grip[0] == pytest.approx(0.3, abs=0.08)


def test_a_slip_ends_by_pulling_without_slipping_and_by_nothing_else():
    slipping = counted(6.0, 0.25, 20)
    assert slipping.regained[0] == 0.0
    assert counted(0.5, 0.0, 50, slipping).regained[0] == 0.0  # hardly a load: says nothing
    assert counted(6.0, 0.25, 50, slipping).regained[0] == 0.0  # still slips
    assert counted(10.0, 0.02, 50, slipping).regained[0] > Thresholds().healthy
    # a motor whose wheel stands, held by its own friction, shows no grip
    assert counted(10.0, 0.02, 50, slipping, held=10.0).regained[0] == 0.0
    assert counted(10.0, 0.02, 50, slipping, held=2.0).regained[0] > Thresholds().healthy


def test_slip_within_the_creep_of_a_healthy_wheel_is_discarded():
    slipping = counted(2.0, 0.3, 10)
    assert slipping.slipped[0] > 0.0
    assert counted(8.0, ALLOWED, 400, slipping).slipped[0] == pytest.approx(0.0, abs=1e-9)


@pytest.mark.slow
def test_channels_are_aligned_to_the_slowest():
    waits = alignment_delays(ROBOT, 1e-3)
    assert waits[:4] == pytest.approx(5.0) and waits[4:8] == pytest.approx(
        0.0
    )  # 4 ms of filter, 1 ms of counting
    line, out = np.zeros((LINE, 11)), np.zeros(11)
    for k in range(2 * LINE):
        align(line, waits, np.full(11, float(k)), k == 0, out)
    assert 2 * LINE - 1 - out == pytest.approx(waits)


@pytest.mark.parametrize(
    ("layout", "included", "alone"),
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
def test_velocity_along_a_wheel_is_dead_reckoning_where_the_others_do_not_measure_it(layout, included, alone):
    assert _is_dead_reckoning(robot_constants(layout), np.array(included, bool), 0) == alone
