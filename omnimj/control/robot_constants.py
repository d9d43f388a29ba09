"""Constants of a robot and of ordinary floors that the kernels of detection and recovery share."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from omnimj.parameters import Robot
from omnimj.physics.kinematics import rolling_matrix
from omnimj.signals import Array

GRAVITY = 9.81
"""[m/s²]"""
CREEP_SLOPE = 2.5
"""Traction per normal force and creep, σ: nearly the same on every floor that was measured [s/m]."""


class RobotConstants(NamedTuple):
    """Nominal constants of a robot with n wheels, as the controller assumes them."""

    mass: float
    """[kg]"""
    yaw_inertia: float
    """[kg.m²]"""
    radius: float
    """Rolling radius r of a wheel [m]."""
    inertia: float
    """Inertia at the wheel over its radius, I_eff/r [kg.m]."""
    load: float
    """Normal force of one wheel at rest, F_N [N]."""
    torque: float
    """Traction per ampere, K_t E G_r/r [N/A]."""
    dry: float
    """Traction lost to the no-load torque and to the bearings' dry friction [N]."""
    viscous: float
    """Traction lost per wheel speed [N.s]."""
    efficiency: float
    """Gear efficiency E [1]."""
    roller_dry: float
    """Dry friction of the rollers over the normal force [1]."""
    roller_viscous: float
    """Viscous friction of the rollers over the normal force [s/m]."""
    forces: Array
    """Force and moment on the body per traction of each wheel, B = Aᵀ, shape (3, n)."""
    across: Array
    """Roller speed per body twist of each wheel, of omni wheels along the axle, shape (n, 3)."""


def robot_constants(robot: Robot) -> RobotConstants:
    """Constants of a robot from its parameters."""
    n, radius, positions = len(robot.wheels), robot.wheel.radius, robot.wheel_positions
    load = robot.body.mass * GRAVITY / n
    through = robot.motor.gear_efficiency * robot.motor.gear_ratio / radius
    a, b = robot.bearing.spacing, robot.bearing.overhang
    bearing = robot.bearing.dry * 0.5 * robot.bearing.pitch_diameter * load * (a + 2.0 * b) / a / radius
    return RobotConstants(
        mass=float(robot.body.mass),
        yaw_inertia=float(robot.body.yaw_inertia),
        radius=float(radius),
        inertia=float((robot.wheel.inertia + robot.motor.reflected_inertia) / radius),
        load=float(load),
        torque=float(robot.motor.torque_constant * through),
        dry=float(robot.motor.no_load_torque * through + bearing),
        viscous=float(robot.motor.viscous * robot.motor.gear_ratio * through),
        efficiency=float(robot.motor.gear_efficiency),
        roller_dry=float(robot.wheel.roller_dry),
        roller_viscous=float(robot.wheel.roller_viscous),
        forces=np.ascontiguousarray(rolling_matrix(positions, robot.rolling_directions).T),
        across=np.ascontiguousarray(rolling_matrix(positions, robot.side_directions)),
    )
