"""CSV: the quick way for good files, and a patient one that says where a bad file is bad."""

from __future__ import annotations

import csv
import math
from collections.abc import Collection, Iterator, Sequence
from itertools import islice
from pathlib import Path
from typing import TextIO

import numpy as np
import pyarrow as pa
import pyarrow.compute
import pyarrow.csv

from omnimj.errors import InputError
from omnimj.recording.run_table import MOST_NUMBERS, RunTable, checked_names
from omnimj.signals import Array

_NUMBER_NEEDED = "a finite number is needed"


def read_csv(path: Path, needed: Collection[str]) -> RunTable:
    """Reads a CSV file with a header row: commas, any line ends, a byte order mark or not.

    Raises:
      InputError: As `read_run_table`.
    """
    names, header_lines = _header(path)
    needed = [name for name in names if name in needed]
    numbers = _quick(path, names, header_lines, needed)
    if numbers is None:
        numbers = _patient(path, names, header_lines, needed)
    return RunTable(names, numbers, lambda sample: _row_of(path, header_lines, sample))


def _text_of(path: Path) -> TextIO:
    """The file as text. Bytes that are no UTF-8 come as surrogates: they may stand where nobody looks."""
    return path.open(encoding="utf-8-sig", errors="surrogateescape", newline="")


def _header(path: Path) -> tuple[tuple[str, ...], int]:
    """Column names, and the lines that they take."""
    try:
        with _text_of(path) as lines:
            reader = csv.reader(lines)
            record = next(reader, None)
    except csv.Error as error:
        raise InputError(f"{path}: row 1", f"is no header ({error})") from None
    except OSError as error:
        raise InputError(path, f"cannot be read ({error.strerror})") from None
    if not record:
        raise InputError(
            path, "has no header" if record is not None else "is empty", "the first row is the header"
        )
    if any("\udc80" <= letter <= "\udcff" for name in record for letter in name):
        raise InputError(f"{path}: row 1", "is not UTF-8 text", "save the file as CSV in UTF-8")
    if len(record) == 1 and (";" in record[0] or "\t" in record[0]):
        raise InputError(f"{path}: row 1", f"found {record[0]!r}", "columns are separated by commas")
    return checked_names(path, record), reader.line_num


def _quick(
    path: Path, names: Sequence[str], header_lines: int, needed: Collection[str]
) -> dict[str, Array] | None:
    """Numbers by column; None where anything at all is not as it should be."""
    keys = [f"{k}" for k in range(len(names))]
    # a column that nobody asked for is read as text, since whether it holds numbers shows at its end
    kinds = {
        key: pa.float64() if name in needed else pa.string() for key, name in zip(keys, names, strict=True)
    }
    try:
        table = pa.csv.read_csv(
            path,
            pa.csv.ReadOptions(column_names=keys, skip_rows=header_lines),
            convert_options=pa.csv.ConvertOptions(column_types=kinds, null_values=[""], check_utf8=False),
        )
        if table.num_rows * len(names) > MOST_NUMBERS:
            raise InputError(path, f"has {table.num_rows} rows", f"at most {MOST_NUMBERS} numbers are read")
        numbers = {}
        for key, name in zip(keys, names, strict=True):
            column = table.column(key)
            if name in needed:
                values = np.array(column.to_numpy(), dtype=float)  # an empty cell becomes NaN
                if not np.isfinite(values).all():
                    return None
                numbers[name] = values
            elif name and (values := _numbers_of(column)) is not None:
                numbers[name] = values
    except (pa.ArrowException, UnicodeDecodeError):
        return None
    except OSError as error:
        raise InputError(path, f"cannot be read ({error.strerror or error})") from None
    return numbers


def _numbers_of(column: pa.ChunkedArray) -> Array | None:
    """A column of text as numbers, NaN for its empty cells; None if there is anything but numbers."""
    try:
        text = pa.compute.utf8_trim_whitespace(column)
        empty = pa.compute.equal(text, "")
        found = pa.compute.if_else(empty, None, text).cast(pa.float64())
    except (pa.ArrowException, UnicodeDecodeError):
        return None
    return None if found.null_count == len(found) else np.array(found.to_numpy(), dtype=float)


def _records(path: Path, header_lines: int) -> Iterator[tuple[int, list[str]]]:
    """Row, counted from the header's 1, and cells of every record that is not an empty line."""
    with _text_of(path) as lines:
        reader = csv.reader(lines)
        next(reader)
        row = header_lines + 1
        try:
            for record in reader:
                if len(record) > 1 or (record and record[0].strip()):
                    yield row, record
                row = reader.line_num + 1
        except csv.Error as error:
            raise InputError(f"{path}: row {row}", f"cannot be read ({error})") from None


def _row_of(path: Path, header_lines: int, sample: int) -> int:
    return next(islice((row for row, _ in _records(path, header_lines)), sample, None))


def _patient(
    path: Path, names: Sequence[str], header_lines: int, needed: Collection[str]
) -> dict[str, Array]:
    """Numbers by column, cell by cell.

    Raises:
      InputError: At the first row with too few or too many cells, or without a number where one is needed.
    """
    places = [(k, name) for k, name in enumerate(names) if name in needed]
    others: dict[int, str] = {k: name for k, name in enumerate(names) if name and name not in needed}
    found: dict[int, list[float]] = {k: [] for k, name in enumerate(names) if name}
    for row, record in _records(path, header_lines):
        if len(record) != len(names):
            cells = f"has {len(record)} cells" if len(record) != 1 else f"has the one cell {record[0]!r}"
            raise InputError(f"{path}: row {row}", cells, f"the header has {len(names)} columns")
        for k, name in places:
            found[k].append(_needed_number(path, row, name, record[k]))
        for k in list(others):
            number = _number(record[k]) if record[k].strip() else math.nan
            if number is None:
                del others[k], found[k]
            else:
                found[k].append(number)
    return {names[k]: np.array(values, dtype=float) for k, values in found.items()}


def _number(cell: str) -> float | None:
    # Python takes 1_000 and digits of other alphabets for numbers, a measured file does not
    if "_" in cell or not cell.isascii():
        return None
    try:
        return float(cell)
    except ValueError:
        return None


def _needed_number(path: Path, row: int, name: str, cell: str) -> float:
    number = _number(cell)
    if number is not None and math.isfinite(number):
        return number
    found = f"found {cell.strip()!r}" if cell.strip() else "found an empty cell"
    raise InputError(f"{path}: row {row}, column {name!r}", found, _NUMBER_NEEDED)
