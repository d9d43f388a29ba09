"""Planar model of a robot with n omni wheels, Eqs. 3.54-3.85: smooth right-hand side and fixed step.

State, a flat row: [z (n) | φ̇ (n) | v_x, v_y, yaw rate | i (n) | roller deflection (n) | x, y, yaw]; twist
in the body frame at the robot's centre. The first 2n + 3 are the states of Eq. 3.54; `derivative` takes
these, or these and the motor currents, `step` takes all (`state_size`).

Corrected against the text: Coriolis terms m(ẍ − θ̇ẏ), m(ÿ + θ̇ẋ); sign of T_nl and of the gear's power flow;
viscous motor friction, bearing friction (Eqs. 4.37-4.38) and rolling resistance (as a torque r μ_rol F_N on
the wheel). `published` leaves all of these out.
"""

from __future__ import annotations

import math

import numpy as np

from omnimj.physics.motor import LOOP, next_current, set_current, stick_or_slip
from omnimj.physics.native import kernel
from omnimj.physics.planar_constants import (
    COM_X,
    COM_Y,
    DRIVE_X,
    DRIVE_Y,
    GRIP,
    MASS,
    NORMAL,
    NORMAL_X,
    NORMAL_Y,
    POSITION_X,
    POSITION_Y,
    SLOPE_X,
    SLOPE_Y,
    YAW_INERTIA,
    PlanarConstants,
    planar_constants,
)
from omnimj.physics.traction import exact_step, force_ratio, relaxation_rate
from omnimj.physics.wheel import (
    INERTIA,
    RADIUS,
    ROLLER_DRY,
    ROLLER_VISCOUS,
    ROLLING,
    bearing_friction,
    between,
    mean_current,
    mean_deflection,
    motor_torque_bounds,
    roller_friction,
)

__all__ = ["PlanarConstants", "derivative", "output_size", "planar_constants", "state_size", "step"]


def state_size(wheels: int) -> int:
    """Length of the state of `step` for n wheels."""
    return 4 * wheels + 6


def output_size(wheels: int) -> int:
    """Length of the output of `step`: slip, F_N, F, G (n each), acceleration (2)."""
    return 4 * wheels + 2


@kernel
def _gravity(body, yaw):
    """Gravity along the floor in the body frame [m/s²]."""
    c, s = math.cos(yaw), math.sin(yaw)
    return c * body[SLOPE_X] + s * body[SLOPE_Y], c * body[SLOPE_Y] - s * body[SLOPE_X]


@kernel
def _normal_force(wheel, gravity_x, gravity_y):
    """F_N on the (sloping) floor; a wheel cannot pull [N]."""
    return max(wheel[NORMAL] + wheel[NORMAL_X] * gravity_x + wheel[NORMAL_Y] * gravity_y, 0.0)


@kernel
def _wheel_velocity(wheel, v_x, v_y, yaw_rate):
    """Velocity of the wheel's centre along u (V_i, Eqs. 3.50-3.53) and along its axle z × u [m/s]."""
    x = v_x - yaw_rate * wheel[POSITION_Y]
    y = v_y + yaw_rate * wheel[POSITION_X]
    return x * wheel[DRIVE_X] + y * wheel[DRIVE_Y], y * wheel[DRIVE_X] - x * wheel[DRIVE_Y]


@kernel
def _wheel_torque_bounds(wheel, motor, current, wheel_speed, normal_force, lateral_force, published):
    """Torque on the wheel but for traction, turning forward and turning backward [N.m]."""
    low, high = motor_torque_bounds(motor, current, wheel_speed, published)
    if published:
        return low, high
    dry, viscous = bearing_friction(wheel, normal_force, lateral_force)
    dry += wheel[ROLLING] * normal_force * wheel[RADIUS]
    return low - dry - viscous * wheel_speed, high + dry - viscous * wheel_speed


@kernel
def _body_force(wheel, body, traction, lateral):
    """Force of one wheel on the body and its moment about the centre of mass [N, N, N.m]."""
    x = traction * wheel[DRIVE_X] + lateral * wheel[DRIVE_Y]
    y = traction * wheel[DRIVE_Y] - lateral * wheel[DRIVE_X]
    return x, y, (wheel[POSITION_X] - body[COM_X]) * y - (wheel[POSITION_Y] - body[COM_Y]) * x


@kernel
def _twist_rate(body, f_x, f_y, moment, v_x, v_y, yaw_rate, published):
    """d(v_x, v_y, yaw rate)/dt of the robot's centre; the force accelerates the centre of mass."""
    spin = moment / body[YAW_INERTIA]
    rate_x = f_x / body[MASS] + spin * body[COM_Y]
    rate_y = f_y / body[MASS] - spin * body[COM_X]
    if not published:
        rate_x += yaw_rate * (v_y + yaw_rate * body[COM_X])
        rate_y -= yaw_rate * (v_x - yaw_rate * body[COM_Y])
    return rate_x, rate_y, spin


@kernel
def derivative(state, command, yaw, body, wheels, motors, floors, smoothing, published):
    """Right-hand side of Eqs. 3.63-3.85 for `scipy.integrate.solve_ivp`, sign(v) as tanh(v/smoothing).

    Args:
      state: [z | φ̇ | v_x, v_y, yaw rate], shape (2n+3,); or with the motor currents behind, shape (3n+3,).
      command: Current set values, shape (n,) [A]; without currents in the state the amplifiers have no lag.
      yaw: Heading, matters on a slope only [rad].
      body: `PlanarConstants.body`.
      wheels: `PlanarConstants.wheels`.
      motors: `motor.motor_row` per wheel, shape (n, MOTOR_ROW).
      floors: `Floor.row` per wheel, shape (n, ROW).
      smoothing: Speed over which friction changes its sign, at the rim for wheels [m/s].
      published: The equations as printed.

    Returns:
      d(state)/dt.
    """
    n = wheels.shape[0]
    v_x, v_y, yaw_rate = state[2 * n], state[2 * n + 1], state[2 * n + 2]
    g_x, g_y = _gravity(body, yaw)
    change = np.empty_like(state)
    f_x, f_y, moment = body[MASS] * g_x, body[MASS] * g_y, 0.0
    for i in range(n):
        wheel, motor, floor, wheel_speed = wheels[i], motors[i], floors[i], state[n + i]
        normal = _normal_force(wheel, g_x, g_y)
        along, across = _wheel_velocity(wheel, v_x, v_y, yaw_rate)
        rim = wheel[RADIUS] * wheel_speed
        slip = rim - along
        rate = relaxation_rate(floor, slip, max(abs(rim), abs(along)))
        change[i] = slip - rate * state[i]
        traction = normal * wheel[GRIP] * force_ratio(floor, state[i], slip, rate)
        dry = wheel[ROLLER_DRY] * math.tanh(across / smoothing)
        lateral = normal * (dry + wheel[ROLLER_VISCOUS] * across)
        current = set_current(motor, command[i], wheel_speed)
        if state.size > 2 * n + 3:
            change[2 * n + 3 + i] = (current - state[2 * n + 3 + i]) / motor[LOOP]
            current = state[2 * n + 3 + i]
        low, high = _wheel_torque_bounds(wheel, motor, current, wheel_speed, normal, lateral, published)
        torque = between(low, high, math.tanh(rim / smoothing))
        change[n + i] = (torque - wheel[RADIUS] * traction) / wheel[INERTIA]
        x, y, z = _body_force(wheel, body, traction, lateral)
        f_x, f_y, moment = f_x + x, f_y + y, moment + z
    change[2 * n], change[2 * n + 1], change[2 * n + 2] = _twist_rate(
        body, f_x, f_y, moment, v_x, v_y, yaw_rate, published
    )
    return change


@kernel
def _step_wheel(i, state, command, wheel, motor, floor, normal, h, published, output):
    """Advances bristles, current and speed of wheel i; returns its traction and lateral force [N]."""
    n = command.size
    wheel_speed = state[n + i]
    along, across = _wheel_velocity(wheel, state[2 * n], state[2 * n + 1], state[2 * n + 2])
    rim = wheel[RADIUS] * wheel_speed
    slip = rim - along
    rate = relaxation_rate(floor, slip, max(abs(rim), abs(along)))
    z = exact_step(state[i], slip, rate, h)
    mean = mean_deflection(state[i], z, slip, rate, h)
    traction = normal * wheel[GRIP] * force_ratio(floor, mean, slip, rate)
    roller, lateral = roller_friction(wheel, state[3 * n + 3 + i], across, normal, h)
    before = state[2 * n + 3 + i]
    current = next_current(motor, before, command[i], wheel_speed, h)
    driving = mean_current(motor, before, current, command[i], wheel_speed, h)
    low, high = _wheel_torque_bounds(wheel, motor, driving, wheel_speed, normal, lateral, published)
    other = -wheel[RADIUS] * traction
    torque = stick_or_slip(low, high, wheel_speed, wheel[INERTIA], other, h)
    state[i], state[3 * n + 3 + i], state[2 * n + 3 + i] = z, roller, current
    state[n + i] = wheel_speed + h * (torque + other) / wheel[INERTIA]
    output[i], output[n + i], output[2 * n + i], output[3 * n + i] = slip, normal, traction, lateral
    return traction, lateral


@kernel
def _step_body(n, state, body, f_x, f_y, moment, h, published):
    """Advances twist and pose: momentum in the body frame turns back by the yaw of the step."""
    old_x, old_y, old_rate = state[2 * n], state[2 * n + 1], state[2 * n + 2]
    yaw_rate = old_rate + h * moment / body[YAW_INERTIA]
    turn = 0.5 * h * (old_rate + yaw_rate)
    com_x = old_x - old_rate * body[COM_Y] + h * f_x / body[MASS]
    com_y = old_y + old_rate * body[COM_X] + h * f_y / body[MASS]
    if not published:
        c, s = math.cos(turn), math.sin(turn)
        com_x, com_y = c * com_x + s * com_y, c * com_y - s * com_x
    v_x, v_y = com_x + yaw_rate * body[COM_Y], com_y - yaw_rate * body[COM_X]
    state[2 * n], state[2 * n + 1], state[2 * n + 2] = v_x, v_y, yaw_rate
    pose, middle = 4 * n + 3, state[4 * n + 5] + 0.5 * turn
    c, s = math.cos(middle), math.sin(middle)
    mean_x, mean_y = 0.5 * (old_x + v_x), 0.5 * (old_y + v_y)
    state[pose] += h * (c * mean_x - s * mean_y)
    state[pose + 1] += h * (s * mean_x + c * mean_y)
    state[pose + 2] += turn
    return (v_x - old_x) / h, (v_y - old_y) / h


@kernel
def step(state, command, body, wheels, motors, floors, h, steps, published, output):
    """Advances the whole state by `steps` steps of h seconds, in place; stable at any slip speed.

    Exact for frozen speeds: bristles and currents; set-valued: friction of motor, gear, bearings and brake.

    Args:
      state: All of it, shape (4n+6,); changed in place.
      command: Current set values, shape (n,) [A].
      body: `PlanarConstants.body`.
      wheels: `PlanarConstants.wheels`.
      motors: `motor.motor_row` per wheel, shape (n, MOTOR_ROW).
      floors: `Floor.row` per wheel, shape (n, ROW).
      h: Step [s].
      steps: How many.
      published: The equations as printed.
      output: Filled with slip, F_N, F, G (n each) and what an accelerometer at the centre reads along x and y
        (acceleration less gravity), of the last step, shape (4n+2,).
    """
    n = wheels.shape[0]
    for _ in range(steps):
        g_x, g_y = _gravity(body, state[4 * n + 5])
        v_x, v_y, yaw_rate = state[2 * n], state[2 * n + 1], state[2 * n + 2]
        f_x, f_y, moment = body[MASS] * g_x, body[MASS] * g_y, 0.0
        for i in range(n):
            wheel = wheels[i]
            normal = _normal_force(wheel, g_x, g_y)
            traction, lateral = _step_wheel(
                i, state, command, wheel, motors[i], floors[i], normal, h, published, output
            )
            x, y, z = _body_force(wheel, body, traction, lateral)
            f_x, f_y, moment = f_x + x, f_y + y, moment + z
        a_x, a_y = _step_body(n, state, body, f_x, f_y, moment, h, published)
        if not published:
            a_x, a_y = a_x - yaw_rate * v_y, a_y + yaw_rate * v_x
        output[4 * n], output[4 * n + 1] = a_x - g_x, a_y - g_y
