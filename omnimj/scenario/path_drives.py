"""Drives along a path: circle, square, waypoints; the heading is held."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from omnimj.errors import InputError
from omnimj.parameters.reading import Rule
from omnimj.scenario.drive_keys import ANGLE, COUNT, LENGTH, SPEED, TIME, DriveTable, as_point
from omnimj.scenario.trapezoid import one_after_another, over_distance
from omnimj.signals import Array

_PACE_KEYS = ("speed", "acceleration", "deceleration", "start_time")
CIRCLE_KEYS = (*_PACE_KEYS, "lap_time", "laps", "diameter", "center", "clockwise", "start_angle")
SQUARE_KEYS = (*_PACE_KEYS, "lap_time", "laps", "side", "center", "clockwise")
WAYPOINT_KEYS = (*_PACE_KEYS, "points")


def circle(table: DriveTable, time: Array) -> Array:
    """Planned positions of kind `circle`, shape (k, 2) [m].

    Starts at `start` (a point of the circle) or `start_angle` (as seen from its centre, default 0). At
    constant speed with `lap_time`, else from rest to rest with `speed` and `acceleration` along the path.
    """
    radius = 0.5 * table.number("diameter", LENGTH)
    center = np.array(table.point("center", (0.0, 0.0)))
    angle, laps = _start_angle(table, center, radius), table.whole("laps", COUNT, 1)
    sign = -1.0 if table.flag("clockwise", True) else 1.0
    length = 2.0 * np.pi * radius
    phi = angle + sign * _paced(table, time, [laps * length], length) / radius
    return center + radius * np.column_stack([np.cos(phi), np.sin(phi)])


def _start_angle(table: DriveTable, center: Array, radius: float) -> float:
    table.at_most_one("start", "start_angle")
    if "start" not in table:
        return table.number("start_angle", ANGLE, 0.0)
    x, y = table.point("start") - center
    if not math.isclose(math.hypot(x, y), radius, rel_tol=1e-6):
        rule = f"must lie on the circle, {radius:g} m from its center {center.tolist()}"
        raise InputError(table.at("start"), f"found {table.content['start']}", rule)
    return math.atan2(y, x)


def square(table: DriveTable, time: Array) -> Array:
    """Planned positions of kind `square`, shape (k, 2) [m].

    Starts at the corner `start` (default: the one at +x, −y). Stops at corners with `speed`; with `lap_time`
    the whole way is at constant speed.
    """
    side, center = table.number("side", LENGTH), np.array(table.point("center", (0.0, 0.0)))
    corners = center + 0.5 * side * np.array([(1.0, -1.0), (-1.0, -1.0), (-1.0, 1.0), (1.0, 1.0)])
    start = np.array(table.point("start", (corners[0, 0], corners[0, 1])))
    first = int(np.argmin(np.linalg.norm(corners - start, axis=1)))
    if np.linalg.norm(corners[first] - start) > 1e-6 * side:
        raise InputError(
            table.at("start"), f"found {start.tolist()}", f"must be a corner: {corners.tolist()}"
        )
    step = 1 if table.flag("clockwise", True) else -1
    turns = first + step * np.arange(4 * table.whole("laps", COUNT, 1) + 1)
    return _along(corners[turns % 4], table, time, 4.0 * side)


def waypoints(table: DriveTable, time: Array) -> Array:
    """Planned positions of kind `waypoints`, shape (k, 2) [m]: straight lines, a stop at each point.

    From `start` where given, else from the first point.
    """
    found = table.content.get("points")
    if not isinstance(found, list) or not found:
        raise InputError(table.at("points"), f"found {found!r}", "a list of points [[x, y], …] is needed")
    points = [as_point(value, f"{table.at('points')}[{i}]") for i, value in enumerate(found)]
    if "start" in table:
        points.insert(0, table.point("start"))
    return _along(np.array(points), table, time, None)


def _along(points: Array, table: DriveTable, time: Array, lap: float | None) -> Array:
    """Positions on a polyline; with a lap length [m] it may be driven at constant speed."""
    legs = np.linalg.norm(np.diff(points, axis=0), axis=1)
    walked = _paced(table, time, legs.tolist(), lap)
    marks = np.concatenate([[0.0], np.cumsum(legs)])
    walked = np.minimum(walked, marks[-1])
    return np.column_stack([np.interp(walked, marks, points[:, 0]), np.interp(walked, marks, points[:, 1])])


def _paced(table: DriveTable, time: Array, legs: Sequence[float], lap: float | None) -> Array:
    """Distance walked [m]: at constant speed with `lap_time`, else from rest to rest on each leg [m]."""
    time = time - table.number("start_time", TIME, 0.0)
    if lap is not None and "lap_time" in table:
        for key in ("speed", "acceleration", "deceleration"):
            table.at_most_one("lap_time", key)
        shortest = Rule(lap / SPEED.high, TIME.high, False)
        speed = lap / table.number("lap_time", shortest)
        return np.clip(speed * time, 0.0, sum(legs))
    if lap is not None and "speed" not in table:
        raise InputError(table.place, "'speed' or 'lap_time' is missing", "give one of them")
    speed, (up, down) = table.speed(), table.accelerations()
    return one_after_another([over_distance(leg, speed, up, down) for leg in legs], time)
