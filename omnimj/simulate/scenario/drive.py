"""Planned motion of a scenario: its `[drive]` table as a reference, one sample per control step."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from types import MappingProxyType
from typing import Any

import numpy as np

from omnimj.errors import InputError
from omnimj.parameters.reading import check_choice, require_keys
from omnimj.signals import Array, Reference
from omnimj.simulate.scenario.motion import (
    ANGLE,
    CIRCLE_KEYS,
    PROFILE_KEYS,
    SQUARE_KEYS,
    WAYPOINT_KEYS,
    DriveTable,
    circle,
    hold,
    profile,
    square,
    waypoints,
)

_COMMON_KEYS = ("kind", "start", "heading", "yaw_loop", "heading_hold", "heading_feedback", "creep_floor")
_FREE: Mapping[str, tuple[tuple[str, ...], Callable[[DriveTable, Array], tuple[Array, Array]]]] = (
    MappingProxyType({"profile": (PROFILE_KEYS, profile), "hold": ((), hold)})
)
_PATHS: Mapping[str, tuple[tuple[str, ...], Callable[[DriveTable, Array], Array]]] = MappingProxyType(
    {
        "circle": (CIRCLE_KEYS, circle),
        "square": (SQUARE_KEYS, square),
        "waypoints": (WAYPOINT_KEYS, waypoints),
    }
)
KINDS = (*_FREE, *_PATHS)
"""Kinds of drive."""
DRIVE_KEYS = tuple(
    dict.fromkeys([*_COMMON_KEYS, *(key for keys, _ in (*_FREE.values(), *_PATHS.values()) for key in keys)])
)
"""Keys of the `[drive]` table over all kinds of drive."""


@dataclass(frozen=True)
class Drive:
    """Planned motion, start, and the control loops that are switched on."""

    reference: Reference
    """One sample per control step, the first at time 0, the last at the end of the run."""
    yaw_loop: bool
    """Proportional control of the yaw rate."""
    heading_hold: bool
    """Proportional control of the heading."""
    heading_feedback: bool
    """True if world demands are rotated by the measured heading, not by the planned one."""
    start: tuple[float, float, float]
    """Initial x, y [m] and heading [rad] in the world."""
    creep_floor: str | None = None
    """Name of the floor whose creep the controller feeds forward; None: no feed-forward."""

    @property
    def has_path(self) -> bool:
        """True if the motion is a path to follow."""
        return self.reference.is_path


def read_drive(table: Any, place: str, duration: float, period: float) -> Drive:
    """Convert a `[drive]` table to a reference.

    Position, velocity and heading are consistent: velocity k, held for one control period, leads from
    position k to position k+1, and the yaw rate likewise.

    Args:
      table: `kind` and the kind's own keys, with `start`, `heading`, `yaw_loop`, `heading_hold`,
        `heading_feedback` and `creep_floor` for all kinds.
      place: Name of the table in messages.
      duration: Length of the run [s].
      period: Control period [s].

    Raises:
      InputError: A value is missing or breaks its rule.
      UnknownNameError: A kind or key that does not exist; the message lists the choices.
    """
    if not isinstance(table, Mapping):
        raise InputError(place, f"found {table!r}", "a table is needed")
    content = DriveTable(table, place)
    kind = _kind(content)
    time = np.arange(round(duration / period) + 2, dtype=float) * period
    heading = content.number("heading", ANGLE, 0.0)
    if kind in _PATHS:
        position, turned = _PATHS[kind][1](content, time), np.zeros_like(time)
    else:
        moved, turned = _FREE[kind][1](content, time)
        position = moved + np.array(content.point("start", (0.0, 0.0)))
    reference = _reference(time, position, heading + turned, period, kind in _PATHS)
    return Drive(
        reference,
        yaw_loop=content.flag("yaw_loop", True),
        heading_hold=content.flag("heading_hold", False),
        heading_feedback=content.flag("heading_feedback", True),
        start=(float(position[0, 0]), float(position[0, 1]), heading),
        creep_floor=content.text("creep_floor"),
    )


def _kind(table: DriveTable) -> str:
    if "kind" not in table:
        raise InputError(table.place, "'kind' is missing", "a drive has one", KINDS)
    kind = check_choice(table.at("kind"), table.content["kind"], KINDS, "drive")
    own = (_PATHS[kind] if kind in _PATHS else _FREE[kind])[0]
    require_keys(table.place, table.content, (*_COMMON_KEYS, *own), f"key of a {kind} drive")
    return kind


def _reference(time: Array, position: Array, heading: Array, period: float, is_path: bool) -> Reference:
    return Reference(
        time=time[:-1],
        velocity=np.diff(position, axis=0) / period,
        yaw_rate=np.diff(heading) / period,
        heading=heading[:-1],
        position=position[:-1],
        is_path=is_path,
    )
