"""`report.html` of labelled runs: which wheel stands on which floor, beside the camera's truth."""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from omnimj.diagnosis.floor_labels.edge import BAND, true_labels
from omnimj.diagnosis.floor_labels.files import LabelledDataset
from omnimj.diagnosis.floor_labels.runs import LabelledRun, ScoreBoard
from omnimj.diagnosis.floor_labels.scores import EdgeScores
from omnimj.resources import model_display_name
from omnimj.signals import Array
from omnimj.view.plots.diagnosis import floor_probabilities
from omnimj.view.report.page import (
    MOST_FIGURES,
    Cell,
    Figure,
    RunSection,
    Table,
    number,
    run_key,
    run_table,
    table,
    write_page,
)


def describe_crossings(run: LabelledRun, floors: Sequence[str]) -> str:
    """Crossings of a run in words."""
    words = [f"wheel {c.wheel} to {floors[c.floor]} at {c.time:.1f} s" for c in run.crossings]
    return "; ".join(words) or ("none" if len(run.time) else "no steady driving")


def describe_start(run: LabelledRun, floors: Sequence[str]) -> str:
    """Floors under the wheels at the start in words."""
    return "unknown" if run.start is None else ", ".join(floors[label] for label in run.start)


SCORE_HEAD = ("", "crossings", "found", "found within 1 s", "of found within 1 s", "right labels", "false")


def score_rows(board: ScoreBoard) -> list[tuple[str, ...]]:
    """Scores and chance as rows under `SCORE_HEAD`."""
    shifts = [(f"truth shifted by {share:+.0%} of a run", one) for share, one in board.shifted.items()]
    rows = (("currents", board.own), *shifts, ("no change", board.no_change))
    return [(name, *_score_cells(one)) for name, one in rows]


def _score_cells(one: EdgeScores) -> tuple[str, ...]:
    shares = (one.share_found, one.share_found_on_time, one.share_on_time, one.accuracy)
    return (str(one.crossings), *(_percent(share) for share in shares), str(one.false))


def _percent(share: float) -> str:
    return f"{100.0 * share:.0f} %" if math.isfinite(share) else "–"


def write_floor_report(path: Path, found: LabelledDataset, command: str) -> None:
    """Write the report of labelled runs."""
    name = found.dataset.path.resolve().name
    sections = [_section(found, run, k < MOST_FIGURES) for k, run in enumerate(found.runs)]
    many = sum(len(run.crossings) for run in found.runs)
    write_page(
        path,
        "floor_labels",
        f"Floors under {name} · omnimj",
        name=name,
        floors=found.floors,
        runs=len(found.runs),
        model=model_display_name(found.plan.robot.file),
        verdict=f"{many} crossings in {sum(bool(run.crossings) for run in found.runs)} runs",
        calibration=found.calibration,
        notes=found.dataset.notes,
        scores=None if found.board is None else _scores(found.board),
        overview=_overview(found, sections),
        sections=sections,
        command=command,
        model_file=found.plan.robot.file,
    )


def _scores(board: ScoreBoard) -> Table:
    return table([(name, *map(number, cells)) for name, *cells in score_rows(board)], SCORE_HEAD)


def _overview(found: LabelledDataset, sections: Sequence[RunSection]) -> Table:
    rows: list[tuple[str, Sequence[Cell | object]]] = [
        (run.name, (describe_start(run, found.floors), describe_crossings(run, found.floors)))
        for run in found.runs
    ]
    return run_table(rows, ("run", "floors at the start", "crossings"), sections)


def _section(found: LabelledDataset, run: LabelledRun, is_drawn: bool) -> RunSection:
    figures = []
    if is_drawn and len(run.time) > 1:
        second = found.floors[1]
        drawing = floor_probabilities(run.time, run.probability[:, :, 1], _truth(run), second)
        words = f"Probability that each wheel stands on {second}."
        if run.distance is not None:
            words += f" Broad: by the camera, but for ± {1000.0 * BAND:.0f} mm about the line."
        key = run_key(run.name).removeprefix("run-")
        figures.append(Figure(drawing, f"f-{key}", "Floors", words))
    return RunSection(run.name, figures, describe_crossings(run, found.floors))


def _truth(run: LabelledRun) -> Array | None:
    """1 beyond the line, 0 before it, NaN in the band, shape (w, n); None without camera."""
    if run.distance is None:
        return None
    known = np.abs(run.distance) > BAND
    return np.where(known, true_labels(run.distance).astype(float), np.nan)
