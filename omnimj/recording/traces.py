"""Trace files `trace.parquet`: signals of one run, a row per control step, with its description."""

from __future__ import annotations

import json
import zlib
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa

from omnimj.errors import InputError
from omnimj.recording.folder import atomic_file
from omnimj.recording.run_table import open_parquet, write_parquet
from omnimj.signals import Array, Trace

_ABOUT, _CHECKSUM = b"omnimj", b"omnimj-crc32"


def write_trace(path: Path, trace: Trace) -> None:
    """Write a trace, in full or not at all.

    Columns keep all bits, and `about` is stored as JSON in the metadata of the file. The columns have a
    checksum beside those of the pages, which exclude the headers that describe how to read a page.

    Raises:
      OutputError: The file cannot be written.
    """
    with atomic_file(path) as temporary:
        metadata = {_ABOUT: json.dumps(dict(trace.about)).encode(), _CHECKSUM: _checksum(trace.columns)}
        write_parquet(temporary, trace.columns, metadata)


def read_trace(path: Path) -> Trace:
    """Read a trace, bit for bit as it was written.

    Returns:
      Trace: columns, each shape (n,), and the description of the run.

    Raises:
      InputError: The file is missing or damaged, has no column `time`, or has a column without numbers.
    """
    if not path.is_file():
        raise InputError(path, "no such file", "a trace.parquet is needed")
    with open_parquet(path) as file:
        table = file.read()
        names = table.column_names
    if "time" not in names:
        raise InputError(path, "has no column 'time'", "a trace has one row per control step")
    for name in names:
        if names.count(name) > 1:
            raise InputError(path, f"has column {name!r} twice")
    columns = {name: _numbers(path, name, table.column(name)) for name in names}
    metadata = table.schema.metadata or {}
    if metadata.get(_CHECKSUM, _checksum(columns)) != _checksum(columns):
        raise InputError(path, "is damaged", "its numbers do not fit its checksum")
    return Trace(columns, _about(path, metadata))


def _checksum(columns: Mapping[str, Array]) -> bytes:
    """Checksum of names and numbers of all columns."""
    found = 0
    for name, values in columns.items():
        found = zlib.crc32(
            np.ascontiguousarray(values, dtype="<f8").tobytes(), zlib.crc32(name.encode(), found)
        )
    return b"%08x" % found


def _numbers(path: Path, name: str, column: Any) -> Array:
    kind = column.type
    if not (pa.types.is_floating(kind) or pa.types.is_integer(kind)):
        raise InputError(path, f"column {name!r} holds {kind}", "every column holds numbers")
    if column.null_count:
        raise InputError(
            path, f"column {name!r} has {column.null_count} empty rows", "every row holds a number"
        )
    return np.array(column.to_numpy(), dtype=float)


def _about(path: Path, metadata: dict[bytes, bytes]) -> dict[str, Any]:
    try:
        about = json.loads(metadata.get(_ABOUT, b"{}"))
    except (ValueError, RecursionError):
        raise InputError(path, "the description of the run in its metadata is not JSON") from None
    if not isinstance(about, dict):
        raise InputError(path, "the description of the run in its metadata is not a JSON object")
    return about
