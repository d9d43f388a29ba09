"""Record of a wheel with passive rollers: numbers given, and what follows from them."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import cached_property

from omnimj.wheels.limits import RANGES, check_mass, check_range, check_ring
from omnimj.wheels.ring import MECANUM, OMNI, RollerRing

ROLLER_DENSITY = 1500.0  # [kg/m3] urethane around a steel pin
_MASS_PER_VOLUME = 2800.0  # [kg/m3] mass of common wheels over the cube of their radius


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
        for name in RANGES:
            check_range(name, getattr(self, name))
        check_ring(self.ring, self.row_spacing)
        check_mass(self.mass, self.count * self.roller_mass)

    @cached_property
    def ring(self) -> RollerRing:
        """Rollers around the wheel."""
        return RollerRing(self.radius, self.roller_radius, self.rollers, self.rows, self.roller_angle)

    @property
    def count(self) -> int:
        """Rollers N of all rows."""
        return self.ring.count

    @property
    def mounted_angle(self) -> float:
        """Angle between roller axis and axle as built [rad]; see `RollerRing.mounted_angle`."""
        return self.ring.mounted_angle

    @property
    def half_length(self) -> float:
        """Long semi-axis L of a roller's ellipsoid [m]."""
        return self.ring.half_length

    @property
    def drop(self) -> float:
        """Drop of the hub at hand-over from roller to roller [m]."""
        return self.ring.drop

    @property
    def roller_half_length(self) -> float:
        """Half length c of a roller as built, the longest that leaves room to its neighbours [m]."""
        return self.ring.roller_half_length

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
    rollers: int = 20,
    roller_angle: float = MECANUM,
    roller_radius: float | None = None,
    mass: float | None = None,
) -> RollerWheel:
    """Return a mecanum wheel, one row of slanted rollers; what is None is in proportion to the radius.

    Args:
      radius: Radius over the rollers [m].
      rollers: Rollers around the wheel.
      roller_angle: Angle between roller axis and axle [rad].
      roller_radius: Largest radius of a roller [m]; 0.09 of the wheel's when None.
      mass: Mass with rollers [kg]; that of a cube of 2800 kg/m³ on the radius when None.

    Raises:
      InputError: As in `RollerWheel`.
    """
    return _in_proportion(radius, rollers, 1, roller_angle, 0.09, roller_radius, None, mass)


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
