"""Scale, delay and drift between two channels that measure the same quantity, and the order of first motions.

y(t) = c + b t + s x(t − δ), with c and b free in every stretch. δ > 0: y is late.
"""

from __future__ import annotations

import itertools
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from omnimj.estimate.gap.check.columns import fill_masked, unwrap_counter
from omnimj.estimate.gap.check.suspicions import Link, Suspicion, late
from omnimj.recording.dataset import Run
from omnimj.signals import Array

CLEAR = 0.6
"""Correlation of two channels from which on their link counts."""
TIGHT = np.log(1.04)
"""Permitted |log| of the scale between the velocity of a joint and its position."""
_DELAY = 0.004  # [s] largest healthy delay between them
_WINDOW = 4.0  # [s] longest stretch of one comparison of them
_FARTHEST = 0.08  # [s] largest delay in the search
_FEWEST = 30  # samples of a stretch
_TOGETHER = 0.15  # [s] longest time between the step and the first motion
_LEVEL = 0.06  # [s] after the step at which the level of a channel is read
_STEEP = 0.006  # [s] in which a step is over
_COARSE = 0.004  # [s] longest sampling period that resolves an order
_SMOOTH = 0.005  # [s] over which an acceleration is averaged


@dataclass(frozen=True)
class Stretch:
    """Samples of two quantities over one stretch of time; time [s], x and y all have shape (n,)."""

    time: Array
    x: Array
    y: Array


@dataclass(frozen=True)
class Comparison:
    """Relation of y to x over all stretches."""

    scale: float
    """s at the estimated delay."""
    delay: float
    """δ [s]."""
    delay_error: float
    """Standard error of δ from the scatter between stretches; infinite with a single one [s]."""
    correlation: float
    """Correlation of y and x(t − δ) after removal of c + b t."""
    drift: float
    """Mean of b [unit of y per s]."""
    drift_error: float
    """Standard error of the drift from the scatter between stretches."""
    scales: Array
    """s of every stretch, shape (stretches,)."""


def clear_link(found: Comparison | None, x: str, y: str, allowed: float) -> list[Link]:
    """Link of two compared channels, with the |log| of a healthy scale; none where they hardly correlate."""
    if found is None or abs(found.correlation) < CLEAR:
        return []
    return [Link(x, y, found.scale, allowed, abs(found.correlation))]


def integral(time: Array, rate: Array) -> Array:
    """∫ rate dt from the first sample on, by trapezoids; time [s], rate and integral of shape (n,)."""
    steps = 0.5 * (rate[1:] + rate[:-1]) * np.diff(time)
    return np.concatenate([[0.0], np.cumsum(steps)])


def windows(time: Array, longest: float) -> list[slice]:
    """Equal parts of a run, at most as long as a time [s] or 60 samples."""
    size = max(60, int(longest / max(float(np.median(np.diff(time))), 1e-6)))
    parts = max(1, -(-len(time) // size))
    ends = np.linspace(0, len(time), parts + 1).astype(int)
    return [slice(int(a), int(b)) for a, b in itertools.pairwise(ends)]


def solve_scaled(gram: Array, slope: Array, rcond: float) -> Array:
    """Factors that solve normal equations, shape (n,), whose columns are scaled to the same size first."""
    size = np.sqrt(np.maximum(np.diagonal(gram), 1e-300))
    return np.linalg.lstsq(gram / np.outer(size, size), slope / size, rcond=rcond)[0] / size


def compare(stretches: Sequence[Stretch]) -> Comparison | None:
    """Fit scale s, delay δ and drifts b.

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
            x = _detrended(trend, np.interp(part.time - delay, part.time, part.x))
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
        x = _detrended(trend, moved)
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
    return trend, _detrended(trend, part.y)


def _detrended(trend: Array, values: Array) -> Array:
    return values - trend @ (trend.T @ values)


def _lowest(places: Array, values: Array) -> float:
    """Interpolate the place of the lowest value by a parabola."""
    k = int(values.argmin())
    if k in (0, len(values) - 1):
        return float(places[k])
    a, b, c = values[k - 1 : k + 2]
    bend = a - 2.0 * b + c
    shift = 0.5 * (a - c) / bend if bend > 0.0 else 0.0
    return float(places[k] + shift * (places[1] - places[0]))


@dataclass(frozen=True)
class Onsets:
    """Time at which each channel begins to move, per run."""

    times: Mapping[str, Array]
    """Channel → time after the run's start, shape (runs,) [s]; NaN if not determined."""

    def lag(self, first: str, second: str) -> float | None:
        """Median over the runs of second − first [s]; None if not determined."""
        apart = self.times[second] - self.times[first]
        apart = apart[np.isfinite(apart)]
        return float(np.median(apart)) if apart.size else None


def onsets(runs: Sequence[Run], names: Sequence[str], speeds: Sequence[str]) -> Onsets:
    """Find the first motion of the current and of the channels that follow it, in every run.

    A channel begins where it first reaches 0.3 of its mean size between 30 and 90 ms later, an acceleration
    0.5 of it.

    Args:
      runs: The runs; one without all of the channels or a clear step of the current from rest is left out.
      names: The current, then the channels that follow it.
      speeds: Names of the channels that are speeds; the machine is at rest while all of them are near zero.
    """
    rows = [_of_run(run, names, speeds) for run in runs]
    table = np.array([row for row in rows if row is not None]).reshape(-1, len(names))
    return Onsets({name: table[:, c] for c, name in enumerate(names)})


def _of_run(run: Run, names: Sequence[str], speeds: Sequence[str]) -> list[float] | None:
    if not set(names) <= set(run.columns):
        return None
    time = run.time
    step = float(np.median(np.diff(time)))
    current = np.abs(fill_masked(run, names[0]))
    top = float(np.quantile(current, 0.95))
    at, begun = _first(current > 0.3 * top), _first_motion(run, speeds)
    is_step = at is not None and current[at : at + round(_STEEP / step) + 2].max() > 0.7 * top
    if step > _COARSE or not is_step or not begun or at is None or abs(time[begun] - time[at]) > _TOGETHER:
        return None
    rest = min(at, begun)
    ahead = slice(rest + round(0.5 * _LEVEL / step), rest + round(1.5 * _LEVEL / step))
    if ahead.stop > len(time):
        return None
    found = [_crossing(time, current, 0.5 * top)]
    for name in names[1:]:
        values, is_speed = fill_masked(run, name), name in speeds
        if not is_speed:
            width = max(1, round(_SMOOTH / step))
            values = np.convolve(values, np.full(width, 1.0 / width), "same")
        level = (0.3 if is_speed else 0.5) * abs(float(values[ahead].mean()))
        before = np.abs(values[: max(1, rest - round(_SMOOTH / step))])
        if level <= 0.0 or float(before.max()) > 0.6 * level:
            return None
        found.append(_crossing(time, np.abs(values), level))
    return found


def _first(hits: NDArray[np.bool_]) -> int | None:
    return int(hits.argmax()) if hits.any() else None


def _first_motion(run: Run, speeds: Sequence[str]) -> int:
    """Sample at which the first speed moves; 0 where the machine was not at rest."""
    sizes = [np.abs(fill_masked(run, name)) for name in speeds]
    found = [_first(size > 0.03 * max(float(size.max()), 1e-9)) for size in sizes]
    return min((k for k in found if k is not None), default=0)


def _crossing(time: Array, values: Array, level: float) -> float:
    k = int(np.argmax(values >= level))
    if values[k] < level or k == 0:
        return float("nan")
    part = (level - values[k - 1]) / (values[k] - values[k - 1])
    return float(time[k - 1] + part * (time[k] - time[k - 1]))


def velocity_comparison(runs: Sequence[Run], joint: str) -> Comparison | None:
    """Position of a joint compared with its integrated velocity; None where this was not measured."""
    stretches, velocity = [], f"velocity:{joint}"
    for run in runs:
        if velocity in run.columns:
            moved = integral(run.time, fill_masked(run, velocity))
            place = unwrap_counter(fill_masked(run, f"position:{joint}"))
            stretches += [Stretch(run.time[w], moved[w], place[w]) for w in windows(run.time, _WINDOW)]
    return compare(stretches) if stretches else None


def late_velocity(pair: Comparison, joint: str) -> Iterator[Suspicion]:
    """Yield the position or velocity of a joint that is late against the other."""
    error = pair.delay_error if np.isfinite(pair.delay_error) else 0.0
    if abs(pair.delay) > max(_DELAY, 3.0 * error):
        names = f"position:{joint}", f"velocity:{joint}"
        name, other = names if pair.delay > 0.0 else reversed(names)
        yield late(name, abs(pair.delay), _DELAY, other, (other,))
