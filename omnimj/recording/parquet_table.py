"""Parquet files of any writer, whole or damaged."""

from __future__ import annotations

from collections.abc import Collection
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

from omnimj.errors import InputError
from omnimj.recording.run_table import MOST_NUMBERS, RunTable, checked_names, first_not_finite
from omnimj.signals import Array


def read_parquet(path: Path, needed: Collection[str]) -> RunTable:
    """Reads a Parquet file.

    Raises:
      InputError: As `read_run_table`.
    """
    try:
        # not a data set of Arrow's: a folder's name such as `seed=1` must not become a column
        with pq.ParquetFile(path, page_checksum_verification=True) as file:
            schema, rows = file.schema_arrow, file.metadata.num_rows
            names = checked_names(path, schema.names)
            if rows * len(names) > MOST_NUMBERS:
                raise InputError(path, f"claims {rows} rows", f"at most {MOST_NUMBERS} numbers are read")
            asked = [
                k for k, name in enumerate(names) if name in needed or (name and _is_number(schema.types[k]))
            ]
            for k in asked:
                if not _is_number(schema.types[k]):
                    found = f"column {names[k]!r} holds {schema.types[k]}"
                    raise InputError(path, found, "every column of the plant holds numbers")
            table = file.read(columns=[schema.names[k] for k in asked])
            numbers = {
                table.column_names[k].strip(): _array(table.column(k)) for k in range(table.num_columns)
            }
    except (pa.ArrowException, OSError, UnicodeDecodeError, OverflowError) as error:
        reason = " ".join(str(error).split())
        raise InputError(path, "is not a whole Parquet file", reason[:200]) from None
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
    """Shape (n,), NaN where there is no value."""
    if pa.types.is_decimal(column.type):
        column = column.cast(pa.float64())
    return np.array(column.to_numpy(), dtype=float)
