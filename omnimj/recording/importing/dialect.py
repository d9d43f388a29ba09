"""Dialect of a CSV file: separator, decimal sign, and which lines are names, units and data."""

from __future__ import annotations

import csv
import re
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, replace

from omnimj.errors import InputError
from omnimj.recording.importing.units import find_unit

SPACES = "spaces"
"""Name of the separator of columns that are aligned by spaces or tabulators."""
SEPARATORS = (",", ";", "\t", "|", SPACES)
DECIMALS = (".", ",")
_SAMPLE = 200  # lines from which the dialect is found
_NUMERIC = 0.8  # share of a column's cells, and of a row's columns, that are numbers in data
_UNITS = 0.6  # share of a header line's cells that are units
_COMMENT = re.compile(r"^\s*(#|%|//)\s*")
_END = r"(e[+-]?\d+)?|[+-]?(nan|inf)"
_NUMBERS = {
    ".": re.compile(rf"[+-]?(\d+(\.\d*)?|\.\d+){_END}", re.IGNORECASE),
    ",": re.compile(rf"[+-]?(\d+(,\d+)?|,\d+){_END}", re.IGNORECASE),
}
_VALUE = re.compile(r"(\d{4}-\d\d-\d\d)?[T ]?\d\d:\d\d(:\d\d[\d.+:Z-]*)?|true|false|yes|no", re.IGNORECASE)
"""Moments and truth values, which are values as numbers are."""


@dataclass(frozen=True)
class Dialect:
    """Format of a CSV file. Lines are counted from 1; 0 stands for a line that the file does not have.

    None: not known yet.
    """

    separator: str | None = None
    """One of `SEPARATORS`."""
    decimal: str | None = None
    """`.` or `,`."""
    names_line: int | None = None
    """Line with the names of the columns."""
    units_line: int | None = None
    words_line: int | None = None
    """Line with descriptions."""
    first_line: int | None = None
    """First line of the data."""

    def describe(self) -> str:
        """Describe the dialect in words."""
        names = {",": "comma", ";": "semicolon", "\t": "tabulator", "|": "bar", SPACES: "spaces"}
        lines = [
            f"{what} in line {line}"
            for what, line in (
                ("descriptions", self.words_line),
                ("units", self.units_line),
                ("names", self.names_line),
            )
            if line
        ]
        decimal = "decimal comma" if self.decimal == "," else "decimal point"
        header = ", ".join(lines) or "no header"
        return f"CSV, {names[str(self.separator)]}, {decimal}, {header}, data from line {self.first_line}"


def split_line(line: str, separator: str) -> list[str]:
    """Split a line into stripped cells, without a mark of comments before it."""
    plain = _COMMENT.sub("", line)
    if separator == SPACES:
        return plain.split()
    if '"' not in plain:
        return [cell.strip() for cell in plain.split(separator)]
    try:
        return [cell.strip() for cell in next(csv.reader([plain], delimiter=separator), [])]
    except csv.Error:
        return []


def is_comment(line: str) -> bool:
    """True for an empty line and for one that begins with `#`, `%` or `//`."""
    return not line.strip() or _COMMENT.match(line) is not None


def is_number(cell: str, decimal: str) -> bool:
    """True if a cell holds a number with this decimal sign."""
    return _NUMBERS[decimal].fullmatch(cell) is not None


def find_dialect(place: object, lines: Sequence[str], given: Dialect | None = None) -> Dialect:
    """Find the dialect of a file by its first lines.

    Raises:
      InputError: No separator gives rows of numbers, or a given line does not exist.
    """
    known = given or Dialect()
    _require_lines(place, known, len(lines))
    sample = lines[: _SAMPLE + (known.first_line or 0)]
    choices = [
        (separator, decimal)
        for separator in ([known.separator] if known.separator else SEPARATORS)
        for decimal in ([known.decimal] if known.decimal else DECIMALS)
        if separator != decimal
    ]
    scored = [(*_score(sample, s, d, known.first_line), s, d) for s, d in choices]
    share, _, separator, decimal = max(scored, key=lambda one: (round(one[0], 1), one[1], one[0]))
    if share <= 0.0:
        rule = "a table of numbers with columns separated by , ; tabulator | or spaces is needed"
        raise InputError(place, "has no rows of numbers", rule)
    found = replace(known, separator=separator, decimal=decimal)
    first = known.first_line or _first_line(sample, separator, decimal)
    return _with_header(replace(found, first_line=first), sample)


def _require_lines(place: object, given: Dialect, count: int) -> None:
    for name in ("names_line", "units_line", "words_line", "first_line"):
        line = getattr(given, name)
        if line is not None and line > count:
            raise InputError(f"{place}: csv.{name}", f"found {line}", f"the file has {count} lines")


def _data(sample: Sequence[str], separator: str, first: int | None) -> list[tuple[int, list[str]]]:
    """Line numbers and cells of the lines that have the usual number of cells."""
    start = (first or 1) - 1
    rows = [
        (k + 1, split_line(line, separator))
        for k, line in enumerate(sample)
        if k >= start and not is_comment(line)
    ]
    if not rows:
        return []
    (count, _), *_ = Counter(len(cells) for _, cells in rows).most_common(1)
    return [row for row in rows if len(row[1]) == count]


def _score(sample: Sequence[str], separator: str, decimal: str, first: int | None) -> tuple[float, int]:
    """Share of numbers in the cells of the data, and the number of columns; (0, 0) without data."""
    rows = _data(sample, separator, first)
    late = [cells for _, cells in rows[len(rows) // 2 :]]
    filled = [cell for cells in late for cell in cells if cell]
    if not filled:
        return 0.0, 0
    lines = sum(not is_comment(line) for line in sample)
    good = sum(is_number(cell, decimal) or _VALUE.fullmatch(cell) is not None for cell in filled)
    return good / len(filled) * len(rows) / lines, len(late[0])


def _first_line(sample: Sequence[str], separator: str, decimal: str) -> int:
    """First line whose cells are numbers wherever the later ones are."""
    rows = _data(sample, separator, None)
    late = [cells for _, cells in rows[len(rows) // 2 :]]
    numeric = [
        k
        for k in range(len(late[0]))
        if sum(is_number(cells[k], decimal) or not cells[k] for cells in late) >= _NUMERIC * len(late)
        and any(cells[k] for cells in late)
    ]
    for number, cells in rows:
        good = sum(is_number(cells[k], decimal) or not cells[k] for k in numeric)
        if numeric and good >= _NUMERIC * len(numeric) and any(cells[k] for k in numeric):
            return number
    return rows[0][0]


def _with_header(dialect: Dialect, sample: Sequence[str]) -> Dialect:
    """Find the header lines above the data: as many cells as the data, or all but an empty last one."""
    separator, first = str(dialect.separator), int(dialect.first_line or 1)
    width = len(_without_end(split_line(sample[first - 1], separator)))
    header = {
        k + 1: _without_end(split_line(sample[k], separator))
        for k in range(first - 1)
        if sample[k].strip() and abs(len(_without_end(split_line(sample[k], separator))) - width) <= 1
    }
    units, names, words = dialect.units_line, dialect.names_line, dialect.words_line
    taken = {line for line in (units, names, words) if line}
    free = {k: cells for k, cells in header.items() if k not in taken}
    if units is None:
        units = _units_line(free, bool(names))
        free.pop(units, None)
    if names is None:
        distinct = [k for k, cells in free.items() if len(set(cells)) == len(cells)]
        names = max(distinct or free, default=0)
        free.pop(names, None)
    if words is None:
        words = min(free, default=0)
    return replace(dialect, units_line=units, names_line=names, words_line=words)


def _units_line(header: dict[int, list[str]], has_names: bool) -> int:
    """Line of the units; 0 where there is none, or where it would be the only header line."""
    if len(header) < (1 if has_names else 2):
        return 0
    shares = {
        k: sum(find_unit(cell.strip("[]()")) is not None for cell in cells if cell)
        / max(sum(bool(cell) for cell in cells), 1)
        for k, cells in header.items()
    }
    best = max(shares, key=lambda k: shares[k])
    return best if shares[best] >= _UNITS else 0


def _without_end(cells: list[str]) -> list[str]:
    """Cells without an empty last one, which a separator at the end of the line leaves."""
    return cells[:-1] if cells and not cells[-1] else cells
