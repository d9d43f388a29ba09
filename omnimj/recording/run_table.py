"""Tables of runs in CSV and Parquet files, under the column names of the logger."""

from __future__ import annotations

import contextlib
import csv
import math
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import islice
from pathlib import Path
from typing import TextIO

import numpy as np
import pyarrow as pa
import pyarrow.compute
import pyarrow.csv
import pyarrow.parquet as pq

from omnimj.errors import InputError
from omnimj.signals import Array

TABLE_SUFFIXES = (".csv", ".parquet")
"""Suffixes of files that hold a run."""
MAX_NUMBERS = 500_000_000
"""Limit on the numbers of one run, 4 GB: a damaged or hostile file can claim any number of rows."""

_NUMBER_NEEDED = "a finite number is needed"


@dataclass(frozen=True)
class RunTable:
    """Numeric columns of one file."""

    names: tuple[str, ...]
    """All column names, in the file's order."""
    numbers: Mapping[str, Array]
    """Columns that hold numbers, each shape (n,); empty cells of columns that are not needed are NaN."""
    row_of: Callable[[int], int]
    """Function from the index of a sample to the row in its file, counted as in `read_run_table`."""


def read_run_table(path: Path, needed: Collection[str]) -> RunTable:
    """Read a CSV or Parquet file.

    Messages count rows from 1: in CSV the header is row 1, and empty lines count; in Parquet, which has no
    header, the first sample is row 1.

    Args:
      path: File with a suffix of `TABLE_SUFFIXES`.
      needed: Columns that must hold finite numbers if present. Any other column may hold anything; it is in
        `numbers` if it holds numbers.

    Raises:
      InputError: The file cannot be read, or a needed column holds anything other than finite numbers; the
        message names file, row and column.
    """
    if path.suffix.lower() == ".csv":
        return _read_csv(path, needed)
    return _read_parquet(path, needed)


def read_column_names(path: Path) -> tuple[str, ...]:
    """Read the column names of a CSV or Parquet file.

    Raises:
      InputError: The file cannot be read, has no names, or one twice.
    """
    if path.suffix.lower() == ".csv":
        return _header(path)[0]
    with open_parquet(path) as file:
        return _checked_names(path, file.schema_arrow.names)


@contextlib.contextmanager
def open_parquet(path: Path) -> Iterator[pq.ParquetFile]:
    """Open a Parquet file whose checksums are verified.

    It is not opened as an Arrow dataset: a folder name such as `seed=1` must not become a column.

    Raises:
      InputError: The file cannot be read or is damaged, also where that is found within the context.
    """
    try:
        with pq.ParquetFile(path, page_checksum_verification=True) as file:
            yield file
    except (pa.ArrowException, OSError, UnicodeDecodeError, OverflowError) as error:
        raise InputError(path, "is not a whole Parquet file", " ".join(str(error).split())[:200]) from None


def _checked_names(path: Path, names: Sequence[str]) -> tuple[str, ...]:
    """Strip column names of spaces; keep empty names, which result from a trailing comma."""
    stripped = tuple(name.strip() for name in names)
    seen: set[str] = set()
    for name in stripped:
        if name and name in seen:
            raise InputError(
                f"{path}: row 1" if path.suffix.lower() == ".csv" else path, f"has column {name!r} twice"
            )
        seen.add(name)
    if not any(stripped):
        raise InputError(path, "has no column names", "the first row is the header")
    return stripped


def first_not_finite(columns: Mapping[str, Array]) -> tuple[int, str] | None:
    """Find the first sample that is not finite and its column; None if all are finite.

    Args:
      columns: Columns by name, each shape (n,).

    Returns:
      Index of the earliest such sample, and name of the first column with one there.
    """
    found = []
    for order, (name, values) in enumerate(columns.items()):
        broken = ~np.isfinite(values)
        if broken.any():
            found.append((int(np.argmax(broken)), order, name))
    if not found:
        return None
    sample, _, name = min(found)
    return sample, name


def printable(name: str) -> str:
    """Make a column name printable in one line; a damaged file may hold any name."""
    return name if name.isprintable() else repr(name)


def _read_csv(path: Path, needed: Collection[str]) -> RunTable:
    """Read a comma-separated file with a header row, any line endings and an optional byte order mark.

    An irregular file is read again cell by cell, to report the place of the error.
    """
    names, header_lines = _header(path)
    needed = [name for name in names if name in needed]
    numbers = _read_fast(path, names, header_lines, needed)
    if numbers is None:
        numbers = _read_by_cell(path, names, header_lines, needed)
    return RunTable(names, numbers, lambda sample: _row_of(path, header_lines, sample))


def _text_of(path: Path) -> TextIO:
    """Open the file as text; bytes that are not UTF-8 become surrogates, harmless in unused columns."""
    return path.open(encoding="utf-8-sig", errors="surrogateescape", newline="")


def _header(path: Path) -> tuple[tuple[str, ...], int]:
    """Read the header; return the column names and the number of its lines."""
    try:
        with _text_of(path) as lines:
            reader = csv.reader(lines)
            record = next(reader, None)
    except csv.Error as error:
        raise InputError(f"{path}: row 1", f"is not a header ({error})") from None
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
    return _checked_names(path, record), reader.line_num


def _read_fast(
    path: Path, names: Sequence[str], header_lines: int, needed: Collection[str]
) -> dict[str, Array] | None:
    """Read the numbers by column; None if anything in the file is irregular."""
    keys = [f"{k}" for k in range(len(names))]
    # other columns are read as text, since only their last cell shows whether all are numbers
    kinds = {
        key: pa.float64() if name in needed else pa.string() for key, name in zip(keys, names, strict=True)
    }
    try:
        table = pa.csv.read_csv(
            path,
            pa.csv.ReadOptions(column_names=keys, skip_rows=header_lines),
            convert_options=pa.csv.ConvertOptions(column_types=kinds, null_values=[""], check_utf8=False),
        )
        if table.num_rows * len(names) > MAX_NUMBERS:
            raise InputError(path, f"has {table.num_rows} rows", f"at most {MAX_NUMBERS} numbers are read")
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
    """Convert a column of text to numbers, NaN for empty cells; None if it holds anything else."""
    try:
        text = pa.compute.utf8_trim_whitespace(column)
        empty = pa.compute.equal(text, "")
        found = pa.compute.if_else(empty, None, text).cast(pa.float64())
    except (pa.ArrowException, UnicodeDecodeError):
        return None
    return None if found.null_count == len(found) else np.array(found.to_numpy(), dtype=float)


def _records(path: Path, header_lines: int) -> Iterator[tuple[int, list[str]]]:
    """Yield row number (1 for the header) and cells of every record, without empty lines."""
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


def _read_by_cell(
    path: Path, names: Sequence[str], header_lines: int, needed: Collection[str]
) -> dict[str, Array]:
    """Read the numbers by column, cell by cell."""
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
    # Python also accepts 1_000 and digits of other alphabets
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


def _read_parquet(path: Path, needed: Collection[str]) -> RunTable:
    """Read a Parquet file."""
    with open_parquet(path) as file:
        schema, rows = file.schema_arrow, file.metadata.num_rows
        names = _checked_names(path, schema.names)
        if rows * len(names) > MAX_NUMBERS:
            raise InputError(path, f"claims {rows} rows", f"at most {MAX_NUMBERS} numbers are read")
        chosen = [
            k for k, name in enumerate(names) if name in needed or (name and _is_number(schema.types[k]))
        ]
        for k in chosen:
            if not _is_number(schema.types[k]):
                found = f"column {names[k]!r} holds {schema.types[k]}"
                raise InputError(path, found, "every column of the plant holds numbers")
        table = file.read(columns=[schema.names[k] for k in chosen])
        numbers = {table.column_names[k].strip(): _array(table.column(k)) for k in range(table.num_columns)}
    broken = first_not_finite({name: values for name, values in numbers.items() if name in needed})
    if broken is not None:
        sample, name = broken
        place = f"{path}: row {sample + 1}, column {name!r}"
        empty = not table.column(table.column_names.index(_raw(table, name)))[sample].is_valid
        found = "found an empty cell" if empty else f"found {numbers[name][sample]}"
        raise InputError(place, found, "a finite number is needed")
    return RunTable(names, numbers, lambda sample: sample + 1)


def _raw(table: pa.Table, name: str) -> str:
    return next(raw for raw in table.column_names if raw.strip() == name)


def _is_number(kind: pa.DataType) -> bool:
    return pa.types.is_floating(kind) or pa.types.is_integer(kind) or pa.types.is_decimal(kind)


def _array(column: pa.ChunkedArray) -> Array:
    """Return the numbers of a column, NaN where there is no value, shape (n,)."""
    if pa.types.is_decimal(column.type):
        column = column.cast(pa.float64())
    return np.array(column.to_numpy(), dtype=float)


def write_parquet(
    path: Path, columns: Mapping[str, Array], metadata: Mapping[bytes, bytes] | None = None
) -> None:
    """Write columns of doubles to a Parquet file with checksums; all bits are kept.

    Args:
      path: File to write; overwritten if it exists.
      columns: Columns by name, each shape (n,).
      metadata: Entries of the schema's metadata.

    Raises:
      OSError: The file cannot be written.
    """
    arrays = [pa.array(np.asarray(values, float)) for values in columns.values()]
    table = pa.table(arrays, names=list(columns)).replace_schema_metadata(metadata)
    pq.write_table(
        table,
        path,
        compression="zstd",
        use_dictionary=False,
        use_byte_stream_split=True,  # transposed bytes of similar doubles compress well, dictionaries do not
        write_page_checksum=True,
    )
