"""Runs to export: from a run's folder, a trace file, or a dataset."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from omnimj.errors import InputError
from omnimj.recording.dataset_file import DATASET_FILE
from omnimj.recording.exporting.units import column_unit
from omnimj.recording.run_table import TABLE_SUFFIXES
from omnimj.recording.traces import read_trace
from omnimj.signals import Array

TRACE = "trace.parquet"
LAST_STAMP = 2**31 - 1
"""Largest time that ROS stamps hold [s]."""


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
