"""Import of logs: what was understood, and the dataset that follows from it."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from omnimj.errors import InputError, OmnimjError
from omnimj.parameters import read_floors
from omnimj.recording.dataset import MAX_WHEELS, PLANT_COLUMNS, Run, plant_columns
from omnimj.recording.dataset_file import POSE_MEASURED
from omnimj.recording.importing.apply import FOLDER, apply_mapping
from omnimj.recording.importing.mapping import LogMapping, mapping_text, read_mapping
from omnimj.recording.importing.propose import Proposal, missing_columns, propose, wheel_count
from omnimj.recording.importing.quality import (
    TimeQuality,
    packet_scatter,
    pose_misfit,
    suspicious_wheels,
    time_quality,
)
from omnimj.recording.importing.source import read_source
from omnimj.recording.importing.tables import SourceHints, SourceTable
from omnimj.recording.importing.topics.join import TopicSummary
from omnimj.recording.importing.units import find_unit
from omnimj.recording.json_files import write_text
from omnimj.recording.write_dataset import DatasetWriter

MAPPING_FILE = "mapping.toml"
"""Copy of the mapping in the folder of a dataset."""
Progress = Callable[[int, int], None]
_STEPS = 1000  # of progress in each file


@dataclass(frozen=True)
class ImportConfig:
    """Files to import and the choices made for them."""

    files: tuple[Path, ...]
    mapping: Path | None = None
    """Mapping file; a mapping is proposed when None."""
    plant: str | None = None
    floor: str | None = None
    topics: tuple[str, ...] = ()
    """Topics of recorded messages that are read; empty: all, or those that the mapping needs."""


@dataclass(frozen=True)
class ColumnSummary:
    """One column of the log, as the preview shows it."""

    name: str
    unit: str
    low: float
    high: float
    becomes: str
    """Columns of the dataset that come from it; empty where none does."""
    remark: str = ""


@dataclass(frozen=True)
class ImportPlan:
    """Logs as they were understood."""

    layouts: tuple[str, ...]
    """Layouts of the files in words, the most frequent first, each with its number of files."""
    proposal: Proposal
    columns: tuple[ColumnSummary, ...]
    left_out: tuple[str, ...]
    """Columns without numbers, with the reason."""
    plants: dict[str, tuple[str, ...]]
    """Missing columns by plant."""
    runs: tuple[Run, ...]
    """Runs; those that could be converted."""
    quality: dict[str, TimeQuality]
    """By run."""
    notes: tuple[str, ...]
    """Conversions and oddities, one sentence each."""
    scalars: dict[str, str]
    """Single values of the first file."""
    topics: tuple[TopicSummary, ...]
    """Topics of the first file; empty for logs that are not message recordings."""


def plan_import(config: ImportConfig, progress: Progress | None = None) -> ImportPlan:
    """Read logs, find or apply a mapping, and convert them.

    Raises:
      InputError: A file or the mapping is wrong; with a mapping also where it does not fit a file.
      UnknownNameError: A name in the mapping does not exist.
    """
    given = None if config.mapping is None else read_mapping(config.mapping)
    hints = _hints(config, given)
    tables = []
    for k, file in enumerate(config.files):
        tables.append(read_source(file, replace(hints, progress=_shown(progress, k, len(config.files)))))
        if progress is not None:
            progress(_STEPS * (k + 1), _STEPS * len(config.files))
    names = run_names(config.files)
    proposal = _proposal(config, given, tables, names)
    runs, notes = _converted(tables, names, proposal, strict=given is not None)
    quality = {run.name: time_quality(run.time) for run in runs}
    notes += _quality_notes(tables, proposal.mapping, runs, quality)
    return ImportPlan(
        tuple(f"{layout} ({count} files)" if count > 1 else layout for layout, count in _layouts(tables)),
        proposal,
        tuple(_summary(tables, proposal, name) for name in tables[0].columns),
        tuple(f"{name} ({reason})" for name, reason in tables[0].others.items()),
        {plant: missing_columns(list(proposal.mapping.columns), plant) for plant in PLANT_COLUMNS},
        tuple(runs),
        quality,
        tuple(notes),
        dict(tables[0].scalars),
        tables[0].topics,
    )


def _shown(progress: Progress | None, done: int, files: int) -> Callable[[float], None]:
    """Progress within a file, as that of all files."""

    def show(share: float) -> None:
        if progress is not None:
            progress(round(_STEPS * (done + share)), _STEPS * files)

    return show


def _hints(config: ImportConfig, given: LogMapping | None) -> SourceHints:
    if given is None:
        return SourceHints(topics=config.topics)
    if config.topics:
        raise InputError("--topics", f"found {config.topics[0]!r}", f"{config.mapping} states what is needed")
    return SourceHints(given.dialect, given.topics, given.sources)


def run_names(files: Sequence[Path]) -> list[str]:
    """Names of the runs: stems of the files, with the folder before them where stems are alike.

    Raises:
      InputError: A file is given twice.
    """
    own = {file: file.absolute().name if file.is_dir() else file.stem for file in files}
    count = Counter(own[file] for file in files)
    names = [own[f] if count[own[f]] == 1 else f"{f.absolute().parent.name}_{own[f]}" for f in files]
    twice = [name for name, count in Counter(names).items() if count > 1]
    if twice:
        raise InputError(f"run {twice[0]!r}", "comes from two files", "import them into two datasets")
    return names


def _proposal(
    config: ImportConfig, given: LogMapping | None, tables: Sequence[SourceTable], names: Sequence[str]
) -> Proposal:
    if given is None:
        return propose(tables, config.plant, config.floor)
    for option, value in (("--plant", config.plant), ("--floor", config.floor)):
        if value is not None:
            raise InputError(option, f"found {value!r}", f"the mapping {config.mapping} states it")
    for name in given.runs:
        if name not in names:
            raise InputError(f"{config.mapping}: [runs.{name}]", "there is no such run", "", names[:20])
    return Proposal(given, missing=_missing_in(given, names))


def _missing_in(given: LogMapping, names: Sequence[str]) -> tuple[str, ...]:
    """Columns and conditions that the plant needs and a mapping of the user does not state."""
    pose_measured = given.defaults.get(POSE_MEASURED) is True
    missing = missing_columns(list(given.columns), given.plant, pose_measured)
    stated = [{**given.defaults, **given.runs.get(name, {})} for name in names]
    needed = plant_columns(given.plant).conditions
    return (*missing, *(f"[defaults] {key}" for key in needed if not all(key in one for one in stated)))


def _layouts(tables: Sequence[SourceTable]) -> list[tuple[str, int]]:
    return Counter(table.layout for table in tables).most_common()


def _converted(
    tables: Sequence[SourceTable], names: Sequence[str], proposal: Proposal, strict: bool
) -> tuple[list[Run], list[str]]:
    """Convert all logs; without a mapping of the user, what cannot be converted is a note."""
    runs, notes = [], []
    clear = {k: rule for k, rule in proposal.mapping.columns.items() if k not in proposal.unclear}
    mapping = replace(proposal.mapping, columns=clear)
    for table, name in zip(tables, names, strict=True) if "time" in clear else ():
        try:
            done = apply_mapping(table, mapping, name)
        except OmnimjError as error:
            if strict:
                raise
            notes.append(str(error))
            continue
        runs.append(done.run)
        notes += [f"run {name}: {note}" for note in done.notes]
    return runs, notes


def _quality_notes(
    tables: Sequence[SourceTable], mapping: LogMapping, runs: Sequence[Run], quality: dict[str, TimeQuality]
) -> list[str]:
    known = plant_columns(mapping.plant, MAX_WHEELS)
    unknown = [name for name in mapping.columns if not known.has(name)]
    notes = [f"{name} is not a column of {mapping.plant}; omnimj keeps but ignores it" for name in unknown]
    notes += [
        f"run {name}: {found.rate:.3g} samples per second; a dataset has 20 or more"
        for name, found in quality.items()
        if found.is_slow
    ]
    counters = {rule.source for rule in mapping.columns.values() if rule.difference}
    counters |= set(mapping.stale.unchanged if mapping.stale else ())
    time = mapping.columns["time"].source if "time" in mapping.columns else ""
    for name in sorted(counters) if time else ():
        having = [t.columns for t in tables if {name, time} <= set(t.columns)]
        most = max(having, key=lambda columns: np.ptp(np.nan_to_num(columns[name].values)))
        found = packet_scatter(most[name].values, most[time].values)
        if found is not None:
            words = f"its increments scatter by {found[0]:.0%}, time steps by {found[1]:.0%}"
            notes.append(f"{name} arrives in packets: {words}")
    misfit = pose_misfit(runs)
    if misfit:
        shares = ", ".join(f"{1.0 - share:.1%} of wheel {n}" for n, share in misfit.items())
        notes.append(f"the measured pose explains {shares}, by one linear law for all runs")
    wrong = [f"wheel_speed_{n}" for n in suspicious_wheels(misfit)]
    if wrong:
        words = "slip, or a wrong sign, counter, time or pose"
        notes.append(f"{', '.join(wrong)} and the pose disagree: {words}")
    return notes


def _summary(tables: Sequence[SourceTable], proposal: Proposal, name: str) -> ColumnSummary:
    values = np.concatenate([t.columns[name].values for t in tables if name in t.columns])
    finite = values[np.isfinite(values)]
    unit = tables[0].columns[name].unit
    targets = [target for target, rule in proposal.mapping.columns.items() if rule.source == name]
    remarks = [proposal.remarks[target] for target in targets if target in proposal.remarks]
    if unit and find_unit(unit) is None:
        remarks.append(f"unit {unit!r} is not known")
    if len(finite) < len(values):
        remarks.append(f"{len(values) - len(finite)} cells are empty")
    low, high = (float(finite.min()), float(finite.max())) if len(finite) else (np.nan, np.nan)
    return ColumnSummary(name, unit, low, high, ", ".join(targets), "; ".join(dict.fromkeys(remarks)))


def describe_plant(plan: ImportPlan, plant: str) -> str:
    """Name a plant as the columns show it, such as `uto_robot (3 wheels)`."""
    if plant != "uto_robot":
        return plant
    pose = ", measured pose" if plan.proposal.mapping.defaults.get(POSE_MEASURED) else ""
    return f"{plant} ({wheel_count(list(plan.proposal.mapping.columns))} wheels{pose})"


def write_import(
    plan: ImportPlan, out: Path, force: bool = False, table_format: str = "parquet"
) -> list[str]:
    """Write the dataset, with the mapping beside its runs.

    Returns:
      Notes on what the reader masks, and on what the dataset is good for.

    Raises:
      InputError: The folder is not empty or cannot be written, or the dataset would break a rule.
    """
    mapping = plan.proposal.mapping
    if not plan.proposal.is_complete:
        lacking = (*plan.proposal.missing, *(f"a scale of {name}" for name in plan.proposal.unclear))
        raise InputError(f"--out {out}", "is not written", f"the mapping lacks {', '.join(lacking)}")
    shared = {key: value for key, value in mapping.defaults.items() if FOLDER not in str(value)}
    writer = DatasetWriter(out, mapping.plant, shared, force, table_format, len(plan.runs))
    for run in plan.runs:
        writer.add(run)
    write_text(out / MAPPING_FILE, mapping_text(replace(plan.proposal, remarks={}, hints=())))
    return _read_back(out, plan)


def _read_back(out: Path, plan: ImportPlan) -> list[str]:
    from omnimj.recording.read_dataset import read_dataset

    floors = {str(run.conditions["floor"]) for run in plan.runs if "floor" in run.conditions}
    shipped = set(read_floors())
    words = "is not shipped: give a file that has it with --floors to the commands that read the dataset"
    notes = read_dataset(out, shipped | floors).notes
    return [*notes, *(f"floor {floor!r} {words}" for floor in sorted(floors - shipped))]
