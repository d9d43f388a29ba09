"""Right-hand side of the planar equations on a level floor for adaptive integrators, by smoothed friction."""

from __future__ import annotations

import math

import numpy as np

from omnimj.physics.motor import achievable_current
from omnimj.physics.native import kernel
from omnimj.physics.planar import body_at, body_force, driven_wheel
from omnimj.physics.planar_wheel import (
    WheelLoad,
    contact_force,
    contact_velocity,
    on_its_floor,
    wheel_torque_bounds,
    wheel_velocity,
)
from omnimj.physics.traction import force_ratio, load_factor, relaxation_rate, rolling_speed


@kernel
def derivative(state, command, model, smoothing):
    """Right-hand side of Eqs. 3.63-3.85, sign(v) as tanh(v/smoothing).

    Args:
      state: [z | φ̇ | v_x, v_y, yaw rate], shape (2n+3,); or followed by the motor currents, shape (3n+3,).
      command: Commanded currents, shape (n,) [A]; without currents in the state the amplifiers have no lag.
      model: `PlanarModel`; effect terms are left out.
      smoothing: Speed over which friction changes its sign, at the rim for wheels [m/s].

    Returns:
      d(state)/dt.
    """
    body, n = body_at(model.body), command.size
    twist = state[2 * n], state[2 * n + 1], state[2 * n + 2]
    change = np.empty_like(state)
    f_x, f_y, moment = 0.0, 0.0, 0.0
    for i in range(n):
        driven = driven_wheel(model, i)
        wheel, motor, floor = driven.wheel, driven.motor, driven.floor
        wheel_speed, normal = state[n + i], wheel.normal
        along, across = wheel_velocity(wheel, *twist)
        rim = wheel.wheel.radius * wheel_speed
        slip, sideways = contact_velocity(wheel, rim, along, across)
        rate = relaxation_rate(floor, slip, rolling_speed(floor, rim, along, sideways))
        change[i] = slip - rate * state[i]
        grip = wheel.grip * load_factor(floor, normal)
        traction = normal * grip * force_ratio(floor, state[i], slip, rate)
        driven = on_its_floor(driven, rim, along, sideways)
        dry = driven.wheel.wheel.roller_dry * math.tanh(sideways / smoothing)
        drag = normal * (dry + wheel.wheel.roller_viscous * sideways)
        ahead, aside = contact_force(wheel, traction, drag)
        current = achievable_current(motor, command[i], wheel_speed)
        if state.size > 2 * n + 3:
            change[2 * n + 3 + i] = (current - state[2 * n + 3 + i]) / motor.current_loop
            current = state[2 * n + 3 + i]
        low, high = wheel_torque_bounds(driven, current, wheel_speed, WheelLoad(normal, ahead, aside))
        direction = math.tanh(rim / smoothing)
        torque = 0.5 * ((1.0 + direction) * low + (1.0 - direction) * high)
        change[n + i] = (torque - wheel.wheel.radius * ahead) / wheel.wheel.inertia
        x, y, z = body_force(wheel, body, ahead, aside)
        f_x, f_y, moment = f_x + x, f_y + y, moment + z
    rates = _twist_rate(body, (f_x, f_y, moment), twist, model.published)
    change[2 * n], change[2 * n + 1], change[2 * n + 2] = rates
    return change


@kernel
def _twist_rate(body, force, twist, published):
    """d(v_x, v_y, yaw rate)/dt of the robot's centre; the force (N, N, N.m) acts at the centre of mass."""
    f_x, f_y, moment = force
    v_x, v_y, yaw_rate = twist
    spin = moment / body.yaw_inertia
    rate_x = f_x / body.mass + spin * body.com_y
    rate_y = f_y / body.mass - spin * body.com_x
    if not published:
        rate_x += yaw_rate * (v_y + yaw_rate * body.com_x)
        rate_y -= yaw_rate * (v_x - yaw_rate * body.com_y)
    return rate_x, rate_y, spin
