"""`report.html` of a study of sensitivity, its picture and its text."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import omnimj
from omnimj.recording.folder import atomic_file
from omnimj.recording.json_files import write_text
from omnimj.studies.sensitivity.ranking import ResultSensitivity
from omnimj.studies.sensitivity.study import SensitivityResult
from omnimj.studies.sensitivity.tables import (
    format_excluded,
    format_heading,
    format_unranked,
    format_value,
    measure_first_sentence,
    measure_first_table,
    result_table,
    results_table,
    summary_sentences,
)
from omnimj.studies.statistics import Table, format_markdown
from omnimj.view.plots.drawing import svg
from omnimj.view.plots.sensitivity import measure_first_picture, result_bars, result_plane, rows_shown
from omnimj.view.report import page

REPORT, PICTURE, TEXT = "report.html", "sensitivity.png", "sensitivity.md"
_DPI = 160
_FEWEST_BARS = 2
_STYLE = """td { font-variant-numeric: tabular-nums; } td:first-child { color: var(--muted); }
td:not(:last-child) { white-space: nowrap; } td:last-child { min-width: 9rem; }
.wide > svg { min-width: 760px; }
details { margin: .6rem 0 1.6rem; } summary { cursor: pointer; color: var(--muted); }
@media print { details { display: none; } }"""


def write_sensitivity_files(folder: Path, outcome: SensitivityResult) -> None:
    """Writes report, picture and text, each in full or not at all.

    Args:
      folder: Of the study.
      outcome: What was found; the picture is there only where something is ranked.
    """
    found = [measure_first_table(outcome), results_table(outcome)]
    lines = [measure_first_sentence(outcome), *summary_sentences(outcome)]
    write_text(
        folder / TEXT, format_markdown(format_heading(outcome), lines, [one for one in found if one.rows])
    )
    with atomic_file(folder / REPORT) as temporary:
        write_sensitivity_report(temporary, outcome)
    (folder / PICTURE).unlink(missing_ok=True)
    if outcome.ranks:
        with atomic_file(folder / PICTURE) as temporary:
            figure = measure_first_picture(outcome.ranks, outcome.studies, outcome.varied)
            figure.savefig(temporary, dpi=_DPI)


def write_sensitivity_report(path: Path, outcome: SensitivityResult) -> None:
    """Writes the report as one HTML file that needs nothing else."""
    heading = format_heading(outcome)
    parts = [
        f"<h1>{page.text(heading)}</h1>",
        f"<p class='lead'>{page.text(measure_first_sentence(outcome))}</p>",
    ]
    parts += [f"<p>{page.text(line)}</p>" for line in summary_sentences(outcome)]
    perhaps = "" if all(rank.sure for rank in outcome.ranks) else _PERHAPS_WORDS
    if outcome.ranks:
        parts += [_overview(outcome), _section(measure_first_table(outcome), perhaps)]
    if outcome.studies:
        parts.append(_section(results_table(outcome), _FLOOR_WORDS))
        parts += [_of_result(study, outcome) for study in outcome.studies if study.order]
    if outcome.left_out:
        words = "".join(f"<p>{page.text(line)}</p>" for line in format_excluded(outcome))
        parts.append(page.section("Left out", words))
    words = f"omnimj {page.text(omnimj.__version__)}; all numbers are in sensitivity.json, all runs in runs/"
    parts.append(f"<footer>{words}</footer>")
    path.write_text(page.document(heading, "\n".join(parts), _STYLE), encoding="utf-8")


_FLOOR_WORDS = (
    "Behind the names stands μ*, the mean size of the change when the number goes through its whole range. "
    "Ranked is what lies above the floor with all of its 95 % interval: above the μ* that the sensors' noise "
    "alone would reach, and above a millimetre, milliradian, milliampere or millisecond."
)


def _overview(outcome: SensitivityResult) -> str:
    rows = rows_shown(outcome.ranks)
    figure = measure_first_picture(outcome.ranks, outcome.studies, outcome.varied)
    words = (
        "Left: the share of each number in what changes the results, the mean over all of them with its 95 % "
        "interval. Right: its share in each single one; what lacks to 100 is below the floor there. "
        f"The first {rows} of {len(outcome.ranks)} numbers above a floor."
    )
    picture = page.broad(svg(figure, "first", "share of each number in every result"))
    return page.section("What to measure first", page.figure(picture, "", words, "broad"))


_PERHAPS_WORDS = (
    "Perhaps: a few trajectories made it, and its interval reaches down to the floor in every result; more "
    "--trajectories would tell. A small cause can have a large effect where it tips a decision."
)


def _section(table: Table, words: str = "") -> str:
    rows = [[page.cell(cell) for cell in row] for row in table.rows]
    below = f"<p>{page.text(words)}</p>" if words else ""
    return page.section(table.title, page.table(rows, table.head) + below)


def _of_result(study: ResultSensitivity, outcome: SensitivityResult) -> str:
    """Bars, plane and table of one result."""
    return page.section(
        f"{study.name}: {format_value(study.nominal, study.unit)}", "".join(_result_parts(study, outcome))
    )


def _result_parts(study: ResultSensitivity, outcome: SensitivityResult) -> Iterator[str]:
    table, others = _ranked(study, outcome), _others(study, outcome)
    if len(study.order) < _FEWEST_BARS:
        yield f"{table}<details><summary>all others</summary>{others}</details>"
        return
    bars = svg(result_bars(study, outcome.varied), f"bars-{study.name}", f"μ* of {study.name}")
    plane = svg(result_plane(study), f"plane-{study.name}", f"σ over μ* of {study.name}")
    yield "<div class='columns plots'>"
    yield page.figure(bars, "Change across the range", "mean size μ* and its 95 % interval")
    yield page.figure(plane, "Even or not", "far above the line: in a curve, or together with others")
    yield "</div>"
    yield f"<details><summary>all numbers</summary>{table}{others}</details>"


def _ranked(study: ResultSensitivity, outcome: SensitivityResult) -> str:
    table = result_table(study, outcome.varied)
    return page.table([[page.cell(cell) for cell in row] for row in table.rows], table.head)


def _others(study: ResultSensitivity, outcome: SensitivityResult) -> str:
    return "".join(f"<p>{page.text(line)}</p>" for line in format_unranked(study, outcome.varied))
