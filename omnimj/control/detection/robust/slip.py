"""The slip channel: each wheel against a body velocity that this wheel had no say in.

Velocity v of the body by accelerometer and gyro, v̇ = a − b − ω × v, corrected by wheels that are believed to
roll:  r φ̇_i − creep_i = u_i·v + l_i ω.  One filter per wheel leaves that wheel out; its
  e_i = r φ̇_i − creep_i − u_i·v̂ − l_i ω
is slip beyond what the traction explains. A healthy floor creeps under its traction by
  s = (F̂/F_N − σ_0 z)/σ,   ż = s − σ_0 |s|/μ z:
every floor that was measured has a σ near 2.5 s/m. Stone is soft: its bristles give way for 0.2 s after every
change of traction; PVC and paperboard are stiff. creep_i is the mean of both, in doubt by what they differ.

So slip is told from health by traction: what a healthy wheel may creep under F̂ lies between the creep of a
weak floor, soft or slick, and that of a strong one; a wheel that moves beyond them in the direction of its
force has lost grip. No velocity enters the bounds, so that its error counts once and never grows.
"""

from __future__ import annotations

import math

import numpy as np

from omnimj.control.robot_constants import ACCELERATION_NOISE, CREEP_NOISE, RADIUS, TIME, WHEEL_NOISE
from omnimj.physics.native import kernel

CREEP_SLOPE = 2.5
"""σ of every floor [s/m]."""
SOFT_FLOOR, STIFF_FLOOR = (11.5, 0.12), (50.0, 0.09)
"""σ_0 [1/m] and μ [1] of stone, and of what is between PVC and paperboard."""
WEAK_FLOORS, STRONG_FLOORS = ((9.2, 0.096), (44.0, 0.032)), ((9.2, 0.096), (50.0, 0.12))
"""σ_0 and μ of the floors that bound creep: stone and paperboard less a fifth, and a soft and a stiff one."""
WEAKER, STRONGER = 0.8, 1.6
"""How much of its traction a weak wheel carries beside, for its load, and a strong one."""
STATE = 4
"""Of a filter: v_x, v_y [m/s], bias of the accelerometer x and y [m/s²]."""
ROW_NOISE = 0.01
"""Standard deviation of a wheel's word per rad/s of yaw rate, beside those of `ObserverGains` [m]."""
_COLOUR = 6.0  # blocks in which the error of a wheel's word stays alike: its variance counts so many times
_ANY = 1.0  # [m/s²] of a robot whose accelerometer lies
_WANDER = 1e-4  # [m/s²] of the accelerometer's bias per block, and of the slope that it reads as one
_GATE = 3.0  # standard deviations beyond which a wheel's word no longer grows


@kernel
def next_creep(share, z, stiffness, holds, t):
    """Creep of a floor under a traction over one block [m/s], and its bristle at the end [m].

    Args:
      share: F̂/F_N.
      z: Bristle at the beginning [m].
      stiffness: σ_0 [1/m].
      holds: μ.
      t: Length of the block [s].
    """
    after = bristle_after(z, (share - stiffness * z) / CREEP_SLOPE, stiffness, holds, t)
    return (share - 0.5 * stiffness * (z + after)) / CREEP_SLOPE, after


@kernel
def predict_velocity(c, x, cov, acceleration, deaf, turning):
    """One block further: v⁺ = v + T (a − b + (ω v_y, −ω v_x)), in place.

    Args:
      c: `robot_constants.robot_constants`.
      x: State, shape (STATE,).
      cov: Shape (STATE, STATE).
      acceleration: Shape (2,) [m/s²].
      deaf: 1 for axes along which it lies, shape (2,).
      turning: Gyro [rad/s].
    """
    t = c[TIME]
    v_x, v_y = x[0], x[1]
    x[0] += t * ((acceleration[0] - x[2]) * (1.0 - deaf[0]) + turning * v_y)
    x[1] += t * ((acceleration[1] - x[3]) * (1.0 - deaf[1]) - turning * v_x)
    f = np.eye(STATE)
    f[0, 1], f[1, 0], f[0, 2], f[1, 3] = t * turning, -t * turning, -t, -t
    cov[:, :] = f @ cov @ f.T
    for k in range(2):
        cov[k, k] += (t * (_ANY if deaf[k] != 0.0 else c[ACCELERATION_NOISE])) ** 2
        cov[k + 2, k + 2] += _WANDER * _WANDER


@kernel
def update_velocity(x, cov, u_x, u_y, away, noise):
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
def slip_residual(c, forces, speed, turning, creep, x, i):
    """e_i of wheel i at a filter's state [m/s]."""
    return wheel_slip(c, forces, speed, turning, x, i) - creep[i, 0]


@kernel
def correct_velocity(c, forces, speed, turning, creep, believed, left_out, x, cov):
    """All wheels that are believed, but for one, speak to a filter.

    Args:
      c: `robot_constants.robot_constants`.
      forces: B, shape (3, n).
      speed: Shape (n,) [rad/s].
      turning: Gyro [rad/s].
      creep: Of each wheel, and its doubt, shape (n, 2) [m/s].
      believed: 1 for wheels that are taken to roll, shape (n,).
      left_out: The wheel that has no say, or −1.
      x: State, changed.
      cov: Covariance, changed.
    """
    for i in range(speed.size):
        if i == left_out or believed[i] == 0.0:
            continue
        away = slip_residual(c, forces, speed, turning, creep, x, i)
        noise = c[WHEEL_NOISE] + ROW_NOISE * abs(turning) + c[CREEP_NOISE] * abs(creep[i, 0]) + creep[i, 1]
        update_velocity(x, cov, forces[0, i], forces[1, i], away, noise)


@kernel
def wheel_slip(c, forces, speed, turning, x, i):
    """s of wheel i at a filter's state: all of its slip [m/s]."""
    rolling = forces[0, i] * x[0] + forces[1, i] * x[1] + forces[2, i] * turning
    return c[RADIUS] * speed[i] - rolling


@kernel
def bristle_after(z, slip, stiffness, holds, t):
    """z after t seconds of steady slip, exactly [m]."""
    if slip == 0.0:
        return z
    end = math.copysign(holds / stiffness, slip)
    return end + (z - end) * math.exp(-stiffness * abs(slip) / holds * t)


@kernel
def healthy_creep_bounds(share, bristles, t):
    """Least and largest creep of a healthy wheel [m/s].

    Args:
      share: F̂/F_N.
      bristles: Of the weak floors and the strong ones, shape (4,), brought up to date [m].
      t: Length of the block [s].
    """
    soft, bristles[0] = next_creep(share / WEAKER, bristles[0], WEAK_FLOORS[0][0], WEAK_FLOORS[0][1], t)
    slick, bristles[1] = next_creep(share / WEAKER, bristles[1], WEAK_FLOORS[1][0], WEAK_FLOORS[1][1], t)
    tough, bristles[2] = next_creep(
        share / STRONGER, bristles[2], STRONG_FLOORS[0][0], STRONG_FLOORS[0][1], t
    )
    stiff, bristles[3] = next_creep(
        share / STRONGER, bristles[3], STRONG_FLOORS[1][0], STRONG_FLOORS[1][1], t
    )
    return min(min(soft, slick), min(tough, stiff)), max(max(soft, slick), max(tough, stiff))


@kernel
def speed_deviation(cov, u_x, u_y):
    """Standard deviation of u·v̂ [m/s]."""
    across = u_x * u_x * cov[0, 0] + 2.0 * u_x * u_y * cov[0, 1] + u_y * u_y * cov[1, 1]
    return math.sqrt(max(across, 0.0))
