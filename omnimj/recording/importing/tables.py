"""Logs of other programs as named columns: tables, JSON, MATLAB files and recorded messages."""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping
from dataclasses import dataclass, field
from pathlib import Path

from omnimj.errors import InputError
from omnimj.recording.importing.dialect import Dialect
from omnimj.recording.importing.topics.join import TopicChoice, TopicSummary
from omnimj.recording.run_table import MAX_NUMBERS
from omnimj.signals import Array


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


def require_size(path: Path, rows: int, columns: int) -> None:
    """Refuse a table that is too large, as a damaged file may claim.

    Raises:
      InputError: The table has more than `MAX_NUMBERS` numbers.
    """
    if rows * columns > MAX_NUMBERS:
        raise InputError(path, f"has {rows} rows of {columns} columns", f"at most {MAX_NUMBERS} numbers")
