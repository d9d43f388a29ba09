"""Signals as they are drawn: thinned without losing peaks, averaged, compressed beyond a value."""

from __future__ import annotations

import numpy as np

from omnimj.signals import Array

BINS = 4000
"""Most bins of a signal; each keeps its smallest and largest sample."""
_AVERAGES, _WINDOW = 210, 0.05  # most points of a mean line; window [s], longer than the passage of a roller


def envelope(time: Array, value: Array, bins: int = BINS) -> tuple[Array, Array]:
    """Thin a signal, shape (k,), to the smallest and largest sample of each bin, which keeps every peak.

    The two samples stand in their order at the beginning and in the middle of their bin, so that all signals
    of equal times share their abscissae. A bin of NaN stays NaN.

    Returns:
      Times and values, shape (2 bins + 1,) each; the signal itself if it is not longer.
    """
    k = len(time)
    if k <= 2 * bins + 1:
        return time, value
    edges = np.linspace(0, k - 1, bins + 1).astype(int)  # the last sample stands for itself
    width = int(np.diff(edges).max())
    rows = np.minimum(edges[:-1, None] + np.arange(width), edges[1:, None] - 1)
    part = value[rows]
    lowest = np.where(np.isnan(part), np.inf, part).argmin(axis=1)
    highest = np.where(np.isnan(part), -np.inf, part).argmax(axis=1)
    each, picked = np.arange(bins), np.empty(2 * bins + 1)
    picked[0:-1:2] = part[each, np.minimum(lowest, highest)]
    picked[1:-1:2] = part[each, np.maximum(lowest, highest)]
    times = np.empty(2 * bins + 1)
    times[0:-1:2], times[1:-1:2] = time[edges[:-1]], time[(edges[:-1] + edges[1:]) // 2]
    times[-1], picked[-1] = time[-1], value[-1]
    return times, picked


def averaged(time: Array, value: Array) -> tuple[Array, Array]:
    """Average a rippling signal, shape (k,), over `window(time)`.

    Returns:
      Time and mean, shape (bins,) each; the samples themselves if they are few.
    """
    bins = int((time[-1] - time[0]) / window(time)) if len(time) > 1 else 1
    if len(time) < 4 * bins:
        return time, value
    edges = np.linspace(0, len(time), bins + 1).astype(int)[:-1]
    length = np.diff(np.append(edges, len(time)))
    return np.add.reduceat(time, edges) / length, np.add.reduceat(value, edges) / length


def window(time: Array) -> float:
    """Return the averaging window of `averaged` for times of shape (k,) [s]."""
    return max(_WINDOW, float(time[-1] - time[0]) / _AVERAGES)


def log_beyond(value: Array, linear: float) -> Array:
    """Compress values beyond ± `linear` logarithmically: one unit up to there, then one per decade."""
    size = np.abs(value) / linear
    return np.sign(value) * np.where(size <= 1.0, size, 1.0 + np.log10(np.maximum(size, 1.0)))
