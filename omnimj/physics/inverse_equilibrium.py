"""Inverse of `equilibrium`: the wheel speeds at which a wanted body twist is the steady one.

With the twist given, the floor's force on wheel i depends on its own speed alone, and Σ F(φ̇) = 0 are three
equations for n wheel speeds. Three wheels have one solution; of more, that which lies closest to rolling is
taken: min Σ (r φ̇ − r φ̇_roll)² subject to Σ F = 0, by damped Gauss-Newton steps in p = r φ̇,

    δ = d + Jᵀ (J Jᵀ)⁻¹ (−F − J d),   d = p_roll − p,   J = ∂ΣF/∂p.

No solution exists where traction cannot overcome the drag of rollers and floor.
"""

from __future__ import annotations

import math

import numpy as np

from omnimj.physics.equilibrium import steady_force
from omnimj.physics.native import kernel
from omnimj.physics.planar import body_at, body_force, driven_wheel
from omnimj.physics.planar_wheel import wheel_velocity

_STEP = 1e-6  # [m/s] for derivatives
_LONGEST = 0.05  # [m/s] of a wheel's rim in one step
_HALVINGS = 8
_CLOSE, _NEAR, _SMALL = 1e-8, 1e-5, 1e-3  # [m/s] of a step, [m/s] of one that is left, [N] of the rest
_SINGULAR = 1e-11  # share of the largest slope, squared, that keeps J Jᵀ invertible


@kernel
def rolling_rim(wheel, twist):
    """r φ̇ at which a wheel rolls without slip, p = V + (cos γ/sin γ) V_across [m/s].

    Args:
      wheel: `PlanarWheel`.
      twist: v_x, v_y, yaw rate in the body frame, shape (3,).
    """
    along, across = wheel_velocity(wheel, twist[0], twist[1], twist[2])
    return along + across * wheel.roller_cos / wheel.roller_sin


@kernel
def _share(driven, body, rim, twist, smoothing, arm, forces):
    """Force of one wheel on the body, and its moment about the centre of mass over a length [N, N, N]."""
    wheel = driven.wheel
    steady_force(driven, rim / wheel.wheel.radius, twist, smoothing, forces)
    x, y, z = body_force(wheel, body, forces[0], forces[1])
    return x, y, z / arm


@kernel
def _arm(model):
    """Largest distance of a wheel from the middle [m]."""
    arm = 0.0
    for i in range(model.wheels.shape[0]):
        wheel = driven_wheel(model, i).wheel
        arm = max(arm, math.hypot(wheel.position_x, wheel.position_y))
    return arm


@kernel
def _rest(model, rims, twist, smoothing, arm, rest, slopes, forces):
    """Fill the sum of all forces, shape (3,), and its slopes over the rims' speeds, shape (3, n).

    Slopes of shape (3, 0) are left out. Returns the size of the sum [N].
    """
    body = body_at(model.body)
    rest[0], rest[1], rest[2] = body.mass * body.slope_x, body.mass * body.slope_y, 0.0
    for i in range(rims.size):
        driven = driven_wheel(model, i)
        x, y, z = _share(driven, body, rims[i], twist, smoothing, arm, forces)
        rest[0] += x
        rest[1] += y
        rest[2] += z
        if slopes.shape[1] > 0:
            a, b, c = _share(driven, body, rims[i] + _STEP, twist, smoothing, arm, forces)
            slopes[0, i], slopes[1, i], slopes[2, i] = (a - x) / _STEP, (b - y) / _STEP, (c - z) / _STEP
    return math.sqrt(rest[0] ** 2 + rest[1] ** 2 + rest[2] ** 2)


@kernel
def _solved(slopes, right):
    """y of (J Jᵀ) y = b by the adjugate; `slopes` J of shape (3, n), b as three numbers."""
    xx = yy = zz = xy = xz = yz = 0.0
    for i in range(slopes.shape[1]):
        x, y, z = slopes[0, i], slopes[1, i], slopes[2, i]
        xx, yy, zz = xx + x * x, yy + y * y, zz + z * z
        xy, xz, yz = xy + x * y, xz + x * z, yz + y * z
    added = _SINGULAR * max(xx, yy, zz) + 1e-12
    xx, yy, zz = xx + added, yy + added, zz + added
    a, b, c = yy * zz - yz * yz, xz * yz - xy * zz, xy * yz - xz * yy
    d, e, f = xx * zz - xz * xz, xy * xz - xx * yz, xx * yy - xy * xy
    whole = xx * a + xy * b + xz * c
    p, q, r = right
    return (
        (a * p + b * q + c * r) / whole,
        (b * p + d * q + e * r) / whole,
        (c * p + e * q + f * r) / whole,
    )


@kernel
def _direction(slopes, rest, rolling, rims, step):
    """Fill the full step δ, shape (n,); returns its largest part [m/s]."""
    n = rims.size
    p, q, r = -rest[0], -rest[1], -rest[2]
    for i in range(n):
        back = rolling[i] - rims[i]
        p, q, r = p - slopes[0, i] * back, q - slopes[1, i] * back, r - slopes[2, i] * back
    x, y, z = _solved(slopes, (p, q, r))
    length = 0.0
    for i in range(n):
        pulled = slopes[0, i] * x + slopes[1, i] * y + slopes[2, i] * z
        step[i] = rolling[i] - rims[i] + pulled
        length = max(length, abs(step[i]))
    return length


@kernel
def approach_rims(model, twist, smoothing, rounds, rims):
    """Take rim speeds towards those at which a twist is steady, by at most so many damped steps.

    Args:
      model: `PlanarModel`; effect terms are left out.
      twist: Wanted v_x, v_y, yaw rate in the body frame, shape (3,).
      smoothing: Velocity over which dry friction changes its sign [m/s].
      rounds: Largest number of steps.
      rims: r φ̇ of each wheel, a guess that is improved in place, shape (n,) [m/s].

    Returns:
      Whether the forces balance and the last step was short, and the sum of all forces that is left [N].
    """
    n, arm = rims.size, _arm(model)
    rest, moved, forces = np.empty(3), np.empty(3), np.empty(4)
    slopes, none = np.empty((3, n)), np.empty((3, 0))
    rolling, step, trial = np.empty(n), np.empty(n), np.empty(n)
    for i in range(n):
        rolling[i] = rolling_rim(driven_wheel(model, i).wheel, twist)
    size = length = left = np.inf
    for k in range(rounds):
        size = left = _rest(model, rims, twist, smoothing, arm, rest, slopes, forces)
        length = _direction(slopes, rest, rolling, rims, step)
        if not math.isfinite(length):
            return False, np.inf
        # later steps are halved: those along J's null space leave out its curvature and may swing
        scale, better = min(1.0, _LONGEST / max(length, _CLOSE)), False
        scale *= 0.5 if 4 * k > rounds + 4 else 1.0
        for _ in range(_HALVINGS):
            for i in range(n):
                trial[i] = rims[i] + scale * step[i]
            left = _rest(model, trial, twist, smoothing, arm, moved, none, forces)
            better = left < max(size, _SMALL)
            if better:
                break
            scale *= 0.5
        if not better or (length < _CLOSE and size < _SMALL):
            left = size
            break
        rims[:] = trial
    return size < _SMALL and length < _NEAR, left
