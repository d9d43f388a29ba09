"""Two channels that say the same thing: by which factor, how late, and with what drift.

y(t) = c + b t + s x(t − δ), with c and b of every stretch its own. A positive δ: y is late.
"""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from omnimj.signals import Array

_FARTHEST = 0.08  # [s] delays looked for
_FEWEST = 30  # samples of a stretch


@dataclass(frozen=True)
class Stretch:
    """Samples of two quantities over one stretch of time, all shape (n,)."""

    time: Array
    x: Array
    y: Array


@dataclass(frozen=True)
class Comparison:
    """How y follows x over all stretches."""

    scale: float
    """s, at the delay found."""
    delay: float
    """δ [s]."""
    delay_error: float
    """Standard error of δ from stretch to stretch; infinite with a single one [s]."""
    correlation: float
    """Between what c + b t leaves of y and of x(t − δ)."""
    drift: float
    """Mean of b [unit of y per s]."""
    drift_error: float
    """Standard error of the same from stretch to stretch."""
    scales: Array
    """s of every stretch, shape (stretches,)."""


def integral(time: Array, rate: Array) -> Array:
    """∫ rate dt from the first sample on, by trapezoids, shape (n,)."""
    steps = 0.5 * (rate[1:] + rate[:-1]) * np.diff(time)
    return np.concatenate([[0.0], np.cumsum(steps)])


def windows(length: int, longest: int) -> list[slice]:
    """Equal parts of at most `longest` samples."""
    parts = max(1, -(-length // longest))
    ends = np.linspace(0, length, parts + 1).astype(int)
    return [slice(int(a), int(b)) for a, b in itertools.pairwise(ends)]


def compare(stretches: Sequence[Stretch]) -> Comparison | None:
    """Fits s, δ and the drifts.

    Returns:
      None where x or y does not move.
    """
    used = [p for p in stretches if len(p.time) >= _FEWEST and np.ptp(p.x) > 0.0 and np.ptp(p.y) > 0.0]
    if not used:
        return None
    step = float(np.median([np.median(np.diff(p.time)) for p in used]))
    reach = max(_FARTHEST, 3.0 * step)
    delays = np.linspace(-reach, reach, 81)
    errors = np.empty((len(used), len(delays)))
    for row, part in zip(errors, used, strict=True):
        trend, y = _trend(part)
        rest = y @ y
        for k, delay in enumerate(delays):
            x = _left(trend, np.interp(part.time - delay, part.time, part.x))
            row[k] = 1.0 - (x @ y) ** 2 / max((x @ x) * rest, 1e-300)
    powers = np.array([len(p.time) for p in used], float)
    together = (powers[:, None] * np.log(np.maximum(errors, 1e-12))).sum(axis=0)
    delay = _lowest(delays, together)
    own = np.array([_lowest(delays, np.log(np.maximum(row, 1e-12))) for row in errors])
    near = own[np.abs(own - np.median(own)) < 0.05]
    error = float(near.std(ddof=1) / np.sqrt(near.size)) if near.size > 2 else np.inf
    return _at(used, delay, error)


def _at(used: Sequence[Stretch], delay: float, error: float) -> Comparison:
    scales, drifts, moments = [], [], np.zeros(3)
    for part in used:
        trend, y = _trend(part)
        moved = np.interp(part.time - delay, part.time, part.x)
        x = _left(trend, moved)
        moments += (x @ y, x @ x, y @ y)
        scales.append((x @ y) / max(x @ x, 1e-300))
    scale = float(moments[0] / max(moments[1], 1e-300))
    for part in used:
        moved = np.interp(part.time - delay, part.time, part.x)
        drifts.append(np.polyfit(part.time - part.time[0], part.y - scale * moved, 1)[0])
    count = len(drifts)
    spread = float(np.std(drifts, ddof=1) / np.sqrt(count)) if count > 2 else np.inf
    correlation = float(moments[0] / np.sqrt(max(moments[1] * moments[2], 1e-300)))
    return Comparison(scale, delay, error, correlation, float(np.mean(drifts)), spread, np.array(scales))


def _trend(part: Stretch) -> tuple[Array, Array]:
    t = part.time - part.time.mean()
    trend = np.linalg.qr(np.stack([np.ones_like(t), t], axis=1))[0]
    return trend, _left(trend, part.y)


def _left(trend: Array, values: Array) -> Array:
    return values - trend @ (trend.T @ values)


def _lowest(places: Array, values: Array) -> float:
    """Place of the lowest value, between the samples by a parabola."""
    k = int(values.argmin())
    if k in (0, len(values) - 1):
        return float(places[k])
    a, b, c = values[k - 1 : k + 2]
    bend = a - 2.0 * b + c
    shift = 0.5 * (a - c) / bend if bend > 0.0 else 0.0
    return float(places[k] + shift * (places[1] - places[0]))
