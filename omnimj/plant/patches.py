"""A stretch of other floor by place: a sheet of nylon, a puddle of oil."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from omnimj.errors import InputError, UnknownNameError
from omnimj.parameters.floor import Floor, find_floor
from omnimj.parameters.reading import Rule, number

PATCH_KEYS = ("floor", "center", "size", "yaw")

_ANY = Rule(-math.inf, math.inf, False)
_POSITIVE = Rule(0.0, math.inf, True)


@dataclass(frozen=True)
class Patch:
    """A rectangle of other floor that lies in the world."""

    floor: str
    """Name in `floors.toml`."""
    center: tuple[float, float]
    """World x, y [m]."""
    size: tuple[float, float]
    """Length along the patch's own x, width along its y [m]."""
    yaw: float = 0.0
    """Of the patch's x axis, counter-clockwise from the world's [rad]."""

    def covers(self, points: ArrayLike) -> NDArray[np.bool_]:
        """Whether points lie on the patch: |R(−yaw)(p − center)| ≤ size/2 in both directions.

        Args:
          points: One point of shape (2,) or many of shape (..., 2), world frame [m].

        Returns:
          Shape (...); the edge belongs to the patch.
        """
        away = np.asarray(points, float) - np.asarray(self.center)
        c, s = math.cos(self.yaw), math.sin(self.yaw)
        along = away[..., 0] * c + away[..., 1] * s
        across = away[..., 1] * c - away[..., 0] * s
        return (np.abs(along) <= 0.5 * self.size[0]) & (np.abs(across) <= 0.5 * self.size[1])


def _pair(place: str, value: Any, rule: Rule) -> tuple[float, float]:
    if not isinstance(value, list) or len(value) != 2:
        raise InputError(place, f"found {value!r}", "two numbers are needed, [x, y]")
    return number(f"{place}[0]", value[0], rule), number(f"{place}[1]", value[1], rule)


def read_patch(table: Any, place: str, floors: Mapping[str, Floor]) -> Patch:
    """A `[[patches]]` table as a `Patch`.

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
        yaw=float(number(f"{place}.yaw", table.get("yaw", 0.0), _ANY)),
    )
