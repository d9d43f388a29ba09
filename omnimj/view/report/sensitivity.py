"""Files of a sensitivity study: `report.html`, picture and text."""

from __future__ import annotations

from pathlib import Path

from omnimj.recording.json_files import write_text
from omnimj.studies.sensitivity.elementary_effects import ResultSensitivity
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
from omnimj.studies.statistics import Table as TextTable
from omnimj.studies.statistics import format_markdown
from omnimj.view.plots.panels import Drawing
from omnimj.view.plots.sensitivity import result_bars, result_plane, rows_shown, share_bars, share_matrix
from omnimj.view.plots.static import svg_file
from omnimj.view.report.page import Figure, Table, table, write_page

REPORT, PICTURE, TEXT = "report.html", "sensitivity.svg", "sensitivity.md"
_FEWEST_BARS = 2


def write_sensitivity_files(folder: Path, result: SensitivityResult) -> None:
    """Write report, picture and text, each in full or not at all; a picture needs ranked parameters."""
    tables = [one for one in (measure_first_table(result), results_table(result)) if one.rows]
    lines = [measure_first_sentence(result), *summary_sentences(result)]
    write_text(folder / TEXT, format_markdown(format_heading(result), lines, tables))
    write_sensitivity_report(folder / REPORT, result)
    (folder / PICTURE).unlink(missing_ok=True)
    if result.ranks:
        bars, matrix = _shares(result)
        drawing = Drawing((*bars.panels, *matrix.panels))
        write_text(folder / PICTURE, svg_file(drawing, "share of each number in the changes of the results"))


def write_sensitivity_report(path: Path, result: SensitivityResult) -> None:
    """Write the report of a sensitivity study to an HTML file."""
    write_page(
        path,
        "sensitivity",
        format_heading(result),
        lead=measure_first_sentence(result),
        lines=summary_sentences(result),
        overview=_overview(result) if result.ranks else [],
        measure_first=_table(measure_first_table(result)) if result.ranks else None,
        has_unsure=not all(rank.sure for rank in result.ranks),
        results=_table(results_table(result)) if result.studies else None,
        sections=[
            (
                f"{study.name}: {format_value(study.nominal, study.unit)}",
                _figures(study, result),
                _table(result_table(study, result.factors))[1],
                format_unranked(study, result.factors),
            )
            for study in result.studies
            if study.ranked
        ],
        excluded=format_excluded(result) if result.excluded else [],
    )


def _table(found: TextTable) -> tuple[str, Table]:
    return found.title, table(found.rows, found.head)


def _shares(result: SensitivityResult) -> tuple[Drawing, Drawing]:
    return share_bars(result.ranks, result.factors), share_matrix(
        result.ranks, result.studies, result.factors
    )


def _overview(result: SensitivityResult) -> list[Figure]:
    bars, matrix = _shares(result)
    words = (
        "mean share of each number in the changes of the results, with its 95 % interval; the first "
        f"{rows_shown(result.ranks)} of {len(result.ranks)} numbers above a floor"
    )
    first = Figure(bars, "first", "All results", words)
    words = "share of each number in percent; the rest to 100 % is below the floor"
    return [first, Figure(matrix, "each", "Each result", words)]


def _figures(study: ResultSensitivity, result: SensitivityResult) -> list[Figure]:
    """Plot bars and μ*–σ plane of one result; none if too few parameters are ranked."""
    if len(study.ranked) < _FEWEST_BARS:
        return []
    bars, plane = result_bars(study, result.factors), result_plane(study, result.factors)
    words = "mean size μ* and its 95 % interval"
    first = Figure(bars, f"bars-{study.name}", "Change across the range", words, label=f"μ* of {study.name}")
    words = "far above the line: nonlinear, or interacting with other numbers"
    label = f"σ over μ* of {study.name}"
    return [first, Figure(plane, f"plane-{study.name}", "Linear or not", words, label=label)]
