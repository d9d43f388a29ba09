"""The wheel-speed loop on a quarter of the robot: LuGre traction, motor, filtered and noisy measurement."""

import math

import numba
import numpy as np
import pytest

from omnimj.control.cascade.limits import current_limits, limited_current
from omnimj.control.cascade.wheel_speed import amplifier_parameters, speed_gains, speed_loop
from omnimj.parameters import read_floors, read_robot
from omnimj.physics.motor import drive_torque_bounds, motor_parameters, next_current, stick_or_slip
from omnimj.physics.traction import exact_step, force_ratio, relaxation_rate

ROBOT, FLOORS = read_robot(), read_floors()
H, SUBSTEPS, NOISE = 1e-3, 5, 0.05
INERTIA = ROBOT.wheel.inertia + ROBOT.motor.reflected_inertia
MASS = ROBOT.body.mass / 4.0
FLOOR_NAMES = ("natural_stone", "pvc", "paperboard")


@numba.njit
def quarter(floor, motor, row, amplifier, limits, target, noise, mass, inertia, radius):
    out, h = np.empty((target.size, 2)), H / SUBSTEPS
    w = v = z = i = q = measured = command = 0.0
    for k in range(target.size):
        seen = np.round((measured + noise[k]) / 0.0202) * 0.0202  # 12 bits over ±838 rad/s before the gear
        wanted, q = speed_loop(row, amplifier, target[k], seen, q)
        command, _ = limited_current(limits, wanted, command, seen)
        for _ in range(SUBSTEPS):
            i = next_current(motor, i, command, w, h)
            slip = radius * w - v
            rate = relaxation_rate(floor, slip, max(abs(radius * w), abs(v)))
            f = force_ratio(floor, z, slip, rate) * 9.81 * mass
            z = exact_step(z, slip, rate, h)
            low, high = drive_torque_bounds(motor, i, w)
            low, high = min(low, high), max(low, high)
            torque = stick_or_slip(low, high, w, inertia, -radius * f, h)
            w += h / inertia * (torque - radius * f)
            v += h * f / mass
            measured += (w - measured) * (1.0 - math.exp(-h / 4e-3))
        out[k] = w, command
    return out


def run(floor, target, noise=NOISE):
    drawn = np.random.default_rng(1).normal(0.0, 1.0, target.size) * noise
    laws = speed_gains(ROBOT, H), amplifier_parameters(ROBOT), current_limits(ROBOT.control, H)
    wheel = MASS, INERTIA, ROBOT.wheel.radius
    return quarter(FLOORS[floor].traction, motor_parameters(ROBOT.motor), *laws, target, drawn, *wheel).T


TIME = np.arange(4000) * H


@pytest.mark.slow
@pytest.mark.parametrize("floor", FLOOR_NAMES)
def test_step_overshoots_little_and_arrives_in_time(floor):
    speed, _ = run(floor, np.where(TIME > 0.1, 2.0, 0.0), noise=0.0)
    assert speed.max() < 2.0 * 1.2
    assert speed[np.searchsorted(TIME, 0.25) :].min() > 0.9 * 2.0
    assert np.abs(speed[3000:] - 2.0).max() < 0.02


@pytest.mark.slow
@pytest.mark.parametrize("floor", FLOOR_NAMES)
def test_ramp_of_one_metre_per_second_squared_is_followed(floor):
    target = 20.0 * np.clip(np.minimum(TIME - 0.1, 3.0 - TIME), 0.0, 1.0)
    speed, _ = run(floor, target)
    assert np.abs(speed - target).max() < 1.0
    assert np.sqrt(np.mean((speed - target) ** 2)) < 0.25
    assert np.abs(speed[3700:]).max() < 0.05


@pytest.mark.parametrize("floor", FLOOR_NAMES)
def test_noise_moves_neither_the_resting_wheel_nor_the_command_much(floor):
    speed, command = run(floor, np.zeros(4000))
    assert np.abs(speed).max() < 1e-3
    assert command.std() < 0.05


@pytest.mark.parametrize("floor", FLOOR_NAMES)
def test_noise_at_cruise_stays_below_fifty_milliampere(floor):
    quiet, noisy = (run(floor, np.full(4000, 15.0), noise)[1][2000:] for noise in (0.0, NOISE))
    assert (noisy - quiet).std() < 0.05


def test_a_wheel_without_grip_does_not_oscillate():
    speed, _ = run("oil", np.where(TIME > 0.1, 2.0, 0.0), noise=0.0)
    assert speed.max() < 2.0 * 1.25
    # one step of the speed monitor is 0.02 rad/s
    assert np.abs(speed[2000:] - 2.0).max() < 0.03


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_integral_rests_while_the_amplifier_is_at_its_limit_and_leaves_it_at_once(sign):
    row, amplifier = speed_gains(ROBOT, H), amplifier_parameters(ROBOT)
    _, held = speed_loop(row, amplifier, sign * 20.0, 0.0, sign * 0.3)
    assert held == sign * 0.3
    _, back = speed_loop(row, amplifier, -sign * 20.0, 0.0, sign * 0.3)
    assert abs(back) <= 0.3
    # at 28 rad/s the back-EMF leaves 0.26 A: more cannot flow, so more is not collected
    _, held = speed_loop(row, amplifier, sign * 28.5, sign * 28.0, sign * 1.0)
    assert held == sign * 1.0


def test_long_saturation_leaves_no_windup():
    target = np.where(TIME < 2.0, 100.0, 5.0)  # far beyond the top speed of 28.6 rad/s
    speed, _ = run("natural_stone", target, noise=0.0)
    assert speed[np.searchsorted(TIME, 2.0) :].min() > 5.0 - 1.5
    assert abs(speed[-1] - 5.0) < 0.1


def test_speed_loop_is_odd_in_its_signals():
    row, amplifier = speed_gains(ROBOT, H), amplifier_parameters(ROBOT)
    for target, measured, integral in ((3.0, 1.0, 0.2), (30.0, 2.0, 0.5), (-1.0, 0.3, 0.0)):
        plus = np.array(speed_loop(row, amplifier, target, measured, integral))
        minus = np.array(speed_loop(row, amplifier, -target, -measured, -integral))
        np.testing.assert_array_equal(plus, -minus)
