"""Recording of a suite as a dataset, run by run."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from types import MappingProxyType
from typing import Any

import numpy as np

from omnimj.effects import apply_effects
from omnimj.errors import InputError, UnknownNameError
from omnimj.parameters import Robot
from omnimj.parameters.floor import all_floors
from omnimj.recording.dataset import INERTIAL_UNIT, Run
from omnimj.recording.dataset_file import POSE_MEASURED
from omnimj.recording.write_dataset import DatasetWriter
from omnimj.signals import Array
from omnimj.simulate.loop import Progress
from omnimj.simulate.suites.suite import MAX_REPEATS, PlannedRun, RunConfig, Suite, planned_runs

_PROGRESS_PER_RUN = 100  # progress units of one run


@dataclass(frozen=True)
class RecordingConfig:
    """Configuration of a recording."""

    folder: Path
    seed: int = 0
    repeats: int | None = None
    """Number of runs per condition; that of the suite when None."""
    plant: str | None = None
    """`twin` or `planar`; the suite's default when None."""
    model_file: Path | None = None
    """Model file of the plant; the shipped one when None."""
    floors_file: Path | None = None
    """File with floors that are added to the shipped ones or, under the same name, replace them."""
    effects: Mapping[str, Mapping[str, Any]] = field(default_factory=dict)
    """Effects added to the true machine, by name; its model file and the dataset do not mention them."""
    table_format: str = "parquet"
    force: bool = False
    pose_rate: float | None = None
    """Rate at which a robot's pose is recorded instead of its inertial unit [1/s]; the unit when None."""


@dataclass(frozen=True)
class RecordingResult:
    """Result of `record_suite`."""

    runs: tuple[str, ...]
    """Names of the runs in the dataset."""
    planned: int
    samples: int
    interrupted: bool
    """True if Ctrl-C ended the recording."""


def record_suite(
    suite: Suite,
    config: RecordingConfig,
    progress: Progress | None = None,
    choose: Callable[[list[PlannedRun]], list[PlannedRun]] | None = None,
) -> RecordingResult:
    """Drive all runs of a suite and write them as a dataset, each as soon as it is finished.

    The folder contains only what a real logger would record: neither effects nor seeds.

    Args:
      suite: The test plan.
      config: Folder, seed, plant and files.
      progress: Called with the work done and the total work.
      choose: Function that selects some of the planned runs; all when None.

    Raises:
      InputError: The folder cannot be written, or a value breaks its rule.
      UnknownNameError: No such plant, format or effect.
      SimulationError: The simulation failed; runs finished before are kept.
    """
    plant = plant_for(suite, config.plant)
    if config.repeats is not None and not 1 <= config.repeats <= MAX_REPEATS:
        rule = f"must be at least 1 and at most {MAX_REPEATS}"
        raise InputError("--repeats", f"found {config.repeats}", rule)
    if config.pose_rate is not None and suite.plant != "uto_robot":
        raise InputError("--pose-rate", f"{suite.name} records {suite.plant}", "only robots have a pose")
    nominal = suite.read_machine(config.model_file)
    machine = _with_effects(nominal, config.effects)
    runs = planned_runs(suite, nominal, config.seed, config.repeats)
    runs = runs if choose is None else choose(runs)
    defaults, floors = _common_conditions(runs), all_floors(config.floors_file)
    if config.pose_rate is not None:
        defaults = defaults | {POSE_MEASURED: True}
    writer = DatasetWriter(config.folder, suite.plant, defaults, config.force, config.table_format, len(runs))
    written, samples = [], 0
    try:
        for k, run in enumerate(runs):
            run_config = RunConfig(plant, run.seed, _run_progress(progress, k, len(runs)), floors)
            columns = suite.record(machine, nominal, run.condition, run_config)
            if config.pose_rate is not None:
                columns = with_measured_pose(columns, config.pose_rate, machine)
            conditions = MappingProxyType(dict(run.condition.conditions))
            writer.add(Run(run.name, columns, MappingProxyType({}), conditions, run.repeat_of))
            written.append(run.name)
            samples += len(columns["time"])
    except KeyboardInterrupt:
        return RecordingResult(tuple(written), len(runs), samples, True)
    return RecordingResult(tuple(written), len(runs), samples, False)


def with_measured_pose(columns: Mapping[str, Array], rate: float, machine: Robot) -> dict[str, Array]:
    """Turn the log of a robot into one with a measured pose and no inertial unit.

    Args:
      columns: Log with `time`, `x`, `y` and `heading`, each shape (n,).
      rate: Samples per second of the result, of which every k-th row of the log is one.
      machine: Robot, whose effects of the measured pose are applied.

    Returns:
      Columns, each shape (⌈n/k⌉,).
    """
    step = float(np.median(np.diff(columns["time"])))
    every = slice(None, None, max(1, round(1.0 / (rate * step))))
    found = {name: values[every].copy() for name, values in columns.items() if name not in INERTIAL_UNIT}
    readings = apply_effects(machine).channels
    for name in ("x", "y", "heading"):
        if (reading := readings.get(name)) is not None:
            found[name] = reading.scale * found[name] + reading.offset
    return found


def plant_for(suite: Suite, choice: str | None) -> str:
    """Plant to record with: the user's choice, or the suite's default.

    Raises:
      UnknownNameError: The suite has no such plant.
    """
    if choice is not None and choice not in suite.plants:
        raise UnknownNameError("--plant", f"plant of {suite.name}", choice, suite.plants)
    return choice or suite.plants[0]


def _with_effects(machine: Any, effects: Mapping[str, Mapping[str, Any]]) -> Any:
    if not effects:
        return machine
    from omnimj.effects import with_effects
    from omnimj.plant.mujoco.machine import Machine, with_part_effects

    if isinstance(machine, Machine):
        return with_part_effects(machine, effects)
    return with_effects(machine, effects)


def _common_conditions(runs: list[PlannedRun]) -> dict[str, float | str | bool]:
    """Conditions that all runs share."""
    first = dict(runs[0].condition.conditions)
    return {k: v for k, v in first.items() if all(run.condition.conditions.get(k) == v for run in runs)}


def _run_progress(progress: Progress | None, k: int, runs: int) -> Progress | None:
    if progress is None:
        return None
    return lambda done, total: progress(
        _PROGRESS_PER_RUN * k + _PROGRESS_PER_RUN * done // total, _PROGRESS_PER_RUN * runs
    )
