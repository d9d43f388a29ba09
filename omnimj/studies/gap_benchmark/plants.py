"""Machines of the benchmark: the rig, and any machine with an MJCF file."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import NamedTuple

from omnimj.effects import MJCF, RIG
from omnimj.errors import UnknownNameError
from omnimj.studies.gap_benchmark import cases, datasets, machine_cases
from omnimj.studies.gap_benchmark.cases import Case, HiddenEffect


class BenchmarkPlant(NamedTuple):
    """Properties of a machine that the benchmark needs."""

    library: str
    """Plant whose effects are hidden."""
    makers: tuple[str, ...]
    """Choices of what makes the datasets, the default first."""
    draw: Callable[[int, int], list[Case]]
    """Draw all cases by seed and number of trials."""
    true_values: Callable[[HiddenEffect, Case], dict[str, float]]
    """Values of a hidden effect relative to the nominal machine."""


def benchmark_plant(name: str) -> BenchmarkPlant:
    """Return a machine by its name, or by the path of its MJCF file.

    Raises:
      UnknownNameError: Neither a name nor the path of an MJCF file.
    """
    if name == RIG:
        return BenchmarkPlant(RIG, datasets.MAKERS, cases.draw_cases, datasets.true_values)
    if name not in machine_cases.SHIPPED and Path(name).suffix != ".xml":
        choices = (RIG, *machine_cases.SHIPPED, "PATH/NAME.xml")
        raise UnknownNameError("--plant", "plant of the benchmark", name, choices)

    def draw(seed: int, trials: int) -> list[Case]:
        return machine_cases.draw_machine_cases(name, seed, trials)

    return BenchmarkPlant(MJCF, datasets.MAKERS[:1], draw, machine_cases.machine_true_values)


def make_dataset(case: Case, folder: Path, made_by: str, seconds: float, conditions: int) -> None:
    """Drive and write all runs of a case; the folder appears in full or not at all.

    Args:
      case: The case.
      folder: Folder of its dataset.
      made_by: What makes the datasets of the rig, one of `datasets.MAKERS`.
      seconds: Duration of a run of the rig [s].
      conditions: Number of conditions of the rig.

    Raises:
      SimulationError: A run failed.
      InputError: The folder cannot be written.
    """
    if case.plant == RIG:
        datasets.make_dataset(case, folder, made_by, seconds, conditions)
    else:
        machine_cases.make_machine_dataset(case, folder)
