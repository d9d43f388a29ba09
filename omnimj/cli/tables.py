"""Plain-text tables, for eyes and for pipes."""

from __future__ import annotations

from collections.abc import Sequence


def table(header: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    """Left-aligned columns two spaces apart, without a space at the ends of lines."""
    lines = [list(header), *(list(row) for row in rows)]
    widths = [max(len(line[k]) for line in lines) for k in range(len(header))]
    return "\n".join(
        "  ".join(cell.ljust(width) for cell, width in zip(line, widths, strict=True)).rstrip()
        for line in lines
    )


def shown(value: float | None, unit: str = "") -> str:
    """A number in four digits with its unit; a dash where there is none."""
    return "–" if value is None else f"{value:.4g} {unit}".rstrip()
