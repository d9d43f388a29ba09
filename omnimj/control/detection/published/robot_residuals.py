"""Residuals of the robot: r3 … r6 of Eqs. 5.9-5.12, r7, r8, R7 and R8 of Eqs. 5.14-5.20.

The observer is the planar model, driven by the measured currents. Nothing measures the body's velocity, which
the rollers' friction in Eqs. 5.16-5.17 needs: it comes from the measured wheel speeds.
"""

from __future__ import annotations

import numpy as np

from omnimj.control.detection.published.residuals import (
    RESIDUAL_LAG,
    interval_at_speed,
    low_pass,
    outside_interval,
    root_mean_square,
)
from omnimj.physics import planar
from omnimj.physics.native import kernel
from omnimj.physics.planar_wheel import (
    WheelLoad,
    planar_wheel_at,
    wheel_torque_bounds,
    wheel_velocity,
)
from omnimj.physics.wheel import bearing_friction, roller_friction

STEP = 2.5e-4
"""Largest step of the observer [s]."""


@kernel
def previous_speed_index(wheels):
    """Where the last wheel speeds begin in an observer's row for n wheels.

    The row: planar state | last φ̇ (n) | rollers' deflection (n) | i (n), a (2) as late as φ̇ | r7, r8 behind
    their filter | ∫ r7², ∫ r8² | time | r3 … (n) | R7, R8.
    """
    return 7 * wheels + 7


@kernel
def residual_index(wheels):
    """Where r3 … begin in an observer's row for n wheels; R7 and R8 follow them."""
    return 10 * wheels + 14


@kernel
def row_size(wheels):
    """Length of an observer's row for n wheels."""
    return 11 * wheels + 16


@kernel
def roller_force(wheel, deflection, across, normal, time, printed):
    """Deflection and force F_f of one wheel's rollers, Eqs. 3.74-3.77 [m, N].

    Repaired: with stiction at rest, as in the model. Printed: with the sign of the velocity, always.
    """
    if printed:
        return 0.0, normal * (wheel.roller_dry * np.sign(across) + wheel.roller_viscous * across)
    return roller_friction(wheel, deflection, across, normal, time)


@kernel
def joint_force(driven, current, wheel_speed, acceleration, normal, lateral):
    """Traction force of one wheel from its joint, as the interval that rest leaves open [N].

    F_i = [(K_t i − T_nl) E G_r − T_friction − (I + (J_r + J_g) E G_r²) φ̈]/r, the terms of Eqs. 5.14-5.15.
    Repaired: T_nl and friction oppose the motion. Printed: friction has no sign; T_nl, which Eqs. 5.14-5.15
    take off the sum of each axis, is not in here.

    Args:
      driven: `DrivenWheel`.
      current: Measured [A].
      wheel_speed: φ̇ [rad/s].
      acceleration: φ̈ [rad/s²].
      normal: F_N [N].
      lateral: Friction of the rollers [N].
    """
    wheel, motor = driven.wheel.wheel, driven.motor
    low, high = wheel_torque_bounds(driven, current, wheel_speed, WheelLoad(normal, 0.0, lateral))
    if driven.published:
        dry, viscous = bearing_friction(wheel, normal, lateral)
        low += motor.no_load_torque * motor.gear_efficiency * motor.gear_ratio - dry - viscous * wheel_speed
        high = low
    else:
        low, high = interval_at_speed(low, high, wheel_speed)
    inertial = wheel.inertia * acceleration
    return (low - inertial) / wheel.radius, (high - inertial) / wheel.radius


@kernel
def force_residuals(rollers, before, current, wheel_speed, acceleration, time, model, odometry):
    """r7, r8 = F_js − F_ts along x and y, Eqs. 5.14-5.19 [N]; `rollers` (n,) goes on in place.

    At rest, where friction may be anything, they are what no friction could explain. Printed: each axis
    loses 2 T_nl E G_r/r whatever the motion (erratum 4).

    Args:
      rollers: Deflections of the rollers' bearings, shape (n,) [m].
      before: Wheel speeds one measurement ago, shape (n,) [rad/s].
      current: Measured, shape (n,) [A].
      wheel_speed: Measured, shape (n,) [rad/s].
      acceleration: Measured, shape (2,) [m/s²].
      time: Since the measurement before [s].
      model: `planar.PlanarModel`.
      odometry: Body twist from rolling speeds, shape (3, n).
    """
    n, printed = current.size, model.published
    v = np.zeros(3)
    for i in range(n):
        radius = planar_wheel_at(model.wheels[i]).wheel.radius
        for axis in range(3):
            v[axis] += odometry[axis, i] * wheel_speed[i] * radius
    low, high = np.zeros(2), np.zeros(2)
    task = planar.body_at(model.body).mass * acceleration
    for i in range(n):
        driven = planar.driven_wheel(model, i)
        wheel, motor, normal = driven.wheel, driven.motor, driven.wheel.normal
        across = wheel_velocity(wheel, v[0], v[1], v[2])[1]
        rollers[i], lateral = roller_force(wheel.wheel, rollers[i], across, normal, time, printed)
        change = (wheel_speed[i] - before[i]) / time
        one, other = joint_force(driven, current[i], wheel_speed[i], change, normal, lateral)
        for axis in range(2):
            u = wheel.drive_x if axis == 0 else wheel.drive_y
            low[axis] += min(u * one, u * other)
            high[axis] += max(u * one, u * other)
            if printed:
                unsigned = abs(u) * motor.no_load_torque * motor.gear_efficiency * motor.gear_ratio
                unsigned /= wheel.wheel.radius
                low[axis] -= unsigned
                high[axis] -= unsigned
        # the rollers push the body along −z × u
        task[0] -= lateral * wheel.drive_y
        task[1] += lateral * wheel.drive_x
    return outside_interval(0.0, task[0] - high[0], task[0] - low[0]), outside_interval(
        0.0, task[1] - high[1], task[1] - low[1]
    )


@kernel
def update_observer(observer, measured, time, machine, odometry, lags, printed):
    """Advance an observer's row by `time` seconds to the newest measurement, in place.

    Args:
      observer: Its row, shape (row_size(n),).
      measured: Currents (n,) [A], wheel speeds (n,) [rad/s], acceleration (2,) [m/s²].
      time: Since the measurement before [s].
      machine: Packed body, wheels, motors (driven by measured current, with their estimated torque
        constants), floors and effect terms, in the order of `planar.PlanarModel`.
      odometry: Body twist from rolling speeds, shape (3, n).
      lags: From `residuals.matching_lags`.
      printed: The equations as printed.
    """
    current, wheel_speed, acceleration = measured
    body, wheels, motors, floors, terms = machine
    model = planar.PlanarModel(body, wheels, motors, floors, terms, printed)
    n = wheels.shape[0]
    at = previous_speed_index(n)
    before, rollers = observer[at : at + n], observer[at + n : at + 2 * n]
    late, rest = observer[at + 2 * n : at + 3 * n + 2], at + 3 * n + 2
    filtered, squares = observer[rest : rest + 2], observer[rest + 2 : rest + 4]
    if time > 0.0:
        steps = max(1, int(np.ceil(time / STEP - 1e-6)))
        output = np.empty(5 * n + 2)
        planar.step(observer[:at], current, model, time / steps, steps, output)
        for i in range(n):
            late[i] = low_pass(late[i], current[i], time, lags[0])
        for axis in range(2):
            late[n + axis] = low_pass(late[n + axis], acceleration[axis], time, lags[1])
        r7, r8 = force_residuals(rollers, before, late[:n], wheel_speed, late[n:], time, model, odometry)
        filtered[0] = low_pass(filtered[0], r7, time, RESIDUAL_LAG)
        filtered[1] = low_pass(filtered[1], r8, time, RESIDUAL_LAG)
    observer[rest + 4] += time
    first, span = residual_index(n), observer[rest + 4]
    for i in range(n):
        observer[first + i] = wheel_speed[i] - observer[n + i]
        before[i] = wheel_speed[i]
    for axis in range(2):
        squares[axis] += filtered[axis] * filtered[axis] * time
        observer[first + n + axis] = root_mean_square(squares[axis], span)
