"""Validation of a rig model driven by measured currents, section 4.3 of the dissertation."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from types import MappingProxyType
from typing import Any

import numpy as np
from scipy.signal import lfilter

from omnimj.effects import apply_effects
from omnimj.errors import InputError, SimulationError, UnknownNameError
from omnimj.estimate.identification.records import Cell, ReplayedRun, Validation
from omnimj.estimate.intervals import finite_rms
from omnimj.estimate.rig_runs import (
    CARRIAGE,
    CURRENT,
    DISSERTATION_TABLE,
    WHEEL,
    RigRun,
    drive_by_currents,
    require_rig,
    rig_run,
)
from omnimj.estimate.threads import Progress, completed_in_threads
from omnimj.parameters import Floor, Rig
from omnimj.parameters.floor import find_floor
from omnimj.plant.mujoco.twin import RigTwin
from omnimj.plant.planar_rig import PlanarRig
from omnimj.recording.dataset import Dataset, Run
from omnimj.signals import Array

TABLE_4_2_CURRENTS = (0.45, 0.60, 0.75, 0.90, 1.05, 1.20, 1.35, 1.50)
"""Currents in Table 4.2 [A]."""
TABLE_4_2: Mapping[tuple[float, str], tuple[float, ...]] = MappingProxyType(
    {
        (3.9593, "natural_stone"): (0.024, 0.016, 0.007, 0.010, 0.012, 0.016, 0.020, 0.012),
        (3.9593, "pvc"): (0.037, 0.035, 0.014, 0.008, 0.019, 0.009, 0.017, 0.024),
        (3.9593, "paperboard"): (0.035, 0.006, 0.010, 0.021, 0.017, 0.011, 0.021, 0.013),
        (2.9593, "natural_stone"): (0.022, 0.015, 0.013, 0.008, 0.022, 0.016, 0.025, 0.029),
        (2.9593, "pvc"): (0.036, 0.013, 0.011, 0.010, 0.011, 0.010, 0.014, 0.015),
        (2.9593, "paperboard"): (0.031, 0.012, 0.011, 0.008, 0.015, 0.014, 0.012, 0.025),
        (1.9593, "natural_stone"): (0.035, 0.015, 0.029, 0.018, 0.028, 0.038, 0.037, 0.025),
        (1.9593, "pvc"): (0.019, 0.016, 0.016, 0.018, 0.026, 0.033, 0.031, 0.029),
        (1.9593, "paperboard"): (0.022, 0.022, 0.019, 0.022, 0.025, 0.025, 0.032, 0.015),
    }
)
"""Mass [kg] and floor → error per current."""

TABLE_4_3_CURRENTS = (0.6, 0.9, 1.2, 1.5)
"""Currents of Tables 4.3 and 4.4 [A]."""
TABLE_4_3_FLOOR, TABLE_4_3_MASS = "natural_stone", 3.9593
TABLE_4_3: Mapping[float, tuple[float, ...]] = MappingProxyType(
    {
        0.20: (0.045, 0.029, 0.033, 0.024),
        0.35: (0.068, 0.054, 0.040, 0.027),
        0.50: (0.075, 0.038, 0.033, 0.029),
        0.65: (0.072, 0.040, 0.028, 0.033),
        -0.20: (0.023, 0.055, 0.051, 0.078),
        -0.35: (0.047, 0.066, 0.079, 0.102),
        -0.50: (0.034, 0.064, 0.067, 0.093),
        -0.65: (0.057, 0.082, 0.088, 0.103),
    }
)
"""Lateral speed [m/s] → error per current, without lateral friction in the model."""
TABLE_4_4: Mapping[float, tuple[float, ...]] = MappingProxyType(
    {
        0.20: (0.021, 0.005, 0.008, 0.009),
        0.35: (0.029, 0.013, 0.011, 0.024),
        0.50: (0.029, 0.014, 0.022, 0.032),
        0.65: (0.024, 0.019, 0.029, 0.028),
        -0.20: (0.018, 0.018, 0.015, 0.041),
        -0.35: (0.016, 0.008, 0.020, 0.044),
        -0.50: (0.059, 0.023, 0.019, 0.018),
        -0.65: (0.047, 0.018, 0.014, 0.024),
    }
)
"""Lateral speed [m/s] → error per current, with lateral friction in the model."""

_MASS, _CURRENT, _LATERAL = 0.02, 0.03, 0.03  # [kg, A, m/s] tolerance of a measured condition
PLANTS = ("twin", "planar")
"""Plants for the replay of measured currents."""
_SET_VALUE_GRID, _LATERAL_GRID = 0.05, 0.05  # [A, m/s] grid of test plans …
_NEAR = 0.015  # … and largest distance of a measured value from it
_FLOOR_ORDER = ("natural_stone", "pvc", "paperboard")


def published_errors(floor: str, mass: float, lateral_speed: float, current: float) -> tuple[float, ...]:
    """Look up the RMS speed errors printed in the dissertation for a condition.

    Args:
      mass: Mass m_T of the quarter body [kg].
      lateral_speed: Speed of the gantry [m/s].
      current: Motor current [A].

    Returns:
      The one number of Table 4.2; with the gantry moving those of Tables 4.3 and 4.4, without and with
      lateral friction [m/s]; empty where there is no such cell.
    """
    if lateral_speed == 0.0:
        column = _nearest(TABLE_4_2_CURRENTS, current, _CURRENT)
        masses = sorted({m for m, _ in TABLE_4_2})
        row = _nearest(masses, mass, _MASS)
        if column is None or row is None or (masses[row], floor) not in TABLE_4_2:
            return ()
        return (TABLE_4_2[masses[row], floor][column],)
    speeds = tuple(TABLE_4_3)
    column, row = (
        _nearest(TABLE_4_3_CURRENTS, current, _CURRENT),
        _nearest(speeds, lateral_speed, _LATERAL),
    )
    if floor != TABLE_4_3_FLOOR or abs(mass - TABLE_4_3_MASS) > _MASS or column is None or row is None:
        return ()
    return TABLE_4_3[speeds[row]][column], TABLE_4_4[speeds[row]][column]


def _nearest(values, wanted: float, most: float) -> int | None:
    k = min(range(len(values)), key=lambda i: abs(values[i] - wanted))
    return k if abs(values[k] - wanted) <= most else None


def _replays(
    rig: Rig, floors: Mapping[str, Floor], measured: Run, plants: Sequence[str]
) -> list[ReplayedRun]:
    """Replays of one recorded run by several plants."""
    run = rig_run(measured, 1.0 / rig.sensors.sample_rate)
    return [replay_run(rig, floors, run, plant) for plant in plants]


def replay_run(rig: Rig, floors: Mapping[str, Floor], run: RigRun, plant: str) -> ReplayedRun:
    """Simulate one run, from rest or from the measured speeds where the data begin in motion.

    Both simulated speeds pass the sensors' speed filter, so that they lag as the measured ones do.

    Raises:
      InputError: No such floor, or a mass that the rig cannot have.
      SimulationError: The simulation left finite numbers.
    """
    simulated = _plant(rig, floors, run, plant)
    try:
        speeds = drive_by_currents(simulated, _true_current(rig, run), run.start_speeds)[:, :2]
    finally:
        simulated.close()
    if not np.isfinite(speeds).all():
        raise SimulationError(f"run {run.name}: the {plant} plant left finite numbers")
    lag = math.exp(-run.period / rig.sensors.speed_filter)
    late, _ = lfilter([1.0 - lag], [1.0, -lag], speeds, axis=0, zi=lag * speeds[:1])
    late = np.asarray(late)
    wheel, carriage, *_ = run.readings.T
    return ReplayedRun(
        run=run.name,
        plant=plant,
        floor=run.floor,
        mass=run.mass,
        current=run.nominal_current,
        lateral_speed=run.lateral_speed,
        time=run.time,
        measured_speed=carriage,
        simulated_speed=late[:, CARRIAGE],
        carriage_rms=finite_rms(late[:, CARRIAGE] - carriage),
        wheel_rms=finite_rms(late[:, WHEEL] - wheel),
    )


def _plant(rig: Rig, floors: Mapping[str, Floor], run: RigRun, plant: str) -> PlanarRig | RigTwin:
    floor = find_floor(run.floor, f"run {run.name}: floor", floors)
    if run.mass <= rig.wheel.mass:
        rule = f"must be above wheel.mass, {rig.wheel.mass:g}"
        raise InputError(f"run {run.name}: mass", f"found {run.mass:g}", rule)
    options: dict[str, Any] = {"mass": run.mass, "lateral_speed": run.lateral_speed}
    options |= {"ideal_sensors": True, "measured_current": True}
    if plant == "planar":
        return PlanarRig(rig, floor.name, floors=floors, **options)
    return RigTwin(rig, floor, **options)


def _true_current(rig: Rig, run: RigRun) -> Array:
    """Motor current [A]: the monitor's reading with the model's effects on the monitor undone."""
    current, change = run.values[:, CURRENT], apply_effects(rig).channels.get("current")
    if change is None:
        return current
    if change.scale == 0.0:
        raise InputError(f"{rig.file}: effects", "the current monitor has no gain", "its scale must not be 0")
    on_time = np.interp(run.time + change.delay, run.time, current)
    return (on_time - change.offset) / change.scale


def validate(
    dataset: Dataset,
    rig: Rig,
    floors: Mapping[str, Floor],
    plants: Sequence[str] = PLANTS,
    progress: Progress | None = None,
) -> Validation:
    """Replay every run on every plant.

    Ctrl-C keeps the completed runs.

    Raises:
      InputError: Not a rig dataset, a mass that the rig cannot have, or no such floor.
      UnknownNameError: No such plant.
      SimulationError: The simulation left finite numbers.
    """
    require_rig(dataset, DISSERTATION_TABLE)
    for plant in plants:
        if plant not in PLANTS:
            raise UnknownNameError("--plant", "plant", plant, PLANTS)
    replayed, interrupted = completed_in_threads(
        lambda run: _replays(rig, floors, run, plants), dataset.runs, len(plants), progress
    )
    names = tuple(getattr(rig, "effects", {}))
    cells = table_cells(replayed)
    return Validation(
        dataset.path,
        rig.file,
        names,
        tuple(plants),
        cells,
        tuple(replayed),
        dataset.notes,
        interrupted,
    )


def table_cells(replayed: Sequence[ReplayedRun]) -> tuple[Cell, ...]:
    """Cells of the runs by condition, in the order of Table 4.2: mass, floor, lateral speed, current."""
    groups: dict[tuple[str, float, float, float], list[ReplayedRun]] = {}
    for run in replayed:
        lateral = _on_grid(run.lateral_speed, _LATERAL_GRID)
        key = (run.floor, run.mass, lateral, _on_grid(run.current, _SET_VALUE_GRID))
        groups.setdefault(key, []).append(run)
    return tuple(_cell(*key, groups[key]) for key in sorted(groups, key=_order))


def _order(key: tuple[str, float, float, float]) -> tuple:
    floor, mass, lateral, current = key
    place = _FLOOR_ORDER.index(floor) if floor in _FLOOR_ORDER else len(_FLOOR_ORDER)
    return (lateral != 0.0, -mass, place, floor, lateral < 0.0, abs(lateral), current)


def _cell(floor: str, mass: float, lateral: float, current: float, runs: Sequence[ReplayedRun]) -> Cell:
    by_plant: dict[str, list[ReplayedRun]] = {}
    for run in runs:
        by_plant.setdefault(run.plant, []).append(run)
    return Cell(
        floor=floor,
        mass=mass,
        lateral_speed=lateral,
        current=current,
        runs=tuple(dict.fromkeys(run.run for run in runs)),
        rms={plant: _pooled_rms([r.carriage_rms for r in own]) for plant, own in by_plant.items()},
        wheel_rms={plant: _pooled_rms([r.wheel_rms for r in own]) for plant, own in by_plant.items()},
        published=published_errors(floor, mass, lateral, current),
    )


def _pooled_rms(errors: Sequence[float]) -> float:
    return float(np.sqrt(np.mean(np.square(errors))))


def _on_grid(value: float, grid: float) -> float:
    """Round a value to the nearest grid point where it is close to one, to two digits otherwise."""
    nearest = grid * round(value / grid)
    return round(nearest, 6) if abs(value - nearest) <= _NEAR else round(value, 2)
