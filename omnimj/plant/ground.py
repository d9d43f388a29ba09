"""Floors by place: patches such as a sheet of nylon or a puddle of oil, and the hall around them."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from omnimj.errors import InputError, UnknownNameError
from omnimj.parameters.floor import TRACTION_SIZE, Floor, find_floor
from omnimj.parameters.reading import Rule, check_number
from omnimj.physics.native import first_numbers, kernel
from omnimj.signals import Array

PATCH_KEYS = ("floor", "center", "size", "yaw")

_ANY = Rule(-math.inf, math.inf, False)
_POSITIVE = Rule(0.0, math.inf, True)


@dataclass(frozen=True)
class Patch:
    """Rectangle of a different floor, fixed in the world."""

    floor: str
    """Name of the floor of the patch."""
    center: tuple[float, float]
    """Centre x, y in the world [m]."""
    size: tuple[float, float]
    """Length along the x axis of the patch, width along its y axis [m]."""
    yaw: float = 0.0
    """Angle of the patch's x axis, counter-clockwise from the world's [rad]."""

    def covers(self, points: ArrayLike) -> NDArray[np.bool_]:
        """Mask of points on the patch: |R(−yaw)(p − center)| ≤ size/2 in both directions.

        Args:
          points: One point of shape (2,) or many of shape (..., 2), world frame [m].

        Returns:
          Mask of shape (...); the edge belongs to the patch.
        """
        away = np.asarray(points, float) - np.asarray(self.center)
        c, s = math.cos(self.yaw), math.sin(self.yaw)
        along = away[..., 0] * c + away[..., 1] * s
        across = away[..., 1] * c - away[..., 0] * s
        return (np.abs(along) <= 0.5 * self.size[0]) & (np.abs(across) <= 0.5 * self.size[1])


def _pair(place: str, value: Any, rule: Rule) -> tuple[float, float]:
    if not isinstance(value, list) or len(value) != 2:
        raise InputError(place, f"found {value!r}", "two numbers are needed, [x, y]")
    return check_number(f"{place}[0]", value[0], rule), check_number(f"{place}[1]", value[1], rule)


def read_patch(table: Any, place: str, floors: Mapping[str, Floor]) -> Patch:
    """Read a `[[patches]]` table of a scenario.

    Args:
      table: Parsed TOML table.
      place: File and key of the table, for messages.
      floors: Known floors by name.

    Raises:
      InputError: A key is missing or its value breaks the rule.
      UnknownNameError: A key or a floor that does not exist.
    """
    if not isinstance(table, Mapping):
        raise InputError(place, f"found {table!r}", "a table is needed")
    for key in table:
        if key not in PATCH_KEYS:
            raise UnknownNameError(place, "key", key, PATCH_KEYS)
    for key in ("floor", "center", "size"):
        if key not in table:
            raise InputError(place, f"'{key}' is missing")
    return Patch(
        floor=find_floor(str(table["floor"]), f"{place}.floor", floors).name,
        center=_pair(f"{place}.center", table["center"], _ANY),
        size=_pair(f"{place}.size", table["size"], _POSITIVE),
        yaw=float(check_number(f"{place}.yaw", table.get("yaw", 0.0), _ANY)),
    )


class _PatchArea(NamedTuple):
    """Packed geometry of a patch for the kernel."""

    x: float
    """Centre, x in the world [m]."""
    y: float
    """Centre, y in the world [m]."""
    cos: float
    """Cosine of the yaw."""
    sin: float
    half_length: float
    """Half the length [m]."""
    half_width: float
    """Half the width [m]."""


_AREA_SIZE = len(_PatchArea._fields)


class Ground:
    """Floor of the hall and patches, packed for the kernels; where patches overlap, the last is on top."""

    def __init__(self, floor: str, patches: Sequence[Patch], floors: Mapping[str, Floor]):
        """Look up the floors by name.

        Args:
          floor: Name of the hall's floor.
          patches: Patches of other floors.
          floors: Known floors by name.

        Raises:
          UnknownNameError: A floor that does not exist.
        """
        self._floors = floors
        names = [floor, *(patch.floor for patch in patches)]
        places = ["floor", *(f"patches.{k}.floor" for k in range(len(patches)))]
        rows = [self._row(name, place) for name, place in zip(names, places, strict=True)]
        self.rows: Array = np.array(rows)
        """Packed traction law of the hall's floor, then of each patch, shape (1 + patches, TRACTION_SIZE)."""
        self.patches: Array = np.array([_area(patch) for patch in patches]).reshape(-1, _AREA_SIZE)
        """Packed geometry of the patches for `floor_at`, shape (patches, 6)."""

    def replacements(self, names: Sequence[str | None]) -> tuple[Array, Array]:
        """Pack the floors that faults put under the wheels.

        Args:
          names: Name of a floor or None for each wheel, length n.

        Returns:
          Mask of the wheels with such a floor (1 or 0), shape (n,), and its packed traction law, shape
          (n, TRACTION_SIZE).

        Raises:
          UnknownNameError: A floor that does not exist.
        """
        has = np.array([float(name is not None) for name in names])
        rows = [
            np.zeros(TRACTION_SIZE) if name is None else self._row(name, "faults: floor") for name in names
        ]
        return has, np.array(rows)

    def _row(self, name: str, place: str) -> Array:
        return find_floor(name, place, self._floors).row


def _area(patch: Patch) -> _PatchArea:
    length, width = patch.size
    return _PatchArea(*patch.center, math.cos(patch.yaw), math.sin(patch.yaw), 0.5 * length, 0.5 * width)


@kernel
def floor_at(patches, x, y):
    """Index into `Ground.rows` of the floor at a point of the world; the edge of a patch belongs to it.

    Args:
      patches: Packed patches, `Ground.patches`.
      x: World coordinate [m].
      y: World coordinate [m].
    """
    found = 0
    for k in range(patches.shape[0]):
        area = _PatchArea(*first_numbers(patches[k], _AREA_SIZE))
        away_x, away_y = x - area.x, y - area.y
        along = away_x * area.cos + away_y * area.sin
        across = away_y * area.cos - away_x * area.sin
        if abs(along) <= area.half_length and abs(across) <= area.half_width:
            found = k + 1
    return found
