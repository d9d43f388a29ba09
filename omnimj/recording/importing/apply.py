"""A mapping applied to a table of a log: columns of a run in SI units."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType

import numpy as np
from numpy.typing import NDArray

from omnimj.errors import InputError, UnknownNameError
from omnimj.recording.dataset import Run
from omnimj.recording.importing.mapping import ColumnSource, LogMapping
from omnimj.recording.importing.tables import SourceTable
from omnimj.recording.importing.units import find_unit, target_unit
from omnimj.recording.read_dataset import MIN_SAMPLES
from omnimj.signals import Array, true_stretches

FOLDER = "{folder}"
"""Stands for the name of the log's folder in texts under [defaults]: `floor = "{folder}"`."""
_RATES = {"m": "m/s", "rad": "rad/s", "m/s": "m/s2", "": ""}
"""SI units of readings and of their change per second."""


@dataclass(frozen=True)
class ImportedRun:
    """A run with what had to be done to the log."""

    run: Run
    notes: tuple[str, ...]


def apply_mapping(table: SourceTable, mapping: LogMapping, name: str) -> ImportedRun:
    """Convert a log to a run.

    Rows whose time repeats are left out, and so is the first row where a column is a difference. In stale
    rows a difference keeps its last value; the row after them has the mean change over the pause.

    Raises:
      InputError: A needed cell is empty or not finite, time decreases, or a unit does not fit its column.
      UnknownNameError: The log lacks a column; the message lists its columns.
    """
    sources = _sources(table, mapping)
    kept, notes = _kept_rows(table, mapping, sources)
    time = _scaled(table, "time", mapping.columns["time"], sources[mapping.columns["time"].source])[kept]
    twice = np.concatenate(([False], np.diff(time) == 0.0))
    if twice.any():
        notes.append(f"{_counted(twice, 'row')} with the time of the row before left out")
        kept, time = kept[~twice], time[~twice]
    _require_increasing(table, kept, time)
    values = {source: column[kept] for source, column in sources.items()}
    stale = _stale_rows(mapping, values)
    columns = {
        target: time if target == "time" else _column(table, target, rule, values, time, stale)
        for target, rule in mapping.columns.items()
    }
    if any(rule.difference for rule in mapping.columns.values()):
        columns = {target: column[1:] for target, column in columns.items()}
        stale = stale[1:]
    if len(columns["time"]) < MIN_SAMPLES:
        found = f"has {len(columns['time'])} samples"
        raise InputError(table.path, found, f"at least {MIN_SAMPLES} are needed")
    notes += _stale_note(columns["time"], stale)
    if mapping.rotation:
        _turn_pose(table, columns, mapping.rotation)
    for target, column in columns.items():
        _require_finite(table, kept, target, column)
    return ImportedRun(_run(table, name, columns, mapping), (*table.notes, *notes))


def _stale_note(time: Array, stale: NDArray[np.bool_]) -> list[str]:
    if not stale.any():
        return []
    ends = true_stretches(stale) - 1
    longest = float(np.max(np.diff(time[np.maximum(ends, 0)], axis=1)))
    return [f"{_counted(stale, 'stale row')}, for up to {longest:.3g} s, in which speeds are held"]


def _run(table: SourceTable, name: str, columns: Mapping[str, Array], mapping: LogMapping) -> Run:
    folder = table.path.absolute().parent.name
    stated = {**mapping.defaults, **mapping.runs.get(name, {})}
    conditions = {k: v.replace(FOLDER, folder) if isinstance(v, str) else v for k, v in stated.items()}
    conditions.pop("pose_measured", None)
    repeat_of = conditions.pop("repeat_of", None)
    return Run(
        name,
        MappingProxyType(dict(columns)),
        MappingProxyType({}),
        MappingProxyType(conditions),
        None if repeat_of is None else str(repeat_of),
    )


def _sources(table: SourceTable, mapping: LogMapping) -> dict[str, Array]:
    """Every column of the log that the mapping names."""
    wanted = [(f"columns.{target}", rule.source) for target, rule in mapping.columns.items()]
    wanted += [(f"columns.{t}.sign_of", r.sign_of) for t, r in mapping.columns.items() if r.sign_of]
    wanted += [(f"columns.{t}.times", r.times) for t, r in mapping.columns.items() if r.times]
    if mapping.stale is not None:
        wanted += [("stale.unchanged", name) for name in mapping.stale.unchanged]
        wanted += [("stale.moving", name) for name in mapping.stale.moving]
    found: dict[str, Array] = {}
    for key, name in wanted:
        if name in table.others:
            reason = f"column {name!r} is {table.others[name]}"
            raise InputError(table.path, reason, f"{key} of the mapping needs numbers")
        if name not in table.columns:
            raise UnknownNameError(f"{table.path} ({key} of the mapping)", "column", name, table.columns)
        found[name] = np.asarray(table.columns[name].values, float)
    return found


def _kept_rows(
    table: SourceTable, mapping: LogMapping, sources: dict[str, Array]
) -> tuple[NDArray[np.intp], list[str]]:
    """Rows that are used, by the rule for empty cells; `hold` fills the columns in place."""
    empty = np.any([np.isnan(values) for values in sources.values()], axis=0)
    rows = np.arange(len(empty))
    if not empty.any():
        return rows, []
    if mapping.empty == "refuse":
        k = int(np.argmax(empty))
        name = next(name for name, values in sources.items() if np.isnan(values[k]))
        rule = 'empty = "drop" in the mapping leaves such rows out, "hold" takes the last value'
        raise InputError(f"{table.path}: {table.row_of(k)}, column {name!r}", "is empty", rule)
    if mapping.empty == "drop":
        return rows[~empty], [f"{_counted(empty, 'row')} with empty cells left out"]
    start = 0
    for name, values in sources.items():
        last = np.maximum.accumulate(np.where(np.isnan(values), -1, rows))
        start = max(start, int(np.argmax(last >= 0)) if (last >= 0).any() else len(rows))
        sources[name] = values[np.maximum(last, 0)]
    return rows[start:], [f"{_counted(empty, 'row')} with empty cells filled with the last value"]


def _stale_rows(mapping: LogMapping, values: Mapping[str, Array]) -> NDArray[np.bool_]:
    count = len(next(iter(values.values())))
    if mapping.stale is None:
        return np.zeros(count, dtype=bool)
    still = np.all([np.diff(values[name], prepend=np.nan) == 0.0 for name in mapping.stale.unchanged], axis=0)
    return still & np.any([values[name] != 0.0 for name in mapping.stale.moving], axis=0)


def _column(
    table: SourceTable,
    target: str,
    rule: ColumnSource,
    values: Mapping[str, Array],
    time: Array,
    stale: NDArray[np.bool_],
) -> Array:
    reading = values[rule.source]
    if rule.signed:
        top = 2.0**rule.signed
        reading = np.where(reading >= 0.5 * top, reading - top, reading)
    if rule.difference:
        reading = _change_per_time(reading, time, rule.wrap, stale)
    elif rule.wrap:
        reading = np.unwrap(reading, period=rule.wrap)
    if rule.sign_of:
        reading = np.abs(reading) * np.sign(values[rule.sign_of])
    if rule.times:
        reading = reading * values[rule.times]
    return _scaled(table, target, rule, reading)


def _change_per_time(reading: Array, time: Array, wrap: float | None, stale: NDArray[np.bool_]) -> Array:
    """Change of a reading since the last row that is not stale, per time; the first row has none (0)."""
    fresh = np.flatnonzero(~stale)
    steps = np.diff(reading[fresh])
    if wrap:
        steps = (steps + wrap / 2.0) % wrap - wrap / 2.0
    rate = np.concatenate(([0.0], steps / np.diff(time[fresh])))
    return rate[np.maximum(np.cumsum(~stale) - 1, 0)]


def _scaled(table: SourceTable, target: str, rule: ColumnSource, reading: Array) -> Array:
    """Convert a reading to the SI unit of its column."""
    written = rule.unit if rule.unit is not None else table.columns[rule.source].unit
    unit, needed = find_unit(written), target_unit(target)
    factor = unit.factor if unit is not None else 1.0
    if unit is not None and rule.scale is None and needed:
        si = _RATES.get(unit.si, f"{unit.si}/s") if rule.difference else unit.si
        if si != needed:
            found = f"column {rule.source!r} is in {written}{' and differenced' if rule.difference else ''}"
            raise InputError(
                f"{table.path}: columns.{target}", found, f"give a scale to {needed}, or its unit"
            )
    with np.errstate(over="ignore", invalid="ignore"):
        return (1.0 if rule.scale is None else rule.scale) * factor * reading + rule.offset


def _turn_pose(table: SourceTable, columns: dict[str, Array], angle: float) -> None:
    for name in ("x", "y", "heading"):
        if name not in columns:
            raise InputError(table.path, f"column {name!r} is not mapped", "[pose] turns x, y and heading")
    c, s = np.cos(angle), np.sin(angle)
    x, y = columns["x"], columns["y"]
    columns["x"], columns["y"] = c * x - s * y, s * x + c * y
    columns["heading"] = columns["heading"] + angle


def _require_increasing(table: SourceTable, kept: NDArray[np.intp], time: Array) -> None:
    late = np.flatnonzero(~(np.diff(time) > 0.0))
    if len(late):
        k = int(late[0]) + 1
        found = f"found {time[k]:.12g} s after {time[k - 1]:.12g} s"
        raise InputError(f"{table.path}: {table.row_of(int(kept[k]))}, time", found, "must increase")


def _require_finite(table: SourceTable, kept: NDArray[np.intp], target: str, column: Array) -> None:
    wrong = np.flatnonzero(~np.isfinite(column))
    if len(wrong):
        k = int(wrong[0]) + len(kept) - len(column)
        place = f"{table.path}: {table.row_of(int(kept[k]))}, column {target!r}"
        raise InputError(place, f"is {column[wrong[0]]} in SI units", "a finite number is needed")


def _counted(mask: NDArray[np.bool_], what: str) -> str:
    count = int(mask.sum())
    return f"{count} {what}{'s' if count > 1 else ''}"
