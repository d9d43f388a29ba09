"""Record of a wheel with passive rollers: numbers given, checks, and what follows from them."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, fields, replace

from omnimj.errors import InputError
from omnimj.wheels import outline

OMNI, MECANUM = 0.5 * math.pi, 0.25 * math.pi
"""Usual angles between roller axis and axle [rad]."""
ROLLER_DENSITY = 1500.0  # [kg/m3] urethane around a steel pin
MAX_ROLLERS, MAX_ROWS = 60, 4
_MAX_DROP = 0.02  # of the radius; deeper drops shake the robot more than its wheels carry it
_REACH_MARGIN = 1.1  # of the contact's reach at hand-over, by which a roller is longer at least
_ROOM = 0.01  # of the radius, that neighbouring rollers keep between them
_SHORTEST = 0.7  # of its thickness, the length of a roller that pins can hold
_WHOLE = 0.98  # of an ellipsoid's long semi-axis, the longest cut: pins need a flat end
_MASS_PER_VOLUME = 2800.0  # [kg/m3] mass of common wheels over the cube of their radius
_MAX_ROLLER_SHARE = 0.8  # of the wheel's mass


@dataclass(frozen=True)
class RollerWheel:
    """Omni or mecanum wheel: axle along y, rollers in rows around it; positive turning drives it along x.

    Raises:
      InputError: A number is out of range, the rollers overlap, or they are too few.
    """

    radius: float = 0.05
    """Radius R over the rollers [m]."""
    roller_radius: float = 0.009
    """Largest radius b of a roller [m]."""
    rollers: int = 9
    """Rollers in a row."""
    rows: int = 2
    """Rows, each turned by its share of the pitch against the one before."""
    roller_angle: float = OMNI
    """Angle γ between roller axis and axle of the wheel's kinematics [rad]; above 90°: the mirror image."""
    row_spacing: float = 0.022
    """Distance between rows along the axle [m]."""
    mass: float = 0.35
    """Mass of the wheel with its rollers [kg]."""

    def __post_init__(self) -> None:
        _check_numbers(self)
        _check_rows(self)
        _check_rollers(self)
        _check_mass(self)

    @property
    def count(self) -> int:
        """Rollers N of all rows."""
        return self.rows * self.rollers

    @property
    def mounted_angle(self) -> float:
        """Angle γ_m between roller axis and axle as built [rad]: tan γ_m = tan γ · θ/sin θ, θ = π/N.

        Between hand-overs a roller tilts by up to θ, and its angle as seen from above shrinks on average
        by `outline.mean_projection`; built like this, the wheel's mean kinematics are those of γ.
        """
        if self.roller_angle == OMNI:
            return OMNI
        s, c = math.sin(self.roller_angle), math.cos(self.roller_angle)
        return math.atan2(s, c * outline.mean_projection(math.pi / self.count))

    @property
    def half_length(self) -> float:
        """Long semi-axis L of a roller's ellipsoid [m]."""
        return outline.half_length(self.radius, self.roller_radius, self.mounted_angle)

    @property
    def drop(self) -> float:
        """Drop of the hub at hand-over from roller to roller [m]."""
        return outline.hand_over_drop(self.radius, self.roller_radius, self.count)

    @property
    def reach(self) -> float:
        """Distance of the contact at hand-over from the roller's middle, along its axis [m]."""
        return outline.contact_reach(self.radius, self.roller_radius, self.mounted_angle, self.count)

    @property
    def roller_half_length(self) -> float:
        """Half length c of a roller as built, the longest that leaves room to its neighbours [m]."""
        short, long = _shortest(self), _WHOLE * self.half_length
        if _room(self, long) >= _ROOM * self.radius:
            return long
        for _ in range(30):
            middle = 0.5 * (short + long)
            short, long = (middle, long) if _room(self, middle) >= _ROOM * self.radius else (short, middle)
        return short

    @property
    def width(self) -> float:
        """Width over the rollers along the axle [m]."""
        c, s = abs(math.cos(self.mounted_angle)), math.sin(self.mounted_angle)
        long, b = self.half_length, self.roller_radius
        at = min(self.roller_half_length, long**2 * c / math.hypot(long * c, b * s))
        half = at * c + b * math.sqrt(1.0 - (at / long) ** 2) * s
        return 2.0 * half + (self.rows - 1) * self.row_spacing

    @property
    def roller_mass(self) -> float:
        """Mass of one roller, an ellipsoid cut at ±c [kg]."""
        c = self.roller_half_length
        volume = 2.0 * math.pi * self.roller_radius**2 * (c - c**3 / (3.0 * self.half_length**2))
        return ROLLER_DENSITY * volume

    @property
    def roller_inertia(self) -> tuple[float, float]:
        """Moments of inertia of one roller about its axis and across it [kg.m2]."""
        b, k = self.roller_radius, (self.roller_half_length / self.half_length) ** 2
        spin = 0.5 * b**2 * (1.0 - 2.0 * k / 3.0 + k**2 / 5.0) / (1.0 - k / 3.0)
        square = self.roller_half_length**2 * (1.0 / 3.0 - k / 5.0) / (1.0 - k / 3.0)  # mean x² of its volume
        return self.roller_mass * spin, self.roller_mass * (0.5 * spin + square)

    @property
    def hub_radius(self) -> float:
        """Radius of the hub inside the rollers [m]."""
        return self.radius - 2.0 * self.roller_radius

    @property
    def hub_mass(self) -> float:
        """Mass of the wheel without its rollers [kg]."""
        return self.mass - self.count * self.roller_mass

    @property
    def hub_inertia(self) -> tuple[float, float]:
        """Moments of inertia of the hub, a cylinder, about the axle and across it [kg.m2]."""
        square = self.hub_radius**2
        return 0.5 * self.hub_mass * square, self.hub_mass * (0.25 * square + self.width**2 / 12.0)

    @property
    def inertia(self) -> float:
        """Moment of inertia of the whole wheel about its axle [kg.m2]."""
        spin, across = self.roller_inertia
        own = across + (spin - across) * math.cos(self.mounted_angle) ** 2
        ring = self.roller_mass * (self.radius - self.roller_radius) ** 2
        return self.hub_inertia[0] + self.count * (ring + own)

    def mirrored(self) -> RollerWheel:
        """Return the wheel with its rollers slanted the other way."""
        return replace(self, roller_angle=math.pi - self.roller_angle)


def omni_wheel(
    radius: float = 0.05,
    rollers: int = 9,
    rows: int = 2,
    roller_radius: float | None = None,
    row_spacing: float | None = None,
    mass: float | None = None,
) -> RollerWheel:
    """Return an omni wheel; what is None is in proportion to the radius.

    Args:
      radius: Radius over the rollers [m].
      rollers: Rollers in a row.
      rows: Rows of rollers.
      roller_radius: Largest radius of a roller [m]; 0.18 of the wheel's when None.
      row_spacing: Distance between rows along the axle [m]; 2.44 roller radii when None.
      mass: Mass with rollers [kg]; that of a cube of 2800 kg/m³ on the radius when None.

    Raises:
      InputError: As in `RollerWheel`.
    """
    return _in_proportion(radius, rollers, rows, OMNI, 0.18, roller_radius, row_spacing, mass)


def mecanum_wheel(
    radius: float = 0.05,
    rollers: int = 18,
    roller_angle: float = MECANUM,
    roller_radius: float | None = None,
    mass: float | None = None,
) -> RollerWheel:
    """Return a mecanum wheel, one row of slanted rollers; what is None is in proportion to the radius.

    Args:
      radius: Radius over the rollers [m].
      rollers: Rollers around the wheel.
      roller_angle: Angle between roller axis and axle [rad].
      roller_radius: Largest radius of a roller [m]; 0.1 of the wheel's when None.
      mass: Mass with rollers [kg]; that of a cube of 2800 kg/m³ on the radius when None.

    Raises:
      InputError: As in `RollerWheel`.
    """
    return _in_proportion(radius, rollers, 1, roller_angle, 0.1, roller_radius, None, mass)


def _in_proportion(
    radius: float,
    rollers: int,
    rows: int,
    angle: float,
    slenderness: float,
    roller_radius: float | None,
    row_spacing: float | None,
    mass: float | None,
) -> RollerWheel:
    b = slenderness * radius if roller_radius is None else roller_radius
    spacing = 22.0 / 9.0 * b if row_spacing is None else row_spacing
    weight = _MASS_PER_VOLUME * radius**3 if mass is None else mass
    return RollerWheel(radius, b, rollers, rows, angle, spacing, weight)


def _room(wheel: RollerWheel, cut: float) -> float:
    return outline.room_between(wheel.radius, wheel.roller_radius, wheel.mounted_angle, wheel.rollers, cut)


def _shortest(wheel: RollerWheel) -> float:
    """Half length with which a roller hands over to the next, and is not a mere disc [m]."""
    return max(_REACH_MARGIN * wheel.reach, _SHORTEST * wheel.roller_radius)


def _fits(wheel: RollerWheel) -> bool:
    """True if rollers that are long enough leave room to their neighbours."""
    shortest = _shortest(wheel)
    return shortest <= _WHOLE * wheel.half_length and _room(wheel, shortest) >= _ROOM * wheel.radius


def _refuse(name: str, found: object, rule: str) -> None:
    shown = f"{found:g}" if isinstance(found, float) else str(found)
    raise InputError(f"wheel: {name}", f"found {shown}", rule)


_RANGES = {
    "radius": (0.005, 1.0, " m"),
    "rollers": (3, MAX_ROLLERS, ""),
    "rows": (1, MAX_ROWS, ""),
    "roller_angle": (math.radians(20.0), math.radians(160.0), " rad"),
    "mass": (1e-4, 1e5, " kg"),
}


def _check_numbers(wheel: RollerWheel) -> None:
    for field in fields(wheel):
        value = getattr(wheel, field.name)
        if field.name in ("rollers", "rows") and not isinstance(value, int):
            _refuse(field.name, value, "must be a whole number")
        if field.name in _RANGES:
            low, high, unit = _RANGES[field.name]
            if not low <= value <= high:  # also not for nan
                _refuse(field.name, value, f"must be at least {low:.4g} and at most {high:.4g}{unit}")
    low, high = 0.02 * wheel.radius, 0.4 * wheel.radius
    if not low <= wheel.roller_radius <= high:
        rule = f"must be at least {low:.4g} and at most {high:.4g} m, 0.02 to 0.4 of the wheel's radius"
        _refuse("roller_radius", wheel.roller_radius, rule)


def _check_rows(wheel: RollerWheel) -> None:
    if wheel.rows == 1:
        return
    low, high = 2.0 * wheel.roller_radius, 2.0 * wheel.radius
    if wheel.roller_angle != OMNI:
        _refuse("rows", wheel.rows, "must be 1 for slanted rollers")
    if not low <= wheel.row_spacing <= high:
        rule = f"must be at least {low:.4g} m, or rows overlap, and at most {high:.4g} m"
        _refuse("row_spacing", wheel.row_spacing, rule)


def _check_rollers(wheel: RollerWheel) -> None:
    if wheel.drop > _MAX_DROP * wheel.radius:
        fewest = next(n for n in range(3, 4 * MAX_ROLLERS) if _drop_of(wheel, n) <= _MAX_DROP * wheel.radius)
        rule = f"the hub would drop by {1e3 * wheel.drop:.2g} mm from roller to roller, more than 2 % of the "
        rule += f"radius; at least {fewest} in a row are needed"
        _refuse("rollers", f"{wheel.rollers} in a row", rule)
    if not _fits(wheel):
        rule = "the rollers overlap"
        _refuse("rollers", f"{wheel.rollers} in a row", f"{rule}; {_what_fits(wheel)}")


def _drop_of(wheel: RollerWheel, rollers: int) -> float:
    return outline.hand_over_drop(wheel.radius, wheel.roller_radius, wheel.rows * rollers)


def _variants(wheel: RollerWheel, name: str, values: Iterator[float]) -> Iterator[float]:
    """Yield those values of a number with which the rollers fit."""
    for value in values:
        other = object.__new__(RollerWheel)  # unchecked
        for field in fields(wheel):
            object.__setattr__(other, field.name, getattr(wheel, field.name))
        object.__setattr__(other, name, value)
        if _fits(other):
            yield value


def _what_fits(wheel: RollerWheel) -> str:
    counts = [
        n
        for n in _variants(wheel, "rollers", iter(range(3, MAX_ROLLERS + 1)))
        if _drop_of(wheel, int(n)) <= _MAX_DROP * wheel.radius
    ]
    radii = [wheel.radius * (0.02 + 0.002 * k) for k in range(191)]
    radii = list(_variants(wheel, "roller_radius", iter(radii)))
    known = f"{wheel.roller_radius:.4g} m"
    parts = []
    if counts:
        fit = f"{counts[0]} to {counts[-1]}" if len(counts) > 1 else f"only {counts[0]}"
        parts.append(f"with roller radius {known} {fit} in a row fit")
    if radii:
        parts.append(f"with {wheel.rollers} the roller radius may be up to {radii[-1]:.4g} m")
    return ", ".join(parts) or f"with {wheel.rows} row none fit, two rows do"


def _check_mass(wheel: RollerWheel) -> None:
    rollers = wheel.count * wheel.roller_mass
    if rollers > _MAX_ROLLER_SHARE * wheel.mass:
        low = rollers / _MAX_ROLLER_SHARE
        _refuse("mass", wheel.mass, f"must be at least {low:.3g} kg: the rollers alone have {rollers:.3g} kg")
