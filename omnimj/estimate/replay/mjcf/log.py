"""Runs of any machine on a common clock: smoothed motion, inputs, stretches, windows and blocks.

Motion and inputs pass local cubics, beside a measured force one and the same filter (`filters`), so that a
linear balance of forces holds between the filtered signals as between the true ones. A joint's filter is the
narrowest whose acceleration is clear of the noise of the encoder.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import correlate1d
from scipy.signal import savgol_coeffs, savgol_filter

from omnimj.errors import InputError
from omnimj.estimate.replay.mjcf.columns import MeasuredParts
from omnimj.estimate.replay.mjcf.filters import filtered, filtered_speed, limited_speed
from omnimj.estimate.replay.stretches import WINDOW, on_clock, split_at_gaps, white_noise
from omnimj.recording.dataset import Run
from omnimj.signals import Array

BLOCK = 0.02
"""Length of a block [s]."""
STRETCH = 4
"""Columns of the table of stretches: rows start … end − 1, its first window and number of windows."""
_STEP = 0.002  # [s] shortest period of the rows
_HALVES = (0.008, 0.012, 0.016, 0.024, 0.036, 0.05, 0.07)  # [s] half widths of the filter
_CLEAR = 0.1  # noise of the acceleration over its RMS in motion
_REST = 6.0  # noise of the smoothed speed up to which a joint counts as at rest
_SLOWEST = 2e-3  # least such speed over the top speed
_FEWEST = 24  # samples of a stretch
_GAP = 3.5  # sample periods between two samples from which on a gap is assumed


@dataclass(frozen=True)
class MachineLog:
    """All runs of a dataset on a common clock, stretches concatenated; n rows, j joints, s sensors."""

    period: float
    """Time between rows [s]."""
    size: int
    """Rows per block."""
    stretches: NDArray[np.int64]
    """Table of stretches, see `STRETCH`, shape (stretches, STRETCH)."""
    windows: NDArray[np.int64]
    """Table of free windows, see `stretches.WINDOW`, shape (windows, WINDOW)."""
    run_of_stretch: tuple[int, ...]
    times: Array
    """Time since the start of the run, shape (n,) [s]."""
    position: Array
    speed: Array
    acceleration: Array
    """Smoothed motion, shape (n, j) each; positions and speeds by local cubics."""
    balanced_speed: Array
    """Speed for balances of forces; beside a measured force under its filter, shape (n, j)."""
    limited_speed: Array
    """Speed that tells in which direction a joint moves, see `filters.limited_speed`; beside a measured
    force the speed, shape (n, j)."""
    inputs: Array
    """Smoothed force or command of each joint's actuator, 0 without one, shape (n, j)."""
    enabled: NDArray[np.bool_]
    """Whether each joint's actuator was on, shape (n, j)."""
    velocity: Array
    """Smoothed measured velocity, NaN where it was not measured, shape (n, j)."""
    sensors: Array
    """Smoothed readings of the sensors, shape (n, s)."""
    valid: NDArray[np.bool_]
    """Mask of the rows in which the balance of a joint's forces holds, shape (n, j)."""
    reach: Array
    """Half width of each joint's filter, shape (j,) [s]."""
    position_noise: Array
    """Standard deviation of the noise of each position, quantisation included, shape (j,)."""
    speed_noise: Array
    """Standard deviation of the noise of each smoothed speed, shape (j,)."""
    input_noise: Array
    """Standard deviation of the noise of each measured input, 0 without one, shape (j,)."""

    @property
    def rest_speed(self) -> Array:
        """Speed up to which each joint counts as at rest, shape (j,)."""
        return _rest_speed(self.speed, self.speed_noise)

    @property
    def filter_widths(self) -> list[int]:
        """Width of each joint's filter [rows]; 5 at least."""
        return [max(2 * round(half / self.period) + 1, 5) for half in self.reach.tolist()]

    @property
    def blocks(self) -> int:
        """Number of blocks."""
        return int(self.windows[-1, 2] + (self.windows[-1, 1] - self.windows[-1, 0]) // self.size)


@dataclass(frozen=True)
class _Stretch:
    """Stretch without gaps, on the clock of the logger."""

    run: int
    time: Array
    columns: dict[str, Array]
    masked: dict[str, NDArray[np.bool_]]


def read_machine_log(runs: Sequence[Run], parts: MeasuredParts, window: float) -> MachineLog:
    """Resample all runs to a common clock, smooth them, and cut them into stretches, windows and blocks.

    Args:
      window: Length of a free window [s].

    Raises:
      InputError: No run is as long as half a window.
    """
    period = min(float(np.median(np.diff(run.time))) for run in runs)
    stride = max(1, round(_STEP / period))
    size = max(1, round(BLOCK / (stride * period)))
    length = size * max(2, round(window / (size * stride * period)))
    every = [s for k, run in enumerate(runs) for s in _cut_run(k, run, parts, period)]
    kept = [s for s in every if len(s.time) >= max(stride * length // 2, _FEWEST)]
    if not kept:
        raise InputError("dataset", "no run is long enough", f"{0.5 * window:g} s without a gap are needed")
    joints = range(len(parts.joints))
    places = [[s.columns[f"position:{parts.joints[j]}"] for s in kept] for j in joints]
    noise = np.array([_logged_noise(runs, f"position:{name}") for name in parts.joints])
    widths = [_width(places[j], period, noise[j]) for j in joints]
    pieces = [_smoothed(s, parts, widths, period, stride) for s in kept]
    table, windows = _tables([len(p["times"]) for p in pieces], size, length)
    whole = {key: np.concatenate([p[key] for p in pieces]) for key in pieces[0]}
    spread = [float(np.linalg.norm(savgol_coeffs(w, 3, deriv=1, delta=period))) for w in widths]
    return MachineLog(
        stride * period,
        size,
        table,
        windows,
        tuple(s.run for s in kept),
        reach=np.array([0.5 * (w - 1) * period for w in widths]),
        position_noise=noise,
        speed_noise=noise * np.array(spread),
        input_noise=np.array([0.0 if i is None else _logged_noise(runs, i.column) for i in parts.inputs]),
        **whole,
    )


def _logged_noise(runs: Sequence[Run], name: str) -> float:
    """Noise of a channel as it was logged: between the samples of a coarse encoder it would seem finer."""
    logged = [
        run.columns[name][~np.asarray(run.masked.get(name, np.zeros(len(run.time), bool)))] for run in runs
    ]
    finite = [values[np.isfinite(values)] for values in logged]
    return white_noise([values for values in finite if len(values) > _FEWEST])


def _cut_run(index: int, run: Run, parts: MeasuredParts, period: float):
    """Yield the stretches of a run, resampled to a clock of the given period [s]."""
    names = [n for n in run.columns if ":" in n]
    needed = [f"position:{name}" for name in parts.joints]
    for part in split_at_gaps(run.time, _GAP * float(np.median(np.diff(run.time)))):
        time = run.time[part]
        clock = time[0] + np.arange(int((time[-1] - time[0]) / period * (1.0 + 1e-12)) + 1) * period
        found = {n: on_clock(run, n, run.columns[n], part, clock) for n in names}
        if not any(found[n][1].all() for n in needed):
            values = {n: v for n, (v, _) in found.items()}
            yield _Stretch(index, clock - run.time[0], values, {n: mask for n, (_, mask) in found.items()})


def _rest_speed(speed: Array, noise: Array | float) -> Array:
    return np.maximum(_REST * noise, _SLOWEST * np.abs(speed).max(axis=0))


def _width(places: Sequence[Array], period: float, noise: float) -> int:
    """Width of the narrowest filter whose acceleration in motion is clear of the noise of the encoder."""
    width = 5
    for half in _HALVES:
        width = max(2 * round(half / period) + 1, 5)
        own = [p for p in places if len(p) > width]
        if not own:
            return 5
        speed, bends = (
            np.concatenate([np.asarray(savgol_filter(p, width, 3, deriv=d, delta=period)) for p in own])
            for d in (1, 2)
        )
        speed_noise, bend_noise = (
            noise * float(np.linalg.norm(savgol_coeffs(width, 3, deriv=d, delta=period))) for d in (1, 2)
        )
        moves = np.abs(speed) > _rest_speed(speed, speed_noise)
        if moves.any() and bend_noise < _CLEAR * float(np.sqrt(np.mean(bends[moves] ** 2))):
            break
    return width


def _smoothed(
    stretch: _Stretch, parts: MeasuredParts, widths: Sequence[int], period: float, stride: int
) -> dict[str, Any]:
    """Rows of one stretch by the names of `MachineLog`."""
    n, j = len(stretch.time), len(parts.joints)
    names = ("position", "speed", "acceleration", "balanced_speed", "limited_speed", "inputs")
    found: dict[str, Any] = {key: np.zeros((n, j)) for key in names}
    found["velocity"] = np.full((n, j), np.nan)
    enabled, valid = np.ones((n, j), bool), np.ones((n, j), bool)
    for k, name in enumerate(parts.joints):
        width = min(widths[k], n - 1 + n % 2)
        place = stretch.columns[f"position:{name}"]
        for d, key in enumerate(("position", "speed", "acceleration")):
            found[key][:, k] = savgol_filter(place, width, 3, deriv=d, delta=period)
        own, smooth, speed = parts.inputs[k], _local_cubic, found["speed"][:, k]
        found["balanced_speed"][:, k] = speed
        found["limited_speed"][:, k] = limited_speed(place, speed, width, period)
        if own is not None and own.is_force:  # rows around a stop are left out
            smooth = filtered
            found["balanced_speed"][:, k] = filtered_speed(place, width, period)
            found["limited_speed"][:, k] = speed
        bad = np.asarray(stretch.masked[f"position:{name}"])
        if parts.has_velocity[k]:
            found["velocity"][:, k] = smooth(stretch.columns[f"velocity:{name}"], width)
            found["velocity"][_near(stretch.masked[f"velocity:{name}"], width), k] = np.nan
        if own is not None:
            found["inputs"][:, k] = smooth(stretch.columns[own.column], width)
            bad = bad | stretch.masked[own.column]
            on = stretch.columns.get(f"enabled:{own.drive.name}")
            if on is not None:
                enabled[:, k] = on > 0.5
                bad = bad | ~enabled[:, k]
        valid[:, k] = ~_near(bad, width)
        valid[: width // 2, k] = valid[n - width // 2 :, k] = False
    sensors: list[Any] = [_local_cubic(stretch.columns[f"sensor:{s}"], widths[0]) for s in parts.sensors]
    rows = slice(0, n, stride)
    whole = {key: _thinned(values, stride) for key, values in found.items()}
    stacked = np.column_stack(sensors) if sensors else np.zeros((n, 0))
    more = {
        "times": stretch.time[rows],
        "enabled": enabled[rows],
        "valid": valid[rows],
        "sensors": stacked[rows],
    }
    return {**whole, **more}


def _local_cubic(values: Array, width: int) -> Array:
    return np.asarray(savgol_filter(values, width, 3))


def _thinned(values: Array, stride: int) -> Array:
    """Every so many samples, each the mean of its neighbours: noise beyond the new rate would fold back."""
    if stride == 1:
        return values
    triangle = np.convolve(np.ones(stride), np.ones(stride)) / stride**2
    return correlate1d(values, triangle, axis=0, mode="nearest")[::stride]


def _near(bad: NDArray[np.bool_], width: int) -> NDArray[np.bool_]:
    """Samples whose filter reaches a bad one."""
    return np.convolve(bad.astype(float), np.ones(width), "same") > 0.5 if bad.any() else bad


def _tables(lengths: Sequence[int], size: int, length: int) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Tables of stretches and windows; a remainder shorter than half a window is left out."""
    table, windows, at, row = [], [], 0, 0
    for count in lengths:
        first_window = len(windows)
        for first in range(0, count - length // 2 + 1, length):
            samples = min(length, (count - first) // size * size)
            windows.append((at + first, at + first + samples, row))
            row += samples // size
        table.append((at, at + count, first_window, len(windows) - first_window))
        at += count
    return np.array(table, np.int64).reshape(-1, STRETCH), np.array(windows, np.int64).reshape(-1, WINDOW)
