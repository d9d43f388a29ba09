"""Constants of a robot and of ordinary floors that the kernels of detection and recovery share."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from omnimj.control.expected_floor import ExpectedFloor, expected_floor
from omnimj.effects.effect import AppliedEffects
from omnimj.effects.machine import apply_effects
from omnimj.parameters import Floor, Robot
from omnimj.parameters.parts import GRAVITY
from omnimj.physics.effect_terms import TERM
from omnimj.physics.kinematics import rolling_matrix
from omnimj.signals import Array

CREEP_SLOPE = 2.5
"""Traction per normal force and creep, σ: nearly the same on every floor that was measured [s/m]."""

_FRICTION = ("axle_dry", "axle_viscous", "gear_load")


class RobotConstants(NamedTuple):
    """Nominal constants of a robot with n wheels, as the controller assumes them."""

    mass: float
    """[kg]"""
    yaw_inertia: float
    """About the body's origin [kg.m²]."""
    centre: Array
    """Centre of mass in the body frame, shape (2,) [m]."""
    accelerometer: Array
    """Place of the accelerometer in the body frame, shape (2,) [m]."""
    radius: Array
    """Rolling radius r of each wheel, shape (n,) [m]."""
    inertia: Array
    """Inertia at each wheel over its radius, I_eff/r, shape (n,) [kg.m]."""
    load: float
    """Mean normal force of a wheel at rest, F_N [N]."""
    torque: Array
    """Traction per ampere of each motor, K_t E G_r/r, shape (n,) [N/A]."""
    dry: Array
    """Traction that each wheel loses to the no-load torque and to the bearings' dry friction, (n,) [N]."""
    viscous: Array
    """Traction that each wheel loses per wheel speed, shape (n,) [N.s]."""
    driven: Array
    """Factor on the traction of a wheel that is driven by the floor, 1/(E E_b), shape (n,) [1]."""
    roller_dry: float
    """Dry friction of the rollers over the normal force [1]."""
    roller_viscous: float
    """Viscous friction of the rollers over the normal force [s/m]."""
    forces: Array
    """Force and moment on the body per traction of each wheel, B = Aᵀ, shape (3, n)."""
    across: Array
    """Roller speed per body twist of each wheel, of omni wheels along the axle, shape (n, 3)."""
    rollers: float
    """Rollers that pass per turn of a wheel."""
    floor: ExpectedFloor
    """Floor that the controller expects."""


def robot_constants(robot: Robot, floor: Floor | None = None) -> RobotConstants:
    """Constants of a robot from its parameters and the effects of its model file.

    Of the effects, those that a force balance contains enter: torque constants, radii, friction of gears,
    bearings and rollers, twisted axles, payload.

    Args:
      robot: The robot.
      floor: Floor that the controller expects; None: nothing is known of it.
    """
    expected = expected_floor(robot, floor)
    effects = apply_effects(robot)
    robot, n = effects.machine, len(robot.wheels)
    extra, x, y = effects.payload
    mass, positions = robot.body.mass + extra, robot.wheel_positions
    load, radius = mass * GRAVITY / n, robot.wheel.radius * effects.radius_scale
    axle_dry, axle_viscous, lost = (effects.terms[:, TERM[name]] for name in _FRICTION)
    through = robot.motor.gear_efficiency * robot.motor.gear_ratio / radius
    a, b = robot.bearing.spacing, robot.bearing.overhang
    bearing = robot.bearing.dry * 0.5 * robot.bearing.pitch_diameter * load * (a + 2.0 * b) / a
    driving = through * (1.0 - lost)
    return RobotConstants(
        mass=float(mass),
        yaw_inertia=float(robot.body.yaw_inertia + extra * (x * x + y * y)),
        centre=extra / mass * np.array([x, y]),
        accelerometer=robot.accelerometer,
        radius=radius,
        inertia=(robot.wheel.inertia + robot.motor.reflected_inertia) / radius,
        load=float(load),
        torque=robot.motor.torque_constant * effects.torque_scale * driving,
        dry=robot.motor.no_load_torque * driving + (bearing + axle_dry) / radius,
        viscous=robot.motor.viscous * robot.motor.gear_ratio * driving + axle_viscous / radius,
        driven=robot.motor.driven_gain / robot.motor.gear_efficiency * (1.0 + lost) / (1.0 - lost),
        roller_dry=float(robot.wheel.roller_dry),
        roller_viscous=float(robot.wheel.roller_viscous),
        forces=np.ascontiguousarray(_turned(positions, robot.rolling_directions, effects).T),
        across=np.ascontiguousarray(_turned(positions, robot.side_directions, effects)),
        rollers=float(robot.wheel.rows * robot.wheel.rollers_per_row),
        floor=expected,
    )


def _turned(positions: Array, directions: Array, effects: AppliedEffects) -> Array:
    """Rolling matrix of wheels whose axles are turned by their misalignment, shape (n, 3)."""
    cos, sin = np.cos(effects.misalignment), np.sin(effects.misalignment)
    x, y = directions.T
    return rolling_matrix(positions, np.column_stack([cos * x - sin * y, sin * x + cos * y]))
