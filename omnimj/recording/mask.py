"""Detection of samples that must not be fitted: edges of gaps in time, and single-sample spikes."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from omnimj.signals import Array

Mask = NDArray[np.bool_]
"""Mask of samples, True where a sample must not be fitted, shape (n,)."""

_GAP = 1.75  # × median time step: one dropped sample makes 2, a clock in whole milliseconds 3 : 2
_SCATTERS = 10.0  # × robust scatter: a logger without a steady rate has no gap at every long step
_NEAR_STEPS = 10  # time steps on each side: after a change of rate, longer steps are no gaps
_NEAR = 25  # samples on each side that define the usual deviation
_LOCAL = 8.0  # × the upper quartile of the nearby deviations: least size of a spike
_ALONE = 3.0  # × the largest nearby deviation, without other candidates: least size of a spike
_OTHERS = 2  # most candidates nearby: repeated deviations belong to the signal
_RETURN = 0.35  # × the deviation: largest distance between the neighbours beyond the trend
_MIRRORED = 0.5  # × the deviation that a spike causes in its neighbours: a corner causes none
_QUANTUM = 8.0  # × the smallest difference in the data: one encoder count is not a spike
_ROUNDING = 1e-9  # × the largest number in the data: rounding error
_USUAL = 5.0  # × the 95th percentile of the deviations over all runs: least size of a spike
_FEWEST = 7  # least samples of a run, for neighbours and their neighbours
_SOME = 0.01  # share of the samples: more frequent deviations belong to the signal


def find_gaps(time: Array) -> NDArray[np.int64]:
    """Find gaps: time steps well above the median over the run and over neighbouring steps.

    A varying sample rate is not a gap.

    Args:
      time: Strictly increasing times, shape (n,) [s].

    Returns:
      Indices of the samples before each gap, shape (g,).
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


def gap_edges(after: NDArray[np.int64], count: int) -> Mask:
    """Mask the samples on both sides of each gap.

    Args:
      after: Indices of the samples before each gap, from `find_gaps`, shape (g,).
      count: Number of samples n.

    Returns:
      Mask, shape (n,).
    """
    mask = np.zeros(count, dtype=bool)
    mask[after] = mask[after + 1] = True
    return mask


def find_spikes(columns: Sequence[Array], times: Sequence[Array], angle: bool = False) -> list[Mask]:
    """Find single-sample spikes in one channel.

    Sample k deviates by r = x_k − (line through its neighbours at t_k). It is a spike when |r| is far above
    all other deviations nearby and far above those usual over all runs, and when the neighbours continue the
    trend as if it were absent. Steps, corners and impacts do not return to the line; quantised or rattling
    signals have a large scatter; a channel with frequent deviations has no spikes.

    A spike of 20 times the largest noise sample is always found. In Gaussian noise of standard deviation σ,
    all but about one in a thousand spikes of 20 σ are found, and those of 8 σ are not: a missed small spike
    hardly affects a fit, whereas removing real data could hide an effect.

    Args:
      columns: Samples of the channel, by run, each shape (n,).
      times: Times of the samples, by run, each shape (n,) [s].
      angle: Whether the channel is an angle [rad] that may be wrapped.

    Returns:
      Masks of the spikes, by run, each shape (n,).
    """
    deviations, returns = [], []
    for values, time in zip(columns, times, strict=True):
        deviation, apart = _deviation(np.unwrap(values) if angle else values, time)
        deviations.append(np.abs(deviation))
        returns.append((np.abs(apart) <= _RETURN * np.abs(deviation)) & _mirrored(deviation, time))
    least = _usual_deviation(deviations, columns)
    return [
        _isolated(size, np.flatnonzero(back & (size > least)))
        for size, back in zip(deviations, returns, strict=True)
    ]


def _deviation(x: Array, time: Array) -> tuple[Array, Array]:
    """Return each sample's deviation from its neighbours' line, and their distance beyond the trend.

    The trend is that of the neighbours' own neighbours. At the ends and beside gaps both are 0.

    Args:
      x: Channel in one run, shape (n,).
      time: Times, shape (n,) [s].

    Returns:
      Deviation and distance, each shape (n,), in the unit of the channel.
    """
    deviation, apart = np.zeros(len(x)), np.zeros(len(x))
    if len(x) < _FEWEST:
        return deviation, apart
    before, after = time[1:-1] - time[:-2], time[2:] - time[1:-1]
    outer = np.clip(np.arange(len(x) - 2), 1, None) - 1, np.clip(np.arange(3, len(x) + 1), None, len(x) - 1)
    with np.errstate(over="ignore", invalid="ignore"):
        across = x[2:] - x[:-2]
        deviation[1:-1] = x[1:-1] - (x[:-2] + across * (before / (before + after)))
        trend = (x[outer[1]] - x[outer[0]]) / (time[outer[1]] - time[outer[0]])
        apart[1:-1] = across - trend * (before + after)
    for k in (-1, 0, 1, 2):  # a triple across a gap is not evaluated
        deviation[np.clip(find_gaps(time) + k, 0, len(x) - 1)] = 0.0
    return np.nan_to_num(deviation, nan=0.0), np.nan_to_num(apart, nan=0.0)


def _mirrored(deviation: Array, time: Array) -> Mask:
    """Mask the samples whose neighbours deviate to the other side, as they do beside a spike, shape (n,).

    A spike of size r makes the sample before it deviate by −r (t₋₁ − t₋₂)/(t − t₋₂), and likewise the one
    after it.
    """
    mask = np.ones(len(deviation), dtype=bool)
    if len(deviation) < _FEWEST:
        return mask
    share = (time[1:-1] - time[:-2]) / (time[2:] - time[:-2])  # weight of the later neighbour in each line
    size = np.abs(deviation)
    against = -np.sign(deviation)
    mask[2:] &= against[2:] * deviation[1:-1] >= _MIRRORED * share * size[2:]
    mask[:-2] &= against[:-2] * deviation[1:-1] >= _MIRRORED * (1.0 - share) * size[:-2]
    return mask


def _usual_deviation(deviations: Sequence[Array], columns: Sequence[Array]) -> float:
    """Return the largest deviation that is usual in these runs."""
    sizes = np.concatenate(deviations)
    with np.errstate(over="ignore"):
        differences = [np.abs(np.diff(values)) for values in columns]
    quantum = min((float(d[d > 0.0].min()) for d in differences if (d > 0.0).any()), default=0.0)
    rounding = _ROUNDING * max(float(np.max(np.abs(values))) for values in columns)
    return max(_USUAL * float(np.quantile(sizes, 0.95)), _QUANTUM * quantum, rounding)


def _isolated(size: Array, found: NDArray[np.int64]) -> Mask:
    """Mask the candidates `found` that stand out from the deviations nearby, shape (n,)."""
    mask = np.zeros(len(size), dtype=bool)
    if not len(found) or len(found) > max(_OTHERS + 1, _SOME * len(size)):
        return mask
    calm = size.copy()
    for k in (-1, 0, 1):  # a spike makes its neighbours deviate as well
        calm[np.clip(found + k, 0, len(size) - 1)] = 0.0
    offsets = np.concatenate((np.arange(-_NEAR, -1), np.arange(2, _NEAR + 1)))
    around = np.clip(found[:, None] + offsets, 0, len(size) - 1)
    others = (np.abs(found[:, None] - found) <= _NEAR).sum(axis=1) - 1
    usual = np.quantile(size[around], 0.75, axis=1)
    stands_out = (size[found] > _ALONE * calm[around].max(axis=1)) & (size[found] > _LOCAL * usual)
    mask[found[stands_out & (others <= _OTHERS)]] = True
    return mask
