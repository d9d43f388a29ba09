"""How well a model drives as the rig did: section 4.3 of the dissertation, a table of RMS speed errors."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence

import numpy as np

from omnimj.errors import InputError, UnknownNameError
from omnimj.identification.published import published_errors
from omnimj.identification.records import Cell, ReplayedRun, Validation
from omnimj.identification.replay import PLANTS, replay
from omnimj.identification.rig_run import RigRun, rig_run
from omnimj.parameters import Floor, Rig
from omnimj.recording.dataset import Dataset, Run

Progress = Callable[[int, int], None]

_SET_VALUE_GRID, _LATERAL_GRID = 0.05, 0.05  # [A, m/s] that test plans are written on …
_NEAR = 0.015  # … and how near to it a measured value must be to belong to it
_FLOOR_ORDER = ("natural_stone", "pvc", "paperboard")


def validate(
    dataset: Dataset,
    rig: Rig,
    floors: Mapping[str, Floor],
    plants: Sequence[str] = PLANTS,
    progress: Progress | None = None,
) -> Validation:
    """Replays every run on every plant.

    Ctrl-C keeps the runs that were finished.

    Args:
      dataset: Rig runs.
      rig: The model, with its effects.
      floors: By name.
      plants: Of `PLANTS`.
      progress: Called with replays done and replays in all.

    Raises:
      InputError: Not a rig dataset, a mass that the rig cannot have, or no such floor.
      UnknownNameError: No such plant.
      SimulationError: The simulation left finite numbers.
    """
    if dataset.plant != "quarter_rig":
        # robot and axis come in here, each with a replay and a table of its own
        rule = "this version validates rig runs, plant 'quarter_rig'"
        raise InputError(f"{dataset.path}: plant", f"found {dataset.plant!r}", rule)
    for plant in plants:
        if plant not in PLANTS:
            raise UnknownNameError("--plant", "plant", plant, PLANTS)
    replayed: list[ReplayedRun] = []
    interrupted, total = False, len(dataset.runs) * len(plants)
    try:
        for measured in dataset.runs:
            run = rig_run(measured, 1.0 / rig.sensors.sample_rate)
            nominal = _set_value(measured, run)
            done = [replay(rig, floors, run, plant, nominal) for plant in plants]
            replayed.extend(done)
            if progress is not None:
                progress(len(replayed), total)
    except KeyboardInterrupt:
        interrupted = True
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
    """The runs by condition, in the order of Table 4.2: mass, floor, lateral speed, current."""
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
        rms={plant: _together([r.carriage_rms for r in own]) for plant, own in by_plant.items()},
        wheel_rms={plant: _together([r.wheel_rms for r in own]) for plant, own in by_plant.items()},
        published=published_errors(floor, mass, lateral, current),
    )


def _together(errors: Sequence[float]) -> float:
    return float(np.sqrt(np.mean(np.square(errors))))


def _set_value(measured: Run, run: RigRun) -> float:
    """The current that was asked for, most of the time where it changes [A]; from the monitor without it."""
    target = measured.columns.get("current_target")
    if target is None or not np.any(target):
        return run.nominal_current
    return float(np.copysign(np.median(np.abs(target[target != 0.0])), np.mean(target)))


def _on_grid(value: float, grid: float) -> float:
    """A value that is meant to lie on a grid, put there; any other to two digits."""
    nearest = grid * round(value / grid)
    return round(nearest, 6) if abs(value - nearest) <= _NEAR else round(value, 2)
