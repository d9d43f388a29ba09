"""Logs of other programs as named columns: tables, JSON, MATLAB files and recorded messages."""

from __future__ import annotations

import stat
from collections.abc import Callable, Collection, Mapping
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from omnimj.errors import InputError
from omnimj.recording.importing.dialect import Dialect
from omnimj.recording.importing.topics.join import TopicChoice, TopicSummary
from omnimj.recording.run_table import MAX_NUMBERS, read_run_table
from omnimj.signals import Array

MAX_BYTES = 4 * 2**30
"""Largest file that is read."""


@dataclass(frozen=True)
class SourceColumn:
    """One column as the logger wrote it."""

    name: str
    """Name, without its unit."""
    values: Array
    """Readings, NaN where a row has none, shape (n,)."""
    unit: str = ""
    """Unit as written; empty where none is."""
    words: str = ""
    """Description in another header line, or the type of its message; empty where there is none."""
    kind: str = ""
    """Quantity where the message states it: a column of omnimj, or a quantity of a joint."""
    part: str = ""
    """The joint; empty elsewhere."""


@dataclass(frozen=True)
class SourceTable:
    """Content of one file."""

    path: Path
    columns: Mapping[str, SourceColumn]
    """Columns of numbers, by name."""
    layout: str
    """Layout of the file, in words."""
    others: Mapping[str, str] = field(default_factory=dict)
    """Names of the columns that are left out, and why."""
    scalars: Mapping[str, str] = field(default_factory=dict)
    """Single values beside the table, such as the name of a test."""
    notes: tuple[str, ...] = ()
    """Omissions and repairs made while reading, one sentence each."""
    row_of: Callable[[int], str] = lambda sample: f"sample {sample + 1}"
    """Index of a sample → its place in the file, in words."""
    topics: tuple[TopicSummary, ...] = ()
    """Topics of recorded messages; empty for other logs."""
    choice: TopicChoice | None = None
    """Description of how the topics were joined; None for other logs."""


@dataclass(frozen=True)
class SourceHints:
    """Knowledge of a log before it is read."""

    dialect: Dialect | None = None
    """Dialect of CSV files; the rest is found."""
    choice: TopicChoice | None = None
    """Rules by which topics are joined."""
    columns: Collection[str] = ()
    """Columns that are needed, so that other topics can be skipped; empty: all."""
    topics: Collection[str] = ()
    """Topics that are read; empty: all."""
    progress: Callable[[float], None] = lambda share: None
    """Called with the share of the file that is read, 0 … 1, where that takes long."""


def read_source(path: Path, hints: SourceHints | None = None) -> SourceTable:
    """Read a log of another program.

    Raises:
      InputError: The file is missing, damaged, of another format, or holds no table of numbers.
    """
    hints = hints or SourceHints()
    try:
        status = path.stat()
    except (OSError, ValueError):  # a null byte in the name is a ValueError
        status = None
    is_bag = status is not None and stat.S_ISDIR(status.st_mode) and (path / "metadata.yaml").exists()
    reader = _read_topics if is_bag else READERS.get(path.suffix.lower())
    if reader is None and status is not None and stat.S_ISDIR(status.st_mode):
        raise InputError(path, "is a folder without metadata.yaml", "a log file or a ROS 2 bag is needed")
    if reader is None and path.suffix.lower() == ".bag":
        rule = f"`rosbags-convert --src {path.name} --dst {path.stem}` makes a ROS 2 bag of it"
        raise InputError(path, "is a ROS 1 bag", rule)
    if reader is None:
        raise InputError(path, f"the suffix is {path.suffix!r}", "the format is not known", READERS)
    if not is_bag:
        _require_file(path, reader is not _read_topics)
    try:
        table = reader(path, hints)
    except OSError as error:
        raise InputError(path, f"cannot be read ({error.strerror or error})") from None
    if not table.columns:
        raise InputError(path, "has no column of numbers", f"understood as {table.layout}")
    return table


def _require_file(path: Path, is_held: bool) -> None:
    """Refuse what is no regular file, and files too large to be held in memory."""
    try:
        status = path.stat()
    except FileNotFoundError:
        raise InputError(path, "no such file") from None
    except (OSError, ValueError) as error:  # a null byte in the name is a ValueError
        raise InputError(path, f"cannot be read ({getattr(error, 'strerror', None) or error})") from None
    if stat.S_ISDIR(status.st_mode):
        raise InputError(path, "is a folder", "a log file is needed")
    if not stat.S_ISREG(status.st_mode):
        raise InputError(path, "is a pipe or a device", "a regular file is needed")
    if not status.st_size:
        raise InputError(path, "is empty")
    if is_held and status.st_size > MAX_BYTES:
        raise InputError(path, f"has {status.st_size} bytes", f"at most {MAX_BYTES} are read")


def require_size(path: Path, rows: int, columns: int) -> None:
    """Refuse a table that is too large, as a damaged file may claim.

    Raises:
      InputError: The table has more than `MAX_NUMBERS` numbers.
    """
    if rows * columns > MAX_NUMBERS:
        raise InputError(path, f"has {rows} rows of {columns} columns", f"at most {MAX_NUMBERS} numbers")


def _read_csv(path: Path, hints: SourceHints) -> SourceTable:
    from omnimj.recording.importing.csv_table import read_csv

    return read_csv(path, hints.dialect)


def _read_topics(path: Path, hints: SourceHints) -> SourceTable:
    from omnimj.recording.importing.topics.read import read_topics

    return read_topics(path, hints)


def _read_json(path: Path, _: SourceHints) -> SourceTable:
    from omnimj.recording.importing.nested import read_json

    return read_json(path)


def _read_mat(path: Path, _: SourceHints) -> SourceTable:
    from omnimj.recording.importing.nested import read_mat

    return read_mat(path)


def _read_parquet(path: Path, _: SourceHints) -> SourceTable:
    from omnimj.recording.importing.units import split_unit

    table = read_run_table(path, ())
    columns = {}
    for full, values in table.numbers.items():
        name, unit = split_unit(full)
        columns[name] = SourceColumn(name, np.asarray(values, float), unit)
    others = {name: "text" for name in table.names if name and name not in table.numbers}
    return SourceTable(path, columns, "Parquet", others)


READERS: Mapping[str, Callable[[Path, SourceHints], SourceTable]] = {
    ".csv": _read_csv,
    ".txt": _read_csv,
    ".tsv": _read_csv,
    ".dat": _read_csv,
    ".log": _read_csv,
    ".json": _read_json,
    ".jsonl": _read_json,
    ".ndjson": _read_json,
    ".mat": _read_mat,
    ".parquet": _read_parquet,
    ".mcap": _read_topics,
    ".db3": _read_topics,
}
"""Readers by suffix."""
