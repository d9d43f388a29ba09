"""Datasets as records, in SI units: columns of each plant, measured runs, and their dataset."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from types import MappingProxyType
from typing import Any

import numpy as np
from numpy.typing import NDArray

from omnimj.display import Displayed
from omnimj.errors import InputError
from omnimj.signals import Array, to_frame

MJCF = "mjcf"
"""Plant of datasets of any machine with an MJCF file; columns name its joints, actuators and sensors."""
MASS_OF = "mass:"
"""Beginning of the condition that states the mass of a body of such a machine: `mass:forearm`."""
ROBOT_WHEELS = 4
"""Number of wheels of a robot whose dataset neither states nor shows it."""
MIN_WHEELS, MAX_WHEELS = 3, 12
"""Limits of the number of wheels of a robot."""


@dataclass(frozen=True)
class PlantColumns:
    """Columns in the runs of one plant, and conditions that must be stated for each run."""

    required: tuple[str, ...]
    """Columns that every run has."""
    optional: tuple[str, ...] = ()
    """Columns that a run may have."""
    zero_if_absent: tuple[str, ...] = ()
    """Columns taken as 0 if absent."""
    one_of: tuple[str, ...] = ()
    """Columns of which every run has at least one."""
    angles: tuple[str, ...] = ()
    """Columns in rad that may be wrapped to one turn."""
    conditions: tuple[str, ...] = ()
    """Keys that must be set for every run, in [defaults] or [runs.NAME]."""
    prefixes: tuple[str, ...] = ()
    """Beginnings of names that end with a part of the machine: `position:` of `position:elbow`."""

    @property
    def known(self) -> tuple[str, ...]:
        """All columns with a meaning."""
        return (*self.required, *self.one_of, *self.zero_if_absent, *self.optional)

    @property
    def needed(self) -> str:
        """Columns that a run needs, in words."""
        either = f", and {' or '.join(self.one_of)}" if self.one_of else ""
        return ", ".join(self.required) + either

    @property
    def choices(self) -> tuple[str, ...]:
        """Names with a meaning, for messages."""
        return (*self.known, *(f"{prefix}NAME" for prefix in self.prefixes))

    def has(self, name: str) -> bool:
        """Return whether a column has a meaning."""
        return name in self.known or any(
            name.startswith(prefix) and len(name) > len(prefix) for prefix in self.prefixes
        )


def _wheel_columns(wheels: int, *names: str) -> tuple[str, ...]:
    return tuple(f"{name}_{i}" for name in names for i in range(1, wheels + 1))


INERTIAL_UNIT = ("acceleration_x", "acceleration_y", "yaw_rate", "yaw")
"""Columns of a robot's inertial unit."""


_POSE = ("x", "y", "heading")


def _robot_columns(wheels: int, pose_measured: bool = False) -> PlantColumns:
    always, other = (_POSE, INERTIAL_UNIT) if pose_measured else (INERTIAL_UNIT, _POSE)
    return PlantColumns(
        required=("time", *_wheel_columns(wheels, "current", "wheel_speed"), *always),
        optional=(*_wheel_columns(wheels, "current_target"), *other),
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
        "uto_robot": _robot_columns(ROBOT_WHEELS),
        "linear_axis": PlantColumns(
            required=("time", "position"),
            optional=("velocity",),
            one_of=("force", "current"),
        ),
        MJCF: PlantColumns(
            required=("time",),
            prefixes=("position:", "velocity:", "force:", "control:", "enabled:", "sensor:"),
        ),
    }
)
"""Columns by plant, for a robot with four wheels; a new recorded plant needs one entry here."""


def plant_columns(plant: str, wheels: int = ROBOT_WHEELS, pose_measured: bool = False) -> PlantColumns:
    """Return the columns of a plant."""
    return _robot_columns(wheels, pose_measured) if plant == "uto_robot" else PLANT_COLUMNS[plant]


# Measured data as records: the content of a dataset folder once read and checked.


@dataclass(frozen=True)
class Run:
    """One measured run, in SI units under the column names of omnimj."""

    name: str
    """Stem of the file name."""
    columns: Mapping[str, Array]
    """`time` and the plant's columns, each shape (n,); unknown columns are kept."""
    masked: Mapping[str, NDArray[np.bool_]]
    """Masks by column of samples that must not be fitted (spikes, edges of gaps), shape (n,); or absent."""
    conditions: Mapping[str, float | str]
    """`floor`, `mass` and other entries of [defaults] and [runs.NAME], without `repeat_of`."""
    repeat_of: str | None = None
    """Name of the condition that this run repeats, shared by all its repeats."""

    @property
    def time(self) -> Array:
        """Time of the samples, shape (n,) [s]."""
        return self.columns["time"]

    @property
    def condition(self) -> str:
        """Name of the condition: `repeat_of`, or else the name of the run."""
        return self.repeat_of or self.name

    def unmasked(self, names: Sequence[str]) -> Array:
        """Columns by name, NaN where masked, shape (n, columns)."""
        table = np.column_stack([np.array(self.columns[name], float) for name in names])
        for k, name in enumerate(names):
            if (bad := self.masked.get(name)) is not None:
                table[bad, k] = np.nan
        return table

    def to_pandas(self) -> Any:
        """Convert the columns to a `pandas.DataFrame` indexed by `time`; needs pandas."""
        return to_frame(self.columns)


@dataclass(frozen=True)
class Dataset(Displayed):
    """Checked content of a folder of measured runs of one plant."""

    path: Path
    plant: str
    """One of `PLANT_COLUMNS`."""
    runs: tuple[Run, ...]
    notes: tuple[str, ...] = ()
    """Sentences on the masked gaps and spikes, one each."""
    wheels: int = ROBOT_WHEELS
    """Number of wheels of a robot."""
    pose_measured: bool = False
    """Whether `x`, `y` and `heading` of a robot were measured; its inertial unit may then be missing."""
    model: Path | None = None
    """MJCF file that `dataset.toml` names."""


def require_inertial_unit(dataset: Dataset, hint: str = "") -> None:
    """Refuse robot runs with a measured pose and no inertial unit, for work that needs the unit.

    Raises:
      InputError: A run lacks a column of the inertial unit.
    """
    for run in dataset.runs if dataset.plant == "uto_robot" else ():
        missing = [name for name in INERTIAL_UNIT if name not in run.columns]
        if missing:
            found = f"run {run.name!r} has no {', '.join(missing)}"
            rule = "this command needs the inertial unit; a measured pose does not replace it here"
            if hint:
                rule += f"; {hint}"
            raise InputError(dataset.path, found, rule)
