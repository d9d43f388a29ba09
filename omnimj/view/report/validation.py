"""`report.html` of a validation: the table in the shape of Tables 4.2 to 4.4, and overlays."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import omnimj
from omnimj.estimate.identification.records import Cell, ReplayedRun, Validation
from omnimj.view.plots import identification as validation_plots
from omnimj.view.plots.drawing import svg
from omnimj.view.report import page

_MOST_OVERLAYS = 8
_STYLE = (
    "td.pair { line-height: 1.35; } td.pair small { color: var(--muted); } .empty { color: var(--line); }"
)


def write_validation_report(path: Path, found: Validation, command: str = "") -> None:
    """Writes the report as one HTML file that needs nothing else.

    Args:
      path: The file to write.
      found: Table and runs.
      command: The command line that makes it again.
    """
    straight = [cell for cell in found.cells if not cell.lateral_speed]
    sideways = [cell for cell in found.cells if cell.lateral_speed]
    content = [_head(found)]
    if straight:
        content.append(page.section("Straight runs, as Table 4.2", _straight(straight, found.plants)))
    if sideways:
        content.append(
            page.section("With the gantry moving sideways, as Tables 4.3 and 4.4", _sideways(sideways, found))
        )
    content += [_wheels(found), _overlays(found), _foot(found, command)]
    heading = f"Validation on {found.dataset.name} · omnimj"
    path.write_text(page.document(heading, "\n".join(content), _STYLE), encoding="utf-8")


def _head(found: Validation) -> str:
    means = ", ".join(f"{found.mean(plant):.4f} m/s ({plant})" for plant in found.plants)
    effects = f" It carries {', '.join(found.effects)}." if found.effects else ""
    stopped = "<p class='verdict bad'>Stopped before the last run</p>" if found.interrupted else ""
    printed = [cell for cell in found.cells if cell.published]
    beside = ""
    if printed:
        mean = sum(cell.published[0] for cell in printed) / len(printed)
        beside = (
            f"<p>The dissertation prints {mean:.3f} m/s on average for the {len(printed)} of these "
            "conditions that it has; it compares another rig with another model: a size to go by.</p>"
        )
    notes = "".join(f"<li>{page.text(note)}</li>" for note in found.notes)
    runs = len({run.run for run in found.runs})
    return (
        f"<h1>Validation on {page.text(found.dataset.name)}</h1>"
        f"<p class='lead'>The currents measured in {runs} runs drive the model "
        f"{page.text(found.model.name)}.{page.text(effects)}</p>"
        f"<p><b>RMS error of the carriage's speed, mean over {len(found.cells)} conditions: {means}.</b></p>"
        f"{beside}{stopped}" + (f"<ul>{notes}</ul>" if notes else "")
    )


def _straight(cells: Sequence[Cell], plants: Sequence[str]) -> str:
    """Mass and floor down, current across."""
    currents = sorted({cell.current for cell in cells})
    by_row: dict[tuple[float, str], dict[float, Cell]] = {}
    for cell in cells:
        by_row.setdefault((cell.mass, cell.floor), {})[cell.current] = cell
    rows = []
    for (mass, floor), own in by_row.items():
        row = [page.cell(f"{mass:g} kg", "number"), page.cell(floor.replace("_", " "))]
        rows.append(row + [_errors(own.get(current), plants) for current in currents])
    head = ("mass", "floor", *(f"{current:.2f} A" for current in currents))
    return _legend(plants, "published") + page.table(rows, head)


def _sideways(cells: Sequence[Cell], found: Validation) -> str:
    """Lateral speed down, current across; a table for each floor and mass."""
    tables = []
    for floor, mass in dict.fromkeys((cell.floor, cell.mass) for cell in cells):
        own = [cell for cell in cells if (cell.floor, cell.mass) == (floor, mass)]
        currents = sorted({cell.current for cell in own})
        rows = []
        for lateral in dict.fromkeys(cell.lateral_speed for cell in own):
            at = {cell.current: cell for cell in own if cell.lateral_speed == lateral}
            row = [page.cell(f"{lateral:+.2f} m/s", "number")]
            rows.append(row + [_errors(at.get(current), found.plants) for current in currents])
        head = ("lateral", *(f"{current:.2f} A" for current in currents))
        name = f"<p>{page.text(floor.replace('_', ' '))}, {mass:g} kg</p>"
        tables.append(name + page.table(rows, head))
    words = "published without → with lateral friction in the model"
    return _legend(found.plants, words) + "".join(tables)


def _legend(plants: Sequence[str], published: str) -> str:
    return (
        f"<p>RMS error of the carriage's speed [m/s]: {' / '.join(plants)}; below it, small: {published}.</p>"
    )


def _errors(cell: Cell | None, plants: Sequence[str]) -> str:
    if cell is None:
        return "<td class='empty'>–</td>"
    ours = " / ".join(_short(cell.rms[plant]) for plant in plants if plant in cell.rms)
    theirs = " → ".join(_short(value) for value in cell.published) or "&nbsp;"
    return f"<td class='number pair'>{ours}<br><small>{theirs}</small></td>"


def _short(value: float) -> str:
    """`.024`, as the dissertation prints it."""
    text = f"{value:.3f}"
    return text[1:] if text.startswith("0.") else text


def _wheels(found: Validation) -> str:
    rows = []
    for plant in found.plants:
        errors = [cell.wheel_rms[plant] for cell in found.cells if plant in cell.wheel_rms]
        mean = sum(errors) / len(errors)
        rows.append((page.text(plant), page.cell(f"mean {mean:.3g}, largest {max(errors):.3g} rad/s")))
    return page.section("Wheel speed", page.table(rows))


def _overlays(found: Validation) -> str:
    by_run: dict[str, list[ReplayedRun]] = {}
    for run in found.runs:
        by_run.setdefault(run.run, []).append(run)
    worst = sorted(by_run.values(), key=lambda runs: -max(run.carriage_rms for run in runs))
    shown = worst[:_MOST_OVERLAYS]
    figures = []
    for k, runs in enumerate(shown):
        first = runs[0]
        errors = ", ".join(f"{run.plant} {_short(run.carriage_rms)}" for run in runs)
        where = f"{first.floor.replace('_', ' ')}, {first.mass:g} kg, {first.current:.2f} A"
        if first.lateral_speed:
            where += f", {first.lateral_speed:+.2f} m/s sideways"
        drawn = svg(validation_plots.speed_overlay(runs), f"run-{k}", page.text(first.run))
        figures.append(page.figure(drawn, first.run, f"{where}; RMS {errors} m/s"))
    heading = "Runs, largest error first" if len(worst) > len(shown) else "Runs"
    more = f"<p>{len(shown)} of {len(worst)} runs.</p>" if len(worst) > len(shown) else ""
    return page.section(heading, f"{more}<div class='columns plots'>{''.join(figures)}</div>")


def _foot(found: Validation, command: str) -> str:
    again = f"<p>To make it again:</p>{page.command(command)}" if command else ""
    return (
        f"<footer>{again}<p>Errors are root mean squares over all samples of a run, sensor noise among them; "
        "both speeds of the simulation pass the sensors' speed filter. Model "
        f"{page.text(found.model)}. Beside this page: <code>validation.json</code>. "
        f"Written by omnimj {page.text(omnimj.__version__)}.</p></footer>"
    )
