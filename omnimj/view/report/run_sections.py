"""Parts of a page about single runs: a search field finds them, their plots are loaded when they are opened.

A row of a table that belongs to a run is found together with the part of the run.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Collection, Sequence
from dataclasses import dataclass

from omnimj.view.report.page import Cell, Figure, Table, table

FEW_RUNS = 3
"""Number of runs up to which a page has no search field."""
MOST_FIGURES = 40
"""Largest number of runs with plots, which keeps the page small enough for a browser."""


@dataclass(frozen=True)
class RunSection:
    """Part of the page about one run."""

    name: str
    key: str
    """Anchor of the section."""
    note: str
    """Words beside the name, readable while the section is closed."""
    is_open: bool
    """True if the section is open from the beginning."""
    lines: Sequence[str]
    table: Table | None
    figures: Sequence[Figure]


def run_key(name: str) -> str:
    """Return the anchor of the section of a run."""
    return "run-" + "".join(c if c.isascii() and c.isalnum() else f"-{ord(c):x}-" for c in name)


def make_section(
    name: str,
    figures: Sequence[Figure],
    note: str = "",
    lines: Sequence[str] = (),
    found: Table | None = None,
    is_open: bool = False,
) -> RunSection:
    """Make the part of the page about one run, whose plots are loaded when it is opened.

    Args:
      name: Name of the run, unique within the page.
      figures: Plots of the run.
      note: Words beside the name.
      lines: Paragraphs.
      found: Table above them.
      is_open: True to open the section from the beginning; the first section of a page is always open.
    """
    key = run_key(name)
    grouped = [dataclasses.replace(figure, group=key) for figure in figures]
    return RunSection(name, key, note, is_open, lines, found, grouped)


def run_table(
    rows: Sequence[tuple[str, Sequence[Cell | object]]],
    head: Sequence[str],
    sections: Collection[RunSection],
) -> Table:
    """Make a table of runs, whose rows are found by the search field.

    Args:
      rows: Name of a run, which links to its section if there is one, and the other cells of the row.
      head: Column headings.
      sections: Sections of the page.
    """
    linked = {section.key for section in sections}
    keys = [run_key(name) for name, _ in rows]
    cells = [
        (Cell(name, link=key if key in linked else ""), *others)
        for key, (name, others) in zip(keys, rows, strict=True)
    ]
    return dataclasses.replace(table(cells, head), keys=keys)
