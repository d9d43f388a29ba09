"""Which floor each wheel of a planar plant stands on: by fault, by place, or the floor of the hall."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

import numpy as np

from omnimj.parameters.floor import ROW, Floor, find_floor
from omnimj.physics.native import kernel
from omnimj.plant.patches import Patch
from omnimj.signals import Array

PATCH_ROW = 6


class Ground:
    """Floors of the hall as rows for the kernels; of patches that overlap the one listed last is on top."""

    def __init__(self, floor: str, patches: Sequence[Patch], floors: Mapping[str, Floor]):
        """Looks the floors up.

        Raises:
          UnknownNameError: A floor that does not exist.
        """
        self._floors = floors
        names = [floor, *(patch.floor for patch in patches)]
        places = ["floor", *(f"patches.{k}.floor" for k in range(len(patches)))]
        rows = [self._row(name, place) for name, place in zip(names, places, strict=True)]
        self.rows: Array = np.array(rows)
        """Row of the hall's floor, then of each patch, shape (1 + patches, ROW)."""
        self.patches: Array = np.array([_patch_row(patch) for patch in patches]).reshape(-1, PATCH_ROW)
        """Centre, cosine and sine of the yaw, half length and half width, shape (patches, PATCH_ROW)."""

    def replaced(self, names: Sequence[str | None]) -> tuple[Array, Array]:
        """Floors that faults put under the wheels.

        Returns:
          Whether each wheel has one (1 or 0), shape (n,), and its row, shape (n, ROW).

        Raises:
          UnknownNameError: A floor that does not exist.
        """
        has = np.array([float(name is not None) for name in names])
        rows = [np.zeros(ROW) if name is None else self._row(name, "faults: floor") for name in names]
        return has, np.array(rows)

    def _row(self, name: str, place: str) -> Array:
        return find_floor(name, place, self._floors).row


def _patch_row(patch: Patch) -> tuple[float, ...]:
    length, width = patch.size
    return (*patch.center, math.cos(patch.yaw), math.sin(patch.yaw), 0.5 * length, 0.5 * width)


@kernel
def floor_at(patches, x, y):
    """Index into `Ground.rows` of the floor at a point of the world [m]; a patch's edge belongs to it."""
    found = 0
    for k in range(patches.shape[0]):
        patch = patches[k]
        away_x, away_y = x - patch[0], y - patch[1]
        along = away_x * patch[2] + away_y * patch[3]
        across = away_y * patch[2] - away_x * patch[3]
        if abs(along) <= patch[4] and abs(across) <= patch[5]:
            found = k + 1
    return found
