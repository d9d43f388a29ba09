"""Limits of a wheel's numbers; each refusal states the rule and what would fit."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import replace
from types import MappingProxyType
from typing import NoReturn

from omnimj.errors import InputError
from omnimj.wheels.ring import OMNI, RollerRing

MAX_ROLLERS, MAX_ROWS = 60, 4
_MAX_DROP = 0.02  # of the radius; deeper drops shake the robot more than its wheels carry it
_MAX_ROLLER_SHARE = 0.8  # of the wheel's mass
RANGES: Mapping[str, tuple[float, float, str]] = MappingProxyType(
    {
        "radius": (0.005, 1.0, " m"),
        "rollers": (3, MAX_ROLLERS, ""),
        "rows": (1, MAX_ROWS, ""),
        "roller_angle": (math.radians(20.0), math.radians(160.0), " rad"),
        "mass": (1e-4, 1e5, " kg"),
    }
)
"""Least and largest value of a number, and its unit."""


def refuse(name: str, found: object, rule: str) -> NoReturn:
    """Raise the error of a number of a wheel.

    Raises:
      InputError: Always.
    """
    shown = f"{found:g}" if isinstance(found, float) else str(found)
    raise InputError(f"wheel: {name}", f"found {shown}", rule)


def check_range(name: str, value: float) -> None:
    """Check a number of `RANGES`.

    Raises:
      InputError: It is out of its range, not finite, or not a whole number where one is needed.
    """
    if name in ("rollers", "rows") and not isinstance(value, int):
        refuse(name, value, "must be a whole number")
    low, high, unit = RANGES[name]
    if not low <= value <= high:  # also not for nan
        refuse(name, value, f"must be at least {low:.4g} and at most {high:.4g}{unit}")


def check_ring(ring: RollerRing, row_spacing: float) -> None:
    """Check that rollers and rows are apart, and enough to carry the wheel without dropping far.

    Args:
      ring: Rollers, their numbers within `RANGES`.
      row_spacing: Distance between rows [m].

    Raises:
      InputError: A number breaks a rule.
    """
    low, high = 0.02 * ring.radius, 0.4 * ring.radius
    if not low <= ring.roller_radius <= high:
        rule = f"must be at least {low:.4g} and at most {high:.4g} m, 0.02 to 0.4 of the wheel's radius"
        refuse("roller_radius", ring.roller_radius, rule)
    if ring.rows > 1:
        _check_rows(ring, row_spacing)
    found = f"{ring.rollers} in a row"
    if not _carries(ring):
        fewest = next(n for n in range(3, 4 * MAX_ROLLERS) if _carries(replace(ring, rollers=n)))
        rule = f"the hub would drop by {1e3 * ring.drop:.2g} mm from roller to roller, more than 2 % of the "
        refuse("rollers", found, f"{rule}radius; at least {fewest} in a row are needed")
    if not ring.fits:
        refuse("rollers", found, f"the rollers overlap; {_what_fits(ring)}")


def check_mass(mass: float, rollers: float) -> None:
    """Check that a wheel is heavier than its rollers.

    Args:
      mass: Mass of the wheel [kg].
      rollers: Mass of its rollers [kg].

    Raises:
      InputError: Too little is left for the hub.
    """
    if rollers > _MAX_ROLLER_SHARE * mass:
        low = rollers / _MAX_ROLLER_SHARE
        refuse("mass", mass, f"must be at least {low:.3g} kg: the rollers alone have {rollers:.3g} kg")


def _check_rows(ring: RollerRing, spacing: float) -> None:
    if ring.roller_angle != OMNI:
        refuse("rows", ring.rows, "must be 1 for slanted rollers")
    low, high = 2.0 * ring.roller_radius, 2.0 * ring.radius
    if not low <= spacing <= high:
        refuse(
            "row_spacing", spacing, f"must be at least {low:.4g} m, or rows overlap, and at most {high:.4g} m"
        )


def _carries(ring: RollerRing) -> bool:
    return ring.drop <= _MAX_DROP * ring.radius


def _what_fits(ring: RollerRing) -> str:
    rings = [replace(ring, rollers=n) for n in range(3, MAX_ROLLERS + 1)]
    counts = [one.rollers for one in rings if one.fits and _carries(one)]
    rings = [replace(ring, roller_radius=ring.radius * (0.02 + 0.002 * k)) for k in range(191)]
    radii = [one.roller_radius for one in rings if one.fits]
    parts = []
    if counts:
        fit = f"{counts[0]} to {counts[-1]}" if len(counts) > 1 else f"only {counts[0]}"
        parts.append(f"with roller radius {ring.roller_radius:.4g} m {fit} in a row fit")
    if radii:
        parts.append(f"with {ring.rollers} the roller radius may be up to {radii[-1]:.4g} m")
    return ", ".join(parts) or "neither another number nor another radius of rollers fits"
