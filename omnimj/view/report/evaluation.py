"""`report.html` of an evaluation or of the gap benchmark: tables, and plots of the evaluation."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from omnimj.studies.evaluation.study import EvaluationResult
from omnimj.studies.random_truth import NONE
from omnimj.studies.statistics import Table
from omnimj.view.plots.evaluation import confusion_picture, delay_curves, headings, paths, with_and_without
from omnimj.view.report.page import Figure, plot, table, write_page


def write_evaluation_report(path: Path, result: EvaluationResult) -> None:
    """Write the report of an evaluation.

    Args:
      path: HTML file to write.
      result: Result of the evaluation.
    """
    files = "evaluation.json and cases/"
    _write_tables(path, result.heading, result.lines, result.tables, files, _figures(result))


def write_benchmark_report(path: Path, lines: Sequence[str], tables: Sequence[Table]) -> None:
    """Write the report of the gap benchmark.

    Args:
      path: HTML file to write.
      lines: Sentences about the benchmark.
      tables: Tables of `benchmark.md`; empty ones are left out.
    """
    filled = [one for one in tables if one.rows]
    _write_tables(path, "Blind benchmark of the gap workflow", lines, filled, "benchmark.json", [])


def _write_tables(
    path: Path,
    heading: str,
    lines: Sequence[str],
    tables: Sequence[Table],
    files: str,
    figures: Sequence[Sequence[Figure]],
) -> None:
    title, *plain = (line.replace("**", "").replace("`", "") for line in (heading, *lines))
    write_page(
        path,
        "evaluation",
        title,
        lines=plain,
        tables=[(one.title.replace("`", ""), table(one.rows, one.head)) for one in tables],
        files=files,
        figures=figures,
    )


def _figures(result: EvaluationResult) -> list[list[Figure]]:
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
