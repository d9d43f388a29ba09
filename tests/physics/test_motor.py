"""Laws of motor, amplifier and gear."""

from __future__ import annotations

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.integrate import quad

from omnimj.parameters import read_robot
from omnimj.physics import motor as m

MOTOR = read_robot().motor
currents = st.floats(-3.0, 3.0)
speeds = st.floats(-60.0, 60.0)


def _motor(**changes):
    return m.motor_parameters(MOTOR)._replace(**changes)


def test_a_driving_motor_gives_the_closed_form():
    speed = 10.0
    shaft = MOTOR.torque_constant * 1.0 - MOTOR.no_load_torque - MOTOR.viscous * MOTOR.gear_ratio * speed
    forward, _ = m.drive_torque_bounds(_motor(), 1.0, speed)
    assert forward == pytest.approx(shaft * MOTOR.gear_ratio * MOTOR.gear_efficiency, rel=1e-14)


def test_a_driven_gear_loses_the_other_way_round():
    forward, _ = m.drive_torque_bounds(_motor(viscous=0.0), -1.0, 10.0)
    shaft = -MOTOR.torque_constant - MOTOR.no_load_torque
    assert forward == pytest.approx(shaft * MOTOR.gear_ratio / MOTOR.gear_efficiency, rel=1e-14)


gains = st.floats(0.3, 2.0)


@given(currents, speeds, gains)
def test_friction_bounds_never_cross(current, speed, driven_gain):
    low, high = m.drive_torque_bounds(_motor(driven_gain=driven_gain), current, speed)
    assert low <= high


@given(currents, speeds.filter(bool), gains)
def test_a_turning_wheel_has_the_torque_of_its_motion_whatever_the_gear_loses(current, speed, driven_gain):
    motor, way = _motor(driven_gain=driven_gain), math.copysign(1.0, speed)
    shaft = MOTOR.torque_constant * current - MOTOR.viscous * MOTOR.gear_ratio * speed
    shaft -= way * MOTOR.no_load_torque
    gain = driven_gain if shaft * speed < 0.0 else MOTOR.gear_efficiency
    low, high = m.drive_torque_bounds(motor, current, speed)
    assert (low if speed > 0.0 else high) == pytest.approx(shaft * MOTOR.gear_ratio * gain, rel=1e-12)


@given(speeds)
def test_without_current_the_drive_only_brakes(speed):
    low, high = m.drive_torque_bounds(_motor(), 0.0, speed)
    assert (low if speed > 0.0 else high) * speed <= 0.0
    assert low <= 0.0 <= high or speed != 0.0


@pytest.mark.parametrize("speed", [0.0, -5.0])
def test_printed_no_load_torque_drives_a_motor_without_current(speed):
    low, high = m.motor_torque_bounds(_motor(), 0.0, speed, True)
    printed = -MOTOR.no_load_torque * MOTOR.gear_efficiency * MOTOR.gear_ratio
    assert low == high == pytest.approx(printed)


@given(currents, speeds)
def test_the_supply_is_never_exceeded(command, speed):
    current = m.achievable_current(_motor(), command, speed)
    voltage = MOTOR.resistance * current + MOTOR.torque_constant * MOTOR.gear_ratio * speed
    assert abs(voltage) <= MOTOR.supply + 1e-9
    if abs(MOTOR.torque_constant * MOTOR.gear_ratio * speed) < MOTOR.supply:
        assert abs(current) <= MOTOR.current_limit


def test_the_current_lags_by_its_time_constant():
    current = m.next_current(_motor(), 0.0, 1.0, 0.0, MOTOR.current_loop)
    assert current == pytest.approx(1.0 - math.exp(-1.0), rel=1e-14)
    half = 0.5 * MOTOR.current_loop
    twice = m.next_current(_motor(), m.next_current(_motor(), 0.0, 1.0, 0.0, half), 1.0, 0.0, half)
    assert twice == pytest.approx(current, rel=1e-14)


def test_mean_current_is_the_integral_over_the_step():
    h, motor = 2.5e-4, _motor()
    total, _ = quad(lambda t: m.next_current(motor, 0.2, 1.0, 0.0, t), 0.0, h)
    mean = m.mean_current(motor, 0.2, m.next_current(motor, 0.2, 1.0, 0.0, h), 1.0, 0.0, h)
    assert mean == pytest.approx(total / h, rel=1e-12)


def test_overrides_replace_the_command():
    assert m.achievable_current(_motor(override=m.FREE), 1.0, 0.0) == 0.0
    over = _motor(override=m.HARD_OVER, override_current=math.inf)
    assert m.achievable_current(over, -1.0, 0.0) == MOTOR.current_limit
    assert m.achievable_current(_motor(override=m.HARD_OVER, override_current=-0.5), 1.0, 0.0) == -0.5


@given(currents, st.floats(0.0, 60.0), st.floats(1e-3, 1.0))
def test_a_second_motor_never_takes_more_than_its_shaft_holds(current, speed, torque):
    own = m.winding_current(_motor(parallel_torque=torque), current, speed)
    assert abs(current - own) <= torque / MOTOR.torque_constant + 1e-12
    assert m.winding_current(_motor(), current, speed) == current


def test_a_held_second_motor_takes_half_the_current_at_rest():
    assert m.winding_current(_motor(parallel_torque=10.0), 1.0, 0.0) == pytest.approx(0.5)


bounds = st.tuples(st.floats(-5.0, 5.0), st.floats(0.0, 5.0)).map(lambda p: (p[0], p[0] + p[1]))


@given(bounds, speeds, st.floats(1e-4, 1.0), st.floats(-10.0, 10.0), st.floats(1e-5, 1e-2))
def test_set_valued_friction_comes_as_near_to_rest_as_it_can(bound, speed, inertia, other, h):
    low, high = bound
    torque = m.stick_or_slip(low, high, speed, inertia, other, h)
    assert low <= torque <= high

    def after(t):
        return speed + h * (t + other) / inertia

    scale = 1e-12 * (abs(speed) + h * (abs(torque) + abs(other)) / inertia) + 1e-300
    for alternative in (low, 0.5 * (low + high), high):
        assert abs(after(torque)) <= abs(after(alternative)) + scale
    if low < torque < high:
        assert abs(after(torque)) <= scale
