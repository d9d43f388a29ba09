"""`dataset.toml`: plant, conditions of each run, and names of the columns."""

from __future__ import annotations

import datetime
import math
from collections.abc import Collection, Mapping
from dataclasses import dataclass
from pathlib import Path
from types import MappingProxyType
from typing import Any

from omnimj.errors import InputError, UnknownNameError
from omnimj.parameters import read_floors
from omnimj.parameters.reading import (
    Rule,
    check_choice,
    check_flag,
    check_number,
    check_table,
    check_text,
    read_toml,
    require_keys,
)
from omnimj.recording.dataset import (
    MASS_OF,
    MAX_WHEELS,
    MIN_WHEELS,
    MJCF,
    PLANT_COLUMNS,
    ROBOT_WHEELS,
    PlantColumns,
    plant_columns,
)
from omnimj.recording.run_table import printable

DATASET_FILE = "dataset.toml"
CONDITION_KEYS = ("floor", "start_floors", "mass", "repeat_of", "description", "date")
"""Keys allowed in [defaults] and [runs.NAME]."""
POSE_MEASURED = "pose_measured"
"""Further key of [defaults], for robots: x, y and heading were measured, an inertial unit is not needed."""

PLANNED_RUNS = "planned_runs"
"""Key of the number of runs that the dataset was to have; it is incomplete with fewer."""
_TOP = ("plant", "model", "wheels", "description", PLANNED_RUNS, "defaults", "columns", "runs")
_COUNT = Rule(1.0, 1e6, False)
_POSITIVE = Rule(0.0, math.inf, True)
_WHEELS = Rule(MIN_WHEELS, MAX_WHEELS, False)
_FINITE = Rule(-math.inf, math.inf, False)
_COLUMN_KEYS = ("name", "scale", "offset")
_WRITE_COLUMN = 'write { name = "carriage_speed", scale = 0.001 }'


@dataclass(frozen=True)
class ColumnMapping:
    """Conversion of a logger's column to a column of omnimj: value = scale × logged value + offset."""

    name: str
    scale: float = 1.0
    offset: float = 0.0
    """Offset in the SI unit of the column."""


@dataclass(frozen=True)
class DatasetFile:
    """Checked content of `dataset.toml`."""

    path: Path
    plant: str
    wheels: int
    """Number of wheels of a robot; that of `ROBOT_WHEELS` unless the file states it."""
    defaults: Mapping[str, float | str]
    renamed: Mapping[str, ColumnMapping]
    """Conversions by the logger's column name."""
    runs: Mapping[str, Mapping[str, float | str]]
    """Conditions of individual runs, by file stem."""
    pose_measured: bool = False
    """Whether the pose of a robot was measured, so that its inertial unit may be missing."""
    states_wheels: bool = True
    """Whether the file states the number of wheels; otherwise it follows from the columns of the runs."""
    model: Path | None = None
    """MJCF file of the machine; relative to the dataset's folder in the file."""
    planned_runs: int = 0
    """Number of runs that the dataset was to have; 0 if the file does not state it."""

    @property
    def columns(self) -> PlantColumns:
        """Columns of the runs."""
        return plant_columns(self.plant, self.wheels, self.pose_measured)

    def conditions(self, run: str) -> dict[str, float | str]:
        """Return the conditions of a run: the defaults, overridden by its own.

        Raises:
          InputError: A condition that the plant needs is set neither in [defaults] nor for the run.
        """
        found = {**self.defaults, **self.runs.get(run, {})}
        for key in self.columns.conditions:
            if key not in found:
                rule = f"state it under [defaults] or [runs.{printable(run)}]"
                raise InputError(f"{self.path}: run {run!r}", f"'{key}' is missing", rule)
        return found


def read_dataset_file(folder: Path, floors: Collection[str] | None = None) -> DatasetFile:
    """Read the `dataset.toml` of a folder.

    Raises:
      InputError: The file is missing or not TOML, or a value breaks its rule.
      UnknownNameError: A plant, floor, column or key does not exist; the message lists the choices.
    """
    path = folder / DATASET_FILE
    tree = read_toml(path)
    require_keys(path, tree, _TOP)
    if "plant" not in tree:
        raise InputError(path, "'plant' is missing", "a dataset has one", PLANT_COLUMNS)
    plant = check_choice(f"{path}: plant", tree["plant"], PLANT_COLUMNS, "plant")
    if "description" in tree:
        check_text(f"{path}: description", tree["description"])
    wheels = _wheels(path, tree, plant)
    known = tuple(read_floors() if floors is None else floors)
    common = dict(check_table(f"{path}: [defaults]", tree.get("defaults", {})))
    pose_measured = _pose_measured(f"{path}: [defaults]: {POSE_MEASURED}", common, plant)
    defaults = _conditions(f"{path}: [defaults]", common, known, plant)
    runs = {
        name: _conditions(f"{path}: [runs.{printable(name)}]", table, known, plant)
        for name, table in check_table(f"{path}: [runs]", tree.get("runs", {})).items()
    }
    columns = check_table(f"{path}: [columns]", tree.get("columns", {}))
    states_wheels = "wheels" in tree or plant != "uto_robot"
    known_columns = plant_columns(plant, wheels if states_wheels else MAX_WHEELS)
    renamed = {}
    for theirs, entry in columns.items():
        if theirs.strip() in renamed:
            raise InputError(f"{path}: [columns]", f"{theirs.strip()!r} occurs twice")
        place = f"{path}: columns.{theirs!r}"
        renamed[theirs.strip()] = _column_mapping(place, entry, plant, known_columns)
    return DatasetFile(
        path,
        plant,
        wheels,
        MappingProxyType(defaults),
        MappingProxyType(renamed),
        MappingProxyType(runs),
        pose_measured,
        states_wheels,
        _model(path, tree, plant),
        _planned_runs(path, tree),
    )


def _planned_runs(path: Path, tree: Mapping[str, Any]) -> int:
    if PLANNED_RUNS not in tree:
        return 0
    return int(check_number(f"{path}: {PLANNED_RUNS}", tree[PLANNED_RUNS], _COUNT, whole=True))


def _model(path: Path, tree: Mapping[str, Any], plant: str) -> Path | None:
    """MJCF file of the machine, from the dataset's folder; None if the file names none."""
    if "model" not in tree:
        return None
    name = check_text(f"{path}: model", tree["model"])
    if plant != MJCF:
        raise InputError(f"{path}: model", f"found {name!r}", f"{plant} takes its model from --model")
    return path.parent / name


def _wheels(path: Path, tree: Mapping[str, Any], plant: str) -> int:
    if "wheels" not in tree:
        return ROBOT_WHEELS
    if plant != "uto_robot":
        raise InputError(f"{path}: wheels", f"found {tree['wheels']!r}", f"{plant} has none to count")
    return int(check_number(f"{path}: wheels", tree["wheels"], _WHEELS, whole=True))


def _pose_measured(place: str, defaults: dict[str, Any], plant: str) -> bool:
    """Take `pose_measured` out of the defaults."""
    if POSE_MEASURED not in defaults:
        return False
    found = check_flag(place, defaults.pop(POSE_MEASURED))
    if found and plant != "uto_robot":
        raise InputError(place, "found true", f"{plant} has no pose")
    return found


def _conditions(place: str, entry: Any, floors: Collection[str], plant: str) -> dict[str, float | str]:
    found: dict[str, float | str] = {}
    for key, value in check_table(place, entry).items():
        at = f"{place}: {key}"
        states_mass = plant == MJCF and key.startswith(MASS_OF) and key != MASS_OF
        if key not in CONDITION_KEYS and not states_mass:
            if key == POSE_MEASURED:
                raise InputError(at, f"found {value!r}", "it holds for all runs: state it under [defaults]")
            raise UnknownNameError(place, "key", key, (*CONDITION_KEYS, POSE_MEASURED))
        if key == "mass" or states_mass:
            found[key] = check_number(at, value, _POSITIVE)
        elif key == "start_floors":
            found[key] = _start_floors(at, value, floors)
        elif key == "floor":
            found[key] = check_choice(at, value, floors, "floor")
        elif key == "date" and isinstance(value, datetime.date | datetime.time):
            found[key] = value.isoformat()
        else:
            found[key] = check_text(at, value)
    return found


def _start_floors(place: str, value: Any, floors: Collection[str]) -> str:
    """Floors under the wheels at the start, a list or a text with commas, as such a text."""
    names = [name.strip() for name in value.split(",")] if isinstance(value, str) else value
    if not isinstance(names, list) or not names:
        raise InputError(
            place, f"found {value!r}", "a list with the floor under each wheel is needed", floors
        )
    return ", ".join(check_choice(place, name, floors, "floor") for name in names)


def _column_mapping(place: str, entry: Any, plant: str, known: PlantColumns) -> ColumnMapping:
    if not isinstance(entry, Mapping):
        raise InputError(place, f"found {entry!r}", _WRITE_COLUMN)
    require_keys(place, entry, _COLUMN_KEYS)
    if "name" not in entry:
        raise InputError(place, "'name' is missing", _WRITE_COLUMN)
    name = entry["name"]
    if not isinstance(name, str) or not known.has(name):
        raise UnknownNameError(f"{place}.name", f"column of {plant}", name, known.choices)
    scale = check_number(f"{place}.scale", entry.get("scale", 1.0), _FINITE)
    if scale == 0.0:
        raise InputError(f"{place}.scale", "found 0", "must not be 0")
    return ColumnMapping(name, scale, check_number(f"{place}.offset", entry.get("offset", 0.0), _FINITE))
