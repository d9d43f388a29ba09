"""`report.html` of a robot's validation: errors by floor and speed, and the runs that are furthest off."""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path

from omnimj.estimate.drives.records import DrivenRun, DriveValidation, Group
from omnimj.signals import Array
from omnimj.view.plots.drives import drive_courses, drive_paths
from omnimj.view.report.page import Figure, Table, number, plot, table, write_page
from omnimj.view.wording import percent

_HEAD = ("wheels", "runs", "plant", "body", "simulated", "error", "currents", "yaw rate", "end of path")


def write_drives_report(path: Path, found: DriveValidation, command: str = "") -> None:
    """Write the report of a robot's validation."""
    floors = tuple(dict.fromkeys(group.floor for group in found.groups))
    write_page(
        path,
        "drives",
        f"Validation on {found.dataset.name} · omnimj",
        found=found,
        runs=len({run.run for run in found.runs}),
        tables=[(floor, groups_table([g for g in found.groups if g.floor == floor])) for floor in floors],
        figures=[figure for floor in floors for figure in drive_figures(found, floor)],
        command=command,
    )


def groups_table(groups: Sequence[Group]) -> Table:
    """List groups of runs: speeds, and errors of velocity, currents, yaw rate and end of path."""
    return table([_row(group) for group in groups], _HEAD)


def _row(group: Group) -> tuple:
    currents = " ".join(_plain(value, 3) for value in group.current_error.tolist())
    drawn = " ".join(_plain(value, 2) for value in group.measured_current.tolist())
    return (
        number(f"{group.wheel_rolling:.2f}"),
        number(len(group.runs)),
        group.plant,
        number(f"{group.measured_speed:.4f}"),
        number(f"{group.simulated_speed:.4f}"),
        number(percent(group.velocity_error)),
        number(currents, f"of {drawn}"),
        number(f"{group.yaw_rate_error:.4f}", f"of {group.measured_yaw_rate:.4f}"),
        number(percent(group.end_by_measured_heading), f"own heading {percent(group.end_by_own_heading)}"),
    )


def _plain(value: float, digits: int) -> str:
    return f"{value:.{digits}f}" if math.isfinite(value) else "–"


def drive_figures(found: DriveValidation, floor: str) -> list[Figure]:
    """Plot the run of a floor that the first plant misses most, and the one in the middle."""
    first = [one for one in found.numbers if one.floor == floor and one.plant == found.plants[0]]
    off = {one.run: _distance(one.measured, one.simulated) for one in first}
    order = sorted(off, key=lambda run: off[run])
    figures = []
    for word, name in {"median": order[len(order) // 2], "worst": order[-1]}.items():
        runs = [run for run in found.runs if run.run == name]
        figures += _pair(runs, f"{floor}, {word}", f"{1000.0 * off[name]:.3g} mm/s")
    return figures


def _distance(measured: Array, simulated: Array) -> float:
    error = simulated - measured
    return math.hypot(error[0], error[1]) if math.isfinite(error[0]) else 0.0


def _pair(runs: Sequence[DrivenRun], word: str, error: str) -> list[Figure]:
    name = runs[0].run
    key = f"{word}-{name}".replace(", ", "-").replace(" ", "-")
    caption = f"{name}; error of the mean velocity {error} ({runs[0].plant})"
    return [
        plot(drive_paths(runs), f"path-{key}", f"{word}: paths", caption),
        plot(drive_courses(runs), f"course-{key}", f"{word}: courses", caption),
    ]
