"""What lies on the floor in a Rerun recording: tiles, patches of other floor, planned and driven path."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import numpy as np
import rerun as rr
from numpy.typing import NDArray

from omnimj.signals import Trace
from omnimj.view import palette
from omnimj.view.plots_path import patch_corners
from omnimj.view.timeline import time_column

Array = NDArray[np.float64]
FLOOR, PATH = "world/floor", "world/path"
_TRAIL_STEPS, _TRAIL_POINTS = 120, 240
_TILE = 0.25  # [m]
_MOST_TILES = 512  # along a side: a run that broke down may end anywhere
_MARGIN = 0.6  # [m] of floor around what moves


def log_floor(stream: rr.RecordingStream, points: Array, patches: Sequence[Any], floor: str) -> None:
    """The floor as a slab with tiles, and each patch of other floor with its name.

    Tiles are 0.25 m wide, larger ones where the floor is vast.

    Args:
      stream: Where to log.
      points: What the floor must lie under, shape (k, 2) [m].
      patches: Each has `floor`, `center`, `size` and `yaw`.
      floor: Its name.
    """
    low, high = np.floor(points.min(axis=0) - _MARGIN), np.ceil(points.max(axis=0) + _MARGIN)
    slab = rr.Boxes3D(
        centers=[[*(low + high) / 2, -0.008]],
        half_sizes=[[*(high - low) / 2, 0.006]],
        colors=[(214, 212, 206)],
        fill_mode="solid",
    )
    stream.log(f"{FLOOR}/{floor}", slab, static=True)
    tile = _TILE * 2.0 ** max(0, math.ceil(math.log2(float((high - low).max()) / (_MOST_TILES * _TILE))))
    lines = [[[x, low[1], 0], [x, high[1], 0]] for x in np.arange(low[0], high[0] + 1e-9, tile)]
    lines += [[[low[0], y, 0], [high[0], y, 0]] for y in np.arange(low[1], high[1] + 1e-9, tile)]
    stream.log(
        f"{FLOOR}/tiles", rr.LineStrips3D(lines, colors=[(196, 193, 186)], radii=[0.0012]), static=True
    )
    for i, patch in enumerate(patches, start=1):
        _log_patch(stream, f"{FLOOR}/patch_{i}_{patch.floor}", patch)


def _log_patch(stream: rr.RecordingStream, entity: str, patch: Any) -> None:
    corners = np.column_stack([patch_corners(patch), np.full(4, 0.0008)])
    mesh = rr.Mesh3D(
        vertex_positions=corners,
        triangle_indices=[[0, 1, 2], [0, 2, 3]],
        albedo_factor=(143, 196, 228, 255),
    )
    stream.log(entity, mesh, static=True)
    # at the far edge, where the machine that starts on it does not stand in front
    name = rr.Points3D(
        [corners[2:].mean(axis=0)],
        radii=[0.004],
        colors=[(245, 248, 252)],
        labels=[patch.floor.replace("_", " ")],
        show_labels=True,
    )
    stream.log(f"{entity}/name", name, static=True)


def log_planned(stream: rr.RecordingStream, planned: Array) -> None:
    """The planned path as a whole, shape (k, 2) [m]."""
    keep = np.unique(np.linspace(0, len(planned) - 1, min(len(planned), _TRAIL_POINTS)).astype(int))
    strip = rr.LineStrips3D(
        [_on_floor(planned[keep], 0.002)], colors=[palette.rgb(palette.PLANNED)], radii=[0.004]
    )
    stream.log(f"{PATH}/planned", strip, static=True)


class Trail:
    """The driven path as it grows, the whole line so far at each of its steps."""

    def __init__(self, stream: rr.RecordingStream, duration: float):
        """A path of a run that lasts at most `duration` [s]."""
        self._stream, self._duration = stream, duration
        self._points = np.empty((0, 2))
        self._last = -1.0
        style = rr.LineStrips3D.from_fields(colors=[palette.rgb(palette.MEASURED)], radii=[0.006])
        stream.log(f"{PATH}/driven", style, static=True)

    def add(self, trace: Trace) -> None:
        """Goes on by the rows of a trace, which follow those added before."""
        time, place = trace["time"], np.column_stack([trace["x"], trace["y"]])
        kept = self._crossed(time, _TRAIL_POINTS)
        ends = np.union1d(self._crossed(time, _TRAIL_STEPS), [len(time) - 1])
        strips = [
            _on_floor(np.vstack([self._points, place[kept[kept < end]], place[end]]), 0.004) for end in ends
        ]
        columns = rr.LineStrips3D.columns(strips=strips)
        self._stream.send_columns(f"{PATH}/driven", [time_column(time[ends])], columns)
        # a drive by hand may go on for ever, its trail may not
        self._points = np.vstack([self._points, place[kept]])[-2 * _TRAIL_POINTS :]
        self._last = float(time[-1])

    def _crossed(self, time: Array, parts: int) -> NDArray[np.int64]:
        """Rows at which another of the run's equal parts begins."""
        part = np.floor(np.concatenate([[self._last], time]) * parts / self._duration + 1e-9)
        return np.flatnonzero(np.diff(part) > 0)


def _on_floor(points: Array, height: float) -> NDArray[np.float32]:
    return np.column_stack([points, np.full(len(points), height)]).astype(np.float32)
