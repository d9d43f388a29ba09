"""Quality of a log: rate, regularity, packets, and whether wheels and measured pose agree."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from omnimj.recording.dataset import Run
from omnimj.recording.logger_faults import burst_share, wheel_numbers
from omnimj.recording.mask import find_gaps
from omnimj.signals import Array

_NEAR = 9  # samples around which increments are compared
_PACKETS = 0.1  # scatter of increments from which on they come in packets …
_TIMES = 3.0  # … and × the scatter of the time steps
_WINDOW = 0.3  # [s] over which the pose is differenced: a camera's noise is a few tenths of a millimetre
_SLOWEST = 20.0  # [1/s] least rate of a dataset
_MISFIT = 0.1
"""Share of the wheels' motion that slip and noise leave unexplained."""


@dataclass(frozen=True)
class TimeQuality:
    """Regularity of the samples of one run."""

    samples: int
    duration: float
    """[s]."""
    rate: float
    """Samples per second, by the median step."""
    steps: tuple[float, float]
    """Quantiles of the time step at 5 and 95 % [s]."""
    gaps: int
    longest_gap: float
    """[s]; 0 without gaps."""
    bursts: float
    """Share of the samples that follow the one before far sooner than on average."""

    @property
    def is_slow(self) -> bool:
        """True if the rate is below that of a dataset."""
        return self.rate < 0.99 * _SLOWEST


def time_quality(time: Array) -> TimeQuality:
    """Judge the times of a run.

    Args:
      time: Strictly increasing times, shape (n,) [s].
    """
    steps = np.diff(time)
    gaps = find_gaps(time)
    low, middle, high = np.quantile(steps, (0.05, 0.5, 0.95))
    return TimeQuality(
        len(time),
        float(time[-1] - time[0]),
        float(1.0 / middle),
        (float(low), float(high)),
        len(gaps),
        float(steps[gaps].max()) if len(gaps) else 0.0,
        burst_share(time),
    )


def packet_scatter(counter: Array, time: Array) -> tuple[float, float] | None:
    """Compare the scatter of a counter's increments with that of the time steps.

    Counters of a machine in steady motion grow with time; messages of another rate make them grow by one
    message or by two.

    Args:
      counter: Readings, shape (n,).
      time: Times, shape (n,) [s].

    Returns:
      Relative scatter of increments and of steps where the counter comes in packets; None elsewhere.
    """
    if len(time) < 5 * _NEAR:
        return None
    increments, steps = np.diff(counter), np.diff(time)
    around = np.lib.stride_tricks.sliding_window_view(increments, _NEAR)
    usual = np.median(around, axis=1)
    middle = increments[_NEAR // 2 : -(_NEAR // 2)]
    steady = np.abs(usual) > 0.5 * np.quantile(np.abs(usual), 0.9)
    if np.count_nonzero(steady) < _NEAR or not np.any(usual):
        return None
    scatter = _scatter(middle[steady] / usual[steady])
    of_steps = _scatter(steps / np.median(steps))
    return (scatter, of_steps) if scatter > max(_PACKETS, _TIMES * of_steps) else None


def _scatter(values: Array) -> float:
    low, high = np.quantile(values, (0.16, 0.84))
    return float(high - low) / 2.0


def pose_misfit(runs: Sequence[Run]) -> dict[int, float]:
    """Share of each wheel's motion that no fixed combination of the body's speeds explains.

    Body speeds follow from the measured pose; the layout of the wheels need not be known. A wrong sign, time,
    scale or turn of the pose that differs between runs, and wheels that slip, leave a large share.

    Returns:
      Share 0 … 1 by number of the wheel; empty without pose or wheels.
    """
    having = [run for run in runs if {"x", "y", "heading"} <= set(run.columns) and wheel_numbers(run)]
    if not having:
        return {}
    numbers = sorted(set.intersection(*(set(wheel_numbers(run)) for run in having)))
    body, wheels = zip(*(_windows(run, numbers) for run in having), strict=True)
    twist, speeds = np.concatenate(body), np.concatenate(wheels)
    if len(twist) < 10 * twist.shape[1]:
        return {}
    left = speeds - twist @ np.linalg.lstsq(twist, speeds, rcond=None)[0]
    total = np.maximum((speeds**2).sum(axis=0), 1e-300)
    return {n: float(share) for n, share in zip(numbers, (left**2).sum(axis=0) / total, strict=True)}


def suspicious_wheels(misfit: dict[int, float]) -> list[int]:
    """Wheels whose motion the pose does not explain."""
    return [n for n, share in misfit.items() if share > _MISFIT]


def _windows(run: Run, numbers: Sequence[int]) -> tuple[Array, Array]:
    """Mean twist in the body frame, shape (m, 3), and mean wheel speeds, shape (m, wheels), by window."""
    time = run.time
    size = max(1, round(_WINDOW / float(np.median(np.diff(time)))))
    ends = np.arange(0, len(time), size)
    span = np.diff(time[ends])[:, None]
    pose = np.stack([run.columns[name] for name in ("x", "y", "heading")], axis=1)
    pose[:, 2] = np.unwrap(pose[:, 2])
    speed = np.stack([run.columns[f"wheel_speed_{n}"] for n in numbers], axis=1)
    angle = np.concatenate(
        (np.zeros((1, len(numbers))), np.cumsum(speed[1:] * np.diff(time)[:, None], axis=0))
    )
    change = np.diff(pose[ends], axis=0) / span
    heading = 0.5 * (pose[ends[1:], 2] + pose[ends[:-1], 2])
    c, s = np.cos(heading), np.sin(heading)
    ahead, left = c * change[:, 0] + s * change[:, 1], c * change[:, 1] - s * change[:, 0]
    return np.stack([ahead, left, change[:, 2]], axis=1), np.diff(angle[ends], axis=0) / span
