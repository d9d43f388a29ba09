"""Suites: test plans for one plant, run by run."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from omnimj.parameters import Floor, read_floors
from omnimj.signals import Array
from omnimj.simulate.loop import Progress

MAX_REPEATS = 26
"""Largest number of repeats, since they have the suffixes a … z."""


@dataclass(frozen=True)
class Condition:
    """One set of conditions, driven once, or repeatedly for the repeatability floor."""

    name: str
    """Name of the runs, without the suffix of a repeat."""
    conditions: Mapping[str, float | str]
    """Conditions recorded in the dataset, such as `floor` and `mass`."""
    drive: Any
    """Motion or input, in the form that the suite's `record` takes."""
    repeats: int | None = None
    """Number of runs unless the user sets it; the suite's number when None."""


@dataclass(frozen=True)
class RunConfig:
    """Configuration of one recorded run."""

    plant: str
    """`twin` or `planar`."""
    seed: int
    """Seed of the sensor noise of this run."""
    progress: Progress | None = None
    floors: Mapping[str, Floor] = field(default_factory=read_floors)
    """All floors by name."""


RecordRun = Callable[[Any, Any, Condition, RunConfig], Mapping[str, Array]]
"""Function of (true machine with its effects, nominal machine that the controller assumes, condition,
configuration) that drives one run and returns its columns, shape (samples,) each. It raises SimulationError
where the simulation fails, KeyboardInterrupt after Ctrl-C."""


@dataclass(frozen=True)
class Suite:
    """A test plan."""

    name: str
    description: str
    plant: str
    """Name of the plant in datasets, and of its folder in `models/`."""
    read_machine: Callable[[Path | None], Any]
    """Function that reads a model file, or the shipped one for None."""
    plan: Callable[[Any, int], Sequence[Condition]]
    """Function of nominal machine and seed that returns the conditions."""
    record: RecordRun
    repeats: int = 1
    """Number of runs per condition."""
    plants: tuple[str, ...] = ("twin", "planar")
    """Simulated plants with which the suite can be recorded, the default first."""


@dataclass(frozen=True)
class PlannedRun:
    """One run of a suite."""

    name: str
    condition: Condition
    repeat_of: str | None
    """Name of the condition if it has several runs, otherwise None."""
    seed: int
    """Seed of the run's sensor noise."""


def planned_runs(suite: Suite, machine: Any, seed: int, repeats: int | None = None) -> list[PlannedRun]:
    """List the runs of a suite in order; the noise of run k is seeded by `SeedSequence(seed, k)`.

    Args:
      suite: The test plan.
      machine: The nominal machine.
      seed: Seed of the dataset.
      repeats: Runs per condition; the suite's number when None.
    """
    runs: list[PlannedRun] = []
    for condition in suite.plan(machine, seed):
        times = repeats or condition.repeats or suite.repeats
        for letter in "abcdefghijklmnopqrstuvwxyz"[:times]:
            own = np.random.SeedSequence(seed, spawn_key=(len(runs),)).generate_state(1, np.uint64)[0]
            name, of = (f"{condition.name}_{letter}", condition.name) if times > 1 else (condition.name, None)
            runs.append(PlannedRun(name, condition, of, int(own)))
    return runs
