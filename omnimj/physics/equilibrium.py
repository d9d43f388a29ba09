"""Steady driving: the body velocity at which the floor's forces on given turning wheels balance.

With wheel speeds known, traction and the rollers' drag depend on the body twist V alone. Σ F(V) = 0 has one
solution, which a damped Newton iteration finds. Bristles are settled; friction changes its sign over a small
velocity. Inertia is left out: this holds for blocks of steady motion only.
"""

from __future__ import annotations

import math

import numpy as np

from omnimj.parameters.floor import LUGRE
from omnimj.physics.motor import motor_torque_bounds
from omnimj.physics.native import kernel
from omnimj.physics.planar import body_at, body_force, driven_wheel
from omnimj.physics.planar_wheel import contact_force, contact_velocity, wheel_velocity
from omnimj.physics.traction import (
    force_ratio,
    load_factor,
    relaxation_rate,
    rolling_resistance,
    rolling_speed,
    stribeck,
)
from omnimj.physics.wheel import bearing_friction

SMOOTHING = 0.0002
"""Velocity over which dry friction changes its sign [m/s]."""
_BLUNTER = (256.0, 64.0, 16.0, 4.0, 1.0)
_STEP = 1e-6  # [m/s] for derivatives
_LONGEST = 0.03  # [m/s] of a Newton step
_ROUNDS, _HALVINGS = 60, 12
_CLOSE, _SMALL = 1e-8, 1e-3  # [m/s] of a step, [N] of the rest
_STIFFNESS = 1e-6  # added to the derivative's diagonal [N.s/m]: a wheel in full sliding has none


@kernel
def steady_ratio(floor, slip, rolling, smoothing):
    """F/F_N of settled bristles [1].

    Args:
      floor: `TractionParameters`.
      slip: Slip velocity [m/s].
      rolling: Rolling speed, as `traction.rolling_speed` [m/s].
      smoothing: Velocity over which dry friction changes its sign [m/s].
    """
    rate = relaxation_rate(floor, slip, rolling)
    if floor.law == LUGRE:  # its dry part changes sign at once otherwise
        rate = math.hypot(rate, floor.sigma_0 * smoothing / stribeck(floor, slip))
    elif rate <= 0.0:
        rate = 1e-9
    return force_ratio(floor, slip / rate, slip, rate)


@kernel
def steady_force(driven, wheel_speed, twist, smoothing, forces):
    """Force of the floor on one wheel in steady motion.

    Args:
      driven: `DrivenWheel`.
      wheel_speed: φ̇ [rad/s].
      twist: v_x, v_y, yaw rate in the body frame, shape (3,).
      smoothing: Velocity over which dry friction changes its sign [m/s].
      forces: Filled with the force along u, that against z × u, r φ̇ and the speed of the rollers, shape (4,).
    """
    wheel, floor = driven.wheel, driven.floor
    along, across = wheel_velocity(wheel, twist[0], twist[1], twist[2])
    rim = wheel.wheel.radius * wheel_speed
    slip, sideways = contact_velocity(wheel, rim, along, across)
    rolling = rolling_speed(floor, rim, along, sideways)
    grip = wheel.grip * load_factor(floor, wheel.normal)
    traction = wheel.normal * grip * steady_ratio(floor, slip, rolling, smoothing)
    _, resisted = rolling_resistance(floor, max(abs(rim), abs(along)), sideways)
    dry = (wheel.wheel.roller_dry + resisted) * math.tanh(sideways / smoothing)
    drag = wheel.normal * (dry + wheel.wheel.roller_viscous * sideways)
    forces[0], forces[1] = contact_force(wheel, traction, drag)
    forces[2], forces[3] = rim, sideways


@kernel
def _resultant(model, wheel_speed, twist, extra, smoothing, total, forces):
    """Forces of all wheels and of gravity on the body, moment over 1 m about the centre of mass."""
    body = body_at(model.body)
    total[0], total[1], total[2] = body.mass * body.slope_x, body.mass * body.slope_y, 0.0
    for i in range(wheel_speed.size):
        driven = driven_wheel(model, i)
        steady_force(driven, wheel_speed[i], twist, smoothing, forces)
        ahead, aside = forces[0], forces[1]
        if extra.size > 3:
            place = forces[2] if extra[0] == 0.0 else forces[3]
            force = _tabulated(extra, place)
            ahead += force if extra[0] == 0.0 else 0.0
            aside -= force if extra[0] != 0.0 else 0.0
        x, y, z = body_force(driven.wheel, body, ahead, aside)
        total[0] += x
        total[1] += y
        total[2] += z


@kernel
def _tabulated(extra, place):
    """Force of a free curve [variable, low, high, force at knots …] at a value of its variable [N]."""
    knots = extra.size - 3
    share = (place - extra[1]) / (extra[2] - extra[1]) * (knots - 1)
    share = min(max(share, 0.0), knots - 1.0)
    k = min(int(share), knots - 2)
    return extra[3 + k] + (share - k) * (extra[4 + k] - extra[3 + k])


@kernel
def steady_twist(model, wheel_speed, extra, twist):
    """Body twist at which all forces on the body balance, by friction that becomes sharper step by step.

    Args:
      model: `PlanarModel`; effect terms are left out.
      wheel_speed: φ̇ of each wheel, shape (n,) [rad/s].
      extra: Free curve of an additional force at every wheel, [variable (0: along u over r φ̇, 1: along the
        axle over the rollers' speed), low, high, force at the knots …]; shape (0,) for none.
      twist: First guess, replaced by the solution, shape (3,) [m/s, m/s, rad/s].

    Returns:
      Whether the iteration converged.
    """
    found = False
    for blunter in _BLUNTER:
        found = _balance(model, wheel_speed, extra, blunter * SMOOTHING, twist)
    return found


@kernel
def _balance(model, wheel_speed, extra, smoothing, twist):
    """Damped Newton iteration for one smoothing of friction; whether it converged."""
    arm = 0.0
    for i in range(wheel_speed.size):
        wheel = driven_wheel(model, i).wheel
        arm = max(arm, math.hypot(wheel.position_x, wheel.position_y))
    here, moved = np.empty(3), np.empty(3)
    forces, slopes, trial = np.empty(4), np.empty((3, 3)), np.empty(3)
    _resultant(model, wheel_speed, twist, extra, smoothing, here, forces)
    for _ in range(_ROUNDS):
        for k in range(3):
            size = _STEP if k < 2 else _STEP / arm
            trial[:] = twist
            trial[k] += size
            _resultant(model, wheel_speed, trial, extra, smoothing, moved, forces)
            for j in range(3):
                slopes[j, k] = (moved[j] - here[j]) / size
        for j in range(3):
            slopes[j, j] -= _STIFFNESS * (1.0 if j < 2 else arm * arm)
        step = np.linalg.solve(slopes, -here)
        length = max(abs(step[0]), abs(step[1]), abs(step[2]) * arm)
        if length < _CLOSE:
            return True
        # shorter steps until the rest falls: friction bends where a wheel begins to slide
        before, scale = _size(here, arm), min(1.0, _LONGEST / length)
        for _ in range(_HALVINGS):
            for k in range(3):
                trial[k] = twist[k] + scale * step[k]
            _resultant(model, wheel_speed, trial, extra, smoothing, moved, forces)
            if _size(moved, arm) < before:
                break
            scale *= 0.5
        twist[:], here[:] = trial, moved
    return _size(here, arm) < _SMALL


@kernel
def _size(total, arm):
    """Size of forces and a moment, shape (3,) [N]."""
    return math.sqrt(total[0] ** 2 + total[1] ** 2 + (total[2] / arm) ** 2)


@kernel
def steady_current(driven, wheel_speed, twist, forces):
    """Current that turns a wheel steadily against the floor's force [A].

    Args:
      driven: `DrivenWheel`.
      wheel_speed: φ̇, not zero [rad/s].
      twist: Body twist, shape (3,).
      forces: Scratch, shape (4,).
    """
    steady_force(driven, wheel_speed, twist, SMOOTHING, forces)
    needed = driven.wheel.wheel.radius * forces[0] + _resisting_torque(driven, wheel_speed, forces)
    # the torque of the motor at the wheel rises with the current: by two points on either line of the gear
    low, high = -20.0, 20.0
    for _ in range(60):
        middle = 0.5 * (low + high)
        forward, backward = motor_torque_bounds(driven.motor, middle, wheel_speed, driven.published)
        if (forward if wheel_speed > 0.0 else backward) < needed:
            low = middle
        else:
            high = middle
    return 0.5 * (low + high)


@kernel
def _resisting_torque(driven, wheel_speed, forces):
    """Torque of bearing and rolling resistance on a turning wheel, with `forces` of `steady_force` [N.m]."""
    wheel = driven.wheel.wheel
    dry, viscous = bearing_friction(wheel, driven.wheel.normal, forces[1])
    resisted, _ = rolling_resistance(driven.floor, abs(forces[2]), forces[3])
    dry += (wheel.rolling + resisted) * driven.wheel.normal * wheel.radius
    return viscous * wheel_speed + math.copysign(dry, wheel_speed)


@kernel
def traction_rows(model, rows, wheel_speed, found):
    """Slip, rolling speed and F/F_N of every wheel, the force by its motor's current.

    Args:
      model: `PlanarModel` of the runs' floor.
      rows: Body twist and currents of each block, shape (blocks, 3 + n).
      wheel_speed: φ̇ in each block, shape (blocks, n) [rad/s].
      found: Filled with slip velocity and rolling speed [m/s] and F/F_N along the drive,
        shape (blocks, n, 3).
    """
    forces = np.empty(4)
    for b in range(wheel_speed.shape[0]):
        for i in range(wheel_speed.shape[1]):
            driven, speed = driven_wheel(model, i), wheel_speed[b, i]
            steady_force(driven, speed, rows[b, :3], SMOOTHING, forces)
            forward, backward = motor_torque_bounds(driven.motor, rows[b, 3 + i], speed, driven.published)
            torque = forward if speed > 0.0 else backward
            force = (torque - _resisting_torque(driven, speed, forces)) / driven.wheel.wheel.radius
            along, _ = wheel_velocity(driven.wheel, rows[b, 0], rows[b, 1], rows[b, 2])
            found[b, i, 0] = forces[2] - along
            found[b, i, 1] = math.hypot(max(abs(forces[2]), abs(along)), forces[3])
            found[b, i, 2] = force / driven.wheel.normal


@kernel
def steady_rows(model, wheel_speed, extra, rows):
    """Body twist and currents of every block of steady driving.

    Args:
      model: `PlanarModel` of the runs' floor.
      wheel_speed: φ̇ in each block, shape (blocks, n) [rad/s].
      extra: As for `steady_twist`.
      rows: Filled with twist and currents, first guess of the twist in its place, shape (blocks, 3 + n).
    """
    forces = np.empty(4)
    for b in range(wheel_speed.shape[0]):
        steady_twist(model, wheel_speed[b], extra, rows[b, :3])
        for i in range(wheel_speed.shape[1]):
            driven = driven_wheel(model, i)
            rows[b, 3 + i] = steady_current(driven, wheel_speed[b, i], rows[b, :3], forces)
