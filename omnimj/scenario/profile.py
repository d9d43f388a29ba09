"""Drives without a path: straight at a trapezoid of speed, turning if asked, or standing still."""

from __future__ import annotations

import math

import numpy as np

from omnimj.parameters.reading import Rule
from omnimj.scenario.drive_keys import ACCELERATION, ANGLE, LENGTH, TIME, DriveTable
from omnimj.scenario.trapezoid import Trapezoid, over_distance
from omnimj.signals import Array

PROFILE_KEYS = (
    "speed",
    "direction",
    "acceleration",
    "deceleration",
    "start_time",
    "cruise_time",
    "distance",
    "yaw_rate",
    "yaw_acceleration",
    "yaw_cruise_time",
    "turn",
)
_YAW_RATE = Rule(-100.0, 100.0, False)
DEFAULT_YAW_ACCELERATION = 2.0
"""[rad/s²]."""


def directions(count: int = 24) -> Array:
    """Evenly spaced driving directions from 0, shape (count,) [rad]."""
    return np.arange(count, dtype=float) * (2.0 * np.pi / count)


def profile(table: DriveTable, time: Array) -> tuple[Array, Array]:
    """Displacement, shape (k, 2) [m], and turned angle, shape (k,) [rad], of kind `profile`.

    The direction is one of the world, whatever the robot's heading does meanwhile. Without `cruise_time` and
    `distance` the robot cruises to the end of the run, and so does a turn without `yaw_cruise_time` and
    `turn`.
    """
    begin = table.number("start_time", TIME, 0.0)
    direction = table.number("direction", ANGLE, 0.0)
    along = _translation(table).distance_at(time - begin)
    turned = np.zeros_like(time)
    if "yaw_rate" in table:
        rate = table.number("yaw_rate", _YAW_RATE)
        turned = math.copysign(1.0, rate) * _turn(table, abs(rate)).distance_at(time - begin)
    return np.outer(along, (math.cos(direction), math.sin(direction))), turned


def _translation(table: DriveTable) -> Trapezoid:
    table.at_most_one("cruise_time", "distance")
    still = "yaw_rate" in table and table.content.get("speed", 0) == 0
    speed, (up, down) = 0.0 if still else table.speed(), table.accelerations()
    if "distance" in table:
        return over_distance(table.number("distance", LENGTH), speed, up, down)
    return Trapezoid(speed, up, down, table.number("cruise_time", TIME, math.inf))


def _turn(table: DriveTable, rate: float) -> Trapezoid:
    table.at_most_one("yaw_cruise_time", "turn")
    up = table.number("yaw_acceleration", ACCELERATION, DEFAULT_YAW_ACCELERATION)
    if "turn" in table:
        return over_distance(table.number("turn", LENGTH), rate, up, up)
    return Trapezoid(rate, up, up, table.number("yaw_cruise_time", TIME, math.inf))


def hold(table: DriveTable, time: Array) -> tuple[Array, Array]:
    """No displacement and no turn: kind `hold`."""
    return np.zeros((len(time), 2)), np.zeros_like(time)
