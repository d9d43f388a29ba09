"""A linear axis' runs made ready for replay: one clock, gaps cut out, position smoothed, noise measured."""

from __future__ import annotations

import itertools
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.signal import savgol_coeffs, savgol_filter

from omnimj.errors import InputError
from omnimj.estimate.replay.axis.kernels import STRETCH, WINDOW
from omnimj.physics.native import kernel
from omnimj.recording.dataset import Run
from omnimj.signals import Array

BLOCK = 0.02
"""Time that one block mean covers [s]."""
_GAP = 3.5  # periods without a sample that make a gap
_STEP = 1e-3  # [s] longest step of the equations
_FEWEST = 16  # samples that a local cubic and third differences need
_DRIFT = 5e-5  # [m] that an error of the smoothed speed may carry a window away


@dataclass(frozen=True)
class AxisLog:
    """All runs of a dataset on one clock, their stretches one behind the other."""

    period: float
    """[s]"""
    size: int
    """Samples per block."""
    stretches: Array
    """See `kernels.STRETCH`."""
    windows: NDArray[np.int64]
    """See `kernels.WINDOW`."""
    run_of_stretch: tuple[int, ...]
    times: Array
    """Since the run's start, shape (n,) [s]."""
    force: Array
    position: Array
    velocity: Array
    """NaN where a run has none."""
    smooth: Array
    """Position, speed, acceleration, shape (n, 3)."""
    masked: NDArray[np.bool_]
    """Force, position, velocity, shape (n, 3)."""
    force_noise: float
    """Standard deviation of what changes from sample to sample [N]."""
    position_noise: float
    """The same, counting steps included [m]."""

    @property
    def blocks(self) -> int:
        """Rows of block means."""
        return int(self.windows[-1, 2] + (self.windows[-1, 1] - self.windows[-1, 0]) // self.size)


def force_column(run: Run, force_constant: float) -> tuple[str, Array]:
    """What the drive was told to push, and the column it comes from [N].

    Raises:
      InputError: The run has neither force nor current.
    """
    if "force" in run.columns:
        return "force", run.columns["force"]
    if "current" in run.columns:
        return "current", force_constant * run.columns["current"]
    raise InputError(run.name, "has neither 'force' nor 'current'", "a linear axis' log needs one of them")


def _noise(values: Sequence[Array]) -> float:
    """Standard deviation of white noise from third differences, or of counting where that is more."""
    changes = np.concatenate([np.diff(v, 3) for v in values])
    spread = float(np.median(np.abs(changes - np.median(changes)))) / 0.6745 / np.sqrt(20.0)
    steps = np.concatenate([np.abs(np.diff(v)) for v in values])
    scale = max(float(np.abs(np.concatenate(values)).max()), 1e-300)
    steps = steps[steps > 1e-12 * scale]
    smallest = float(np.quantile(steps, 0.02)) if len(steps) else 0.0
    return max(spread, smallest / np.sqrt(12.0), 1e-9 * scale)


def _split(run: Run, period: float) -> list[slice]:
    """Stretches without gaps."""
    cuts = np.flatnonzero(np.diff(run.time) > _GAP * period) + 1
    edges = [0, *cuts.tolist(), len(run.time)]
    return [slice(a, b) for a, b in itertools.pairwise(edges)]


def _clean(run: Run, name: str, values: Array, part: slice, clock: Array) -> tuple[Array, NDArray[np.bool_]]:
    """One column on the clock, what is masked drawn straight, and which samples are near what is masked."""
    time, bad = run.time[part], np.asarray(run.masked.get(name, np.zeros(len(run.time), bool)))[part]
    bad = bad | ~np.isfinite(values[part])
    if bad.all():
        return np.full(len(clock), np.nan), np.ones(len(clock), bool)
    on_clock = np.interp(clock, time[~bad], values[part][~bad])
    return on_clock, np.interp(clock, time, bad.astype(float)) > 1e-6


def _smoothed(position: Array, period: float, noise: float, horizon: float) -> Array:
    """Local cubics: the narrowest whose speed, left to itself for a window, drifts off by little enough."""
    width = 5
    for half in (0.01, 0.02, 0.04, 0.08):
        width = max(2 * round(half / period) + 1, 5)
        speed_noise = noise * float(np.linalg.norm(savgol_coeffs(width, 3, deriv=1, delta=period)))
        if width > len(position) // 2 or speed_noise * horizon < _DRIFT:
            break
    width = min(width, len(position) - 1 + len(position) % 2)
    order = min(3, width - 1)
    found = np.empty((len(position), 3))
    for d in range(3):
        found[:, d] = savgol_filter(position, width, order, deriv=d, delta=period)
    return found


@dataclass(frozen=True)
class _Stretch:
    """One stretch without gaps on the common clock."""

    run: int
    columns: tuple[Array, ...]
    """Time since the run's start, force, position, velocity, shape (n,)."""
    masked: NDArray[np.bool_]
    """Shape (n, 3)."""


def _stretches(index: int, run: Run, force_constant: float, period: float) -> Iterator[_Stretch]:
    """Stretches of a run on a clock of this period."""
    name, force = force_column(run, force_constant)
    nothing = np.full(len(run.time), np.nan)
    named = ((name, force), ("position", run.columns["position"]))
    named += (("velocity", run.columns.get("velocity", nothing)),)
    for part in _split(run, float(np.median(np.diff(run.time)))):
        time = run.time[part]
        clock = time[0] + np.arange(int((time[-1] - time[0]) / period * (1.0 + 1e-12)) + 1) * period
        found = [_clean(run, column, values, part, clock) for column, values in named]
        if not (found[0][1].all() or found[1][1].all()):
            columns = (clock - run.time[0], *(values for values, _ in found))
            yield _Stretch(index, columns, np.stack([mask for _, mask in found], axis=1))


def _cut(
    stretches: Sequence[_Stretch], size: int, length: int, period: float
) -> tuple[Array, NDArray[np.int64]]:
    """Tables of stretches and windows; what is left at an end and is no half window belongs to none."""
    substeps = max(1, int(np.ceil(period / _STEP - 1e-9)))
    table, windows, at, row = [], [], 0, 0
    for stretch in stretches:
        count, first_window = len(stretch.masked), len(windows)
        for first in range(0, count - length // 2 + 1, length):
            samples = min(length, (count - first) // size * size)
            windows.append((at + first, at + first + samples, row))
            row += samples // size
        table.append((at, at + count, first_window, len(windows) - first_window, period, substeps))
        at += count
    return np.array(table).reshape(-1, STRETCH), np.array(windows, np.int64).reshape(-1, WINDOW)


def read_axis_log(runs: Sequence[Run], force_constant: float, window: float, block: float = BLOCK) -> AxisLog:
    """Puts all runs on one clock and cuts them into stretches, windows and blocks.

    Args:
      runs: Of a linear axis.
      force_constant: Force over current [N/A].
      window: Length of a window [s].
      block: Length of a block [s].

    Raises:
      InputError: A run without force and current, or no run of half a window.
    """
    period = min(float(np.median(np.diff(run.time))) for run in runs)
    size = max(1, round(block / period))
    length = size * max(2, round(window / (size * period)))
    every = [s for k, run in enumerate(runs) for s in _stretches(k, run, force_constant, period)]
    stretches = [s for s in every if len(s.masked) >= max(length // 2, _FEWEST)]
    if not stretches:
        raise InputError("dataset", "no run is long enough", f"{0.5 * window:g} s without a gap are needed")
    table, windows = _cut(stretches, size, length, period)
    noise = [_noise([s.columns[k] for s in stretches]) for k in (1, 2)]
    smooth = [_smoothed(s.columns[2], period, noise[1], window) for s in stretches]
    times, force, position, velocity = (np.concatenate([s.columns[k] for s in stretches]) for k in range(4))
    return AxisLog(
        period=period,
        size=size,
        stretches=table,
        windows=windows,
        run_of_stretch=tuple(s.run for s in stretches),
        times=times,
        force=force,
        position=position,
        velocity=velocity,
        smooth=np.concatenate(smooth),
        masked=np.concatenate([s.masked for s in stretches]),
        force_noise=noise[0],
        position_noise=noise[1],
    )


def force_sign(log: AxisLog) -> float:
    """−1 where the force pushes against the acceleration that it makes, 1 otherwise.

    F = m a + b v + C sgn(v) + F_0 fitted to the log: no axis has a negative mass and negative friction.
    """
    speed, acceleration = log.smooth[:, 1], log.smooth[:, 2]
    columns = np.stack([acceleration, speed, np.sign(speed), np.ones(len(speed))], axis=1)
    fitted = np.linalg.lstsq(columns, log.force, rcond=None)[0]
    moved = columns[:, :3] @ fitted[:3]
    backward = fitted[0] < 0.0 and float(moved @ speed) < 0.0
    return -1.0 if backward and moved.std() > 0.5 * log.force.std() else 1.0


@kernel
def block_means(values, windows, size, means):
    """Means of every block, NaN where a sample is NaN.

    Args:
      values: Shape (n, columns).
      windows: Shape (windows, WINDOW).
      size: Samples per block.
      means: Filled, shape (blocks, columns).
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
