"""Pages about several runs: a comparison with overlaid plots, and the index of a folder of runs."""

from __future__ import annotations

import dataclasses
import os
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any
from urllib.parse import quote

from omnimj.recording.run_folder import RunFolder
from omnimj.signals import Trace
from omnimj.view import wording
from omnimj.view.comparison import checks_passed, compare_runs, first_alarm
from omnimj.view.motion import wheel_count
from omnimj.view.plots.comparison import LineStyle, courses, paths, run_styles, signals
from omnimj.view.report.page import Cell, Figure, Table, check_state, table, write_page

MOST_RUNS = 8
"""Most runs on a page, whose lines a reader can distinguish."""
_RIG_COLUMNS = (
    ("carriage_speed", "carriage [m/s]"),
    ("wheel_speed", "wheel [rad/s]"),
    ("current", "current [A]"),
    ("slip_velocity_1", "slip [m/s]"),
)


def write_comparison(
    path: Path, runs: Mapping[str, tuple[Mapping[str, Any], Trace]], command: str = ""
) -> None:
    """Write the page that compares up to `MOST_RUNS` runs: tables side by side, plots overlaid."""
    found = compare_runs({name: metrics for name, (metrics, _) in runs.items()})
    write_page(
        path,
        "comparison",
        "Comparison of runs · omnimj",
        names=found.names,
        differing=[name for name in found.differing if name != "duration"],
        setup=_side_by_side(found.names, found.setup),
        checks=_side_by_side(found.names, found.checks) if found.checks else None,
        results=_side_by_side(found.names, found.rows),
        figures=_figures({name: trace for name, (_, trace) in runs.items()}),
        command=command,
    )


def _side_by_side(names: Sequence[str], rows: Sequence[tuple[str, ...]]) -> Table:
    kinds = {"✓": "number good", "✗": "number bad"}
    cells = [(name, *(Cell(text, kinds.get(text[:1], "number")) for text in texts)) for name, *texts in rows]
    return table(cells, ("", *names), "compared", row_headings=True)


def _figures(traces: Mapping[str, Trace]) -> list[Figure]:
    """Overlay the runs of robots and those of rigs in plots of their own."""
    styles = run_styles(traces)
    robots = {name: trace for name, trace in traces.items() if wheel_count(trace)}
    rigs = {name: trace for name, trace in traces.items() if "carriage_speed" in trace}
    figures = []
    if robots:
        figures += _robot_figures(robots, styles)
    if rigs:
        columns = [one for one in _RIG_COLUMNS if any(one[0] in trace for trace in rigs.values())]
        words = "Signals of the rig; slip velocity V_r = r·φ̇ − V where it is known."
        figures.append(Figure(signals(rigs, columns, styles), "rig", "Wheel and carriage", words))
    return figures


def _robot_figures(traces: Mapping[str, Trace], styles: Mapping[str, LineStyle]) -> list[Figure]:
    figures = []
    steered = {name: trace for name, trace in traces.items() if "heading" in trace or "yaw" in trace}
    placed = {name: trace for name, trace in traces.items() if "x" in trace}
    if steered:
        words = "Distance from the plan, and speed."
        figures.append(Figure(courses(steered, (), styles), "courses", "Courses", words))
    if placed:
        words = "From above; squares: the end of each run. The plan is that of the first run."
        figures.append(Figure(paths(placed, (), styles), "paths", "Paths", words))
    for quantity, heading, unit in (
        ("wheel_speed", "Wheel speeds", "rad/s"),
        ("current", "Currents", "A"),
        ("slip_velocity", "Slip velocities", "m/s"),
    ):
        count = max(wheel_count(trace, quantity) for trace in traces.values())
        columns = [
            (f"{quantity}_{i}", f"wheel {i} [{unit}]")
            for i in range(1, count + 1)
            if any(f"{quantity}_{i}" in trace for trace in traces.values())
        ]
        if columns:
            words = "Each wheel in a panel of its own."
            figures.append(Figure(signals(traces, columns, styles), quantity, heading, words))
    return figures


INDEX_HEAD = (
    "scenario",
    "plant",
    "method",
    "floor",
    "seed",
    "checks",
    "first alarm",
    "false alarms",
    "off the path",
)
"""Headings of the index after name and verdict."""


def index_texts(metrics: Mapping[str, Any]) -> tuple[str, ...]:
    """Summarise a run in the columns of `INDEX_HEAD`."""
    diagnosed = wording.is_diagnosed(metrics)
    off_path = metrics.get("path_error_max")
    off_path = metrics.get("tracking_error_max") if off_path is None else off_path
    setup = (
        str(metrics.get(name, "–")).replace("_", " ") for name in ("scenario", "plant", "method", "floor")
    )
    return (
        *setup,
        str(metrics.get("seed", "–")),
        checks_passed(metrics),
        first_alarm(metrics) if diagnosed else "–",
        str(metrics.get("false_alarms", "–")) if diagnosed else "–",
        "–" if off_path is None else f"{wording.number(off_path, 3)} m",
    )


def write_index(path: Path, folder: Path, runs: Sequence[RunFolder]) -> None:
    """Write the index of a folder of runs: a row per run, linked to its report."""
    names, rows, failed = [], [], 0
    for run in runs:
        report = run.path / "report.html"
        link = quote(Path(os.path.relpath(report, path.parent)).as_posix()) if report.is_file() else ""
        ended = bool(run.metrics.get("interrupted"))
        state = check_state(bool(run.metrics.get("passed")) and not ended, bool(run.metrics.get("checks")))
        failed += state.kind == "state bad"
        names.append(run.path.relative_to(folder).as_posix())
        rows.append((Cell(names[-1], link=link), state, *index_texts(run.metrics)))
    found = table(rows, ("run", "", *INDEX_HEAD))
    write_page(
        path,
        "index",
        f"Runs in {folder.name} · omnimj",
        folder=folder.name,
        runs=dataclasses.replace(found, keys=names),
        failed=failed,
    )
