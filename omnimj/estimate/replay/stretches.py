"""Stretches of measured runs without gaps, on a common clock: shared by the replays of joints and axes."""

from __future__ import annotations

import itertools
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from omnimj.physics.native import kernel
from omnimj.recording.dataset import Run
from omnimj.signals import Array

FIRST, LAST, FIRST_BLOCK = range(3)
WINDOW = 3
"""Columns of the table of free windows: samples first … last − 1, and the first row of blocks."""


def white_noise(values: Sequence[Array]) -> float:
    """Deviation of white noise by third differences of stretches; that of quantisation where it is larger."""
    changes = np.concatenate([np.diff(v, 3) for v in values])
    spread = float(np.median(np.abs(changes - np.median(changes)))) / 0.6745 / np.sqrt(20.0)
    steps = np.concatenate([np.abs(np.diff(v)) for v in values])
    scale = max(float(np.abs(np.concatenate(values)).max()), 1e-300)
    steps = steps[steps > 1e-12 * scale]
    smallest = float(np.quantile(steps, 0.02)) if len(steps) else 0.0
    return max(spread, smallest / np.sqrt(12.0), 1e-9 * scale)


def split_at_gaps(time: Array, longest: float) -> list[slice]:
    """Split a run where it has no sample for longer than a time [s]."""
    cuts = np.flatnonzero(np.diff(time) > longest) + 1
    edges = [0, *cuts.tolist(), len(time)]
    return [slice(a, b) for a, b in itertools.pairwise(edges)]


def on_clock(
    run: Run, name: str, values: Array, part: slice, clock: Array
) -> tuple[Array, NDArray[np.bool_]]:
    """Resample a column, masked samples bridged by straight lines.

    Args:
      values: The column, shape (samples of the run,).
      part: Samples of a stretch without gaps.
      clock: Times to resample at, shape (k,) [s].

    Returns:
      Values at these times, NaN where the whole stretch is masked, and the mask of affected ones, shape (k,)
      each.
    """
    time, bad = run.time[part], np.asarray(run.masked.get(name, np.zeros(len(run.time), bool)))[part]
    bad = bad | ~np.isfinite(values[part])
    if bad.all():
        return np.full(len(clock), np.nan), np.ones(len(clock), bool)
    on_clock = np.interp(clock, time[~bad], values[part][~bad])
    return on_clock, np.interp(clock, time, bad.astype(float)) > 1e-6


@kernel
def value_at(values, place, first, last):
    """Interpolate linearly between samples first … last − 1; constant beyond them.

    Args:
      values: Samples of a channel, shape (samples,).
      place: Place, counted like the samples.
      first: First sample of the window.
      last: Sample after the end of the window; it has at least two.
    """
    place = min(max(place, float(first)), float(last - 1))
    below = min(int(place), last - 2)
    share = place - below
    return (1.0 - share) * values[below] + share * values[below + 1]


@kernel
def block_means(values, windows, size, means):
    """Average the samples of every block; NaN where a sample is NaN.

    Args:
      values: Samples, shape (n, columns).
      means: Filled with the block means, shape (blocks, columns).
    """
    for w in range(len(windows)):
        row = windows[w, 2]
        for start in range(windows[w, 0], windows[w, 1], size):
            for c in range(values.shape[1]):
                total = 0.0
                for k in range(start, start + size):
                    total += values[k, c]
                means[row, c] = total / size
            row += 1
