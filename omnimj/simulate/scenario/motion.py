"""Planned motions of each kind of drive, in closed form: profiles of speed, circles, squares, waypoints.

The function of each kind takes the `[drive]` table and k times from the start, shape (k,) [s].
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from omnimj.errors import InputError
from omnimj.parameters.reading import Rule, check_flag, check_number
from omnimj.signals import Array

# wide bounds that keep every reference finite
SPEED = Rule(0.0, 10.0, True)  # seven times what the motors reach
ACCELERATION = Rule(0.0, 100.0, True)
LENGTH = Rule(0.0, 1e4, True)
PLACE = Rule(-1e4, 1e4, False)
TIME = Rule(0.0, 1e5, False)
ANGLE = Rule(-1e4, 1e4, False)
COUNT = Rule(1, 1000, False)
SPEEDS: Mapping[str, float] = {"low": 0.5, "high": 1.0}
"""Named speeds of the tests in the source [m/s]."""
DEFAULT_ACCELERATION = 1.0
"""Default acceleration [m/s²], half of that of 15.8 kg on two wheels with 16 N of peak traction each."""
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
"""Default yaw acceleration [rad/s²]."""
_SPEED_KEYS = ("speed", "acceleration", "deceleration", "start_time")
CIRCLE_KEYS = (*_SPEED_KEYS, "lap_time", "laps", "diameter", "center", "clockwise", "start_angle")
SQUARE_KEYS = (*_SPEED_KEYS, "lap_time", "laps", "side", "center", "clockwise")
WAYPOINT_KEYS = (*_SPEED_KEYS, "points")


@dataclass(frozen=True)
class Trapezoid:
    """Trapezoidal speed profile: acceleration from rest, cruise, deceleration to rest."""

    speed: float
    """Cruising speed, not negative [m/s] (or rad/s)."""
    acceleration: float
    """Magnitude, positive [m/s²]."""
    deceleration: float
    """Magnitude, positive [m/s²]."""
    cruise_time: float
    """Time at constant speed; may be infinite [s]."""

    @property
    def duration(self) -> float:
        """Duration from rest to rest [s]."""
        return self.speed / self.acceleration + self.cruise_time + self.speed / self.deceleration

    def distance_at(self, time: Array) -> Array:
        """Distance s(t) = ∫ v dt, 0 before the start and constant after the end, shape (k,) [m].

        Args:
          time: Time from the start, shape (k,) [s].
        """
        rise, fall = self.speed / self.acceleration, self.speed / self.deceleration
        up = np.clip(time, 0.0, rise)
        cruise = np.clip(time - rise, 0.0, self.cruise_time)
        down = np.clip(time - rise - self.cruise_time, 0.0, fall)
        return (
            0.5 * self.acceleration * up**2 + self.speed * (cruise + down) - 0.5 * self.deceleration * down**2
        )


def fastest_trapezoid(distance: float, speed: float, acceleration: float, deceleration: float) -> Trapezoid:
    """Return the fastest trapezoid over a distance; a triangle where the speed cannot be reached.

    Accelerating and decelerating take the distance v²/2 (1/a + 1/d).

    Args:
      distance: Distance from rest to rest [m] (or rad).
      speed: Highest speed v [m/s] (or rad/s).
      acceleration: Acceleration a, positive [m/s²] (or rad/s²).
      deceleration: Deceleration d, positive [m/s²] (or rad/s²).
    """
    both = 0.5 * (1.0 / acceleration + 1.0 / deceleration)
    speed = min(speed, float(np.sqrt(distance / both)))
    if speed == 0.0:
        return Trapezoid(0.0, acceleration, deceleration, 0.0)
    return Trapezoid(speed, acceleration, deceleration, max(0.0, distance / speed - both * speed))


def chained_distance(motions: Sequence[Trapezoid], time: Array) -> Array:
    """Total distance of consecutive motions, shape (k,) [m].

    Args:
      motions: Motions, each of which starts when the previous one has ended.
      time: Time from the start of the first motion, shape (k,) [s].
    """
    total, start = np.zeros_like(time), 0.0
    for motion in motions:
        total += motion.distance_at(time - start)
        start += motion.duration
    return total


@dataclass(frozen=True)
class DriveTable:
    """A `[drive]` table and its place in messages."""

    content: Mapping[str, Any]
    place: str

    def __contains__(self, key: str) -> bool:
        return key in self.content

    def at(self, key: str) -> str:
        """Place of a key in messages."""
        return f"{self.place}.{key}"

    def number(self, key: str, rule: Rule, default: float | None = None) -> float:
        """Number of a key; required when there is no default."""
        if key not in self.content:
            if default is None:
                raise InputError(self.place, f"'{key}' is missing", f"a number is needed that {rule}")
            return default
        return float(check_number(self.at(key), self.content[key], rule))

    def whole(self, key: str, rule: Rule, default: int) -> int:
        """Whole number of a key."""
        return int(check_number(self.at(key), self.content.get(key, default), rule, whole=True))

    def flag(self, key: str, default: bool) -> bool:
        """Boolean of a key."""
        return check_flag(self.at(key), self.content.get(key, default))

    def text(self, key: str) -> str | None:
        """Text of a key; None without it or where it is empty."""
        value = self.content.get(key, "")
        if not isinstance(value, str):
            raise InputError(self.at(key), f"found {value!r}", "a string is needed")
        return value or None

    def point(self, key: str, default: tuple[float, float] | None = None) -> tuple[float, float]:
        """Point x, y of a key [m]; required when there is no default."""
        if key not in self.content:
            if default is None:
                raise InputError(self.place, f"'{key}' is missing", "two numbers [x, y] are needed")
            return default
        return as_point(self.content[key], self.at(key))

    def speed(self) -> float:
        """Cruising speed: a positive number or one of the named speeds [m/s]."""
        value = self.content.get("speed")
        if isinstance(value, str):
            if value not in SPEEDS:
                rule = f"a number is needed that {SPEED}, or a named speed"
                raise InputError(self.at("speed"), f"found {value!r}", rule, SPEEDS)
            return SPEEDS[value]
        return self.number("speed", SPEED)

    def accelerations(self) -> tuple[float, float]:
        """Acceleration and deceleration, equal unless both are given [m/s²]."""
        up = self.number("acceleration", ACCELERATION, DEFAULT_ACCELERATION)
        return up, self.number("deceleration", ACCELERATION, up)

    def at_most_one(self, first: str, second: str) -> None:
        """Refuse two keys that exclude each other."""
        if first in self and second in self:
            raise InputError(self.place, f"has both '{first}' and '{second}'", "give one of them")


def as_point(value: Any, place: str) -> tuple[float, float]:
    """Point from a list of two finite numbers.

    Raises:
      InputError: Anything else.
    """
    if not isinstance(value, list) or len(value) != 2:
        raise InputError(place, f"found {value!r}", "two numbers [x, y] are needed")
    return float(check_number(f"{place}[0]", value[0], PLACE)), float(
        check_number(f"{place}[1]", value[1], PLACE)
    )


def directions(count: int = 24) -> Array:
    """Driving directions from 0 at equal angles, shape (count,) [rad]."""
    return np.arange(count, dtype=float) * (2.0 * np.pi / count)


def profile(table: DriveTable, time: Array) -> tuple[Array, Array]:
    """Motion of kind `profile`: a straight line at a trapezoidal speed, with a turn if there is a `yaw_rate`.

    Returns displacement, shape (k, 2) [m], and turned angle, shape (k,) [rad].
    The direction is fixed in the world, independent of the heading. Without `cruise_time` and
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
        return fastest_trapezoid(table.number("distance", LENGTH), speed, up, down)
    return Trapezoid(speed, up, down, table.number("cruise_time", TIME, math.inf))


def _turn(table: DriveTable, rate: float) -> Trapezoid:
    table.at_most_one("yaw_cruise_time", "turn")
    up = table.number("yaw_acceleration", ACCELERATION, DEFAULT_YAW_ACCELERATION)
    if "turn" in table:
        return fastest_trapezoid(table.number("turn", LENGTH), rate, up, up)
    return Trapezoid(rate, up, up, table.number("yaw_cruise_time", TIME, math.inf))


def hold(table: DriveTable, time: Array) -> tuple[Array, Array]:
    """Motion of kind `hold`, which stays in place: displacement (k, 2) and turned angle (k,) are zero."""
    return np.zeros((len(time), 2)), np.zeros_like(time)


def circle(table: DriveTable, time: Array) -> Array:
    """Positions of a motion of kind `circle`, shape (k, 2) [m].

    The motion starts at `start` (a point of the circle) or `start_angle` (as seen from its centre, default
    0). It has constant speed with `lap_time`; otherwise it goes from rest to rest with `speed` and
    `acceleration` on the path.
    """
    radius = 0.5 * table.number("diameter", LENGTH)
    center = np.array(table.point("center", (0.0, 0.0)))
    angle, laps = _start_angle(table, center, radius), table.whole("laps", COUNT, 1)
    sign = -1.0 if table.flag("clockwise", True) else 1.0
    length = 2.0 * np.pi * radius
    phi = angle + sign * _distance_along(table, time, [laps * length], length) / radius
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
    """Positions of a motion of kind `square`, shape (k, 2) [m].

    The motion starts at the corner `start` (default: the one at +x, −y). With `speed` it stops at every
    corner; with `lap_time` it has constant speed.
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
    return _on_polyline(corners[turns % 4], table, time, 4.0 * side)


def waypoints(table: DriveTable, time: Array) -> Array:
    """Positions of a motion of kind `waypoints`, shape (k, 2) [m].

    The path consists of straight lines with a stop at each point and begins at `start` where given, otherwise
    at the first point.
    """
    found = table.content.get("points")
    if not isinstance(found, list) or not found:
        raise InputError(table.at("points"), f"found {found!r}", "a list of points [[x, y], …] is needed")
    points = [as_point(value, f"{table.at('points')}[{i}]") for i, value in enumerate(found)]
    if "start" in table:
        points.insert(0, table.point("start"))
    return _on_polyline(np.array(points), table, time, None)


def _on_polyline(points: Array, table: DriveTable, time: Array, lap: float | None) -> Array:
    """Positions on a polyline of points (m, 2) [m]; with the length of a lap [m], `lap_time` is allowed."""
    legs = np.linalg.norm(np.diff(points, axis=0), axis=1)
    travelled = _distance_along(table, time, legs.tolist(), lap)
    marks = np.concatenate([[0.0], np.cumsum(legs)])
    travelled = np.minimum(travelled, marks[-1])
    return np.column_stack(
        [np.interp(travelled, marks, points[:, 0]), np.interp(travelled, marks, points[:, 1])]
    )


def _distance_along(table: DriveTable, time: Array, legs: Sequence[float], lap: float | None) -> Array:
    """Distance along the path [m]: at constant speed with `lap_time`, else from rest to rest on each leg."""
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
    return chained_distance([fastest_trapezoid(leg, speed, up, down) for leg in legs], time)
