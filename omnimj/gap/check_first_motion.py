"""The order in which channels begin to move when a step of current starts a machine that was at rest."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from omnimj.gap.check_columns import filled
from omnimj.recording.dataset import Run
from omnimj.signals import Array

_TOGETHER = 0.15  # [s] between the step and the first motion at most
_LEVEL = 0.06  # [s] after the step: what a channel has come to
_STEEP = 0.006  # [s] in which a step is over
_COARSE = 0.004  # [s] longest sampling period for which an order can be told
_SMOOTH = 0.005  # [s] over which an acceleration is averaged


@dataclass(frozen=True)
class Onsets:
    """When each channel begins to move, per run."""

    times: Mapping[str, Array]
    """Channel → time after the run's start, shape (runs,) [s]; NaN where it could not be told."""

    def lag(self, first: str, second: str) -> float | None:
        """Median over the runs of second − first [s]; None where it could not be told."""
        apart = self.times[second] - self.times[first]
        apart = apart[np.isfinite(apart)]
        return float(np.median(apart)) if apart.size else None


def onsets(runs: Sequence[Run], names: Sequence[str], speeds: Sequence[str]) -> Onsets:
    """First motion of the first of `names` (the current) and of those that follow it.

    A channel begins where it first reaches 0.3 of its mean size between 30 and 90 ms later, an acceleration
    0.5 of it.
    """
    rows = [_of_run(run, names, speeds) for run in runs]
    table = np.array([row for row in rows if row is not None]).reshape(-1, len(names))
    return Onsets({name: table[:, c] for c, name in enumerate(names)})


def _of_run(run: Run, names: Sequence[str], speeds: Sequence[str]) -> list[float] | None:
    if not set(names) <= set(run.columns):
        return None
    time = run.time
    step = float(np.median(np.diff(time)))
    current = np.abs(filled(run, names[0]))
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
        values, is_speed = filled(run, name), name in speeds
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
    sizes = [np.abs(filled(run, name)) for name in speeds]
    found = [_first(size > 0.03 * max(float(size.max()), 1e-9)) for size in sizes]
    return min((k for k in found if k is not None), default=0)


def _crossing(time: Array, values: Array, level: float) -> float:
    k = int(np.argmax(values >= level))
    if values[k] < level or k == 0:
        return float("nan")
    part = (level - values[k - 1]) / (values[k] - values[k - 1])
    return float(time[k - 1] + part * (time[k] - time[k - 1]))
