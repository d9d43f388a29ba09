"""Planar model of a robot with n omni wheels, Eqs. 3.54-3.85: smooth right-hand side and fixed step.

State, a flat row: [z (n) | φ̇ (n) | v_x, v_y, yaw rate | i (n) | roller deflection (n) | wheel angle (n) |
play of the gear (n) and its rate (n) | time | x, y, yaw]; twist in the body frame at the robot's centre. The
first 2n + 3 are the states of Eq. 3.54; `derivative` takes these, or these and the motor currents, `step`
takes all (`state_size`).

Corrected against the text: Coriolis terms m(ẍ − θ̇ẏ), m(ÿ + θ̇ẋ); sign of T_nl and of the gear's power flow;
viscous motor friction, bearing friction (Eqs. 4.37-4.38) and rolling resistance (as a torque r μ_rol F_N on
the wheel). `published` leaves all of these out.
"""

from __future__ import annotations

import math

import numpy as np

from omnimj.physics.effect_terms import AIR, SAG, change_motor, changes_motor
from omnimj.physics.motor import LOOP, MOTOR_ROW, set_current
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
from omnimj.physics.planar_wheel import (
    contact_force,
    contact_velocity,
    pose_at,
    step_wheel,
    supply_load,
    wheel_torque_bounds,
    wheel_velocity,
)
from omnimj.physics.traction import force_ratio, relaxation_rate
from omnimj.physics.wheel import INERTIA, RADIUS, ROLLER_DRY, ROLLER_VISCOUS, between

__all__ = [
    "PlanarConstants",
    "derivative",
    "output_size",
    "planar_constants",
    "pose_at",
    "state_size",
    "step",
]


def state_size(wheels: int) -> int:
    """Length of the state of `step` for n wheels."""
    return 7 * wheels + 7


def output_size(wheels: int) -> int:
    """Length of the output of `step`: slip, F_N, F, G (n each), acceleration (2), encoders' speeds (n)."""
    return 5 * wheels + 2


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
def _body_force(wheel, body, ahead, aside):
    """Force of one wheel on the body and its moment about the centre of mass [N, N, N.m]."""
    x = ahead * wheel[DRIVE_X] + aside * wheel[DRIVE_Y]
    y = ahead * wheel[DRIVE_Y] - aside * wheel[DRIVE_X]
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
        along, across = wheel_velocity(wheel, v_x, v_y, yaw_rate)
        rim = wheel[RADIUS] * wheel_speed
        slip, sideways = contact_velocity(wheel, rim, along, across)
        rate = relaxation_rate(floor, slip, max(abs(rim), abs(along)))
        change[i] = slip - rate * state[i]
        traction = normal * wheel[GRIP] * force_ratio(floor, state[i], slip, rate)
        dry = wheel[ROLLER_DRY] * math.tanh(sideways / smoothing)
        drag = normal * (dry + wheel[ROLLER_VISCOUS] * sideways)
        ahead, aside = contact_force(wheel, traction, drag)
        current = set_current(motor, command[i], wheel_speed)
        if state.size > 2 * n + 3:
            change[2 * n + 3 + i] = (current - state[2 * n + 3 + i]) / motor[LOOP]
            current = state[2 * n + 3 + i]
        low, high = wheel_torque_bounds(wheel, motor, current, wheel_speed, normal, aside, published)
        torque = between(low, high, math.tanh(rim / smoothing))
        change[n + i] = (torque - wheel[RADIUS] * ahead) / wheel[INERTIA]
        x, y, z = _body_force(wheel, body, ahead, aside)
        f_x, f_y, moment = f_x + x, f_y + y, moment + z
    change[2 * n], change[2 * n + 1], change[2 * n + 2] = _twist_rate(
        body, f_x, f_y, moment, v_x, v_y, yaw_rate, published
    )
    return change


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
    pose = pose_at(n)
    middle = state[pose + 2] + 0.5 * turn
    state[pose - 1] += h
    c, s = math.cos(middle), math.sin(middle)
    mean_x, mean_y = 0.5 * (old_x + v_x), 0.5 * (old_y + v_y)
    state[pose] += h * (c * mean_x - s * mean_y)
    state[pose + 1] += h * (s * mean_x + c * mean_y)
    state[pose + 2] += turn
    return (v_x - old_x) / h, (v_y - old_y) / h


@kernel
def _drag(body, coefficient, v_x, v_y):
    """Air drag −c |v| v at the robot's centre and its moment about the centre of mass [N, N, N.m]."""
    pull = -coefficient * math.sqrt(v_x * v_x + v_y * v_y)
    x, y = pull * v_x, pull * v_y
    return x, y, body[COM_Y] * x - body[COM_X] * y


@kernel
def step(state, command, body, wheels, motors, floors, terms, h, steps, published, output):
    """Advances the whole state by `steps` steps of h seconds, in place; stable at any slip speed.

    Exact for frozen speeds: bristles and currents; set-valued: friction of motor, gear, bearings and brake.

    Args:
      state: All of it, shape (7n+7,); changed in place.
      command: Current set values, shape (n,) [A].
      body: `PlanarConstants.body`.
      wheels: `PlanarConstants.wheels`.
      motors: `motor.motor_row` per wheel, shape (n, MOTOR_ROW).
      floors: `Floor.row` per wheel, shape (n, ROW).
      terms: Effects, a row of `effect_terms` per wheel, shape (n, TERMS); without effects zeros.
      h: Step [s].
      steps: How many.
      published: The equations as printed.
      output: Filled with slip, F_N, F, G (n each) and what an accelerometer at the centre reads along x and y
        (acceleration less gravity), of the last step, then the wheel speeds that the motors' encoders see,
        shape (5n+2,).
    """
    n = wheels.shape[0]
    changed, draws = np.empty(MOTOR_ROW), np.zeros(n)
    sagging = terms[0, SAG] != 0.0
    # drag acts on the body as a whole: it stands, shared, in the rows of all wheels
    drag = 0.0
    for i in range(n):
        drag += terms[i, AIR] / n
    for _ in range(steps):
        g_x, g_y = _gravity(body, state[pose_at(n) + 2])
        v_x, v_y, yaw_rate = state[2 * n], state[2 * n + 1], state[2 * n + 2]
        f_x, f_y, moment = body[MASS] * g_x, body[MASS] * g_y, 0.0
        if drag != 0.0:
            x, y, z = _drag(body, drag, v_x, v_y)
            f_x, f_y, moment = f_x + x, f_y + y, moment + z
        load = supply_load(state, command, motors, terms, changed, draws) if sagging else 0.0
        for i in range(n):
            wheel, motor = wheels[i], motors[i]
            normal = _normal_force(wheel, g_x, g_y)
            if changes_motor(terms[i]):
                change_motor(motor, terms[i], state[pose_at(n) - 1], load - draws[i], changed)
                motor = changed
            ahead, aside = step_wheel(
                i, state, command, wheel, motor, floors[i], terms[i], normal, h, published, output
            )
            x, y, z = _body_force(wheel, body, ahead, aside)
            f_x, f_y, moment = f_x + x, f_y + y, moment + z
        a_x, a_y = _step_body(n, state, body, f_x, f_y, moment, h, published)
        if not published:
            a_x, a_y = a_x - yaw_rate * v_y, a_y + yaw_rate * v_x
        output[4 * n], output[4 * n + 1] = a_x - g_x, a_y - g_y
