"""Runs to export: from a run's folder, a trace file, or a dataset; units and names of their columns."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from omnimj.errors import InputError
from omnimj.recording.dataset_file import DATASET_FILE
from omnimj.recording.importing.units import target_unit
from omnimj.recording.run_table import TABLE_SUFFIXES
from omnimj.recording.traces import read_trace
from omnimj.signals import Array

TRACE = "trace.parquet"
LAST_STAMP = 2**31 - 1
"""Largest time that ROS stamps hold [s]."""
_N = r"(_\d+)?"
_UNITS = (
    # beyond the measured columns, which `target_unit` knows
    (rf"(target|true)_wheel_speed{_N}|target_yaw_rate|twist_yaw|gyro_bias", "rad/s"),
    (r"heading_estimate|target_heading|tilt", "rad"),
    (rf"(target_)?twist_[xy]|target_velocity_[xy]|slip_velocity{_N}|true_(carriage_speed|velocity)", "m/s"),
    (r"target_[xy]|place_error_[xy]|lateral_position|true_position", "m"),
    (rf"(normal|traction|lateral)_force{_N}|(residual|threshold)_force(_[xy])?", "N"),
    (r"residual_moment", "Nm"),
    (rf"(residual|threshold)_wheel_speed{_N}", "rad/s"),
    (rf"(residual|threshold)_slip{_N}", "m"),
    (rf"(residual|threshold)_motor{_N}", "1"),  # log likelihood ratio
    (rf"(effectiveness|limit_reason|weight){_N}|misfit|mode|recovery|pace", "1"),
)
_LONGEST_MATLAB = 63
_MATLAB_WORDS = (
    *("break", "case", "catch", "classdef", "continue", "else", "elseif", "end", "for", "function", "global"),
    *("if", "otherwise", "parfor", "persistent", "return", "spmd", "switch", "try", "while"),
)


@dataclass(frozen=True)
class ExportedRun:
    """Columns of one run, in SI units."""

    file: Path
    """File that they were read from."""
    columns: Mapping[str, Array]
    """`time` first, each shape (n,)."""
    about: Mapping[str, Any] = field(default_factory=dict)
    """Description of the run."""

    @property
    def units(self) -> dict[str, str]:
        """Units by column; `1` for pure numbers, empty where unknown."""
        return {name: column_unit(name) for name in self.columns}


def read_run(path: Path) -> ExportedRun:
    """Read a run.

    Args:
      path: Folder with `trace.parquet`, a trace file, or a run of a dataset (NAME.parquet or NAME.csv beside
        `dataset.toml`).

    Raises:
      InputError: There is no such run, it is damaged, or its time is not finite and increasing.
    """
    if path.is_dir():
        if (path / DATASET_FILE).exists() and not (path / TRACE).exists():
            runs = [one.name for one in sorted(path.iterdir()) if one.suffix in TABLE_SUFFIXES]
            raise InputError(path, "is a dataset", f"give one of its runs: {', '.join(runs[:8])}")
        path = path / TRACE
    if path.suffix.lower() in TABLE_SUFFIXES and (path.parent / DATASET_FILE).exists():
        found = _of_dataset(path)
    else:
        trace = read_trace(path)
        found = ExportedRun(path, {"time": trace.columns["time"], **trace.columns}, trace.about)
    _require_times(found)
    return found


def _of_dataset(path: Path) -> ExportedRun:
    from omnimj.recording.read_dataset import read_dataset

    if not path.is_file():
        raise InputError(path, "no such file")
    dataset = read_dataset(path.parent)
    run = next(one for one in dataset.runs if one.name == path.stem)
    about = {"plant": dataset.plant, "run": run.name, **run.conditions}
    return ExportedRun(path, {"time": run.time, **run.columns}, about)


def _require_times(run: ExportedRun) -> None:
    time = run.columns["time"]
    if not len(time):
        raise InputError(run.file, "has no rows")
    wrong = np.flatnonzero(~np.isfinite(time))
    if len(wrong):
        raise InputError(f"{run.file}: row {wrong[0] + 1}", f"time is {time[wrong[0]]}", "must be finite")
    late = np.flatnonzero(np.diff(time) <= 0.0)
    if len(late):
        k = int(late[0]) + 1
        found = f"time is {time[k]:.12g} s after {time[k - 1]:.12g} s"
        raise InputError(f"{run.file}: row {k + 1}", found, "must increase")


def column_unit(name: str) -> str:
    """SI unit of a column; `1` for pure numbers, empty where it depends on the machine or is unknown."""
    return target_unit(name) or next((unit for pattern, unit in _UNITS if re.fullmatch(pattern, name)), "")


def ros_names(names: Iterable[str]) -> dict[str, str]:
    """Field names of a ROS message by column: small letters, digits and single underscores."""

    def valid(name: str) -> str:
        plain = re.sub(r"_+", "_", re.sub(r"[^a-z0-9]", "_", name.lower())).strip("_")
        return plain if plain[:1].isalpha() else f"column_{plain}".rstrip("_")

    return _distinct(names, valid)


def matlab_names(names: Iterable[str]) -> dict[str, str]:
    """Variable names for MATLAB by column: letters, digits and underscores, at most 63."""

    def valid(name: str) -> str:
        plain = re.sub(r"[^A-Za-z0-9_]", "_", name)
        plain = plain if plain[:1].isalpha() else f"column_{plain.lstrip('_')}"
        return (f"{plain}_" if plain in _MATLAB_WORDS else plain)[:_LONGEST_MATLAB]

    return _distinct(names, valid)


def _distinct(names: Iterable[str], valid: Callable[[str], str]) -> dict[str, str]:
    """Names made valid; a number is added to those that another column has."""
    found: dict[str, str] = {}
    taken: set[str] = set()
    for name in names:
        first = one = valid(name)
        count = 2
        while one in taken:
            ending = f"_{count}"
            one, count = f"{first[: _LONGEST_MATLAB - len(ending)]}{ending}", count + 1
        taken.add(one)
        found[name] = one
    return found
