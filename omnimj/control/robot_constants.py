"""What the kernels of the robust method need of a robot, as arrays."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from omnimj.control.gains import ObserverGains
from omnimj.parameters import Robot
from omnimj.physics.kinematics import rolling_matrix
from omnimj.signals import Array

BLOCK = 0.01
"""Time over which samples are averaged before anything is judged [s]."""

(
    MASS,
    YAW_INERTIA,
    RADIUS,
    INERTIA,
    LOAD,
    TORQUE,
    DRY,
    VISCOUS,
    EFFICIENCY,
    ROLLER_DRY,
    ROLLER_VISCOUS,
    TIME,
    WHEEL_NOISE,
    CREEP_NOISE,
    ACCELERATION_NOISE,
) = range(15)

GRAVITY = 9.81


def samples_per_block(period: float) -> int:
    """How many samples come nearest to `BLOCK`; one where they come slower.

    Args:
      period: From sample to sample [s].
    """
    return max(1, round(BLOCK / period))


@dataclass(frozen=True)
class WheelGeometry:
    """Of n wheels."""

    forces: Array
    """Column i is the force and moment of wheel i per newton of torque over radius, shape (3, n): B = Aᵀ."""
    across: Array
    """Row i: speed at which rollers turn for a body twist, of omni wheels along the axle, shape (n, 3)."""


def wheel_geometry(robot: Robot) -> WheelGeometry:
    """B and the lateral directions of the robot's wheels."""
    p = robot.wheel_positions
    return WheelGeometry(
        np.ascontiguousarray(rolling_matrix(p, robot.rolling_directions).T),
        rolling_matrix(p, robot.side_directions),
    )


def robot_constants(robot: Robot, period: float, gains: ObserverGains | None = None) -> Array:
    """The scalars, in the order of the names above; the last three are of `gains`, as shipped when None.

    TORQUE: traction per ampere K_t E G_r/r [N/A]; DRY: what T_nl and the bearings take of it, VISCOUS: the
    same per rad/s [N, N.s]; LOAD: F_N of one wheel at rest [N]; INERTIA: I_eff/r [kg.m].
    """
    own = ObserverGains() if gains is None else gains
    n, radius = len(robot.wheels), robot.wheel.radius
    load = robot.body.mass * GRAVITY / n
    through = robot.motor.gear_efficiency * robot.motor.gear_ratio / radius
    a, b = robot.bearing.spacing, robot.bearing.overhang
    bearing = robot.bearing.dry * 0.5 * robot.bearing.pitch_diameter * load * (a + 2.0 * b) / a / radius
    return np.array(
        (
            robot.body.mass,
            robot.body.yaw_inertia,
            radius,
            (robot.wheel.inertia + robot.motor.reflected_inertia) / radius,
            load,
            robot.motor.torque_constant * through,
            robot.motor.no_load_torque * through + bearing,
            robot.motor.viscous * robot.motor.gear_ratio * through,
            robot.motor.gear_efficiency,
            robot.wheel.roller_dry,
            robot.wheel.roller_viscous,
            samples_per_block(period) * period,
            own.wheel_noise,
            own.creep_noise,
            own.acceleration_noise,
        )
    )
