"""Preparation of a linear axis' runs for replay: common clock, gaps cut out, smoothing, noise estimates."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.signal import savgol_coeffs, savgol_filter

from omnimj.errors import InputError
from omnimj.estimate.replay.axis.kernels import STRETCH
from omnimj.estimate.replay.stretches import WINDOW, on_clock, split_at_gaps, white_noise
from omnimj.recording.dataset import Run
from omnimj.signals import Array

BLOCK = 0.02
"""Length of a block [s]."""
_STEP = 1e-3  # [s] longest step of the equations
_FEWEST = 16  # samples that a local cubic and third differences need
_DRIFT = 5e-5  # [m] permitted drift of a free window from the noise of its initial speed


@dataclass(frozen=True)
class AxisLog:
    """All runs of a dataset on a common clock, their stretches concatenated."""

    period: float
    """Sample period [s]."""
    size: int
    """Samples per block."""
    stretches: Array
    """Table of stretches, see `kernels.STRETCH`, shape (stretches, STRETCH)."""
    windows: NDArray[np.int64]
    """Table of free windows, see `stretches.WINDOW`, shape (windows, WINDOW)."""
    run_of_stretch: tuple[int, ...]
    times: Array
    """Time since the start of the run, shape (n,) [s]."""
    force: Array
    """Force reported by the drive, shape (n,) [N]."""
    position: Array
    """Measured position, shape (n,) [m]."""
    velocity: Array
    """Measured velocity, shape (n,) [m/s]; NaN for runs without it."""
    smooth: Array
    """Smoothed position, speed and acceleration, shape (n, 3) [m, m/s, m/s²]."""
    masked: NDArray[np.bool_]
    """Mask of bad samples of force, position and velocity, shape (n, 3)."""
    force_noise: float
    """Standard deviation of the white noise of the force [N]."""
    position_noise: float
    """Standard deviation of the position noise, quantisation included [m]."""

    @property
    def blocks(self) -> int:
        """Number of blocks."""
        return int(self.windows[-1, 2] + (self.windows[-1, 1] - self.windows[-1, 0]) // self.size)


def force_column(run: Run, force_constant: float) -> tuple[str, Array]:
    """Name of the column from which the drive force is taken, and that force.

    Args:
      run: A run of a linear axis.
      force_constant: Force over current [N/A].

    Returns:
      `force` or `current`, and the force, shape (n,) [N].

    Raises:
      InputError: The run has neither force nor current.
    """
    if "force" in run.columns:
        return "force", run.columns["force"]
    if "current" in run.columns:
        return "current", force_constant * run.columns["current"]
    raise InputError(run.name, "has neither 'force' nor 'current'", "a linear axis' log needs one of them")


def _smoothed(position: Array, period: float, noise: float, horizon: float) -> Array:
    """Smooth by local cubics: the narrowest filter whose speed noise drifts by less than `_DRIFT`."""
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
    """Stretch without gaps, on the common clock."""

    run: int
    columns: tuple[Array, ...]
    """Time since the start of the run, force, position and velocity, each of shape (n,) [s, N, m, m/s]."""
    masked: NDArray[np.bool_]
    """Mask of bad samples of force, position and velocity, shape (n, 3)."""


def _stretches(index: int, run: Run, force_constant: float, period: float) -> Iterator[_Stretch]:
    """Yield the stretches of a run, resampled to a clock of the given period [s]."""
    name, force = force_column(run, force_constant)
    nothing = np.full(len(run.time), np.nan)
    named = ((name, force), ("position", run.columns["position"]))
    named += (("velocity", run.columns.get("velocity", nothing)),)
    for part in split_at_gaps(run, float(np.median(np.diff(run.time)))):
        time = run.time[part]
        clock = time[0] + np.arange(int((time[-1] - time[0]) / period * (1.0 + 1e-12)) + 1) * period
        found = [on_clock(run, column, values, part, clock) for column, values in named]
        if not (found[0][1].all() or found[1][1].all()):
            columns = (clock - run.time[0], *(values for values, _ in found))
            yield _Stretch(index, columns, np.stack([mask for _, mask in found], axis=1))


def _cut(
    stretches: Sequence[_Stretch], size: int, length: int, period: float
) -> tuple[Array, NDArray[np.int64]]:
    """Tables of stretches and windows; a remainder shorter than half a window is left out."""
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
    """Resample all runs to a common clock and cut them into stretches, windows and blocks.

    Args:
      runs: Runs of a linear axis.
      force_constant: Force over current [N/A].
      window: Length of a free window [s].
      block: Length of a block [s].

    Raises:
      InputError: A run has neither force nor current, or no run is as long as half a window.
    """
    period = min(float(np.median(np.diff(run.time))) for run in runs)
    size = max(1, round(block / period))
    length = size * max(2, round(window / (size * period)))
    every = [s for k, run in enumerate(runs) for s in _stretches(k, run, force_constant, period)]
    stretches = [s for s in every if len(s.masked) >= max(length // 2, _FEWEST)]
    if not stretches:
        raise InputError("dataset", "no run is long enough", f"{0.5 * window:g} s without a gap are needed")
    table, windows = _cut(stretches, size, length, period)
    noise = [white_noise([s.columns[k] for s in stretches]) for k in (1, 2)]
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
    """Sign of the recorded force: −1 where it is opposite to the motion that it causes, else 1.

    The sign follows from a fit of F = m a + b v + C sgn(v) + F_0 to the log: no axis has negative mass and
    negative friction.
    """
    speed, acceleration = log.smooth[:, 1], log.smooth[:, 2]
    columns = np.stack([acceleration, speed, np.sign(speed), np.ones(len(speed))], axis=1)
    fitted = np.linalg.lstsq(columns, log.force, rcond=None)[0]
    moved = columns[:, :3] @ fitted[:3]
    backward = fitted[0] < 0.0 and float(moved @ speed) < 0.0
    return -1.0 if backward and moved.std() > 0.5 * log.force.std() else 1.0
