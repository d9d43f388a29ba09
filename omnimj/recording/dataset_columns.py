"""Which columns a dataset of each plant has, all in SI units."""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from types import MappingProxyType

from omnimj.errors import InputError
from omnimj.recording.dataset import Dataset

ROBOT_WHEELS = 4
"""Wheels of the shipped robot's logs, and of those that name none."""
FEWEST_ROBOT_WHEELS, MOST_ROBOT_WHEELS = 3, 8
"""Wheels that a robot's logs can have."""


@dataclass(frozen=True)
class PlantColumns:
    """The columns of one plant's runs, and what must be known about each run."""

    required: tuple[str, ...]
    """Columns that every run has."""
    optional: tuple[str, ...] = ()
    """Columns that a run may have."""
    zero_if_absent: tuple[str, ...] = ()
    """Columns that stand for 0 where they are absent."""
    one_of: tuple[str, ...] = ()
    """Columns of which a run has at least one."""
    angles: tuple[str, ...] = ()
    """Columns in rad that may be wrapped into one turn."""
    conditions: tuple[str, ...] = ()
    """Keys that hold for every run, by [defaults] or by [runs.NAME]."""

    @property
    def known(self) -> tuple[str, ...]:
        """Every column that has a meaning."""
        return (*self.required, *self.one_of, *self.zero_if_absent, *self.optional)

    @property
    def needed(self) -> str:
        """What a run needs, in words."""
        either = f", and {' or '.join(self.one_of)}" if self.one_of else ""
        return ", ".join(self.required) + either


_BODY = ("acceleration_x", "acceleration_y", "yaw_rate", "yaw")
_NUMBERED = re.compile(r"(?:current|wheel_speed)_([1-9])")


def _robot(wheels: int) -> PlantColumns:
    def each(*names: str) -> tuple[str, ...]:
        return tuple(f"{name}_{i}" for name in names for i in range(1, wheels + 1))

    return PlantColumns(
        required=("time", *each("current", "wheel_speed"), *_BODY),
        optional=(*each("current_target"), "x", "y", "heading"),
        angles=("yaw", "heading"),
        conditions=("floor",),
    )


PLANT_COLUMNS: Mapping[str, PlantColumns] = MappingProxyType(
    {
        "quarter_rig": PlantColumns(
            required=("time", "current", "wheel_speed", "carriage_speed", "carriage_acceleration"),
            optional=("current_target", "carriage_position", "wheel_angle"),
            zero_if_absent=("lateral_speed",),
            angles=("wheel_angle",),
            conditions=("floor", "mass"),
        ),
        "uto_robot": _robot(ROBOT_WHEELS),
        "linear_axis": PlantColumns(
            required=("time", "position"),
            optional=("velocity",),
            one_of=("force", "current"),
        ),
    }
)
"""Columns by plant. A new plant of recorded data is one entry here."""


def wheels_in(names: Iterable[str]) -> int:
    """How many wheels a robot's log is of: the highest number of a current or a wheel speed."""
    numbers = [int(found[1]) for found in map(_NUMBERED.fullmatch, names) if found]
    if not numbers:
        return ROBOT_WHEELS
    return min(max(FEWEST_ROBOT_WHEELS, *numbers), MOST_ROBOT_WHEELS)


def wheels_of(dataset: Dataset) -> int:
    """How many wheels the logs of a robot are of.

    Raises:
      InputError: Runs of one dataset are of robots with different numbers of wheels.
    """
    first, *others = dataset.runs
    count = wheels_in(first.columns)
    for run in others:
        if wheels_in(run.columns) != count:
            found = f"has the columns of {wheels_in(run.columns)} wheels"
            raise InputError(f"{dataset.path}: run {run.name!r}", found, f"{first.name!r} has {count}")
    return count


def columns_for(plant: str, names: Iterable[str]) -> PlantColumns:
    """The columns of a run with these names; a robot's depend on how many wheels it has."""
    return _robot(wheels_in(names)) if plant == "uto_robot" else PLANT_COLUMNS[plant]


def all_columns(plant: str) -> PlantColumns:
    """Every column that any run of the plant may have."""
    return _robot(MOST_ROBOT_WHEELS) if plant == "uto_robot" else PLANT_COLUMNS[plant]
