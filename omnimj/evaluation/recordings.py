"""What the sensors of evaluated cases said, as a dataset: for `omnimj calibrate` and `omnimj diagnose`.

The dataset gets what a logger and its owner would know: channels, set currents and the floor; no fault, no
error of a constant, no seed.
"""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path
from types import MappingProxyType

from omnimj.evaluation.cases import WHEELS, Case
from omnimj.plant.channels import robot_channels
from omnimj.recording.dataset import Run
from omnimj.recording.dataset_file import DATASET_FILE
from omnimj.recording.folder import whole_file
from omnimj.recording.write_dataset import dataset_text, write_table
from omnimj.signals import Array, Trace

RECORDINGS = "recordings"
"""The dataset's folder inside the evaluation's."""
_PLANT = "uto_robot"


def is_recorded(folder: Path, case: Case) -> bool:
    """Whether the recording of a case is there."""
    return _file(folder, case).is_file()


def record(folder: Path, case: Case, trace: Trace) -> None:
    """Writes the recording of a case, in full or not at all."""
    targets = [f"current_target_{i}" for i in range(1, WHEELS + 1)]
    columns = {name: trace[name] for name in ("time", *robot_channels(WHEELS), *targets)}
    folder.mkdir(parents=True, exist_ok=True)
    with whole_file(_file(folder, case)) as temporary:
        write_table(temporary, _run(case, columns))


def describe(folder: Path, cases: Iterable[Case]) -> None:
    """Makes the recordings that are there a dataset."""
    runs = [_run(case, {}) for case in cases if is_recorded(folder, case)]
    if runs:
        with whole_file(folder / DATASET_FILE) as temporary:
            temporary.write_text(dataset_text(_PLANT, {}, runs), encoding="utf-8", newline="\n")


def _file(folder: Path, case: Case) -> Path:
    return folder / f"{case.name}.parquet"


def _run(case: Case, columns: dict[str, Array]) -> Run:
    return Run(case.name, columns, MappingProxyType({}), MappingProxyType({"floor": case.floor}))
