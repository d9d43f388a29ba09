"""`report.html` of a validation, of the rig or of a robot.

That of the rig has speed errors in the layout of Tables 4.2 to 4.4, and overlays; that of a robot errors by
floor and speed, and the runs that are furthest off.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path

from omnimj.estimate.drives.records import DrivenRun, DriveValidation, Group
from omnimj.estimate.identification.records import Cell as Condition
from omnimj.estimate.identification.records import ReplayedRun, Validation
from omnimj.signals import Array
from omnimj.view.plots import identification as plots
from omnimj.view.report.page import Cell, Figure, Table, number, table, write_page
from omnimj.view.wording import percent

_MOST_OVERLAYS = 8
_HEAD = ("wheels", "runs", "plant", "body", "simulated", "error", "currents", "yaw rate", "end of path")


def write_validation_report(path: Path, found: Validation, command: str = "") -> None:
    """Write the report of a validation."""
    straight = [cell for cell in found.cells if not cell.lateral_speed]
    lateral = [cell for cell in found.cells if cell.lateral_speed]
    published = [cell.published[0] for cell in found.cells if cell.published]
    write_page(
        path,
        "validation",
        f"Validation on {found.dataset.name} · omnimj",
        found=found,
        runs=len({run.run for run in found.runs}),
        means=", ".join(f"{found.mean(plant):.4f} m/s ({plant})" for plant in found.plants),
        published=published,
        plants=" / ".join(found.plants),
        straight=_straight(straight, found.plants) if straight else None,
        lateral=_lateral(lateral, found.plants),
        wheel_speed=_wheel_speed(found),
        figures=overlays(found),
        command=command,
    )


def _straight(cells: Sequence[Condition], plants: Sequence[str]) -> Table:
    """Tabulate errors of straight runs by mass and floor (rows) and current (columns)."""
    currents = sorted({cell.current for cell in cells})
    by_row: dict[tuple[float, str], dict[float, Condition]] = {}
    for cell in cells:
        by_row.setdefault((cell.mass, cell.floor), {})[cell.current] = cell
    rows = [
        (number(f"{mass:g} kg"), floor.replace("_", " "), *(_errors(own.get(i), plants) for i in currents))
        for (mass, floor), own in by_row.items()
    ]
    return table(rows, ("mass", "floor", *(f"{current:.2f} A" for current in currents)))


def _lateral(cells: Sequence[Condition], plants: Sequence[str]) -> list[tuple[str, Table]]:
    """Tabulate errors of lateral runs by lateral speed (rows) and current (columns), per floor and mass."""
    tables = []
    for floor, mass in dict.fromkeys((cell.floor, cell.mass) for cell in cells):
        own = [cell for cell in cells if (cell.floor, cell.mass) == (floor, mass)]
        currents = sorted({cell.current for cell in own})
        rows = []
        for speed in dict.fromkeys(cell.lateral_speed for cell in own):
            at = {cell.current: cell for cell in own if cell.lateral_speed == speed}
            rows.append((number(f"{speed:+.2f} m/s"), *(_errors(at.get(i), plants) for i in currents)))
        head = ("lateral", *(f"{current:.2f} A" for current in currents))
        tables.append((f"{floor.replace('_', ' ')}, {mass:g} kg", table(rows, head)))
    return tables


def _errors(cell: Condition | None, plants: Sequence[str]) -> Cell:
    if cell is None:
        return Cell("–", "empty")
    ours = " / ".join(_short(cell.rms[plant]) for plant in plants if plant in cell.rms)
    published = " → ".join(_short(value) for value in cell.published) or "\N{NO-BREAK SPACE}"
    return Cell(ours, "number pair", note=published)


def _short(value: float) -> str:
    """Format an error as the dissertation does: `.024`."""
    text = f"{value:.3f}"
    return text[1:] if text.startswith("0.") else text


def _wheel_speed(found: Validation) -> Table:
    rows = []
    for plant in found.plants:
        errors = [cell.wheel_rms[plant] for cell in found.cells if plant in cell.wheel_rms]
        rows.append((plant, f"mean {sum(errors) / len(errors):.3g}, largest {max(errors):.3g} rad/s"))
    return table(rows)


def overlays(found: Validation) -> list[Figure]:
    """Plot the runs with the largest errors."""
    by_run: dict[str, list[ReplayedRun]] = {}
    for run in found.runs:
        by_run.setdefault(run.run, []).append(run)
    worst = sorted(by_run.values(), key=lambda runs: -max(run.carriage_rms for run in runs))
    figures = []
    for k, runs in enumerate(worst[:_MOST_OVERLAYS]):
        first = runs[0]
        errors = ", ".join(f"{run.plant} {_short(run.carriage_rms)}" for run in runs)
        condition = f"{first.floor.replace('_', ' ')}, {first.mass:g} kg, {first.current:.2f} A"
        if first.lateral_speed:
            condition += f", {first.lateral_speed:+.2f} m/s sideways"
        caption = f"{condition}; RMS {errors} m/s"
        figures.append(Figure(plots.speed_overlay(runs), f"run-{k}", first.run, caption))
    return figures


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
        Figure(plots.drive_paths(runs), f"path-{key}", f"{word}: paths", caption),
        Figure(plots.drive_courses(runs), f"course-{key}", f"{word}: courses", caption),
    ]
