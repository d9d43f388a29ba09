"""Logs of a robot as rows every 30 ms: every channel behind the same low pass, all at the same instant.

A product of two signals needs both behind the same filter, and a derivative needs the filter of what is
differentiated: all channels pass one Gaussian, and derivatives are taken by its own derivative, exact in
between. The filter looks both ways, so that it delays nothing; what the sensors delay is taken back. It is
slow enough that the yaw loop, which answers the gyro's noise with torque, does not bias what torque does to
the yaw rate.
"""

from __future__ import annotations

import itertools
import math
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter1d, minimum_filter1d

from omnimj.errors import InputError
from omnimj.parameters import Robot
from omnimj.recording.dataset import Dataset, Run
from omnimj.signals import Array, robot_channels

PERIOD = 0.03
"""Time from row to row [s]."""
WIDTH = 0.03
"""Standard deviation of the Gaussian [s]; two samples of the log where these are further apart."""
LOWEST_RATE = 50.0
"""Lowest sample rate at which a current still shows what it does to the speed [1/s]."""
_GAP, _GAP_PERIODS = 0.02, 5.0  # [s] and samples: a longer time without samples ends a stretch
_SHORTEST = 0.5  # [s] of a stretch
_NEAR = 0.12  # [s] to either side over which a wheel's slowest speed counts, and that a bad sample spoils
_STILL = 0.3  # [rad/s] below which a wheel stands
_REST = 0.3  # [s] shortest rest that counts


@dataclass(frozen=True)
class RunRows:
    """m rows of one run of a robot with n wheels."""

    name: str
    floor: str
    time: Array
    """Since the start of the log, shape (m,) [s]."""
    current: Array
    """Shape (m, n) [A]."""
    ripple: Array
    """Standard deviation of the current within the filter, less the monitor's noise, shape (m, n) [A]."""
    wheel_speed: Array
    """Shape (m, n) [rad/s]."""
    wheel_acceleration: Array
    """Shape (m, n) [rad/s²]."""
    acceleration: Array
    """Accelerometer, shape (m, 2) [m/s²]."""
    yaw_rate: Array
    """Gyro less its mean at rest, shape (m,) [rad/s]."""
    yaw_acceleration: Array
    """Its derivative, shape (m,) [rad/s²]."""
    slowest: Array
    """Smallest |φ̇| within 120 ms, shape (m, n) [rad/s]."""
    stretch: NDArray[np.int_]
    """Number of the stretch without gaps that a row belongs to, shape (m,)."""
    good: NDArray[np.bool_]
    """Rows without a masked sample nearby, shape (m,)."""
    still: NDArray[np.bool_]
    """Rows at which all wheels stand for a while, shape (m,)."""
    yaw_rate_bias: float = 0.0
    """Mean of the gyro at rest [rad/s]; 0 without any rest."""
    noise: Array = field(default_factory=lambda: np.zeros(0))
    """Noise of the currents, speeds, accelerations and yaw rate from sample to sample, shape (2n+3,)."""

    @property
    def duration(self) -> float:
        """Time that the rows cover [s]."""
        return PERIOD * len(self.time)


def robot_rows(dataset: Dataset, robot: Robot) -> tuple[RunRows, ...]:
    """Rows of every run.

    Args:
      dataset: Runs of a robot with currents, wheel speeds, accelerometer and gyro.
      robot: Gives the delays of its sensors.

    Raises:
      InputError: A run lacks a channel, is sampled too slowly, or has no stretch that is long enough.
    """
    n = len(robot.wheels)
    found = []
    for run in dataset.runs:
        place = f"{dataset.path}: run {run.name!r}"
        missing = [name for name in _channels(n) if name not in run.columns]
        if missing:
            raise InputError(
                place, f"has no {missing[0]}", "a force balance needs currents, wheel speeds and both sensors"
            )
        rate = 1.0 / float(np.median(np.diff(run.time)))
        if rate < LOWEST_RATE * 0.995:
            raise InputError(
                place, f"has {rate:.4g} samples per second", f"at least {LOWEST_RATE:g} are needed"
            )
        found.append(_rows_of(run, robot, place))
    return tuple(found)


def _channels(wheels: int) -> tuple[str, ...]:
    return tuple(name for name in robot_channels(wheels) if name != "yaw")


def sensor_delays(robot: Robot, period: float) -> Array:
    """Nominal delay of each channel without the yaw, shape (2n+3,) [s].

    A current is read at once; a wheel speed passes a filter and counts over one sample; accelerometer and
    gyro have bandwidths.
    """
    n, sensors = len(robot.wheels), robot.sensors
    late = [0.0] * n + [sensors.speed_filter + 0.5 * period] * n
    late += [0.5 / (math.pi * sensors.accelerometer_bandwidth)] * 2
    return np.array([*late, 0.5 / (math.pi * sensors.gyro_bandwidth)])


def _rows_of(run: Run, robot: Robot, place: str) -> RunRows:
    n = len(robot.wheels)
    step = np.diff(run.time)
    longest = max(_GAP, _GAP_PERIODS * float(np.median(step)))
    cuts = [0, *(np.flatnonzero(step > longest) + 1).tolist(), len(run.time)]
    parts = []
    for number, (a, b) in enumerate(itertools.pairwise(cuts)):
        if b - a > 10 and run.time[b - 1] - run.time[a] >= _SHORTEST:
            parts.append(_stretch(run, slice(a, b), robot, number))
    if not parts:
        raise InputError(place, "is too short", f"{_SHORTEST:g} s without a gap are needed")
    time, means, slopes, ripple, stretch, good = (
        np.concatenate(columns) for columns in zip(*parts, strict=True)
    )
    speed = means[:, n : 2 * n]
    yaw_rate = means[:, 2 * n + 2]
    still = _rests(np.abs(speed).max(axis=1) < _STILL)
    bias = float(yaw_rate[still].mean()) if still.any() else 0.0
    slowest = np.empty_like(speed)
    for number in np.unique(stretch):
        rows = stretch == number
        slowest[rows] = minimum_filter1d(np.abs(speed[rows]), 2 * round(_NEAR / PERIOD) + 1, axis=0)
    return RunRows(
        run.name,
        str(run.conditions.get("floor", "")),
        time - run.time[0],
        means[:, :n],
        ripple,
        speed,
        slopes[:, n : 2 * n],
        means[:, 2 * n : 2 * n + 2],
        yaw_rate - bias,
        slopes[:, 2 * n + 2],
        slowest,
        stretch,
        good,
        still,
        bias,
        np.array([_sample_noise(run.columns[name]) for name in _channels(n)]),
    )


def _sample_noise(values: Array) -> float:
    """Noise of single samples from second differences, robust to motion and steps."""
    bend = values[2:] - 2.0 * values[1:-1] + values[:-2]
    return float(1.4826 * np.median(np.abs(bend)) / math.sqrt(6.0))


def _rests(slow: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Rows of those slow stretches that last, without their edges."""
    rests, least, edge = np.zeros(len(slow), bool), round(_REST / PERIOD), round(0.1 / PERIOD)
    changes = np.flatnonzero(np.diff(np.concatenate(([0], slow.astype(int), [0]))))
    for first, last in changes.reshape(-1, 2):
        if last - first >= least:
            rests[first + edge : last - edge] = True
    return rests


def _stretch(run: Run, part: slice, robot: Robot, number: int) -> tuple[Array, ...]:
    """Times, filtered channels, derivatives, ripple of currents, number and goodness of a stretch's rows."""
    n = len(robot.wheels)
    names = _channels(n)
    time = run.time[part]
    period = float(np.median(np.diff(time)))
    width = max(WIDTH, 2.0 * period)
    grid = time[0] + period * np.arange(int((time[-1] - time[0]) / period * (1.0 + 1e-9)) + 1)
    delays = sensor_delays(robot, period)
    edge = 3.0 * width
    rows = np.arange(grid[0] + edge, grid[-1] - edge - delays.max(), PERIOD)
    means, slopes = np.empty((len(rows), len(names))), np.empty((len(rows), len(names)))
    ripple, good = np.empty((len(rows), n)), np.ones(len(rows), bool)
    for c, name in enumerate(names):
        values, bad = run.columns[name][part], run.masked.get(name)
        keep = np.ones(len(time), bool) if bad is None else ~bad[part]
        if not keep.any():
            good[:] = False
            keep[:] = True
        even = np.interp(grid, time[keep], values[keep])
        smooth = gaussian_filter1d(even, width / period, mode="nearest")
        slope = gaussian_filter1d(even, width / period, order=1, mode="nearest") / period
        means[:, c] = np.interp(rows + delays[c], grid, smooth)
        slopes[:, c] = np.interp(rows + delays[c], grid, slope)
        if c < n:
            square = gaussian_filter1d((even - smooth) ** 2, width / period, mode="nearest")
            own = np.maximum(square - robot.sensors.current_noise**2, 0.0)
            ripple[:, c] = np.interp(rows, grid, np.sqrt(own))
        for spoilt in time[~keep]:
            good &= np.abs(rows - spoilt) > _NEAR
    return rows, means, slopes, ripple, np.full(len(rows), number), good
