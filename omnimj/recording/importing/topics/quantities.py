"""Units and meaning of the fields of well-known messages (REP 103 and the comments of their definitions)."""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from omnimj.recording.importing.units import find_unit, split_unit
from omnimj.signals import Array

JOINT_POSITION, JOINT_VELOCITY, JOINT_EFFORT = "joint_position", "joint_velocity", "joint_effort"
"""Kinds of the columns of a joint."""
JOINT_STATES = "sensor_msgs/JointState"

_TYPE_UNITS: Mapping[str, tuple[tuple[str, str], ...]] = {
    JOINT_STATES: ((r"position\[", "rad"), (r"velocity\[", "rad/s"), (r"effort\[", "Nm")),
    "sensor_msgs/Imu": ((r"angular_velocity\.", "rad/s"), (r"linear_acceleration\.", "m/s2")),
    "sensor_msgs/BatteryState": ((r"voltage$", "V"), (r"current$", "A")),
}
_FIELD_UNITS = (
    (r"(^|\.)(position|translation)\.[xyz]$", "m"),
    (r"(^|\.)(twist\.)?linear\.[xyz]$", "m/s"),
    (r"(^|\.)(twist\.)?angular\.[xyz]$", "rad/s"),
    (r"(^|\.)force\.[xyz]$", "N"),
    (r"(^|\.)torque\.[xyz]$", "Nm"),
    (r"\.yaw$", "rad"),
)
"""Units of the parts of poses, transforms, twists and wrenches."""
_GEOMETRY = re.compile(r"^(geometry_msgs|nav_msgs|tf2_msgs|sensor_msgs|foxglove)[/.]")
_KINDS: tuple[tuple[str, str, str], ...] = (
    # type, path, kind
    (JOINT_STATES, r"position\[", JOINT_POSITION),
    (JOINT_STATES, r"velocity\[", JOINT_VELOCITY),
    (JOINT_STATES, r"effort\[", JOINT_EFFORT),
    ("sensor_msgs/Imu", r"linear_acceleration\.x$", "acceleration_x"),
    ("sensor_msgs/Imu", r"linear_acceleration\.y$", "acceleration_y"),
    ("sensor_msgs/Imu", r"angular_velocity\.z$", "yaw_rate"),
    ("sensor_msgs/Imu", r"orientation\.yaw$", "yaw"),
    (r"geometry_msgs/Pose\w*|nav_msgs/Odometry", r"(^|\.)position\.x$", "x"),
    (r"geometry_msgs/Pose\w*|nav_msgs/Odometry", r"(^|\.)position\.y$", "y"),
    (r"geometry_msgs/Pose\w*|nav_msgs/Odometry", r"(^|\.)orientation\.yaw$", "heading"),
)
_ENTRY = re.compile(r"\[([^\[\]]+)\]$")
_COMMENTED = re.compile(r"^\s*[\w/]+(?:\[[^\]]*\])?\s+(\w+)\b[^#=]*#.*?\[\s*([^\[\]]+?)\s*\]")
_QUATERNION = re.compile(r"^(.*(?:orientation|rotation))\.w$")


@dataclass(frozen=True)
class Quantity:
    """Description of one field."""

    unit: str = ""
    kind: str = ""
    """A column of omnimj, or a kind of a joint's columns; empty if unknown."""
    part: str = ""
    """The joint; empty elsewhere."""


def quantity(type_name: str, path: str, stated: Mapping[str, str], renamed: Mapping[str, str]) -> Quantity:
    """Find unit and meaning of a field."""
    kind = renamed.get(path) or next(
        (kind for of, field, kind in _KINDS if re.fullmatch(of, type_name) and re.search(field, path)), ""
    )
    entry = _ENTRY.search(path)
    part = entry[1] if entry and kind in (JOINT_POSITION, JOINT_VELOCITY, JOINT_EFFORT) else ""
    return Quantity(_unit(type_name, path, stated), kind, part)


def _unit(type_name: str, path: str, stated: Mapping[str, str]) -> str:
    plain = _ENTRY.sub("", path)  # the entries of a list share its unit
    if path in stated or plain in stated:
        return stated.get(path, stated.get(plain, ""))
    known = _TYPE_UNITS.get(type_name, ())
    if _GEOMETRY.match(type_name):
        known = (*known, *_FIELD_UNITS)
    for field, unit in known:
        if re.search(field, path):
            return unit
    suffix = split_unit(path)[1]
    return suffix if find_unit(suffix) is not None else ""


def definition_units(text: str) -> dict[str, str]:
    """Units by field in the comments of a ROS message definition: `float64 speed  # of wheel 1 [rad/s]`."""
    own = text.split("\n====", 1)[0]
    found = (_COMMENTED.match(line) for line in own.splitlines())
    return {one[1]: one[2] for one in found if one}


def with_yaw(columns: Mapping[str, Array]) -> dict[str, Array]:
    """Add the heading of every quaternion: atan2(2 (w z + x y), 1 − 2 (y² + z²)).

    Args:
      columns: Columns by path, each shape (n,).

    Returns:
      The columns, and `….yaw` [rad], unwrapped, after each quaternion; NaN where a quaternion is no rotation
      (drivers without orientation send zeros), and no column where none is one.
    """
    done: dict[str, Array] = {}
    for path, values in columns.items():
        done[path] = values
        found = _QUATERNION.match(path)
        parts = [f"{found[1]}.{axis}" for axis in "xyz"] if found else []
        if not found or not all(part in columns for part in parts):
            continue
        x, y, z = (columns[part] for part in parts)
        turned = np.abs(x * x + y * y + z * z + values * values - 1.0) < 0.1
        if turned.any():
            yaw = np.full(len(values), np.nan)
            angle = np.arctan2(2.0 * (values * z + x * y), 1.0 - 2.0 * (y * y + z * z))
            yaw[turned] = np.unwrap(angle[turned])
            done[f"{found[1]}.yaw"] = yaw
    return done
