"""What a suite is: a test plan for one plant, run by run."""

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
"""Repeats are called a … z."""


@dataclass(frozen=True)
class Condition:
    """One set of conditions that is driven once, or more often for the repeatability floor."""

    name: str
    """What its runs are called."""
    conditions: Mapping[str, float | str]
    """What the logger's owner writes down: `floor`, `mass`."""
    drive: Any
    """What the plant is asked to do, as the suite's `record` understands it."""
    repeats: int | None = None
    """How often, unless the user asks for another number; the suite's own number when None."""


@dataclass(frozen=True)
class RunConfig:
    """How one run is to be recorded."""

    plant: str
    """`twin` or `planar`."""
    seed: int
    """Of the sensors' noise in this run alone."""
    progress: Progress | None = None
    floors: Mapping[str, Floor] = field(default_factory=read_floors)
    """Every floor that can be named."""


RecordRun = Callable[[Any, Any, Condition, RunConfig], Mapping[str, Array]]
"""Drives one run: the machine with its effects, the nominal one that the user believes in, condition, how.
Returns the columns that a logger would have."""


@dataclass(frozen=True)
class Suite:
    """A test plan."""

    name: str
    description: str
    plant: str
    """Folder of the plant under `models/`, as the dataset names it."""
    read_machine: Callable[[Path | None], Any]
    """Reads the model file; the shipped one when None."""
    plan: Callable[[Any, int], Sequence[Condition]]
    """Conditions from the nominal machine and a seed."""
    record: RecordRun
    repeats: int = 1
    """How often each condition is driven."""
    plants: tuple[str, ...] = ("twin", "planar")
    """Kinds of simulation that it can be recorded with, the usual one first."""


@dataclass(frozen=True)
class PlannedRun:
    """One run of a suite."""

    name: str
    condition: Condition
    repeat_of: str | None
    """The condition's name where it is driven more than once."""
    seed: int
    """Of its sensors' noise."""


def planned_runs(suite: Suite, machine: Any, seed: int, repeats: int | None = None) -> list[PlannedRun]:
    """All runs of a suite in their order; run k's noise comes from `SeedSequence(seed, k)`.

    Args:
      suite: The test plan.
      machine: The nominal machine.
      seed: Of the whole dataset.
      repeats: Of every condition; as the suite has it when None.
    """
    runs: list[PlannedRun] = []
    for condition in suite.plan(machine, seed):
        times = repeats or condition.repeats or suite.repeats
        for letter in "abcdefghijklmnopqrstuvwxyz"[:times]:
            own = np.random.SeedSequence(seed, spawn_key=(len(runs),)).generate_state(1, np.uint64)[0]
            name, of = (f"{condition.name}_{letter}", condition.name) if times > 1 else (condition.name, None)
            runs.append(PlannedRun(name, condition, of, int(own)))
    return runs
