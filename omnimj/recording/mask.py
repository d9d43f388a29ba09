"""Samples that must not be fitted: the edges of gaps in time, and single samples that leap out and back."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from omnimj.signals import Array

Marks = NDArray[np.bool_]

_GAP = 1.75  # × median time step: one dropped sample makes 2, a clock in whole milliseconds 3 : 2
_SCATTERS = 10.0  # × robust scatter: a logger without a steady rate has no gap at every long step
_NEAR_STEPS = 10  # time steps on each side: a logger that changes its rate has no gaps ever after
_NEAR = 25  # samples on each side that say what is usual here
_LOCAL = 8.0  # × their upper quartile
_ALONE = 3.0  # × the largest of them, but for others that look like spikes
_OTHERS = 2  # of those at most: what leaps again and again is how the signal is
_RETURN = 0.35  # × the leap: how far the neighbours may lie apart beyond the trend
_MIRRORED = 0.5  # × what a spike makes its neighbours leap: a corner leaves them in peace
_QUANTUM = 8.0  # × the smallest difference there is: a count of an encoder more or less is no spike
_ROUNDING = 1e-9  # × the largest number
_USUAL = 5.0  # × the 95th percentile of all runs together
_FEWEST = 7  # samples, for neighbours and their neighbours
_SOME = 0.01  # of the samples: leaps that are more frequent are how this signal is


def find_gaps(time: Array) -> NDArray[np.int64]:
    """Samples after which time steps well above the usual, shape (g,).

    Usual is the median of the run and of the steps around; a rate that varies is no gap.

    Args:
      time: Strictly increasing, shape (n,) [s].
    """
    step = np.diff(time)
    median = np.median(step)
    scatter = 1.4826 * np.median(np.abs(step - median))
    long = np.flatnonzero((step > _GAP * median) & (step > median + _SCATTERS * scatter))
    if not len(long):
        return long
    near = long[:, None] + np.arange(-_NEAR_STEPS, _NEAR_STEPS + 1)
    around = np.median(step[np.clip(near, 0, len(step) - 1)], axis=1)
    return long[step[long] > _GAP * around]


def gap_edges(after: NDArray[np.int64], count: int) -> Marks:
    """The samples on both sides of each gap, shape (count,)."""
    marks = np.zeros(count, dtype=bool)
    marks[after] = marks[after + 1] = True
    return marks


def find_spikes(columns: Sequence[Array], times: Sequence[Array], angle: bool = False) -> list[Marks]:
    """Single samples that leap out of one channel's runs and back.

    Sample k leaps by r = x_k − (its neighbours' line at t_k). It is a spike when |r| is far above all other
    leaps around it, far above what is usual in all runs together, and when the neighbours lie as if it were
    not there. Steps, corners and impacts do not return; what is quantised or rattles has a scatter of its
    own; a channel that leaps all the time is not to be judged by this and has no spikes.

    With white noise of standard deviation σ a leap of 20 σ is found, one of 8 σ is not: to miss a small
    spike costs a fit little, to take away what is there could hide an effect.

    Args:
      columns: The channel in each run, shapes (n,).
      times: Times of the samples, shapes (n,) [s].
      angle: Whether the channel is an angle [rad] that may be wrapped.

    Returns:
      Per run the spikes, shape (n,).
    """
    leaps, returns = [], []
    for values, time in zip(columns, times, strict=True):
        leap, apart = _deviation(np.unwrap(values) if angle else values, time)
        leaps.append(np.abs(leap))
        returns.append((np.abs(apart) <= _RETURN * np.abs(leap)) & _mirrored(leap, time))
    least = _usual_deviation(leaps, columns)
    return [
        _isolated(size, np.flatnonzero(back & (size > least)))
        for size, back in zip(leaps, returns, strict=True)
    ]


def _deviation(x: Array, time: Array) -> tuple[Array, Array]:
    """How far each sample lies off its neighbours' line, and how far those lie apart beyond the trend.

    The trend is that of the neighbours' own neighbours. At the ends and beside gaps both are 0.
    """
    leap, apart = np.zeros(len(x)), np.zeros(len(x))
    if len(x) < _FEWEST:
        return leap, apart
    before, after = time[1:-1] - time[:-2], time[2:] - time[1:-1]
    outer = np.clip(np.arange(len(x) - 2), 1, None) - 1, np.clip(np.arange(3, len(x) + 1), None, len(x) - 1)
    with np.errstate(over="ignore", invalid="ignore"):
        across = x[2:] - x[:-2]
        leap[1:-1] = x[1:-1] - (x[:-2] + across * (before / (before + after)))
        trend = (x[outer[1]] - x[outer[0]]) / (time[outer[1]] - time[outer[0]])
        apart[1:-1] = across - trend * (before + after)
    for k in (-1, 0, 1, 2):  # a triple with a gap in it says nothing
        leap[np.clip(find_gaps(time) + k, 0, len(x) - 1)] = 0.0
    return np.nan_to_num(leap, nan=0.0), np.nan_to_num(apart, nan=0.0)


def _mirrored(leap: Array, time: Array) -> Marks:
    """Whether both neighbours leap the other way, as a spike makes them, shape (n,).

    A spike of size r makes the neighbour before it leap by −r (t₋₁ − t₋₂)/(t − t₋₂), the one after it alike.
    """
    marks = np.ones(len(leap), dtype=bool)
    if len(leap) < _FEWEST:
        return marks
    share = (time[1:-1] - time[:-2]) / (time[2:] - time[:-2])  # of the later neighbour in each line
    size = np.abs(leap)
    against = -np.sign(leap)
    marks[2:] &= against[2:] * leap[1:-1] >= _MIRRORED * share * size[2:]
    marks[:-2] &= against[:-2] * leap[1:-1] >= _MIRRORED * (1.0 - share) * size[:-2]
    return marks


def _usual_deviation(leaps: Sequence[Array], columns: Sequence[Array]) -> float:
    """Up to here a leap is usual in these runs."""
    sizes = np.concatenate(leaps)
    with np.errstate(over="ignore"):
        differences = [np.abs(np.diff(values)) for values in columns]
    quantum = min((float(d[d > 0.0].min()) for d in differences if (d > 0.0).any()), default=0.0)
    rounding = _ROUNDING * max(float(np.max(np.abs(values))) for values in columns)
    return max(_USUAL * float(np.quantile(sizes, 0.95)), _QUANTUM * quantum, rounding)


def _isolated(size: Array, found: NDArray[np.int64]) -> Marks:
    """Those of the leaps found that stand out of what is around them, shape (n,)."""
    marks = np.zeros(len(size), dtype=bool)
    if not len(found) or len(found) > max(_OTHERS + 1, _SOME * len(size)):
        return marks
    calm = size.copy()
    for k in (-1, 0, 1):  # a spike makes its neighbours leap, too
        calm[np.clip(found + k, 0, len(size) - 1)] = 0.0
    offsets = np.concatenate((np.arange(-_NEAR, -1), np.arange(2, _NEAR + 1)))
    around = np.clip(found[:, None] + offsets, 0, len(size) - 1)
    others = (np.abs(found[:, None] - found) <= _NEAR).sum(axis=1) - 1
    usual = np.quantile(size[around], 0.75, axis=1)
    stands_out = (size[found] > _ALONE * calm[around].max(axis=1)) & (size[found] > _LOCAL * usual)
    marks[found[stands_out & (others <= _OTHERS)]] = True
    return marks
