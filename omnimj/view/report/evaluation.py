"""`report.html` of an evaluation, the gap benchmark or the scoreboard: tables, and plots of an evaluation."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from omnimj.studies.evaluation.study import EvaluationResult
from omnimj.studies.random_truth import NONE
from omnimj.studies.statistics import Table as TextTable
from omnimj.view.plots.evaluation import confusion_picture, delay_curves, headings, paths, with_and_without
from omnimj.view.report.evaluation_cases import case_sections, case_table
from omnimj.view.report.page import Figure, Table, plot, table, write_page


def write_evaluation_report(path: Path, result: EvaluationResult) -> None:
    """Write the report of an evaluation."""
    sections = case_sections(result.scores, result.events, result.suite)
    write_page(
        path,
        "evaluation",
        plain_text(result.heading),
        lines=list(map(plain_text, result.lines)),
        tables=_titled(result.tables),
        files="evaluation.json and cases/",
        figures=evaluation_figures(result),
        cases=case_table(result.scores, result.suite, sections) if result.scores else None,
        sections=sections,
    )


def write_tables_report(
    path: Path, heading: str, lines: Sequence[str], tables: Sequence[TextTable], files: str
) -> None:
    """Write the report of the gap benchmark or of the scoreboard, without empty tables.

    Args:
      path: HTML file to write.
      heading: Title of the page.
      lines: Paragraphs above the tables.
      tables: Tables of the study.
      files: Names of the files with all numbers.
    """
    write_page(
        path,
        "evaluation",
        heading,
        lines=list(map(plain_text, lines)),
        tables=_titled([one for one in tables if one.rows]),
        files=files,
        figures=[],
        cases=None,
        sections=[],
    )


def _titled(tables: Sequence[TextTable]) -> list[tuple[str, Table]]:
    return [(plain_text(one.title), table(one.rows, one.head)) for one in tables]


def plain_text(line: str) -> str:
    """Remove the marks of Markdown from a line."""
    return line.replace("**", "").replace("`", "")


def evaluation_figures(result: EvaluationResult) -> list[list[Figure]]:
    """Return rows of figures: confusion matrix, delays, excursions."""
    if not result.scores:
        return []
    words = "rows: truth; shades: share of its cases; numbers: cases; green boxes: correct diagnoses"
    drawing = confusion_picture(result.summary.confusion)
    rows = [[plot(drawing, "confusion", "Confusion matrix", words, "broad")]]
    faulty = [score for score in result.scores if score.fault != NONE]
    if any(score.was_in_use for score in faulty):
        words = "share of cases with an alarm within that time"
        rows.append(
            [
                plot(delay_curves(faulty, in_use), f"delay-{in_use:d}", f"Delay since {since}", words)
                for in_use, since in ((False, "onset"), (True, "first use"))
            ]
        )
    if any(score.heading_off is not None for score in faulty):
        words = "below the dashed line recovery helps"
        rows.append(
            [
                plot(
                    with_and_without(faulty, excursion, f"{name} excursion [{unit}]"),
                    name,
                    f"{name.capitalize()} excursion",
                    words,
                )
                for excursion, name, unit in ((headings, "heading", "°"), (paths, "path", "m"))
            ]
        )
    return rows
