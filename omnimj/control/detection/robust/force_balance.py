"""The force channel: what accelerates the body against what the motors give, ρ = L + B F̂ − M a.

F̂_i = (K_t i E G_r/r − dry σ(φ̇) − viscous φ̇ − I_eff φ̈/r) comes from the joint side, so no friction law of
the floor enters: the channel is blind to slip and to the floor. M a is accelerometer and gyro. What may be
wrong of it in health is written as columns of a linear law

  ρ = X θ + noise,  θ = [δ_1…n, ν_1…n, β_x, β_y, λ, μ, ι, h_1…n, k_1…n]

δ loss of torque constant and ν excess of dry friction per wheel, β accelerometer bias, λ excess of the
rollers' friction, μ excess of mass, ι of inertia; h and k what the friction of a wheel or of its rollers
holds while it stands, −1 … 1, which nobody knows and nobody learns.
"""

from __future__ import annotations

import math

import numpy as np

from omnimj.control.robot_constants import (
    DRY,
    EFFICIENCY,
    INERTIA,
    LOAD,
    MASS,
    RADIUS,
    ROLLER_DRY,
    ROLLER_VISCOUS,
    TORQUE,
    VISCOUS,
    YAW_INERTIA,
)
from omnimj.physics.native import kernel

SLOW = 1.5
"""Wheel speed below which the sign of dry friction is not known [rad/s]."""
SLOW_SIDEWAYS = 0.05
"""The same of rollers [m/s]."""
_UNKNOWN = 1e4  # [N²]
_NOT_JUDGED = 0.5  # standard deviation of the loss of a motor that is not judged
_PULLS = 5.0  # × dry friction: from there on a slow wheel tells of a motor that is known to be weak
_TURNING = 0.3  # [rad/s] width of the sign
_SIDEWAYS = 0.01  # [m/s] the same for the rollers
NOISE = (1.0, 1.0, 0.6)
"""Standard deviation of ρ in a block of 10 ms: N, N, N.m; accelerometer, gyro's difference, rollers."""


@kernel
def columns(wheels):
    """Length of θ."""
    return 4 * wheels + 5


@kernel
def lasting(wheels):
    """How many of them, the first ones, are numbers of the robot that last."""
    return 2 * wheels + 5


@kernel
def wheel_force(c, current, speed, rate, loss, friction):
    """F̂ of one wheel [N], and what the gear makes of its shaft's torque besides E G_r.

    Args:
      c: `robot_constants.robot_constants`.
      current: Mean over the block [A].
      speed: φ̇ [rad/s].
      rate: φ̈ [rad/s²].
      loss: Share of the torque constant that is believed to be gone.
      friction: Excess of dry friction that is believed in.
    """
    sign = math.tanh(speed / _TURNING)
    force = c[TORQUE] * current * (1.0 - loss) - c[VISCOUS] * speed - (1.0 + friction) * c[DRY] * sign
    through = 1.0
    if force * sign < 0.0:  # driven by the floor: the gear takes its share the other way
        through = 1.0 / (c[EFFICIENCY] * c[EFFICIENCY])
    return through * force - c[INERTIA] * rate, through


@kernel
def balance(c, forces, across, current, speed, rate, acceleration, turning, spin, loss, x, rho, wheel, side):
    """Fills X, shape (3, p), ρ, shape (3,), and of the wheels F̂ and what the rollers do, of one block.

    Args:
      c: `robot_constants.robot_constants`.
      forces: B, shape (3, n).
      across: Shape (n, 3).
      current: Shape (n,) [A].
      speed: Shape (n,) [rad/s].
      rate: Shape (n,) [rad/s²].
      acceleration: Shape (2,) [m/s²].
      turning: Gyro [rad/s].
      spin: Its rate [rad/s²].
      loss: Believed losses of the torque constants, shape (n,).
      x: Output.
      rho: Output [N, N, N.m].
      wheel: Output [N].
      side: Output, speeds along the axles, shape (n,) [m/s].
    """
    n = speed.size
    x[:] = 0.0
    rho[0], rho[1], rho[2] = -c[MASS] * acceleration[0], -c[MASS] * acceleration[1], -c[YAW_INERTIA] * spin
    pushes = np.zeros(3)
    twist = rolling_twist(c, forces, speed, turning)
    for i in range(n):
        force, through = wheel_force(c, current[i], speed[i], rate[i], loss[i], 0.0)
        wheel[i] = force
        sideways = across[i, 0] * twist[0] + across[i, 1] * twist[1] + across[i, 2] * turning
        side[i] = sideways
        drag = c[ROLLER_DRY] * math.tanh(sideways / _SIDEWAYS) + c[ROLLER_VISCOUS] * sideways
        for k in range(3):
            x[k, i] = forces[k, i] * through * c[TORQUE] * current[i]
            x[k, n + i] = forces[k, i] * through * c[DRY] * math.tanh(speed[i] / _TURNING)
            x[k, 2 * n + 2] += across[i, k] * c[LOAD] * drag
            rho[k] += forces[k, i] * force - across[i, k] * c[LOAD] * drag
            pushes[k] += forces[k, i] * (force + c[INERTIA] * rate[i]) - across[i, k] * c[LOAD] * drag
    x[0, 2 * n], x[1, 2 * n + 1] = -c[MASS], -c[MASS]
    for k in range(3):
        # what should accelerate the body, without what was differentiated: noise would pull μ and ι to zero
        x[k, 2 * n + 3 if k < 2 else 2 * n + 4] = pushes[k]


@kernel
def rolling_twist(c, forces, speed, turning):
    """v_x, v_y of a body whose wheels roll, least squares with the gyro's yaw rate [m/s]."""
    xx = xy = yy = bx = by = 0.0
    for i in range(speed.size):
        u_x, u_y = forces[0, i], forces[1, i]
        along = c[RADIUS] * speed[i] - forces[2, i] * turning
        xx, xy, yy = xx + u_x * u_x, xy + u_x * u_y, yy + u_y * u_y
        bx, by = bx + u_x * along, by + u_y * along
    det = xx * yy - xy * xy
    return (yy * bx - xy * by) / det, (xx * by - xy * bx) / det


@kernel
def whiten(c, forces, across, current, slowest, sideways, unknown, deaf, weak, x, rho):
    """Scales the rows of X and ρ so that the noise is white and of size 1.

    A wheel that turns slowly, or did a moment ago, holds any friction between ± dry, and goes on to hold it:
    a number h of its own along its column of B, and noise for its changes. So do rollers that hardly turn.
    A slow wheel's motor is not judged meanwhile:
    what that may lack is noise too, or the robot's other numbers would have to answer for it. One that is
    known to be broken is judged all the same where its current is far beyond what friction can hold: a wheel
    that stands for want of its motor shall not hide how little is left.

    Args:
      c: `robot_constants.robot_constants`.
      forces: B, shape (3, n).
      across: Shape (n, 3).
      current: Shape (n,) [A].
      slowest: Smallest |φ̇| of the last tenth of a second, shape (n,) [rad/s].
      sideways: The same of the speed along the axle, shape (n,) [m/s].
      unknown: 1 for wheels whose force nobody knows, shape (n,).
      deaf: 1 for axes along which the accelerometer lies, shape (2,).
      weak: 1 for wheels whose motor is known to be broken, shape (n,).
      x: In and out, shape (3, p).
      rho: In and out, shape (3,).
    """
    cov = np.zeros((3, 3))
    for k in range(3):
        cov[k, k] = NOISE[k] * NOISE[k]
        if k < 2 and deaf[k] != 0.0:
            cov[k, k] = _UNKNOWN
    n, dry, rollers = slowest.size, c[DRY], c[LOAD] * c[ROLLER_DRY]
    held = lasting(n)
    for i in range(slowest.size):
        full = c[TORQUE] * current[i]
        hidden = slowest[i] < SLOW and (weak[i] == 0.0 or abs(full) < _PULLS * dry)
        lacks = _NOT_JUDGED * full if hidden else 0.0
        for k in range(3):
            for j in range(3):
                if unknown[i] != 0.0:
                    cov[k, j] += forces[k, i] * forces[j, i] * _UNKNOWN
                elif slowest[i] < SLOW:
                    cov[k, j] += forces[k, i] * forces[j, i] * (dry * dry + lacks * lacks)
                if sideways[i] < SLOW_SIDEWAYS:
                    cov[k, j] += across[i, k] * across[i, j] * rollers * rollers
            x[k, held + i] = forces[k, i] * dry if hidden else 0.0
            if hidden:  # what its motor gives, its friction may take
                x[k, i] = x[k, n + i] = 0.0
            x[k, held + n + i] = across[i, k] * rollers if sideways[i] < SLOW_SIDEWAYS else 0.0
    # Cholesky factor L, then forward substitution of every column
    low = np.zeros((3, 3))
    for k in range(3):
        for j in range(k + 1):
            rest = cov[k, j]
            for q in range(j):
                rest -= low[k, q] * low[j, q]
            low[k, j] = math.sqrt(rest) if k == j else rest / low[j, j]
    for col in range(x.shape[1] + 1):
        for k in range(3):
            value = x[k, col] if col < x.shape[1] else rho[k]
            for q in range(k):
                value -= low[k, q] * (x[q, col] if col < x.shape[1] else rho[q])
            if col < x.shape[1]:
                x[k, col] = value / low[k, k]
            else:
                rho[k] = value / low[k, k]
