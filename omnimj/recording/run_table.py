"""A run's table as it stands in its file, under the logger's own column names."""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from omnimj.errors import InputError
from omnimj.signals import Array

ENDINGS = (".csv", ".parquet")
"""Kinds of files that hold a run."""
MOST_NUMBERS = 500_000_000
"""Numbers in one run: 4 GB. A damaged or hostile file can claim any number of rows."""


@dataclass(frozen=True)
class RunTable:
    """Numbers of one file."""

    names: tuple[str, ...]
    """All column names, in the file's order."""
    numbers: Mapping[str, Array]
    """The columns that hold numbers, each shape (n,); the empty cells of those not asked for are NaN."""
    row_of: Callable[[int], int]
    """The row, as a person counts them in the file, of sample 0, 1, …"""


def read_run_table(path: Path, needed: Collection[str]) -> RunTable:
    """Reads a CSV or Parquet file.

    Rows are counted as a person counts them: in CSV the header is row 1 and empty lines count; in Parquet,
    where there is no header, the first sample is row 1.

    Args:
      path: Ends with one of `ENDINGS`.
      needed: Columns that must hold finite numbers if they are there. A column that is not among them may
        hold anything; it is in `numbers` if it holds numbers.

    Raises:
      InputError: The file cannot be read, or a needed column holds something else than finite numbers; the
        message names file, row and column.
    """
    if path.suffix.lower() == ".csv":
        from omnimj.recording.csv_table import read_csv

        return read_csv(path, needed)
    from omnimj.recording.parquet_table import read_parquet

    return read_parquet(path, needed)


def checked_names(path: Path, names: Sequence[str]) -> tuple[str, ...]:
    """Column names without spaces around them; nameless columns stay, since a comma too many makes them.

    Raises:
      InputError: A name is there twice, or there is none at all.
    """
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
    """The first sample that is not finite and its column: the earliest sample, then the first column."""
    found = []
    for order, (name, values) in enumerate(columns.items()):
        broken = ~np.isfinite(values)
        if broken.any():
            found.append((int(np.argmax(broken)), order, name))
    if not found:
        return None
    sample, _, name = min(found)
    return sample, name


def plain(name: str) -> str:
    """A name as it can stand in a line of text: a damaged file may call a column anything."""
    return name if name.isprintable() else repr(name)
