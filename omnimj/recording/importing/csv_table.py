"""CSV files of any dialect as named columns."""

from __future__ import annotations

import codecs
import csv
import datetime
import io
import re
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc
import pyarrow.csv

from omnimj.errors import InputError
from omnimj.recording.importing.dialect import SPACES, Dialect, find_dialect, is_comment, split_line
from omnimj.recording.importing.tables import SourceColumn, SourceTable, require_size
from omnimj.recording.importing.units import split_unit
from omnimj.recording.run_table import printable
from omnimj.signals import Array

_NOTHING = ("", "-", "null", "NULL", "none", "None", "NA", "N/A", "n/a")
_MARKS = (
    (codecs.BOM_UTF8, "utf-8-sig"),
    (codecs.BOM_UTF32_LE, "utf-32"),
    (codecs.BOM_UTF32_BE, "utf-32"),
    (codecs.BOM_UTF16_LE, "utf-16"),
    (codecs.BOM_UTF16_BE, "utf-16"),
)
_DAY = 86400.0  # [s]


def read_csv(path: Path, given: Dialect | None = None) -> SourceTable:
    """Read a CSV file whose dialect is found by its content.

    Args:
      path: The file, in UTF-8, UTF-16 or a Western 8-bit encoding.
      given: What is known of the dialect.

    Raises:
      InputError: The file is no table of numbers, or a row has another number of cells.
    """
    lines = _lines(path)
    dialect = find_dialect(path, lines, given)
    separator, first = str(dialect.separator), int(dialect.first_line or 1)
    rows = [k for k in range(first - 1, len(lines)) if not is_comment(lines[k])]
    width = len(split_line(lines[rows[0]], separator))
    rows, notes = _whole_rows(path, lines, rows, separator, width)
    require_size(path, len(rows), width)
    body = "\n".join(_one_spaced(lines[k]) if separator == SPACES else lines[k] for k in rows)
    table = _parsed(path, body, width, "," if separator == SPACES else separator)
    names, more = _names(lines, dialect, width)
    notes += more
    columns: dict[str, SourceColumn] = {}
    others: dict[str, str] = {}
    for key, (name, unit, words) in enumerate(names):
        found, kind = _converted(table.column(key), str(dialect.decimal), rows)
        if found is not None:
            unit = kind or unit
            columns[name] = SourceColumn(name, found, unit, words)
        elif name:
            others[name] = kind
    columns.pop("", None)
    return SourceTable(
        path, columns, dialect.describe(), others, {}, tuple(notes), lambda sample: f"row {rows[sample] + 1}"
    )


def _lines(path: Path) -> list[str]:
    """Lines of a text file."""
    content = path.read_bytes()
    encoding = next((name for mark, name in _MARKS if content.startswith(mark)), "utf-8")
    try:
        text = content.decode(encoding)
    except UnicodeDecodeError as error:
        if encoding != "utf-8":
            raise InputError(path, f"is not {encoding} text, at byte {error.start}") from None
        text = content.decode("latin-1")
    if "\0" in text:
        raise InputError(path, "is not a text file", f"it has a zero byte at {text.index(chr(0))}")
    return re.split(r"\r\n|\r|\n", text)


def _one_spaced(line: str) -> str:
    return ",".join(f'"{cell}"' if "," in cell else cell for cell in line.split())


def _whole_rows(
    path: Path, lines: Sequence[str], rows: list[int], separator: str, width: int
) -> tuple[list[int], list[str]]:
    """Check that every row has all its cells; leave out a last row that is cut off."""
    for place, k in enumerate(rows):
        line = lines[k]
        if '"' in line or separator == SPACES:
            cells = len(split_line(line, separator))
        else:
            cells = line.count(separator) + 1
        if cells == width:
            continue
        if place == len(rows) - 1 and place > 0:
            return rows[:-1], [f"row {k + 1}, the last one, is cut off and left out"]
        raise InputError(f"{path}: row {k + 1}", f"has {cells} cells", f"the rows above have {width}")
    return rows, []


def _parsed(path: Path, body: str, width: int, delimiter: str) -> pa.Table:
    keys = [f"{k}" for k in range(width)]
    try:
        return pa.csv.read_csv(
            io.BytesIO(body.encode("utf-8", "replace")),
            pa.csv.ReadOptions(column_names=keys),
            pa.csv.ParseOptions(delimiter=delimiter),
            pa.csv.ConvertOptions(column_types=dict.fromkeys(keys, pa.string()), strings_can_be_null=False),
        )
    except (pa.ArrowException, csv.Error) as error:
        raise InputError(path, "cannot be read as CSV", " ".join(str(error).split())[:200]) from None


def _names(
    lines: Sequence[str], dialect: Dialect, width: int
) -> tuple[list[tuple[str, str, str]], list[str]]:
    """Name, unit and description of every column; names that occur twice are numbered."""

    def cells(line: int | None) -> list[str]:
        found = split_line(lines[line - 1], str(dialect.separator)) if line else []
        return [*found[:width], *[""] * (width - len(found))]

    found, notes = [], []
    seen: dict[str, int] = {}
    every = zip(cells(dialect.names_line), cells(dialect.units_line), cells(dialect.words_line), strict=True)
    for k, (full, unit, words) in enumerate(every):
        name, own = split_unit(full)
        if not dialect.names_line:
            name = f"column_{k + 1}"
        if name in seen and name:
            seen[name] += 1
            notes.append(f"column {name!r} occurs again; it is called {name}_{seen[name]} here")
            name = f"{name}_{seen[name]}"
        seen.setdefault(name, 1)
        found.append((printable(name), unit.strip("[]() ") or own, words))
    return found, notes


def _converted(column: pa.ChunkedArray, decimal: str, rows: Sequence[int]) -> tuple[Array | None, str]:
    """Convert a column of text to numbers.

    Returns:
      The numbers and the unit that follows from their form; or None and the reason.
    """
    text = pc.utf8_trim_whitespace(column)
    nothing = pc.is_in(text, value_set=pa.array(_NOTHING))
    text = pc.if_else(nothing, pa.scalar(None, pa.string()), text)
    if text.null_count == len(text):
        return None, "empty"
    plain = pc.replace_substring_regex(text, r"^\+", "")
    if decimal == ",":
        plain = pc.replace_substring(plain, ",", ".")
    try:
        return np.array(plain.cast(pa.float64()).to_numpy(), dtype=float), ""
    except pa.ArrowException:
        pass
    texts = text.to_pylist()
    for convert, unit in ((_from_truth, "1"), (_from_moments, "s")):
        found = convert(texts)
        if found is not None:
            return found, unit
    return None, _text_reason(texts, decimal, rows)


def _text_reason(texts: Sequence[str | None], decimal: str, rows: Sequence[int]) -> str:
    """Describe where a column holds text; one cell in a column of numbers is named by its row."""
    from omnimj.recording.importing.dialect import is_number

    wrong = [k for k, cell in enumerate(texts) if cell is not None and not is_number(cell, decimal)]
    if not wrong:
        return "text"
    return f"text, {str(texts[wrong[0]])[:20]!r} in row {rows[wrong[0]] + 1}"


def _from_truth(texts: Sequence[str | None]) -> Array | None:
    values = {"true": 1.0, "false": 0.0, "yes": 1.0, "no": 0.0, "on": 1.0, "off": 0.0}
    found = [np.nan if cell is None else values.get(cell.lower()) for cell in texts]
    return None if any(value is None for value in found) else np.array(found, dtype=float)


def _from_moments(texts: Sequence[str | None]) -> Array | None:
    """Dates with times, or times of the day, as seconds since the first one; midnight may pass."""
    try:
        moments = [None if cell is None else datetime.datetime.fromisoformat(cell) for cell in texts]
        first = next(moment for moment in moments if moment is not None)
        return np.array([np.nan if m is None else (m - first).total_seconds() for m in moments])
    except (ValueError, TypeError, OverflowError):
        pass
    try:
        times = [None if cell is None else datetime.time.fromisoformat(cell) for cell in texts]
    except ValueError:
        return None
    seconds = np.array(
        [
            np.nan if t is None else t.hour * 3600.0 + t.minute * 60.0 + t.second + t.microsecond * 1e-6
            for t in times
        ]
    )
    steps = np.diff(seconds, prepend=seconds[:1])
    days = np.cumsum(np.nan_to_num(steps) < -0.5 * _DAY)
    return np.asarray(seconds + _DAY * days, dtype=float)
