"""Numbers of many trials as tables for people."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from omnimj.trials.rates import Rate


@dataclass(frozen=True)
class Table:
    """A heading and ready cells."""

    title: str
    head: tuple[str, ...]
    rows: tuple[tuple[str, ...], ...]


def percent(found: Rate) -> str:
    """`93 % (84–97, n 60)`."""
    if found.value is None:
        return "–"
    return f"{100 * found.value:.0f} % ({100 * found.low:.0f}–{100 * found.high:.0f}, n {found.count})"


def number(value: float | None) -> str:
    """Three digits, or a dash."""
    return "–" if value is None else f"{value:.3g}"


def markdown(heading: str, lines: Sequence[str], found: Sequence[Table]) -> str:
    """A whole file: heading, what the numbers are of, tables."""
    parts = [f"# {heading}", *lines]
    for table in found:
        rows = [table.head, tuple("---" for _ in table.head), *table.rows]
        cells = "\n".join("| " + " | ".join(row) + " |" for row in rows)
        parts.append(f"## {table.title}\n\n{cells}")
    return "\n\n".join(parts) + "\n"
