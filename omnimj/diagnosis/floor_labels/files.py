"""Files of labelled runs: `floor_labels.json` and one Parquet file per run."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import omnimj
from omnimj.diagnosis.floor_labels.calibration import LabelCalibration
from omnimj.diagnosis.floor_labels.currents import FloorPlan
from omnimj.diagnosis.floor_labels.edge import EdgeLine
from omnimj.diagnosis.floor_labels.runs import LabelledRun, ScoreBoard
from omnimj.diagnosis.floor_labels.scores import EdgeScores, true_crossings
from omnimj.recording.dataset import Dataset
from omnimj.recording.folder import make_folder
from omnimj.recording.json_files import to_jsonable, write_json
from omnimj.recording.traces import write_trace
from omnimj.signals import Trace

LABELS_FILE, REPORT_FILE = "floor_labels.json", "report.html"


@dataclass(frozen=True)
class LabelledDataset:
    """Labelled runs of a dataset, with all that led to them."""

    plan: FloorPlan
    dataset: Dataset
    calibration: LabelCalibration
    lines: Mapping[str, EdgeLine]
    """Line between both floors by run; empty without camera."""
    runs: tuple[LabelledRun, ...]
    board: ScoreBoard | None
    """Scores, with lines only."""

    @property
    def floors(self) -> list[str]:
        """Names of the floors."""
        return [floor.name for floor in self.plan.floors]


def write_labels(folder: Path, force: bool, found: LabelledDataset, command: str) -> dict[str, Any]:
    """Write `floor_labels.json` and the labels of each run.

    Returns:
      Content of `floor_labels.json`.

    Raises:
      InputError: The folder is not empty and `force` is false, or a file cannot be written.
    """
    make_folder(folder, force, (LABELS_FILE, REPORT_FILE, *(f"{run.name}.parquet" for run in found.runs)))
    for run in found.runs:
        write_trace(folder / f"{run.name}.parquet", _trace(found, run))
    content = labels_json(found, command)
    write_json(folder / LABELS_FILE, content)
    return content


def _trace(found: LabelledDataset, run: LabelledRun) -> Trace:
    """Labels, probabilities and distances beyond the line, a row per window."""
    columns = {"time": run.time}
    for i in range(run.labels.shape[1]):
        columns[f"floor_{i + 1}"] = run.labels[:, i].astype(float)
        for k, name in enumerate(found.floors):
            columns[f"probability_{i + 1}_{name}"] = run.probability[:, i, k]
        if run.distance is not None:
            columns[f"beyond_line_{i + 1}"] = run.distance[:, i]
    return Trace(columns, {"run": run.name, "floors": found.floors})


def labels_json(found: LabelledDataset, command: str) -> dict[str, Any]:
    """Content of `floor_labels.json`."""
    board = found.board
    content = {
        "dataset": str(found.dataset.path),
        "model": str(found.plan.robot.file),
        "floors": found.floors,
        "version": omnimj.__version__,
        "command": command,
        "calibration": dataclasses.asdict(found.calibration),
        "notes": list(found.dataset.notes),
        "scores": None if board is None else _board(board),
        "runs": {run.name: _run(found, run) for run in found.runs},
    }
    return to_jsonable(content)


def _run(found: LabelledDataset, run: LabelledRun) -> dict[str, Any]:
    names, line = found.floors, found.lines.get(run.name)
    content: dict[str, Any] = {
        "start_floors": None if run.start is None else [names[k] for k in run.start],
        "windows": len(run.time),
        "crossings": [{"time": c.time, "wheel": c.wheel, "floor": names[c.floor]} for c in run.crossings],
    }
    if line is not None:
        truth = run.truth
        content["edge_line"] = dataclasses.asdict(line)
        content["true_crossings"] = [
            {"first": c.first, "last": c.last, "wheel": c.wheel, "floor": names[c.floor]}
            for c in true_crossings(truth.time, truth.distance)
        ]
    return content


def _board(board: ScoreBoard) -> dict[str, Any]:
    shifts = {f"{share:+g}": _scores(one) for share, one in board.shifted.items()}
    return {"currents": _scores(board.own), "truth_shifted": shifts, "no_change": _scores(board.no_change)}


def _scores(one: EdgeScores) -> dict[str, Any]:
    shares = ("share_found", "share_found_on_time", "share_on_time", "accuracy")
    return dataclasses.asdict(one) | {name: getattr(one, name) for name in shares}
