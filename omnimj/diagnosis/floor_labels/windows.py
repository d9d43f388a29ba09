"""Runs as windows: means of currents and wheel speeds where the robot drives steadily."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from omnimj.recording.dataset import Run
from omnimj.signals import Array

WINDOW = 0.3
"""Length of a window [s]."""
START = 1.0
"""Time after the first motion from which a run is judged [s]: starting currents tell nothing of the floor."""
_AROUND = 1.0  # window of the wheel speeds, whose ticks come in packets [s]
_MOVING = 0.02  # [m/s] at the rim
_TURNS = 0.3  # [rad/s] the gear's friction holds a slower wheel, whose current then tells nothing
_UNSTEADY = 0.25  # change of a wheel's speed between the halves of `_AROUND`, over the fastest wheel's
_FEWEST = 3  # samples of a window


@dataclass(frozen=True)
class Windows:
    """Windows of one run, w of them."""

    time: Array
    """Centres, shape (w,) [s]."""
    wheel_speed: Array
    """Mean wheel speeds about each window, shape (w, n) [rad/s]."""
    current: Array
    """Mean currents; NaN where a wheel stands, or nothing is known, shape (w, n) [A]."""


def steady_windows(run: Run, radius: float, wheels: int) -> Windows:
    """Windows of steady driving of a run; masked samples are left out.

    Args:
      run: Run with wheel speeds and currents.
      radius: Wheel radius r [m].
      wheels: Number of wheels n.
    """
    time = run.time
    speeds = run.unmasked([f"wheel_speed_{i + 1}" for i in range(wheels)])
    currents = run.unmasked([f"current_{i + 1}" for i in range(wheels)])
    moving = np.flatnonzero(radius * np.nan_to_num(np.abs(speeds)).max(axis=1) > _MOVING)
    found: list[tuple[float, Array, Array]] = []
    start = float(time[moving[0]]) + START if len(moving) else np.inf
    for k in range(int(max(time[-1] - start, 0.0) / WINDOW + 0.05)):
        middle = start + (k + 0.5) * WINDOW
        inside = _between(time, middle, WINDOW)
        around = _steady_speed(time, speeds, middle)
        if around is None or radius * np.abs(around).max() < _MOVING:
            continue
        known = np.isfinite(currents[inside]).sum(axis=0) >= _FEWEST
        if not (known & (np.abs(around) > _TURNS)).any():
            continue
        drawn = np.full(wheels, np.nan)
        for i in np.flatnonzero(known & (np.abs(around) > _TURNS)):
            drawn[i] = np.nanmean(currents[inside, i])
        found.append((middle, around, drawn))
    if not found:
        return Windows(np.zeros(0), np.zeros((0, wheels)), np.zeros((0, wheels)))
    times, means, drawn = (np.array(column) for column in zip(*found, strict=True))
    return Windows(times, means, drawn)


def _between(time: Array, middle: float, width: float) -> slice:
    first, last = np.searchsorted(time, [middle - 0.5 * width, middle + 0.5 * width])
    return slice(int(first), int(last))


def _steady_speed(time: Array, speeds: Array, middle: float) -> Array | None:
    """Mean wheel speeds about a time, shape (n,); None if unknown or changing."""
    halves = [speeds[_between(time, middle + side * _AROUND, 0.5 * _AROUND)] for side in (-0.25, 0.25)]
    if any(not np.isfinite(half).any(axis=0).all() if len(half) else True for half in halves):
        return None
    before, after = (np.nanmean(half, axis=0) for half in halves)
    if np.abs(after - before).max() > _UNSTEADY * max(np.abs([before, after]).max(), 1e-9):
        return None
    return 0.5 * (before + after)
