"""JSON and MATLAB files, whose tables may lie at any depth, as named columns."""

from __future__ import annotations

import json
import math
import warnings
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from omnimj.errors import InputError
from omnimj.recording.importing.tables import SourceColumn, SourceTable, require_size
from omnimj.recording.importing.topics.json_numbers import to_float
from omnimj.recording.importing.units import split_unit
from omnimj.recording.run_table import printable
from omnimj.signals import Array

_DEEPEST = 8  # levels of tables in tables that are looked into
_MOST_COLUMNS = 64  # of a matrix that is taken as columns
_FEWEST = 2  # rows of a table
_UNITS, _NAMES = "units.", "names."
"""Structures beside the columns, whose texts are units and full names of the columns."""


def read_json(path: Path) -> SourceTable:
    """Read a JSON file: a list of records, or lists of equal length, at any depth; or one record per line.

    Raises:
      InputError: The file is not JSON, or holds no such table.
    """
    try:
        text = path.read_bytes().decode("utf-8-sig")
    except UnicodeDecodeError as error:
        raise InputError(path, "is not UTF-8 text", f"at byte {error.start}") from None
    try:
        content = _parsed(path, text)
        return _table_of(path, content, "JSON")
    except RecursionError:
        raise InputError(path, "is not a log", "it is nested too deeply") from None


def _parsed(path: Path, text: str) -> Any:
    if path.suffix.lower() == ".json":
        try:
            return json.loads(text)
        except ValueError as error:
            raise InputError(path, "is not valid JSON", str(error)) from None
    records = []
    for number, line in enumerate(text.splitlines(), 1):
        if not line.strip():
            continue
        try:
            records.append(json.loads(line))
        except ValueError as error:
            raise InputError(f"{path}: line {number}", "is not valid JSON", str(error)) from None
    return records


def read_mat(path: Path) -> SourceTable:
    """Read a MATLAB file up to version 7: vectors of equal length, matrices and structures.

    Raises:
      InputError: The file is damaged, of version 7.3, or holds no vectors of equal length.
    """
    from scipy.io import loadmat

    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            content = loadmat(path, simplify_cells=True)
    except NotImplementedError:
        found = "is a MATLAB file of version 7.3 (HDF5)"
        raise InputError(path, found, "save it with save('FILE', '-v7') and import that") from None
    except OSError:
        raise
    except Exception as error:  # a damaged file makes SciPy raise errors of any kind
        reason = " ".join(str(error).split())[:120] or type(error).__name__
        raise InputError(path, "is not a whole MATLAB file", reason) from None
    inside = {name: value for name, value in content.items() if not name.startswith("__")}
    return _table_of(path, inside, "MATLAB")


def _table_of(path: Path, content: Any, format_name: str) -> SourceTable:
    """Find the table in nested content: the columns of the most frequent length."""
    leaves = dict(_leaves(_as_columns(content), "", 0))
    vectors = {name: values for name, values in leaves.items() if isinstance(values, np.ndarray)}
    lengths = Counter(len(values) for values in vectors.values() if len(values) >= _FEWEST)
    if not lengths:
        raise InputError(path, "holds no table", "a list of records or lists of equal length is needed")
    rows = max(lengths, key=lambda n: (lengths[n], n))
    units, names = _texts(leaves, _UNITS), _texts(leaves, _NAMES)
    leaves = {name: value for name, value in leaves.items() if not name.startswith((_UNITS, _NAMES))}
    chosen = {name: values for name, values in vectors.items() if len(values) == rows}
    require_size(path, rows, len(chosen))
    start = _common_start(list(chosen))
    columns = {}
    for full, values in chosen.items():
        plain = full.removeprefix(start)
        name, unit = (names.get(plain, plain), units[plain]) if plain in units else split_unit(plain)
        columns[printable(name)] = SourceColumn(printable(name), values, unit)
    others = {name: f"{len(values)} rows" for name, values in vectors.items() if len(values) != rows}
    others |= {name.removeprefix(start): "text" for name, value in leaves.items() if value is None}
    scalars = {
        name: value if isinstance(value, str) else f"{value:g}"
        for name, value in leaves.items()
        if isinstance(value, str | float)
    }
    where = f" under {start.rstrip('.')!r}" if start else ""
    return SourceTable(path, columns, f"{format_name}, {rows} rows{where}", others, scalars)


def _texts(leaves: Mapping[str, Any], start: str) -> dict[str, str]:
    """Texts of a structure by the name that they belong to."""
    found = {name.removeprefix(start): text for name, text in leaves.items() if name.startswith(start)}
    return {name: text if isinstance(text, str) else "" for name, text in found.items()}


def _common_start(names: Sequence[str]) -> str:
    """Longest `a.b.` with which all names begin."""
    first = names[0].split(".")[:-1]
    while first and not all(name.startswith(".".join(first) + ".") for name in names):
        first.pop()
    return ".".join(first) + "." if first else ""


def _as_columns(content: Any, depth: int = 0) -> Any:
    """Turn lists of records into records of lists, at every depth."""
    if isinstance(content, np.ndarray) and content.dtype == object:
        content = content.tolist()
    if depth > _DEEPEST:
        return None
    if isinstance(content, list) and len(content) >= _FEWEST and all(isinstance(e, Mapping) for e in content):
        keys = dict.fromkeys(key for entry in content for key in entry)
        return {key: _as_columns([entry.get(key) for entry in content], depth + 1) for key in keys}
    if isinstance(content, Mapping):
        return {key: _as_columns(value, depth + 1) for key, value in content.items()}
    return content


def _leaves(content: Any, name: str, depth: int) -> Iterator[tuple[str, Array | str | float | None]]:
    """Yield arrays of numbers, texts and numbers with their names; None for lists of anything else."""
    if isinstance(content, Mapping):
        if depth <= _DEEPEST:
            for key, value in content.items():
                yield from _leaves(value, f"{name}.{key}" if name else str(key), depth + 1)
    elif isinstance(content, str):
        yield name, content
    elif isinstance(content, bool | int | float | np.number):
        yield name, to_float(content)
    elif isinstance(content, list | np.ndarray):
        yield from _arrays(content, name)


def _arrays(content: Any, name: str) -> Iterator[tuple[str, Array | None]]:
    """Yield a list of numbers as one column, and one of equally long lists as several."""
    values = _numbers(content)
    if values is None:
        yield name, None
    elif values.ndim == 1 or min(values.shape) == 1:
        yield name or "column", values.reshape(-1)
    elif values.ndim == 2:
        table = values if values.shape[0] >= values.shape[1] else values.T
        for k in range(min(table.shape[1], _MOST_COLUMNS)):
            yield f"{name or 'column'}_{k + 1}", np.ascontiguousarray(table[:, k])


def _numbers(content: Any) -> Array | None:
    """Array of numbers; NaN for null; None if anything else is in it."""
    if isinstance(content, np.ndarray):
        return content.astype(float) if content.dtype.kind in "biuf" else None
    if content and all(isinstance(entry, list) for entry in content):
        inner = [_numbers(entry) for entry in content]
        if any(row is None or row.ndim != 1 or row.shape != inner[0].shape for row in inner):  # pyright: ignore
            return None
        return np.array(inner, dtype=float)
    found = []
    for entry in content:
        if entry is None:
            found.append(math.nan)
        elif isinstance(entry, bool | int | float | np.number):
            found.append(to_float(entry))
        else:
            return None
    return np.array(found, dtype=float)
