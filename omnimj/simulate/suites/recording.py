"""Records a suite into a dataset, run by run."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from types import MappingProxyType
from typing import Any

from omnimj.errors import InputError, UnknownNameError
from omnimj.parameters.floor import all_floors
from omnimj.recording.dataset import Run
from omnimj.recording.write_dataset import DatasetWriter
from omnimj.simulate.loop import Progress
from omnimj.simulate.suites.suite import MAX_REPEATS, PlannedRun, RunConfig, Suite, planned_runs

_PROGRESS_PER_RUN = 100  # parts of a run in the progress


@dataclass(frozen=True)
class RecordingConfig:
    """What is to be recorded, beside the suite itself."""

    folder: Path
    seed: int = 0
    repeats: int | None = None
    """Of every condition; as the suite has it when None."""
    plant: str | None = None
    """`twin` or `planar`; the suite's usual one when None."""
    model_file: Path | None = None
    """A copy of the plant's model file; the shipped one when None."""
    floors_file: Path | None = None
    """Floors beside the shipped ones, or in their place where names are alike."""
    effects: Mapping[str, Mapping[str, Any]] = field(default_factory=dict)
    """What the machine has and its model file lacks, by name. The dataset does not tell."""
    table_format: str = "parquet"
    force: bool = False


@dataclass(frozen=True)
class RecordingResult:
    """What came of it."""

    runs: tuple[str, ...]
    """Runs that are in the dataset."""
    planned: int
    samples: int
    interrupted: bool
    """Whether Ctrl-C ended it."""


def record_suite(
    suite: Suite,
    order: RecordingConfig,
    progress: Progress | None = None,
    choose: Callable[[list[PlannedRun]], list[PlannedRun]] | None = None,
) -> RecordingResult:
    """Drives all runs of a suite and writes them as a dataset.

    The folder gets what a real logger and its owner would know, neither effects nor seeds. Each run is
    there as soon as it was driven.

    Args:
      suite: The test plan.
      order: Where to, and how.
      progress: Called now and then with the work done and the work in all.
      choose: Some of the planned runs, for a look or a test; all when None.

    Raises:
      InputError: The folder cannot be written, or a value breaks its rule.
      UnknownNameError: No such plant, format or effect.
      SimulationError: The simulation broke down; runs finished before are kept.
    """
    plant = plant_for(suite, order.plant)
    if order.repeats is not None and not 1 <= order.repeats <= MAX_REPEATS:
        rule = f"must be at least 1 and at most {MAX_REPEATS}"
        raise InputError("--repeats", f"found {order.repeats}", rule)
    nominal = suite.read_machine(order.model_file)
    machine = _with_effects(nominal, order.effects)
    runs = planned_runs(suite, nominal, order.seed, order.repeats)
    runs = runs if choose is None else choose(runs)
    defaults, floors = _common_conditions(runs), all_floors(order.floors_file)
    writer = DatasetWriter(order.folder, suite.plant, defaults, order.force, order.table_format)
    written, samples = [], 0
    try:
        for k, run in enumerate(runs):
            how = RunConfig(plant, run.seed, _run_progress(progress, k, len(runs)), floors)
            columns = suite.record(machine, nominal, run.condition, how)
            conditions = MappingProxyType(dict(run.condition.conditions))
            writer.add(Run(run.name, columns, MappingProxyType({}), conditions, run.repeat_of))
            written.append(run.name)
            samples += len(columns["time"])
    except KeyboardInterrupt:
        return RecordingResult(tuple(written), len(runs), samples, True)
    return RecordingResult(tuple(written), len(runs), samples, False)


def plant_for(suite: Suite, asked: str | None) -> str:
    """The kind of plant to record with: the suite's usual one unless asked otherwise.

    Raises:
      UnknownNameError: The suite has no such plant.
    """
    if asked is not None and asked not in suite.plants:
        raise UnknownNameError("--plant", f"plant of {suite.name}", asked, suite.plants)
    return asked or suite.plants[0]


def _with_effects(machine: Any, effects: Mapping[str, Mapping[str, Any]]) -> Any:
    if not effects:
        return machine
    from omnimj.effects import with_effects

    return with_effects(machine, effects)


def _common_conditions(runs: list[PlannedRun]) -> dict[str, float | str]:
    """What holds for every run."""
    first = dict(runs[0].condition.conditions)
    return {k: v for k, v in first.items() if all(run.condition.conditions.get(k) == v for run in runs)}


def _run_progress(progress: Progress | None, k: int, runs: int) -> Progress | None:
    if progress is None:
        return None
    return lambda done, total: progress(
        _PROGRESS_PER_RUN * k + _PROGRESS_PER_RUN * done // total, _PROGRESS_PER_RUN * runs
    )
