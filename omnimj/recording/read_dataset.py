"""Dataset folders as checked records: columns renamed and converted, gaps and spikes masked."""

from __future__ import annotations

import difflib
from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from types import MappingProxyType

import numpy as np
from numpy.typing import NDArray

from omnimj.errors import InputError, UnknownNameError
from omnimj.recording.dataset import MASS_OF, MAX_WHEELS, MIN_WHEELS, ROBOT_WHEELS, Dataset, PlantColumns, Run
from omnimj.recording.dataset_file import DATASET_FILE, DatasetFile, read_dataset_file
from omnimj.recording.logger_faults import mask_logger_faults
from omnimj.recording.mask import Mask, find_gaps, find_spikes, gap_edges
from omnimj.recording.run_table import (
    TABLE_SUFFIXES,
    RunTable,
    first_not_finite,
    printable,
    read_column_names,
    read_run_table,
)
from omnimj.signals import Array

MIN_SAMPLES = 50
"""Smallest number of samples of a run."""
INCOMPLETE = "the dataset is incomplete"
"""Beginning of the note on a dataset with fewer runs than were planned."""
LONGEST_PAUSE = 3600.0
"""Longest gap within a run [s]; what lies further apart are two runs."""
MOST_STEPS = 100_000_000
"""Largest duration of a run in steps of its usual rate: replays sample the whole of it."""
LARGEST = 1e12
"""Largest magnitude of a channel in SI units; no sensor shows more."""
_MIXED = 2.0  # ratio of the usual steps of two parts of a run from which its rate is said to change
_PARTS = 8


def read_dataset(path: Path | str, floors: Collection[str] | None = None) -> Dataset:
    """Read a folder of measured runs.

    Columns are converted to SI units (scale × logged value + offset) and to the names of omnimj. Gaps and
    single-sample spikes are masked in `Run.masked` and listed in `Dataset.notes`; their numbers are kept.

    Args:
      path: Folder with `dataset.toml` and one NAME.csv or NAME.parquet per run.
      floors: Names of all floors; None for those of the shipped `floors.toml`.

    Raises:
      InputError: The data break a rule; the message is one line with file, row or key, the value found, and
        the allowed values.
      UnknownNameError: A plant, floor, column or key does not exist; the message lists the choices.
    """
    path = Path(path)
    if not path.is_dir():
        found = "is a file" if path.exists() else "no such folder"
        raise InputError(path, found, f"a dataset is a folder with {DATASET_FILE} and one table per run")
    if not (path / DATASET_FILE).exists():
        raise InputError(path, f"has no {DATASET_FILE}", "it names the plant and the floor")
    about = read_dataset_file(path, floors)
    files = _files(about, path)
    about = _with_counted_wheels(about, files.values())
    runs = [_read_run(about, name, file) for name, file in files.items()]
    _require_used_renames(about, runs)
    _require_consistent_repeats(about, [run for run, _ in runs])
    masked, notes = mask_runs(about.columns, [run for run, _ in runs], about.pose_measured)
    notes = (*_incomplete_note(about, len(runs)), *notes)
    return Dataset(path, about.plant, tuple(masked), notes, about.wheels, about.pose_measured, about.model)


def _incomplete_note(about: DatasetFile, runs: int) -> tuple[str, ...]:
    if runs >= about.planned_runs:
        return ()
    return (f"{INCOMPLETE}: {runs} of {about.planned_runs} planned runs were recorded",)


def _files(about: DatasetFile, folder: Path) -> dict[str, Path]:
    """Return the files of the runs by stem, sorted by name."""
    files: dict[str, Path] = {}
    for file in sorted(folder.iterdir()):
        if file.suffix.lower() not in TABLE_SUFFIXES or file.name.startswith(".") or not file.is_file():
            continue
        if file.stem in files:
            raise InputError(
                folder, f"run {file.stem!r} occurs twice, {files[file.stem].name} and {file.name}"
            )
        files[file.stem] = file
    if not files:
        raise InputError(folder, "has no runs", "one NAME.csv or NAME.parquet per run is needed")
    for name in about.runs:
        if name not in files:
            close = difflib.get_close_matches(name, files, n=1)
            hint = f"did you mean {close[0]!r}?" if close else f"the folder has {_abbreviated(list(files))}"
            name = printable(name)
            found = f"there is no {name}.csv or {name}.parquet"
            raise InputError(f"{about.path}: [runs.{name}]", found, hint)
    return files


def _with_counted_wheels(about: DatasetFile, files: Iterable[Path]) -> DatasetFile:
    """Count the wheels in the columns of the runs, unless `dataset.toml` states their number."""
    if about.states_wheels:
        return about
    logged = {name for file in files for name in read_column_names(file)}
    names = logged | {about.renamed[name].name for name in logged & set(about.renamed)}
    kinds = ("current", "wheel_speed")
    found = [n for n in range(MIN_WHEELS, MAX_WHEELS + 1) if any(f"{kind}_{n}" in names for kind in kinds)]
    return replace(about, wheels=max(found, default=ROBOT_WHEELS))


def _read_run(about: DatasetFile, name: str, file: Path) -> tuple[Run, tuple[str, ...]]:
    """Read and check one run; return it with the column names in its file."""
    plant = about.columns
    conditions = about.conditions(name)
    named = (name for name in read_column_names(file) if plant.has(name)) if plant.prefixes else ()
    table = read_run_table(file, {*plant.known, *named, *about.renamed})
    columns = _mapped_columns(about, file, table)
    missing = [column for column in plant.required if column not in columns]
    if plant.one_of and not any(column in columns for column in plant.one_of):
        missing.append(" or ".join(plant.one_of))
    if missing:
        what = "columns" if len(missing) > 1 else "column"
        found = f"has no {what} {', '.join(missing)}"
        have = _abbreviated([column for column in table.names if column], 12)
        rule = f"{about.plant} needs {plant.needed}; the file has {have}"
        if {"x", "y", "heading"} <= set(columns) and not about.pose_measured:
            rule += "; where x, y and heading were measured, state pose_measured = true under [defaults]"
        raise InputError(file, found, f"{rule}; other names belong under [columns] of {DATASET_FILE}")
    _require_time(file, columns["time"], table)
    _require_magnitudes(file, {n: v for n, v in columns.items() if plant.has(n)}, table)
    for column in plant.zero_if_absent:
        columns.setdefault(column, np.zeros(len(columns["time"])))
    for values in columns.values():
        values.flags.writeable = False
    repeat_of = conditions.pop("repeat_of", None)
    run = Run(
        name,
        MappingProxyType(columns),
        MappingProxyType({}),
        MappingProxyType(conditions),
        None if repeat_of is None else str(repeat_of),
    )
    return run, table.names


def _mapped_columns(about: DatasetFile, file: Path, table: RunTable) -> dict[str, Array]:
    """Convert columns to the names of omnimj and to SI units."""
    columns: dict[str, Array] = {}
    origin: dict[str, str] = {}
    for theirs, values in table.numbers.items():
        renamed = about.renamed.get(theirs)
        name = theirs if renamed is None else renamed.name
        if name in columns:
            found = f"column {name!r} occurs twice, as {origin[name]!r} and as {theirs!r}"
            raise InputError(file, found, f"see [columns] of {DATASET_FILE}")
        if renamed is not None:
            with np.errstate(over="ignore"):
                values = renamed.scale * values + renamed.offset
        columns[name], origin[name] = values, theirs
    known = about.columns
    broken = first_not_finite({name: columns[name] for name in columns if known.has(name)})
    if broken is not None:
        sample, name = broken
        place = f"{file}: row {table.row_of(sample)}, column {name!r}"
        raise InputError(place, f"overflows after [columns] of {DATASET_FILE}", "check its scale")
    return columns


def _require_time(file: Path, time: Array, table: RunTable) -> None:
    if len(time) < MIN_SAMPLES:
        raise InputError(file, f"has {len(time)} samples", f"at least {MIN_SAMPLES} are needed")
    late = np.flatnonzero(np.diff(time) <= 0.0)
    if len(late):
        k = int(late[0]) + 1
        found = f"found {time[k]:.12g} after {time[k - 1]:.12g}"
        raise InputError(f"{file}: row {table.row_of(k)}, column 'time'", found, "must increase")
    step = np.diff(time)
    k = int(np.argmax(step)) + 1
    if step[k - 1] > LONGEST_PAUSE:
        found = f"found {time[k]:.12g} after {time[k - 1]:.12g}"
        rule = f"within a run at most {LONGEST_PAUSE:g} s may be missing: correct the time or store two runs"
        raise InputError(f"{file}: row {table.row_of(k)}, column 'time'", found, rule)
    steps = (time[-1] - time[0]) / float(np.median(step))
    if steps > MOST_STEPS:
        found = f"lasts {time[-1] - time[0]:.6g} s at a usual step of {np.median(step):.3g} s"
        raise InputError(file, found, f"at most {MOST_STEPS} steps are read: store it as several runs")


def _require_magnitudes(file: Path, columns: Mapping[str, Array], table: RunTable) -> None:
    for name, values in columns.items():
        k = int(np.argmax(np.abs(values)))
        if name != "time" and abs(values[k]) > LARGEST:
            place = f"{file}: row {table.row_of(k)}, column {name!r}"
            rule = f"no sensor shows more than {LARGEST:g} in SI units: check the log and its scale"
            raise InputError(place, f"found {values[k]:.6g}", rule)


def _require_used_renames(about: DatasetFile, runs: Sequence[tuple[Run, tuple[str, ...]]]) -> None:
    """Refuse a renamed column that is in no file, since it must be a typing error."""
    known = {name for _, names in runs for name in names if name}
    for theirs in about.renamed:
        if theirs not in known:
            kind = "column of any run"
            choices = [printable(name) for name in sorted(known)[:30]]
            raise UnknownNameError(f"{about.path}: [columns]", kind, theirs, choices)


def _require_consistent_repeats(about: DatasetFile, runs: Sequence[Run]) -> None:
    """Refuse repeats of one condition that differ in floor or mass."""
    first: dict[str, Run] = {}
    for run in runs:
        if run.repeat_of is None:
            continue
        other = first.setdefault(run.repeat_of, run)
        stated = {*run.conditions, *other.conditions}
        for key in ("floor", "mass", *sorted(k for k in stated if k.startswith(MASS_OF))):
            mine, others = run.conditions.get(key), other.conditions.get(key)
            if mine != others:
                found = f"{key} is {mine!r} but {others!r} in {other.name!r}"
                rule = f"both are repeats of {run.repeat_of!r}"
                raise InputError(f"{about.path}: run {run.name!r}", found, rule)


def mask_runs(
    plant: PlantColumns, runs: Sequence[Run], pose_measured: bool = False
) -> tuple[list[Run], list[str]]:
    """Mask samples that must not be fitted: spikes, samples beside gaps, and what a slow logger repeated.

    Returns:
      Runs with masks, and one note per gap or column with spikes.
    """
    logged = dict.fromkeys(name for run in runs for name in run.columns if plant.has(name))
    channels = [name for name in dict.fromkeys([*plant.known, *logged]) if name != "time"]
    found: list[dict[str, Mask]] = [{} for _ in runs]
    held, faults = mask_logger_faults(runs) if pose_measured else ([{} for _ in runs], [])
    for name in channels:
        having = [k for k, run in enumerate(runs) if name in run.columns]
        values = [runs[k].columns[name] for k in having]
        spikes = find_spikes(values, [runs[k].time for k in having], name in plant.angles) if having else []
        for k, mask in zip(having, spikes, strict=True):
            if mask.any():
                found[k][name] = mask
    masked, notes = [], []
    for run, own, repeated in zip(runs, found, held, strict=True):
        notes.extend(_spike_note(run, name, mask) for name, mask in own.items())
        own = {**own, **{name: own.get(name, False) | mask for name, mask in repeated.items()}}
        after = find_gaps(run.time)
        if len(after):
            notes.append(_gap_note(run, after))
            beside = gap_edges(after, len(run.time))
            own = {name: own.get(name, False) | beside for name in channels if name in run.columns}
        notes.extend(_rate_note(run))
        for mask in own.values():
            mask.flags.writeable = False
        masked.append(_with_mask(run, own))
    return masked, [*notes, *faults]


def _with_mask(run: Run, masked: Mapping[str, Mask]) -> Run:
    return Run(run.name, run.columns, MappingProxyType(dict(masked)), run.conditions, run.repeat_of)


def _spike_note(run: Run, column: str, mask: Mask) -> str:
    at = run.time[mask]
    many = f"{len(at)} single-sample spikes" if len(at) > 1 else "a single-sample spike"
    return f"run {run.name}: {many} in {column} masked, at {_abbreviated([f'{t:.6g} s' for t in at], 5)}"


def _gap_note(run: Run, after: NDArray[np.int64]) -> str:
    steps = np.diff(run.time)
    longest = after[np.argmax(steps[after])]
    many = f"{len(after)} gaps in time, the longest" if len(after) > 1 else "a gap in time"
    size = f"of {steps[longest]:.4g} s after {run.time[longest]:.6g} s"
    return f"run {run.name}: {many} {size} (a step is {np.median(steps):.4g} s), edges masked"


def _rate_note(run: Run) -> tuple[str, ...]:
    """Note that the rate of a run changes; a steady rate with gaps, or one that only varies, has no note."""
    steps = np.array([np.median(part) for part in np.array_split(np.diff(run.time), _PARTS)])
    if steps.max() < _MIXED * steps.min():
        return ()
    rates = f"{1.0 / steps.max():.4g} and {1.0 / steps.min():.4g} samples per second"
    return (f"run {run.name}: the sampling rate changes, between {rates}",)


def _abbreviated(names: Sequence[str], most: int = 6) -> str:
    shown = ", ".join(map(printable, names[:most]))
    return f"{shown} and {len(names) - most} more" if len(names) > most else shown
