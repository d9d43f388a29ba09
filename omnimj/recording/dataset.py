"""Measured data as records: what a dataset's folder holds once it is read and checked."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from omnimj.recording.dataset_columns import ROBOT_WHEELS
from omnimj.signals import Array


@dataclass(frozen=True)
class Run:
    """One measured run, columns in SI units under our names."""

    name: str
    """The file's stem."""
    columns: Mapping[str, Array]
    """`time` and the plant's columns, each shape (n,); unknown columns are kept."""
    masked: Mapping[str, NDArray[np.bool_]]
    """Per column the samples that must not be fitted (spikes, edges of gaps), shape (n,); none: absent."""
    conditions: Mapping[str, float | str]
    """`floor`, `mass` and whatever else [defaults] and [runs.NAME] say, `repeat_of` apart."""
    repeat_of: str | None = None
    """Runs with one value are repeats of one condition."""

    @property
    def time(self) -> Array:
        """Time of the samples, shape (n,) [s]."""
        return self.columns["time"]

    @property
    def condition(self) -> str:
        """What repeats have in common: `repeat_of`, or the run's own name."""
        return self.repeat_of or self.name


@dataclass(frozen=True)
class Dataset:
    """A folder of measured runs of one plant."""

    path: Path
    plant: str
    """`quarter_rig`, `uto_robot` or `linear_axis`."""
    runs: tuple[Run, ...]
    notes: tuple[str, ...] = ()
    """What a reader should know: gaps and spikes that were masked, one sentence each."""
    wheels: int = ROBOT_WHEELS
    """Of a robot."""
