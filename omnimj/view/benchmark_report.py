"""`report.html` of the blind benchmark: its tables on one page that works offline."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import omnimj
from omnimj.trials.tables import Table
from omnimj.view import page

_HEADING = "Blind benchmark of the gap workflow"
_STYLE = "td:first-child { font-weight: 600; } td { font-variant-numeric: tabular-nums; }"


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
