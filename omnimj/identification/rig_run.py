"""A measured rig run on an even time grid, with what must not be fitted left out."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from omnimj.recording.dataset import Run
from omnimj.signals import Array

AT_REST = 5e-3
"""A carriage slower than this stands [m/s]."""
_TURNING = 3.0  # [rad/s] mean of a wheel that does not start from rest
_LATERAL_REST = 0.01  # [m/s] below it the gantry stands and its speed has no sign
_STEP = 1.5  # × median time step: farther apart, what lies between two samples is not measured
_BEGIN = 0.02  # [s] that say how a run begins
_GRID = 1e-3  # × period: a clock that keeps the grid this well needs no interpolation


@dataclass(frozen=True)
class RigRun:
    """One run at a constant period; arrays have shape (k,)."""

    name: str
    condition: str
    """What repeats share."""
    floor: str
    mass: float
    """m_T [kg]."""
    lateral_speed: float
    """Mean of the gantry's speed, 0 when it stands [m/s]."""
    period: float
    """[s]"""
    time: Array
    """From 0 on [s]."""
    current: Array
    """[A]"""
    wheel_speed: Array
    """[rad/s]"""
    carriage_speed: Array
    """[m/s]"""
    carriage_acceleration: Array
    """[m/s²]"""
    measured: NDArray[np.bool_]
    """Where current, wheel speed, carriage speed, acceleration are measured, shape (k, 4)."""

    @property
    def starts_at_rest(self) -> bool:
        """Whether carriage and wheel stand at the first samples."""
        first = max(1, round(_BEGIN / self.period))
        turning = abs(self.wheel_speed[:first].mean()) > _TURNING
        return bool(abs(self.carriage_speed[:first].mean()) < 4.0 * AT_REST and not turning)

    @property
    def nominal_current(self) -> float:
        """The set value of a constant-current run: the 90 % quantile of |i| with the sign of its mean [A]."""
        return float(np.copysign(np.quantile(np.abs(self.current), 0.9), self.current.mean()))


def rig_run(run: Run, period: float) -> RigRun:
    """A run of a dataset on an even grid.

    Masked samples are bridged by straight lines, so that an input has no holes, and marked as not measured.

    Args:
      run: With columns of the rig, `floor` and `mass` among its conditions.
      period: Of the grid [s].
    """
    time = run.time - run.time[0]
    count = int(np.floor(time[-1] / period + 1e-6)) + 1
    grid = period * np.arange(count, dtype=np.float64)
    names = ("current", "wheel_speed", "carriage_speed", "carriage_acceleration")
    columns, measured = {}, np.empty((count, len(names)), dtype=bool)
    for c, name in enumerate(names):
        columns[name], measured[:, c] = _on_grid(time, run.columns[name], run.masked.get(name), grid, period)
    lateral = float(np.mean(run.columns["lateral_speed"])) if "lateral_speed" in run.columns else 0.0
    return RigRun(
        name=run.name,
        condition=run.condition,
        floor=str(run.conditions["floor"]),
        mass=float(run.conditions["mass"]),
        lateral_speed=lateral if abs(lateral) > _LATERAL_REST else 0.0,
        period=period,
        time=grid,
        measured=measured,
        **columns,
    )


def _on_grid(
    time: Array, values: Array, masked: NDArray[np.bool_] | None, grid: Array, period: float
) -> tuple[Array, NDArray[np.bool_]]:
    """Values on the grid, and where they lie beside measured samples."""
    good = np.isfinite(values) if masked is None else np.isfinite(values) & ~masked
    if not good.any():
        return np.zeros(len(grid)), np.zeros(len(grid), dtype=bool)
    if len(time) >= len(grid) and np.abs(time[: len(grid)] - grid).max() < _GRID * period:
        time = time.copy()
        time[: len(grid)] = grid
    known, step = time[good], np.median(np.diff(time))
    right = np.clip(np.searchsorted(known, grid), 0, len(known) - 1)
    left = np.clip(np.searchsorted(known, grid, side="right") - 1, 0, len(known) - 1)
    return np.interp(grid, known, values[good]), known[right] - known[left] <= _STEP * step


def longest_stretches(measured: NDArray[np.bool_], least: int) -> list[tuple[int, int]]:
    """Stretches of at least `least` samples that are not measured, as first and past-the-last sample."""
    edges = np.flatnonzero(np.diff(np.concatenate(([False], ~measured, [False])).astype(int)))
    return [(a, b) for a, b in zip(edges[::2].tolist(), edges[1::2].tolist(), strict=True) if b - a >= least]
