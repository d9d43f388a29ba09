"""Makes the datasets of the benchmark: a rig with wrong constants and hidden effects, real sensors' readings.

A dataset's folder holds what a logger and its owner would know, and nothing of the truth.
"""

from __future__ import annotations

import shutil
from collections.abc import Mapping
from pathlib import Path
from types import MappingProxyType
from typing import Any

import numpy as np

from omnimj.effects import with_effects
from omnimj.errors import SimulationError
from omnimj.gap.benchmark_cases import FLOORS, Case
from omnimj.gap.benchmark_outside import Moment, Outside
from omnimj.gap.benchmark_plan import PlannedRun, planned_runs
from omnimj.gap.uncertain import Based, base_parameters, with_base
from omnimj.loop import drive_rig
from omnimj.parameters import Rig, read_floors, read_rig
from omnimj.physics.effect_terms import TERMS
from omnimj.plant.channels import RIG_CHANNELS
from omnimj.plant.interface import Plant
from omnimj.plant.planar_rig import PlanarRig
from omnimj.recording.dataset import Run
from omnimj.recording.write_dataset import write_dataset
from omnimj.scenario.suites.currents import on_rail
from omnimj.signals import Array, CurrentCommand
from omnimj.twin import slots
from omnimj.twin.twin import RigTwin

MAKERS = ("twin", "planar")
"""What the datasets are made with, the usual one first."""
PLANT = "quarter_rig"


def make_dataset(
    case: Case, folder: Path, made_by: str = "twin", seconds: float = 1.8, conditions: int = 12
) -> None:
    """Drives all runs of a case and writes them; the folder is there whole or not at all.

    Args:
      case: The truth.
      folder: Where to.
      made_by: One of `MAKERS`.
      seconds: Length of a run.
      conditions: How many conditions are driven.

    Raises:
      SimulationError: A run broke down.
      InputError: The folder cannot be written.
    """
    nominal = read_rig()
    truth = true_machine(case)
    runs = [
        _recorded(case, truth, planned, k, made_by)
        for k, planned in enumerate(planned_runs(nominal, case.seed, seconds, conditions))
    ]
    unfinished = folder.with_name(f".{folder.name}")
    shutil.rmtree(unfinished, ignore_errors=True)
    write_dataset(unfinished, PLANT, {}, runs)
    unfinished.replace(folder)


def true_machine(case: Case) -> Based[Rig]:
    """The rig as it really is: constants off their nominal values, effects on top."""
    rig, floors = read_rig(), read_floors()
    base = base_parameters(rig, floors, FLOORS, ())
    based = with_base(rig, floors, base, np.array([case.base[p.name] for p in base]))
    if not case.hidden:
        return based
    effects: dict[str, Mapping[str, Any]] = {one.effect: one.values for one in case.hidden}
    return Based(with_effects(based.machine, effects), based.floors, based.lags, based.mass_scale)


def _recorded(case: Case, truth: Based[Rig], planned: PlannedRun, k: int, made_by: str) -> Run:
    seed = int(np.random.SeedSequence(case.seed, spawn_key=(1, k)).generate_state(1, np.uint64)[0])
    plant = _plant(truth, planned, seed, made_by)
    if case.outside is not None:
        plant = Disturbed(plant, case.outside, Moment(planned.session, planned.mass * truth.mass_scale))
    try:
        trace = drive_rig(plant, planned.current)
    finally:
        plant.close()
    if trace.about["failure"]:
        raise SimulationError(f"{case.name}, {planned.name}: {trace.about['failure']}")
    if trace.about["interrupted"]:
        raise KeyboardInterrupt
    rows = on_rail(truth.machine, trace["carriage_position"], trace["lateral_position"])
    columns = {name: trace[name][:rows] for name in ("time", *RIG_CHANNELS, "current_target")}
    if case.outside is not None:
        columns = case.outside.bend_readings(columns, trace["carriage_position"][:rows])
    conditions = MappingProxyType({"floor": planned.floor, "mass": planned.mass})
    return Run(planned.name, columns, MappingProxyType({}), conditions, planned.condition)


def _plant(truth: Based[Rig], planned: PlannedRun, seed: int, made_by: str) -> Plant:
    mass = planned.mass * truth.mass_scale
    if made_by == "planar":
        return PlanarRig(
            truth.machine,
            planned.floor,
            mass=mass,
            lateral_speed=planned.lateral_speed,
            seed=seed,
            floors=truth.floors,
        )
    return RigTwin(truth.machine, truth.floors[planned.floor], mass, planned.lateral_speed, seed=seed)


class Disturbed:
    """A rig whose effects' row is written anew before every sample; a `Plant`."""

    def __init__(self, plant: Plant, outside: Outside, run: Moment):
        self._plant, self._outside, self._run = plant, outside, run
        self.period, self.truth_names = plant.period, plant.truth_names
        self._steps = 0

    def reset(self) -> Any:
        """The rig at rest."""
        self._steps = 0
        measured = self._plant.reset()
        self._disturb()
        return measured

    def step(self, command: CurrentCommand) -> Any:
        """One sample period with what holds at its start."""
        self._disturb()
        self._steps += 1
        return self._plant.step(command)

    def _disturb(self) -> None:
        position, speed = self._plant.truth()[:2].tolist()
        time = self._steps * self.period
        self._outside.write_terms(_terms(self._plant), self._run, time, position, speed)

    def truth(self) -> Array:
        """Of the rig."""
        return self._plant.truth()

    def close(self) -> None:
        """Closes the rig."""
        self._plant.close()


def _terms(plant: Plant) -> Array:
    """The row of terms that a rig's kernels read at every step, shape (TERMS,)."""
    if isinstance(plant, RigTwin):
        return plant.mj_model.actuator_user[0, slots.TERM : slots.TERM + TERMS]
    assert isinstance(plant, PlanarRig)
    return plant._terms
