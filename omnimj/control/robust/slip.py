"""The slip channel: each wheel against a body velocity that this wheel had no say in.

Velocity v of the body by accelerometer and gyro, v̇ = a − b − ω × v, corrected by wheels that are believed to
roll:  r φ̇_i − creep(F̂_i) = u_i·v + l_i ω.  One filter per wheel leaves that wheel out; its
  e_i = r φ̇_i − creep(F̂_i) − u_i·v̂ − l_i ω
is slip beyond what the traction explains. creep(F) = (|F|/F_N − μ)/σ sign F: every floor that was measured
has a slope near 2.5 s/m and holds 0.04-0.12 before it creeps.

A bristle of a soft floor gives way by 10 mm before it pulls with all that it has, in which a healthy wheel
seems to slip. So slip is told from health by the force that the weakest healthy floor would have made of it,
  F_w = κ F_N (min over soft, slick of σ_0 z + σ s),   ż = s − σ_0 |s|/μ z,  s = r φ̇_i − u_i·v̂ − l_i ω,
κ what floor and load have been seen to be. The shortfall in terms of speed, (F_w − F̂)/(σ F_N), counts.
"""

from __future__ import annotations

import math

import numpy as np

from omnimj.control.robust.constants import LOAD, RADIUS, TIME
from omnimj.physics.native import kernel

HOLDS, SLOPE = 0.09, 2.5
"""μ [1] and σ [s/m] of creep(F)."""
SOFT, SLICK = (9.2, 0.096), (44.0, 0.032)
"""σ_0 [1/m] and μ [1] of the two floors that are weakest in their own way: natural stone and paperboard, less
a fifth."""
STRONGER = 1.6
"""Of a floor that is strong instead of weak: it pushes back harder while its bristles turn round."""
STATE = 4
"""Of a filter: v_x, v_y [m/s], bias of the accelerometer x and y [m/s²]."""
WHEEL_NOISE, CREEP_NOISE, ROW_NOISE = 0.004, 0.35, 0.01
"""Standard deviation of a wheel's word: [m/s], per m/s of creep, per rad/s of yaw rate [m]."""
_COLOUR = 6.0  # blocks in which the error of a wheel's word stays alike: its variance counts so many times
_ACCELERATION = 0.04  # [m/s²] of a block mean: noise, and gravity while the body pitches on its springs
_WANDER = 1e-4  # [m/s²] of the accelerometer's bias per block, and of the slope that it reads as one
_GATE = 3.0  # standard deviations beyond which a wheel's word no longer grows


@kernel
def creep(c, force):
    """Slip velocity that goes with a traction force on an ordinary floor [m/s]."""
    share = abs(force) / c[LOAD]
    return math.copysign(max(share - HOLDS, 0.0) / SLOPE, force)


@kernel
def predict(c, x, cov, acceleration, turning):
    """One block further: v⁺ = v + T (a − b + (ω v_y, −ω v_x)), in place.

    Args:
      c: `constants.numbers`.
      x: State, shape (STATE,).
      cov: Shape (STATE, STATE).
      acceleration: Shape (2,) [m/s²].
      turning: Gyro [rad/s].
    """
    t = c[TIME]
    v_x, v_y = x[0], x[1]
    x[0] += t * (acceleration[0] - x[2] + turning * v_y)
    x[1] += t * (acceleration[1] - x[3] - turning * v_x)
    f = np.eye(STATE)
    f[0, 1], f[1, 0], f[0, 2], f[1, 3] = t * turning, -t * turning, -t, -t
    cov[:, :] = f @ cov @ f.T
    for k in range(2):
        cov[k, k] += (t * _ACCELERATION) ** 2
        cov[k + 2, k + 2] += _WANDER * _WANDER


@kernel
def hear(x, cov, u_x, u_y, away, noise):
    """A wheel's word, y − u·v is `away`, into state and covariance; one that is far off is cut (Huber)."""
    g = np.empty(STATE)
    for j in range(STATE):
        g[j] = cov[j, 0] * u_x + cov[j, 1] * u_y
    spread = u_x * g[0] + u_y * g[1]
    size = spread + _COLOUR * noise * noise
    size *= max(1.0, abs(away) / (_GATE * math.sqrt(size)))
    for j in range(STATE):
        x[j] += g[j] * away / size
    for j in range(STATE):
        for q in range(STATE):
            cov[j, q] -= g[j] * g[q] / size


@kernel
def away_from_rolling(c, forces, speed, turning, force, x, i):
    """e_i of wheel i at a filter's state [m/s]."""
    rolling = forces[0, i] * x[0] + forces[1, i] * x[1] + forces[2, i] * turning
    return c[RADIUS] * speed[i] - creep(c, force[i]) - rolling


@kernel
def correct(c, forces, speed, turning, force, believed, left_out, x, cov):
    """All wheels that are believed, but for one, speak to a filter.

    Args:
      c: `constants.numbers`.
      forces: B, shape (3, n).
      speed: Shape (n,) [rad/s].
      turning: Gyro [rad/s].
      force: F̂, shape (n,) [N].
      believed: 1 for wheels that are taken to roll, shape (n,).
      left_out: The wheel that has no say, or −1.
      x: State, changed.
      cov: Covariance, changed.
    """
    for i in range(speed.size):
        if i == left_out or believed[i] == 0.0:
            continue
        away = away_from_rolling(c, forces, speed, turning, force, x, i)
        noise = WHEEL_NOISE + ROW_NOISE * abs(turning) + CREEP_NOISE * abs(creep(c, force[i]))
        hear(x, cov, forces[0, i], forces[1, i], away, noise)


@kernel
def slid(c, forces, speed, turning, x, i):
    """s of wheel i at a filter's state: all of its slip [m/s]."""
    rolling = forces[0, i] * x[0] + forces[1, i] * x[1] + forces[2, i] * turning
    return c[RADIUS] * speed[i] - rolling


@kernel
def next_bristle(z, slip, stiffness, holds, t):
    """z after t seconds of steady slip, exactly [m]."""
    if slip == 0.0:
        return z
    end = math.copysign(holds / stiffness, slip)
    return end + (z - end) * math.exp(-stiffness * abs(slip) / holds * t)


@kernel
def weakest_pull(slip, toward, soft, slick):
    """(σ_0 z + σ s) of the weaker of both floors in the direction `toward` (±1) [1].

    It is below 0 while bristles still push the other way; there the stronger floor counts.
    """
    held = min(toward * SOFT[0] * soft, toward * SLICK[0] * slick)
    if held < 0.0:
        held *= STRONGER
    return held + SLOPE * toward * slip


@kernel
def spread_of(cov, u_x, u_y):
    """Standard deviation of u·v̂ [m/s]."""
    across = u_x * u_x * cov[0, 0] + 2.0 * u_x * u_y * cov[0, 1] + u_y * u_y * cov[1, 1]
    return math.sqrt(max(across, 0.0))
