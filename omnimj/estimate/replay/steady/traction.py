"""Traction over slip on each floor: by the currents at the measured slip, and by the models.

The slip comes from the measured pose and the wheel speeds, the force from the motors' currents: neither uses
the traction law, which their points therefore test.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from omnimj.estimate.replay.interface import Setting
from omnimj.estimate.replay.steady.replay import SteadyReplay
from omnimj.parameters import Floor
from omnimj.physics.equilibrium import SMOOTHING, steady_ratio, traction_rows
from omnimj.signals import Array

_SPEEDS, _FEWEST = 3, 4  # rolling speeds of the curves; fewest points about one
_POINTS = 81


@dataclass(frozen=True)
class TractionCurves:
    """Traction over slip on one floor at several rolling speeds, measured and by the models."""

    floor: str
    rolling: tuple[float, ...]
    """Rolling speeds of the curves [m/s]."""
    slip: Array
    """Slip velocities of the curves, shape (k,) [m/s]."""
    before: Array
    """F/F_N of the given model, refitted, shape (speeds, k)."""
    after: Array | None
    """F/F_N of the model with the named effects, shape (speeds, k)."""
    points: tuple[Array, ...]
    """By rolling speed: measured slip [m/s] and F/F_N of the wheels near it, shape (m, 2) each."""


def traction_curves(
    replay: SteadyReplay, before: Setting, after: Setting | None
) -> tuple[TractionCurves, ...]:
    """Traction over slip at up to three rolling speeds, floor by floor.

    Args:
      after: The model with the named effects; None without any. Points are those of the last model.
    """
    return tuple(_on_floor(replay, name, before, after) for name in replay.blocks())


def _on_floor(replay: SteadyReplay, name: str, before: Setting, after: Setting | None) -> TractionCurves:
    last = before if after is None else after
    own, speeds = replay.blocks()[name]
    model, floor = replay.model_on(last, name)
    found = np.full((*speeds.shape, 3), np.nan)
    traction_rows(model, np.ascontiguousarray(replay.true_rows(last)[own]), speeds, found)
    points = found.reshape(-1, 3)
    points = points[np.isfinite(points).all(axis=1)]
    rolling, groups = _by_speed(points)
    most = 1.1 * float(np.abs(points[:, 0]).max(initial=1e-3))
    slip = np.linspace(-most, most, _POINTS)
    _, first = replay.model_on(before, name)
    return TractionCurves(
        name,
        rolling,
        slip,
        _curves(first, slip, rolling),
        None if after is None else _curves(floor, slip, rolling),
        groups,
    )


def _by_speed(points: Array) -> tuple[tuple[float, ...], tuple[Array, ...]]:
    """Rolling speeds in equal shares of the points, and slip and F/F_N of the points about each."""
    order = np.argsort(points[:, 1])
    parts = [part for part in np.array_split(order, _SPEEDS) if len(part) >= _FEWEST]
    return (
        tuple(float(np.median(points[part, 1])) for part in parts),
        tuple(points[part][:, [0, 2]] for part in parts),
    )


def _curves(floor: Floor, slip: Array, rolling: tuple[float, ...]) -> Array:
    law = floor.traction
    return np.array([[steady_ratio(law, float(v), speed, SMOOTHING) for v in slip] for speed in rolling])
