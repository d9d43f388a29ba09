"""The part of a run's report that sets several methods side by side."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from omnimj.parameters import Rig
from omnimj.signals import Trace
from omnimj.view import page, plots_compared
from omnimj.view.compared import compare, runs_by_method
from omnimj.view.drawing import svg
from omnimj.view.wording import Described, Span

HEADING = "With other methods"
STYLE = """
table.compared { margin-bottom: 1.1rem; }
@media (max-width: 520px) { table.compared { font-size: .86rem; }
  table.compared th, table.compared td { padding-right: .5rem; }
  table.compared td, table.compared tbody th { overflow-wrap: anywhere; }
  table.compared tbody th { width: 26%; } }
"""


def compared_section(
    trace: Trace,
    others: Mapping[str, Trace],
    scenario: Described,
    metrics: Mapping[str, Any],
    spans: Sequence[Span],
) -> str:
    """Table and overlaid plots; empty for a run that has none beside it.

    Args:
      trace: Of the run that was asked for.
      others: Of those beside it, by method.
      scenario: What was asked for.
      metrics: Content of `metrics.json`; `compared` holds those of the others.
      spans: When faults held in the run that was asked for.
    """
    runs = runs_by_method(metrics)
    if not runs:
        return ""
    comparison = compare(scenario.metric_units, metrics)
    head = "".join(f"<th scope='col'>{page.text(words)}</th>" for words in ("", *comparison.methods))
    rows = "".join(
        f"<tr><th scope='row'>{page.text(name)}</th>{''.join(page.cell(t, 'number') for t in texts)}</tr>"
        for name, *texts in comparison.rows
    )
    table = f"<table class='compared'><thead><tr>{head}</tr></thead><tbody>{rows}</tbody></table>"
    words = f"Same scenario, same seed. The rest of this page is about the method {metrics['method']}."
    content = f"<p>{page.text(words)}</p><div class='wide'>{table}</div>"
    return page.section(
        HEADING, content + _figures({str(metrics["method"]): trace, **others}, scenario, spans)
    )


def _figures(traces: Mapping[str, Trace], scenario: Described, spans: Sequence[Span]) -> str:
    if isinstance(scenario.constants, Rig):
        words = "The rig is driven with given currents: no method changes how it moves."
        return f"<p>{page.text(words)}</p>"
    first = next(iter(traces.values()))
    shaded = f" Shaded: a fault holds in the run with {next(iter(traces))}." if spans else ""
    drawn = []
    if "heading" in first or "yaw" in first:
        words = f"How far from the plan, and how fast.{shaded}"
        drawn.append(("courses", "Courses", words, plots_compared.courses(traces, spans)))
    if "x" in first:
        words = "From above; squares: where each run ended."
        drawn.append(("paths", "Paths", words, plots_compared.paths(traces, scenario.patches)))
    figures = "".join(
        page.figure(svg(figure, f"compared-{name}", page.text(heading)), heading, words)
        for name, heading, words, figure in drawn
    )
    return f"<div class='columns plots'>{figures}</div>" if figures else ""
