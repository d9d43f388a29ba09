"""A robot's numbers for the planar kernels: masses, wheels and their static normal forces."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from omnimj.errors import InputError
from omnimj.parameters.robot import Robot, roller_sides
from omnimj.physics.wheel import RADIUS, WHEEL_ROW, wheel_row

GRAVITY = 9.81

MASS, COM_X, COM_Y, YAW_INERTIA, SLOPE_X, SLOPE_Y = range(6)
BODY_ROW = 6
# columns that the robot appends to a wheel's row; NORMAL_X, _Y: normal force per m/s² of gravity along x, y
POSITION_X, POSITION_Y, DRIVE_X, DRIVE_Y, GRIP, NORMAL, NORMAL_X, NORMAL_Y = range(WHEEL_ROW, WHEEL_ROW + 8)
ROLLER_SIN, ROLLER_COS = WHEEL_ROW + 8, WHEEL_ROW + 9  # of the angle from the axle to the roller's axis
ROBOT_WHEEL_ROW = WHEEL_ROW + 10


@dataclass(frozen=True)
class PlanarConstants:
    """A robot's numbers for the kernels of `physics.planar`."""

    body: NDArray[np.float64]
    """Mass, centre of mass, yaw inertia about it, gravity along the floor in the world, shape (BODY_ROW,)."""
    wheels: NDArray[np.float64]
    """A row per wheel, shape (n, ROBOT_WHEEL_ROW)."""


def planar_constants(
    robot: Robot,
    misalignment: ArrayLike = 0.0,
    radius_scale: ArrayLike = 1.0,
    grip: ArrayLike = 1.0,
    payload: tuple[float, float, float] = (0.0, 0.0, 0.0),
    slope: tuple[float, float] = (0.0, 0.0),
) -> PlanarConstants:
    """A robot's numbers, with what is wrong with it.

    Args:
      robot: The robot.
      misalignment: Angle of each axle, counter-clockwise, scalar or (n,) [rad].
      radius_scale: True over nominal wheel radius, scalar or (n,).
      grip: Factor on the traction, scalar or (n,).
      payload: Mass [kg] and its place x, y in the body frame [m].
      slope: Inclination of the floor and the world direction that points downhill [rad].

    Raises:
      InputError: The payload leaves no mass, or lifts a wheel off the floor.
    """
    body = _body_row(robot, payload, slope)
    wheels = np.empty((len(robot.wheels), ROBOT_WHEEL_ROW))
    wheels[:, :WHEEL_ROW] = wheel_row(robot.wheel, robot.bearing, robot.motor)
    wheels[:, RADIUS] *= np.asarray(radius_scale, float)
    wheels[:, GRIP] = grip
    p, u = robot.wheel_positions, robot.drive_directions
    angle = np.asarray(misalignment, float)
    c, s = np.cos(angle), np.sin(angle)
    wheels[:, [POSITION_X, POSITION_Y]] = p
    wheels[:, [ROLLER_SIN, ROLLER_COS]] = [roller_sides(mount.roller_angle) for mount in robot.wheels]
    wheels[:, DRIVE_X], wheels[:, DRIVE_Y] = c * u[:, 0] - s * u[:, 1], s * u[:, 0] + c * u[:, 1]
    # static balance Σ F_N = W, Σ p F_N = W r_c in least norm: m g/4 each on four wheels
    balance = np.vstack([np.ones(len(p)), p.T])
    share = np.linalg.pinv(balance)
    weight = body[MASS] * GRAVITY * math.cos(slope[0])
    wheels[:, NORMAL] = weight * (share @ [1.0, body[COM_X], body[COM_Y]])
    # a larger wheel compresses its spring, as far as the robot cannot give way by rising and tilting
    larger = robot.wheel.radius * (np.broadcast_to(radius_scale, len(p)) - 1.0)
    springs = robot.body.suspension_stiffness * (larger - share @ (balance @ larger))
    wheels[:, NORMAL] = np.maximum(wheels[:, NORMAL] + springs, np.minimum(wheels[:, NORMAL], 0.0))
    wheels[:, [NORMAL_X, NORMAL_Y]] = body[MASS] * robot.body.com_height * share[:, 1:]
    lightest = int(np.argmin(wheels[:, NORMAL]))
    if wheels[lightest, NORMAL] < 0.0:
        raise InputError(
            "payload", f"found (mass, x, y) = {payload}", f"lifts wheel {lightest + 1} off the floor"
        )
    return PlanarConstants(body, wheels)


def _body_row(
    robot: Robot, payload: tuple[float, float, float], slope: tuple[float, float]
) -> NDArray[np.float64]:
    """Mass, centre of mass and yaw inertia with the payload as a point, and gravity along the floor."""
    extra, x, y = payload
    mass = robot.body.mass + extra
    if mass <= 0.0:
        rule = f"must leave mass on the robot's {robot.body.mass:g} kg"
        raise InputError("payload.mass", f"found {extra:g}", rule)
    com = extra * np.array([x, y]) / mass
    inertia = robot.body.yaw_inertia + extra * (x * x + y * y) - mass * float(com @ com)
    if inertia <= 0.0:
        raise InputError("payload", f"found (mass, x, y) = {payload}", "leaves no yaw inertia")
    downhill = GRAVITY * math.sin(slope[0])
    return np.array([mass, *com, inertia, downhill * math.cos(slope[1]), downhill * math.sin(slope[1])])
