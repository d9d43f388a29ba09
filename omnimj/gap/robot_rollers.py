"""What the planar equations do not know: rows of rollers under a wheel, and a body that leans on its springs.

As a wheel turns its contact point changes rows, and the load pushes it to and fro.

A roller is an ellipsoid with semi-axes √(R b), b; turned by θ from the lowest point it reaches
  (R − b) cos θ + √(b² cos² θ + R b sin² θ)
below the axle. Rows share the load in proportion to their depths, the deepest one bears it: k d = F_N.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from omnimj.parameters import Robot
from omnimj.signals import Array

_GRAVITY = 9.81
POINTS = 96
"""Points of the tables over one pitch."""


@dataclass(frozen=True)
class Rollers:
    """Tables over one pitch of a row, from a roller of the first row being lowest."""

    pitch: float
    """Angle between two rollers of a row [rad]."""
    table: Array
    """Place of the contact along the axle z × u [m], torque on the wheel over normal force [m] and the pitch,
    shape (3, POINTS)."""


def rollers(robot: Robot) -> Rollers:
    """Tables of a robot's wheels under their static load."""
    wheel = robot.wheel
    pitch = 2.0 * np.pi / wheel.rollers_per_row
    angle = np.arange(POINTS) / POINTS * pitch
    depth = robot.body.mass * _GRAVITY / (len(robot.wheels) * robot.contact.stiffness)
    rows = np.arange(wheel.rows)
    # from the lowest point to the nearest roller of each row, shape (rows, POINTS)
    off = np.mod(angle[None, :] - rows[:, None] * pitch / wheel.rows + 0.5 * pitch, pitch) - 0.5 * pitch
    long = wheel.radius * wheel.roller_radius
    root = np.sqrt(wheel.roller_radius**2 * np.cos(off) ** 2 + long * np.sin(off) ** 2)
    reach = (wheel.radius - wheel.roller_radius) * np.cos(off) + root
    slope = -(wheel.radius - wheel.roller_radius) * np.sin(off)
    slope += (long - wheel.roller_radius**2) * np.sin(off) * np.cos(off) / root
    depths = np.maximum(depth + reach - reach.max(axis=0), 0.0)
    share = depths / depths.sum(axis=0)
    side = wheel.row_offset * np.linspace(1.0, -1.0, wheel.rows) if wheel.rows > 1 else np.zeros(1)
    place = (share * side[:, None]).sum(axis=0)
    # virtual work: F_N lifts the axle by d(reach) per turn, so the wheel is pushed the other way
    torque = -(share * slope).sum(axis=0)
    return Rollers(pitch, np.stack([place, torque, np.full(POINTS, pitch)]))


def leaning(robot: Robot) -> tuple[float, float]:
    """Share by which an accelerometer on the springs reads too much along x and y: m g h/(k Σ p²).

    An accelerating body leans back and its accelerometer sees some of gravity.
    """
    body = robot.body
    sprung = body.mass - len(robot.wheels) * body.unsprung_mass
    stiffness = body.suspension_stiffness * (robot.wheel_positions**2).sum(axis=0)
    x, y = (sprung * _GRAVITY * body.com_height / stiffness).tolist()
    return x, y
