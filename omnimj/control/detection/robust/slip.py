"""The slip channel: each wheel against the body velocity estimated without this wheel.

Velocity v of the body by accelerometer and gyro, v̇ = a − b − ω × v, corrected by the wheels that are taken
to roll: r φ̇_i − creep_i = u_i·v + l_i ω.  One filter per wheel leaves that wheel out; its
  e_i = r φ̇_i − creep_i − u_i·v̂ − l_i ω
is slip beyond what the traction explains. A healthy floor creeps under its traction by
  s = (F̂/F_N − σ_0 z)/σ,   ż = s − σ_0 |s|/μ z:
every floor that was measured has a σ near 2.5 s/m. Stone is soft: its bristles give way for 0.2 s after every
change of traction; PVC and paperboard are stiff. creep_i is the mean of both, uncertain by their difference.
Slip is thus distinguished from health by traction: under F̂ a healthy wheel creeps by no less than on a
strong floor and no more than on a weak one (soft or slick); a wheel that moves beyond these bounds in the
direction of its force has lost grip. No velocity enters the bounds, so that its error counts once and never
grows.

In the kernels `robot` is `RobotConstants`, `parameters` `RobustParameters`, `block` `Block`, i the wheel and
t a duration [s]. `x` and `cov` are state and covariance of one filter, shape (STATE,) and (STATE, STATE);
`creep` is the expected creep of each wheel and its uncertainty, shape (n, 2) [m/s]; u_x, u_y is the direction
of a wheel in the body. A floor has the `stiffness` σ_0 [1/m] and the `friction` μ [1]; z is the deflection of
its bristle at the beginning [m], `slip` s [m/s], `share` F̂/F_N [1].
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from omnimj.control.robot_constants import CREEP_SLOPE
from omnimj.physics.native import kernel

SOFT_FLOOR, STIFF_FLOOR = (11.5, 0.12), (50.0, 0.09)
"""σ_0 [1/m] and μ [1] of stone, and of a floor between PVC and paperboard."""
WEAK_FLOORS, STRONG_FLOORS = ((9.2, 0.096), (44.0, 0.032)), ((9.2, 0.096), (50.0, 0.12))
"""σ_0 and μ of the floors that bound creep: stone and paperboard less a fifth, and a soft and a stiff one."""
WEAKER, STRONGER = 0.8, 1.6
"""Factors on the load of the bounding floors: loads of the wheels differ."""
STATE = 4
"""States of a filter: v_x, v_y [m/s], bias of the accelerometer x and y [m/s²]."""
ROW_NOISE = 0.01
"""Noise of a wheel's velocity per rad/s of yaw rate, beside those of `ObserverGains` [m]."""
_COLOUR = 6.0  # blocks over which a wheel's error is correlated: its variance counts so many times
_UNKNOWN_ACCELERATION = 1.0  # [m/s²] deviation along an axis whose accelerometer has failed
_WANDER = 1e-4  # [m/s²] of the accelerometer's bias per block, and of the slope that it reads as one
_GATE = 3.0  # standard deviations beyond which an innovation is clipped (Huber)


class VelocityNoise(NamedTuple):
    """Standard deviations of the velocity filters, from `ObserverGains`."""

    wheel: float
    """Velocity of a rolling wheel [m/s]."""
    creep: float
    """The same per creep [1]."""
    acceleration: float
    """Mean of the accelerometer over a block [m/s²]."""


@kernel
def bristle_after(z, slip, stiffness, friction, t):
    """Bristle deflection after t seconds of steady slip, exactly [m]."""
    if slip == 0.0:
        return z
    end = math.copysign(friction / stiffness, slip)
    return end + (z - end) * math.exp(-stiffness * abs(slip) / friction * t)


@kernel
def next_creep(share, z, stiffness, friction, t):
    """Creep of a floor under a traction over one block [m/s], and its bristle deflection at the end [m]."""
    after = bristle_after(z, (share - stiffness * z) / CREEP_SLOPE, stiffness, friction, t)
    return (share - 0.5 * stiffness * (z + after)) / CREEP_SLOPE, after


@kernel
def healthy_creep_bounds(share, bristles, t):
    """Smallest and largest creep of a healthy wheel [m/s].

    Args:
      bristles: Deflections on the weak floors and the strong ones, shape (4,), updated in place [m].
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
def predict_velocity(parameters, block, excluded_axes, x, cov):
    """Prediction of one filter by one block, v⁺ = v + T (a − b + (ω v_y, −ω v_x)), in place.

    Args:
      excluded_axes: Axes whose accelerometer has failed, shape (2,).
    """
    t, turning = block.duration, block.yaw_rate
    v_x, v_y = x[0], x[1]
    along = 0.0 if excluded_axes[0] else block.acceleration[0] - x[2]
    across = 0.0 if excluded_axes[1] else block.acceleration[1] - x[3]
    x[0] += t * (along + turning * v_y)
    x[1] += t * (across - turning * v_x)
    f = np.eye(STATE)
    f[0, 1], f[1, 0], f[0, 2], f[1, 3] = t * turning, -t * turning, -t, -t
    cov[:, :] = f @ cov @ f.T
    for k in range(2):
        deviation = _UNKNOWN_ACCELERATION if excluded_axes[k] else parameters.noise.acceleration
        cov[k, k] += (t * deviation) ** 2
        cov[k + 2, k + 2] += _WANDER * _WANDER


@kernel
def update_velocity(x, cov, u_x, u_y, innovation, noise):
    """Correction of one filter by one wheel, in place; a large innovation is clipped (Huber).

    Args:
      innovation: y − u·v [m/s].
      noise: Standard deviation of y [m/s].
    """
    g = np.empty(STATE)
    for j in range(STATE):
        g[j] = cov[j, 0] * u_x + cov[j, 1] * u_y
    variance = u_x * g[0] + u_y * g[1] + _COLOUR * noise * noise
    variance *= max(1.0, abs(innovation) / (_GATE * math.sqrt(variance)))
    for j in range(STATE):
        x[j] += g[j] * innovation / variance
    for j in range(STATE):
        for q in range(STATE):
            cov[j, q] -= g[j] * g[q] / variance


@kernel
def correct_velocity(parameters, block, creep, included, left_out, x, cov):
    """Correction of one filter by all included wheels but one, in place.

    Args:
      included: Mask of the wheels that are taken to roll, shape (n,).
      left_out: Wheel that is left out, or −1.
    """
    robot, noise = parameters.robot, parameters.noise
    for i in range(included.size):
        if i == left_out or not included[i]:
            continue
        innovation = slip_residual(robot, block, creep, x, i)
        deviation = noise.wheel + ROW_NOISE * abs(block.yaw_rate)
        deviation += noise.creep * abs(creep[i, 0])
        deviation += creep[i, 1]
        update_velocity(x, cov, robot.forces[0, i], robot.forces[1, i], innovation, deviation)


@kernel
def wheel_slip(robot, block, x, i):
    """Slip velocity of wheel i at a filter's state, creep included [m/s]."""
    forces = robot.forces
    rolling = forces[0, i] * x[0] + forces[1, i] * x[1] + forces[2, i] * block.yaw_rate
    return robot.radius[i] * block.wheel_speed[i] - rolling


@kernel
def slip_residual(robot, block, creep, x, i):
    """Residual e_i of wheel i at a filter's state: slip beyond the expected creep [m/s]."""
    return wheel_slip(robot, block, x, i) - creep[i, 0]


@kernel
def speed_deviation(cov, u_x, u_y):
    """Standard deviation of the estimated velocity along a direction, u·v̂ [m/s]."""
    along = u_x * u_x * cov[0, 0] + 2.0 * u_x * u_y * cov[0, 1] + u_y * u_y * cov[1, 1]
    return math.sqrt(max(along, 0.0))
