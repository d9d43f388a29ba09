"""Residuals of the test rig: r1, R1, r2 and R2 of Eqs. 5.1-5.7.

The observer is the rig's own model, driven by the measured current and the gantry's speed.
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
from omnimj.physics import rig
from omnimj.physics.native import kernel
from omnimj.physics.wheel import store

STEP = 2.5e-4
"""Largest step of the observer [s]."""
_REST_LATERAL = 0.01  # [m/s] a gantry that is slower stands: its sign would be that of the noise

# a row of the observer: the model's state, then what the residuals need
BEFORE, LATE_CURRENT, LATE_ACCELERATION, FORCE = range(rig.STATE, rig.STATE + 4)
SPEED_SQUARES, FORCE_SQUARES, SPAN, R1, R2 = range(rig.STATE + 4, rig.STATE + 9)
ROW = rig.STATE + 9
"""Length of an observer's row: model | last φ̇ | i and s̈ as late as φ̇ | r2 behind its filter | ∫ r1², ∫ r2²
| time | R1, R2."""


@kernel
def force_residual(model, current, wheel_speed, acceleration, speed, s_ddot, lateral):
    """r2 = F_ts − F_js, Eqs. 5.4-5.6 [N].

    F_js = (T_3 − I_3 φ̈)/r with T_3 from the current; F_ts = m_T s̈ + F_rail + F_roll (Eq. 4.26). Repaired:
    T_nl and friction oppose the motion, and at rest r2 is only what no friction could explain. Printed: they
    are those of forward motion, always (erratum 4).

    Args:
      model: `physics.rig.RigModel`.
      current: Measured [A].
      wheel_speed: φ̇ measured [rad/s].
      acceleration: φ̈ [rad/s²].
      speed: Of the carriage [m/s].
      s_ddot: s̈ measured [m/s²].
      lateral: ṡ of the gantry [m/s].
    """
    g = rig.lateral_force(model.rig, lateral)
    low, high = rig.wheel_torque_bounds(model, current, wheel_speed, g)
    forward, backward = rig.carriage_friction_bounds(model.rig, g, speed, model.published)
    inertial, radius = model.rig.wheel.inertia * acceleration, model.rig.wheel.radius
    inertia = model.rig.mass * s_ddot
    if model.published:
        return inertia - forward - (low - inertial) / radius
    low, high = interval_at_speed(low, high, wheel_speed)
    forward, backward = interval_at_speed(forward, backward, speed / radius)
    joint_low, joint_high = (low - inertial) / radius, (high - inertial) / radius
    return outside_interval(0.0, joint_low - inertia + forward, joint_high - inertia + backward)


@kernel
def update_observer(observer, measured, time, machine, lags, printed):
    """Advance an observer's row by `time` seconds to the newest measurement, in place.

    Args:
      observer: Shape (ROW,).
      measured: Current [A], wheel speed [rad/s], carriage speed [m/s], its acceleration [m/s²], speed of the
        gantry [m/s].
      time: Since the measurement before [s].
      machine: Packed rig, motor, floor and effect terms, see `physics.rig.rig_model_at`.
      lags: From `residuals.matching_lags`.
      printed: The equations as printed.
    """
    current, wheel_speed, speed, s_ddot, lateral = measured
    if abs(lateral) < _REST_LATERAL:
        lateral = 0.0
    if time > 0.0:
        model = rig.rig_model_at(machine, printed)
        steps = max(1, int(np.ceil(time / STEP - 1e-6)))
        state, _ = rig.step(rig.rig_state_at(observer), current, lateral, model, time / steps, steps)
        store(state, observer)
        i = low_pass(observer[LATE_CURRENT], current, time, lags[0])
        a = low_pass(observer[LATE_ACCELERATION], s_ddot, time, lags[1])
        change = (wheel_speed - observer[BEFORE]) / time
        r2 = force_residual(model, i, wheel_speed, change, speed, a, lateral)
        observer[FORCE] = low_pass(observer[FORCE], r2, time, RESIDUAL_LAG)
        observer[LATE_CURRENT], observer[LATE_ACCELERATION] = i, a
    r1 = wheel_speed - rig.rig_state_at(observer).wheel_speed
    observer[SPEED_SQUARES] += r1 * r1 * time
    observer[FORCE_SQUARES] += observer[FORCE] * observer[FORCE] * time
    observer[SPAN] += time
    observer[BEFORE] = wheel_speed
    observer[R1] = root_mean_square(observer[SPEED_SQUARES], observer[SPAN])
    observer[R2] = root_mean_square(observer[FORCE_SQUARES], observer[SPAN])


def initial_observer() -> np.ndarray:
    """The row of a rig at rest, shape (ROW,)."""
    return np.zeros(ROW)
