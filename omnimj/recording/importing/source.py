"""Readers of logs by kind of file."""

from __future__ import annotations

import os
import stat
from collections.abc import Callable, Mapping
from pathlib import Path

import numpy as np

from omnimj.errors import InputError
from omnimj.recording.importing.csv_table import read_csv
from omnimj.recording.importing.nested import read_json, read_mat
from omnimj.recording.importing.tables import SourceColumn, SourceHints, SourceTable
from omnimj.recording.importing.topics.read import read_topics
from omnimj.recording.importing.units import split_unit
from omnimj.recording.run_table import read_run_table

MAX_BYTES = 4 * 2**30
"""Largest file that is read."""


def read_source(path: Path, hints: SourceHints | None = None) -> SourceTable:
    """Read a log of another program.

    Raises:
      InputError: The file is missing, damaged, of another format, or holds no table of numbers.
    """
    status: os.stat_result | OSError | ValueError
    try:
        status = path.stat()
    except (OSError, ValueError) as error:  # a null byte in the name is a ValueError
        status = error
    is_folder = isinstance(status, os.stat_result) and stat.S_ISDIR(status.st_mode)
    is_bag = is_folder and (path / "metadata.yaml").exists()
    reader = read_topics if is_bag else READERS.get(path.suffix.lower())
    if reader is None and is_folder:
        raise InputError(path, "is a folder without metadata.yaml", "a log file or a ROS 2 bag is needed")
    if reader is None and path.suffix.lower() == ".bag":
        rule = f"`rosbags-convert --src {path.name} --dst {path.stem}` makes a ROS 2 bag of it"
        raise InputError(path, "is a ROS 1 bag", rule)
    if reader is None:
        raise InputError(path, f"the suffix is {path.suffix!r}", "the format is not known", READERS)
    if not is_bag:
        _require_file(path, status, reader is not read_topics)
    try:
        table = reader(path, hints or SourceHints())
    except OSError as error:
        raise InputError(path, f"cannot be read ({error.strerror or error})") from None
    if not table.columns:
        raise InputError(path, "has no column of numbers", f"understood as {table.layout}")
    return table


def _require_file(path: Path, status: os.stat_result | OSError | ValueError, is_held: bool) -> None:
    """Refuse anything but a regular file, and files too large to be held in memory."""
    if isinstance(status, FileNotFoundError):
        raise InputError(path, "no such file")
    if not isinstance(status, os.stat_result):
        raise InputError(path, f"cannot be read ({getattr(status, 'strerror', None) or status})")
    if stat.S_ISDIR(status.st_mode):
        raise InputError(path, "is a folder", "a log file is needed")
    if not stat.S_ISREG(status.st_mode):
        raise InputError(path, "is a pipe or a device", "a regular file is needed")
    if not status.st_size:
        raise InputError(path, "is empty")
    if is_held and status.st_size > MAX_BYTES:
        raise InputError(path, f"has {status.st_size} bytes", f"at most {MAX_BYTES} are read")


def _read_parquet(path: Path, _: SourceHints) -> SourceTable:
    table = read_run_table(path, ())
    columns = {}
    for full, values in table.numbers.items():
        name, unit = split_unit(full)
        columns[name] = SourceColumn(name, np.asarray(values, float), unit)
    others = {name: "text" for name in table.names if name and name not in table.numbers}
    return SourceTable(path, columns, "Parquet", others)


READERS: Mapping[str, Callable[[Path, SourceHints], SourceTable]] = {
    **dict.fromkeys(
        (".csv", ".txt", ".tsv", ".dat", ".log"), lambda path, hints: read_csv(path, hints.dialect)
    ),
    **dict.fromkeys((".json", ".jsonl", ".ndjson"), lambda path, _: read_json(path)),
    ".mat": lambda path, _: read_mat(path),
    ".parquet": _read_parquet,
    **dict.fromkeys((".mcap", ".db3"), read_topics),
}
"""Readers by suffix."""
