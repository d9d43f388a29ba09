"""`report.html` of an evaluation: its tables and a few plots on one page that works offline."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import Path

import omnimj
from omnimj.studies.evaluation.study import EvaluationResult
from omnimj.studies.random_truth import NONE
from omnimj.studies.statistics import Table
from omnimj.view.plots.drawing import svg
from omnimj.view.plots.evaluation import confusion_picture, delay_curves, headings, paths, with_and_without
from omnimj.view.report import page

_STYLE = "td:first-child { font-weight: 600; } td { font-variant-numeric: tabular-nums; }"


def write_evaluation_report(path: Path, outcome: EvaluationResult) -> None:
    """Writes the report as one HTML file that needs nothing else.

    Args:
      path: The file to write.
      outcome: What was judged.
    """
    heading = outcome.heading.replace("`", "")
    lead, *rest = (page.text(line.replace("**", "").replace("`", "")) for line in outcome.lines)
    parts = [f"<h1>{page.text(heading)}</h1>", f"<p class='lead'>{lead}</p>"]
    parts += [f"<p>{line}</p>" for line in rest]
    parts += [_section(table) for table in outcome.tables]
    if outcome.scores:
        parts.append(page.section("In pictures", "".join(_figures(outcome))))
    words = f"omnimj {page.text(omnimj.__version__)}; all cases are in evaluation.json and cases/"
    parts.append(f"<footer>{words}</footer>")
    path.write_text(page.document(heading, "\n".join(parts), _STYLE), encoding="utf-8")


def _section(table: Table) -> str:
    rows = [[page.cell(words) for words in row] for row in table.rows]
    return page.section(table.title, page.table(rows, table.head))


def _figures(outcome: EvaluationResult) -> Iterator[str]:
    words = "rows are truths, shades their shares, numbers cases; the green boxes are right"
    picture = svg(confusion_picture(outcome.summary.confusion), "confusion", "confusion matrix")
    yield page.figure(page.broad(picture), "What was taken for what", words, "broad")
    broken = [s for s in outcome.scores if s.fault != NONE]
    if any(s.was_in_use for s in broken):
        yield "<div class='columns plots'>"
        for in_use, since in ((False, "since onset"), (True, "since first use")):
            picture = svg(delay_curves(broken, in_use), f"delay-{int(in_use)}", f"delays {since}")
            yield page.figure(picture, f"Delay {since}", "share of cases with an alarm within that time")
        yield "</div>"
    if any(s.heading_off is not None for s in broken):
        yield "<div class='columns plots'>"
        for of, name, unit in ((headings, "heading", "°"), (paths, "path", "m")):
            picture = svg(
                with_and_without(broken, of, f"{name} excursion [{unit}]"), name, f"{name} excursions"
            )
            yield page.figure(picture, f"Excursion of the {name}", "below the dashed line recovery helps")
        yield "</div>"


# `report.html` of the blind benchmark: its tables on one page that works offline.

_HEADING = "Blind benchmark of the gap workflow"


def write_benchmark_report(path: Path, lines: Sequence[str], tables: Sequence[Table]) -> None:
    """Writes the report as one HTML file that needs nothing else.

    Args:
      path: The file to write.
      lines: What the numbers are of.
      tables: As in `benchmark.md`.
    """
    lead, *rest = (page.text(line.replace("**", "")) for line in lines)
    parts = [f"<h1>{page.text(_HEADING)}</h1>", f"<p class='lead'>{lead}</p>"]
    parts += [f"<p>{line}</p>" for line in rest]
    for one in tables:
        if one.rows:
            rows = [[page.cell(words) for words in row] for row in one.rows]
            parts.append(page.section(one.title.replace("`", ""), page.table(rows, one.head)))
    parts.append(f"<footer>omnimj {page.text(omnimj.__version__)}; all cases are in benchmark.json</footer>")
    path.write_text(page.document(_HEADING, "\n".join(parts), _STYLE), encoding="utf-8")
