"""Measured rig runs on an even time grid, for the identification of floors and the search for a gap."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import uniform_filter1d

from omnimj.errors import InputError
from omnimj.plant.mujoco.twin import RigTwin
from omnimj.plant.planar_rig import PlanarRig
from omnimj.recording.dataset import Dataset, Run
from omnimj.signals import RIG_CHANNELS, Array
from omnimj.simulate.compiled.row import RIG_COLUMNS
from omnimj.simulate.compiled.run import CompiledRigRun, compiled_rig_loop

CHANNELS = ("wheel_speed", "carriage_speed", "carriage_acceleration", "current")
"""Measured channels: [rad/s], [m/s], [m/s²], [A]."""
WHEEL, CARRIAGE, ACCELERATION, CURRENT = range(len(CHANNELS))
FLOOR_FRICTION = "the floor's friction is identified on the test rig"
DISSERTATION_TABLE = "the table of the dissertation needs rig runs"
AT_REST = 5e-3
"""Speed below which the carriage stands [m/s]."""
_TURNING = 3.0  # [rad/s] mean of a wheel that does not start from rest
_LATERAL_REST = 0.03  # [m/s] below it the gantry stands
_LATERAL_WINDOW = 0.05  # [s] over which the gantry's speed is smoothed
_STEP = 1.5  # × median time step: nothing is measured between samples farther apart
_BEGIN = 0.005  # [s] at the start of a run whose mean speeds are those that it begins with
_DRIVEN = [1 + RIG_CHANNELS.index(name) for name in CHANNELS[: ACCELERATION + 1]]  # columns of a row
_GRID = 1e-3  # × period: a clock that keeps the grid this well needs no interpolation


@dataclass(frozen=True)
class RigRun:
    """Run at a constant period, k samples."""

    name: str
    condition: str
    """Condition shared by repeats."""
    floor: str
    mass: float
    """m_T [kg]."""
    period: float
    """Sample period [s]."""
    time: Array
    """Time since the start of the run, shape (k,) [s]."""
    values: Array
    """Readings of `CHANNELS`; unmeasured ones are bridged by straight lines, shape (k, 4)."""
    measured: NDArray[np.bool_]
    """Mask of measured samples of `CHANNELS`, shape (k, 4)."""
    target: Array | None
    """Set value of the current where it was recorded, shape (k,) [A]."""
    gantry_speed: Array
    """Smoothed speed of the gantry, exactly 0 while it stands, shape (k,) [m/s]."""

    @property
    def readings(self) -> Array:
        """Readings of `CHANNELS`, NaN where not measured, shape (k, 4)."""
        return np.where(self.measured, self.values, np.nan)

    @property
    def lateral_speed(self) -> float:
        """Mean of the gantry's speed, 0 when it stands [m/s]."""
        return float(self.gantry_speed.mean())

    @property
    def starts_at_rest(self) -> bool:
        """True if carriage and wheel stand at the first samples."""
        carriage, wheel = self._first_speeds
        return abs(carriage) < 4.0 * AT_REST and abs(wheel) <= _TURNING

    @property
    def start_speeds(self) -> tuple[float, float]:
        """Speeds of carriage [m/s] and wheel [rad/s] at the start; 0 for a run that begins at rest."""
        return (0.0, 0.0) if self.starts_at_rest else self._first_speeds

    @property
    def _first_speeds(self) -> tuple[float, float]:
        first = self.values[: max(1, round(_BEGIN / self.period))].mean(axis=0)
        return float(first[CARRIAGE]), float(first[WHEEL])

    @property
    def nominal_current(self) -> float:
        """Set value [A], the median where it changes; without a record, the 90 % quantile of |i|."""
        if self.target is not None and self.target.any():
            size, sign = np.median(np.abs(self.target[self.target != 0.0])), self.target.mean()
        else:
            size, sign = np.quantile(np.abs(self.values[:, CURRENT]), 0.9), self.values[:, CURRENT].mean()
        return float(np.copysign(size, sign))


def require_rig(dataset: Dataset, task: str) -> None:
    """Check that a dataset is one of the rig, as a task needs it, in words.

    Raises:
      InputError: It is not.
    """
    if dataset.plant != "quarter_rig":
        raise InputError(f"{dataset.path}: plant", f"found {dataset.plant!r}", f"{task}, plant 'quarter_rig'")


def rig_run(run: Run, period: float) -> RigRun:
    """Resample a run with `floor` and `mass` among its conditions to an even grid with a period [s].

    Masked samples are bridged by straight lines, so that inputs have no holes, and marked as not measured.
    """
    time = run.time - run.time[0]
    grid = period * np.arange(int(np.floor(time[-1] / period + 1e-6)) + 1, dtype=np.float64)

    def column(name: str) -> tuple[Array, NDArray[np.bool_]]:
        return _on_grid(time, run.columns[name], run.masked.get(name), grid, period)

    values, measured = zip(*map(column, CHANNELS), strict=True)
    gantry = column("lateral_speed")[0] if "lateral_speed" in run.columns else np.zeros(len(grid))
    return RigRun(
        name=run.name,
        condition=run.condition,
        floor=str(run.conditions["floor"]),
        mass=float(run.conditions["mass"]),
        period=period,
        time=grid,
        values=np.stack(values, axis=1),
        measured=np.stack(measured, axis=1),
        target=column("current_target")[0] if "current_target" in run.columns else None,
        gantry_speed=_steady(gantry, period),
    )


def _on_grid(
    time: Array, values: Array, masked: NDArray[np.bool_] | None, grid: Array, period: float
) -> tuple[Array, NDArray[np.bool_]]:
    """Values on the grid, and the mask of those next to measured samples."""
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


def _steady(speed: Array, period: float) -> Array:
    """Smooth the gantry's speed; exactly 0 while it stands."""
    smooth = uniform_filter1d(speed, max(1, round(_LATERAL_WINDOW / period)), mode="nearest")
    middle = float(np.median(smooth))
    if np.abs(smooth - middle).max() < _LATERAL_REST:  # constant speed: the mean is the best estimate
        smooth = np.full(len(speed), float(speed.mean()))
    return np.where(np.abs(smooth) < _LATERAL_REST, 0.0, smooth)


def drive_by_currents(plant: PlanarRig | RigTwin, current: Array, start_speeds: tuple[float, float]) -> Array:
    """Drive a plant with measured currents.

    Args:
      current: Motor current at every sample, shape (k,) [A].
      start_speeds: Speeds of carriage [m/s] and wheel [rad/s] at the start; both 0 for a start from rest.

    Returns:
      Wheel speed [rad/s], carriage speed [m/s] and its acceleration [m/s²] at every sample, shape (k, 3).
    """
    measured = plant.reset()
    if any(start_speeds):
        plant.set_speeds(*start_speeds)
    loop = compiled_rig_loop(plant)
    assert loop is not None  # both plants have one
    # the sample at the period's end: the current loop is faster than a period
    run = CompiledRigRun(loop, plant, measured, np.append(current[1:], 0.0))
    table = np.full((len(current), RIG_COLUMNS + len(plant.truth_names)), np.nan)
    for _ in run.advance(table, np.empty((0, 0)), 1, np.inf):
        pass
    driven = table[:, _DRIVEN]
    if any(start_speeds):
        driven[0, [CARRIAGE, WHEEL]] = start_speeds
    return driven
