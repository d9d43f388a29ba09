"""Accelerations that the motors' torques predict: the force balance of a robot solved for its motion.

Wheel i pushes the body along column i of B with
  F_i = g (K_i i − dry_i σ(φ̇) − viscous_i φ̇ − J φ̈/r) − axle_i σ(φ̇) − I φ̈/r,
where the bracket is the motor's shaft as far as the gear, J its reflected inertia, and I the wheel's own;
g = 1 while the motor drives and 1/(E E_b) while it is driven. The rollers hold the body back across. With
centre of mass c, P = Σ B_i F_i − drag and the acceleration a of the origin
  m (a_x − ω̇ c_y − ω² c_x) = P_x,   m (a_y + ω̇ c_x − ω² c_y) = P_y,   I ω̇ + m (c_x a_y − c_y a_x) = P_ω.
An accelerometer at r reads a + ω̇ × r − ω² r.
Only currents and wheel speeds, which are hardly noisy, stand on the side of the prediction: noise of the
accelerometer would otherwise make every parameter that it multiplies too small.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from scipy.special import ndtr

from omnimj.control.robot_constants import RobotConstants
from omnimj.estimate.robot.blocks import PERIOD, RunRows
from omnimj.signals import Array

SLOW = 1.5
"""Wheel speed below which the sign of dry friction is unknown [rad/s]."""
SLOW_SIDEWAYS = 0.05
"""Roller speed below which it is unknown [m/s]."""
_TURNING = 0.3  # [rad/s] width of the sign of a wheel's dry friction
_LEAST_RIPPLE = 0.02  # [N] ripple of a force, so that the change of the gear's direction is smooth
_SIDEWAYS = 0.01  # [m/s] width of the sign of its rollers' dry friction


class BalanceConstants(NamedTuple):
    """Constants of the balance of a robot with n wheels."""

    robot: RobotConstants
    """Those of the detector, whose `dry` and `inertia` are shaft and wheel together."""
    axle: Array
    """Part of `dry` behind the gear: bearings, shape (n,) [N]."""
    rotor: Array
    """Part of `inertia` before the gear, shape (n,) [kg.m]."""


class SensorErrors(NamedTuple):
    """Errors of the sensors that all runs share."""

    current: Array
    """Offset of each current monitor, shape (n,) [A]."""
    current_per_yaw_rate: float
    """Error of all currents per yaw rate [A.s/rad]: a log that samples every so many updates of the heading
    always sees the yaw loop's currents at the same moment of an update, and not their mean."""
    acceleration_delay: float
    """Delay of the accelerometer beyond its nominal one [s]."""
    yaw_rate_delay: float
    """The same of the gyro [s]."""


def wheel_forces(constants: BalanceConstants, errors: SensorErrors, rows: RunRows) -> Array:
    """Force F of each wheel on the body, shape (m, n) [N]."""
    c, axle, rotor = constants
    shafts = rows.shafts
    sign = np.tanh(shafts.wheel_speed / _TURNING)
    yaw_rate = c.radius * shafts.wheel_speed @ np.linalg.pinv(c.forces)[:, 2:]
    current = shafts.current - errors.current - errors.current_per_yaw_rate * yaw_rate
    shaft = c.torque * current - c.viscous * shafts.wheel_speed
    shaft -= (c.dry - axle) * sign + rotor * shafts.wheel_acceleration
    forward = np.copysign(1.0, sign)
    # a fast ripple turns rotor and wheel together, a slow one is carried to the floor: half of it each way
    passed = np.sqrt(1.0 - rotor / c.inertia)
    ripple = passed * c.torque * shafts.ripple + _LEAST_RIPPLE
    driven = forward * _mean_negative_part(forward * shaft, ripple)
    force = shaft + (c.driven - 1.0) * driven - axle * sign
    return shafts.averaged(force - (c.inertia - rotor) * shafts.wheel_acceleration)


def _mean_negative_part(mean: Array, deviation: Array) -> Array:
    """Mean of min(F, 0) over a normal F, −s φ(z) + F̄ Φ(−z) with z = F̄/s.

    Within the filter the current ripples, so that near zero the gear changes its direction many times.
    """
    z = mean / deviation
    return mean * ndtr(-z) - deviation * np.exp(-0.5 * z * z) / math.sqrt(2.0 * math.pi)


def roller_speeds(c: RobotConstants, rows: RunRows) -> Array:
    """Speed of each wheel's rollers if all wheels roll, shape (m, n) [m/s]."""
    along = c.radius * rows.wheel_speed - np.outer(rows.yaw_rate, c.forces[2])
    velocity = along @ np.linalg.pinv(c.forces[:2])
    return np.asarray(velocity @ c.across[:, :2].T + np.outer(rows.yaw_rate, c.across[:, 2]), float)


def inertia_matrix(c: RobotConstants) -> Array:
    """Matrix that turns (a_x, a_y, ω̇) at the origin into forces and moment, shape (3, 3)."""
    x, y = c.mass * c.centre
    return np.array([[c.mass, 0.0, -y], [0.0, c.mass, x], [-y, x, c.yaw_inertia]])


def felt_by_turning(place: Array, yaw_rate: Array, yaw_acceleration: Array) -> Array:
    """Acceleration of a place beyond that of the origin, ω̇ × r − ω² r, shape (m, 2) [m/s²].

    Args:
      place: r in the body frame, shape (2,) [m].
      yaw_rate: ω, shape (m,) [rad/s].
      yaw_acceleration: ω̇, shape (m,) [rad/s²].
    """
    x, y = place
    return np.outer(yaw_acceleration, [-y, x]) - np.outer(yaw_rate**2, place)


def predicted_accelerations(constants: BalanceConstants, errors: SensorErrors, rows: RunRows) -> Array:
    """Readings a_x, a_y [m/s²] and ω̇ [rad/s²] without bias, shape (m, 3)."""
    c = constants.robot
    side = roller_speeds(c, rows)
    drag = c.load * (c.roller_dry * np.tanh(side / _SIDEWAYS) + c.roller_viscous * side)
    push = wheel_forces(constants, errors, rows) @ c.forces.T - drag @ c.across
    push[:, :2] += c.mass * np.outer(rows.yaw_rate**2, c.centre)
    motion = push @ np.linalg.inv(inertia_matrix(c)).T
    rate = np.zeros_like(motion)
    for number in np.unique(rows.stretch):
        part = rows.stretch == number
        if part.sum() > 2:
            rate[part] = np.gradient(motion[part], PERIOD, axis=0)
    late = np.array([errors.acceleration_delay] * 2 + [errors.yaw_rate_delay])
    motion -= rate * late
    # by the gyro, which is far less noisy than what the prediction of ω̇ lacks
    motion[:, :2] += felt_by_turning(c.accelerometer, rows.yaw_rate, rows.yaw_acceleration)
    return motion


def unknown_forces(c: RobotConstants, rows: RunRows) -> Array:
    """Covariance of the accelerations that friction at rest may take, shape (m, 3, 3).

    A wheel that hardly turns holds whatever friction it likes, and rollers that hardly turn do so across;
    their forces are taken as unknown, many times as large as they can be, so that nothing is learnt along
    them.
    """
    slow = rows.slowest < SLOW
    size = 3.0 * (c.dry + np.abs(c.torque * rows.current))
    cov = np.einsum("mi,ki,ji->mkj", np.where(slow, size, 0.0) ** 2, c.forces, c.forces)
    stiff = np.abs(roller_speeds(c, rows)) < SLOW_SIDEWAYS
    held = np.where(stiff, 3.0 * c.load * c.roller_dry, 0.0) ** 2
    cov += np.einsum("mi,ik,ij->mkj", held, c.across, c.across)
    inverse = np.linalg.inv(inertia_matrix(c))
    return inverse @ cov @ inverse.T
