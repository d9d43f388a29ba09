"""Datasets of the benchmark: recordings of a rig with parameter errors and hidden effects.

The folder of a dataset holds what a data logger and its user would know; the truth is stored elsewhere.
"""

from __future__ import annotations

import dataclasses
import shutil
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from types import MappingProxyType
from typing import Any

import numpy as np

from omnimj.effects import RIG, apply_effects, with_effects
from omnimj.estimate.replay.base_parameters import AdjustedMachine, adjust_machine, base_parameters
from omnimj.parameters import Rig, read_floors, read_rig
from omnimj.physics.effect_terms import apply_motor_effects, terms_at
from omnimj.physics.motor import achievable_current, motor_parameters
from omnimj.plant.interface import RIG_CHANNELS
from omnimj.plant.mujoco.twin import RigTwin
from omnimj.plant.planar_rig import PlanarRig
from omnimj.recording.dataset import Run
from omnimj.recording.dataset_file import DATASET_FILE
from omnimj.recording.write_dataset import toml_text, write_dataset
from omnimj.signals import Array, CurrentCommand
from omnimj.simulate.driving import drive_rig
from omnimj.simulate.loop import require_complete
from omnimj.simulate.plants import make_simulated
from omnimj.simulate.suites.rig import samples_on_rail
from omnimj.studies.gap_benchmark.cases import FLOORS, Case, HiddenEffect
from omnimj.studies.gap_benchmark.unmodelled import Motion, RunContext, UnmodelledEffect

_REST = 0.1  # [s] without current at the start, in which the accelerometer shows its offset
_SPREAD = 0.08  # half-width of the random deviation of a current, relative


@dataclass(frozen=True)
class PlannedRun:
    """Planned run; repeats share their condition."""

    name: str
    condition: str
    current: Array
    """Commanded current, one per sample, shape (k,) [A]."""
    floor: str
    mass: float
    """Declared mass [kg]."""
    lateral_speed: float
    session: float
    """Position in the series of runs, 0 … 1."""


# profile, current [A], index of the mass, floor, lateral speed [m/s], repeats
_PLAN = (
    ("constant", 0.45, 0, "natural_stone", 0.0, 2),
    ("reversing", 0.90, 0, "natural_stone", 0.0, 2),
    ("ramp", 1.50, 1, "pvc", 0.0, 1),
    ("pulse", 1.05, 2, "paperboard", 0.0, 1),
    ("reversing", 0.75, 0, "paperboard", 0.0, 1),
    ("constant", 1.50, 2, "natural_stone", 0.0, 1),
    ("pulse", 0.75, 0, "pvc", 0.0, 2),
    ("reversing", 0.35, 1, "pvc", 0.0, 1),
    ("constant", 0.75, 0, "natural_stone", 0.35, 2),
    ("reversing", 0.90, 1, "natural_stone", -0.30, 1),
    ("ramp", 1.20, 0, "pvc", 0.25, 1),
    ("constant", 1.05, 2, "paperboard", -0.25, 1),
)


def planned_runs(rig: Rig, seed: int, seconds: float = 1.8, conditions: int = len(_PLAN)) -> list[PlannedRun]:
    """Return the planned runs of one dataset.

    Args:
      rig: Nominal rig with masses and sample rate.
      seed: Seed of the small differences of currents between datasets.
      seconds: Duration of a run that does not reach the end of the rail before [s].
      conditions: Number of conditions, the first of twelve.
    """
    random = np.random.default_rng(np.random.SeedSequence(seed, spawn_key=(0,)))
    runs = []
    for k, (profile, current, mass, floor, lateral, repeats) in enumerate(_PLAN[:conditions]):
        size = current * (1.0 + _SPREAD * float(random.uniform(-1.0, 1.0)))
        values = current_profile(profile, min(size, 1.5), seconds, rig.sensors.sample_rate)
        name, load = f"run_{k:02d}", rig.rig.masses[mass]
        runs += [(f"{name}{letter}", name, values, floor, load, lateral) for letter in "ab"[:repeats]]
    last = max(len(runs) - 1, 1)
    return [PlannedRun(*run, session=k / last) for k, run in enumerate(runs)]


def current_profile(profile: str, size: float, seconds: float, rate: float) -> Array:
    """Return a current profile that begins with a rest.

    Args:
      profile: `reversing`, `pulse`, `ramp` or `constant`.
      size: Amplitude [A].
      seconds: Duration [s].
      rate: Sample rate [1/s].

    Returns:
      Current, shape (seconds · rate + 1,) [A].
    """
    time = np.arange(round(seconds * rate) + 1) / rate
    since = time - _REST
    if profile == "reversing":
        shape = np.where(np.floor(since / 0.5).astype(int) % 2 == 0, 1.0, -1.0)
    elif profile == "pulse":
        shape = np.where(since < 0.7, 1.0, 0.0)
    elif profile == "ramp":
        shape = np.minimum(since / 1.2, 1.0)
    else:
        shape = np.ones(len(time))
    return np.where(since < 0.0, 0.0, size * shape)


MAKERS = ("twin", "planar")
"""Plants that make the datasets, the default first."""


def make_dataset(
    case: Case, folder: Path, made_by: str = "twin", seconds: float = 1.8, conditions: int = 12
) -> None:
    """Drive and write all runs of a case; the folder appears in full or not at all.

    Raises:
      SimulationError: A run failed.
      InputError: The folder cannot be written.
    """
    nominal = read_rig()
    truth = true_machine(case)
    runs = [
        _recorded(case, truth, planned, k, made_by)
        for k, planned in enumerate(planned_runs(nominal, case.seed, seconds, conditions))
    ]
    write_whole_dataset(folder, RIG, runs)


def write_whole_dataset(folder: Path, plant: str, runs: Sequence[Run], model: Path | None = None) -> None:
    """Write a dataset whose folder appears in full or not at all.

    Args:
      folder: Folder of the dataset.
      plant: Its plant.
      runs: Its runs.
      model: MJCF file of the machine, which the dataset names; none when None.

    Raises:
      InputError: The folder cannot be written.
    """
    unfinished = folder.with_name(f".{folder.name}")
    shutil.rmtree(unfinished, ignore_errors=True)
    write_dataset(unfinished, plant, {}, runs)
    if model is not None:
        file = unfinished / DATASET_FILE
        text = f"model = {toml_text(str(model.resolve()))}\n{file.read_text(encoding='utf-8')}"
        file.write_text(text, encoding="utf-8")
    unfinished.replace(folder)


def true_machine(case: Case) -> AdjustedMachine[Rig]:
    """Return the true rig of a case, with parameter errors and hidden effects."""
    rig, floors = read_rig(), read_floors()
    base = base_parameters(rig, floors, FLOORS, ())
    adjusted = adjust_machine(rig, floors, base, np.array([case.base[p.name] for p in base]))
    if not case.hidden:
        return adjusted
    effects: dict[str, Mapping[str, Any]] = {one.effect: one.values for one in case.hidden}
    return dataclasses.replace(adjusted, machine=with_effects(adjusted.machine, effects))


def _recorded(case: Case, truth: AdjustedMachine[Rig], planned: PlannedRun, k: int, made_by: str) -> Run:
    seed = int(np.random.SeedSequence(case.seed, spawn_key=(1, k)).generate_state(1, np.uint64)[0])
    options = {"mass": planned.mass * truth.mass_scale, "lateral_speed": planned.lateral_speed, "seed": seed}
    plant: Any = make_simulated(made_by, truth.machine, planned.floor, truth.floors, **options)
    if case.unmodelled:
        context = RunContext(planned.session, options["mass"])
        plant = DisturbedPlant(plant, case.unmodelled, context, truth.machine)
    try:
        trace = drive_rig(plant, planned.current)
    finally:
        plant.close()
    require_complete(trace, f"{case.name}, {planned.name}")
    rows = samples_on_rail(truth.machine, trace["carriage_position"], trace["lateral_position"])
    columns = {name: trace[name][:rows] for name in ("time", *RIG_CHANNELS, "current_target")}
    for effect in case.unmodelled:
        columns = effect.bend_readings(columns, trace["carriage_position"][:rows])
    conditions = MappingProxyType({"floor": planned.floor, "mass": planned.mass})
    return Run(planned.name, columns, MappingProxyType({}), conditions, planned.condition)


class DisturbedPlant:
    """A rig with physics outside the library, written into its terms before every sample; a `Plant`."""

    def __init__(
        self,
        plant: PlanarRig | RigTwin,
        effects: tuple[UnmodelledEffect, ...],
        context: RunContext,
        machine: Rig,
    ):
        self._plant, self._effects, self._context = plant, effects, context
        self.period, self.truth_names = plant.period, plant.truth_names
        (self._motor,) = apply_effects(machine).motors((motor_parameters(machine.motor),))
        self._own_terms = plant.effect_terms.copy()
        self._steps, self._angle = 0, 0.0

    def reset(self) -> Any:
        """Put the rig to rest."""
        self._steps, self._angle = 0, 0.0
        measured = self._plant.reset()
        self._disturb(0.0)
        return measured

    def step(self, command: CurrentCommand) -> Any:
        """Advance one sample period with the terms at its start."""
        self._disturb(float(command.current[0]))
        self._steps += 1
        return self._plant.step(command)

    def _disturb(self, command: float) -> None:
        position, speed, wheel_speed = self._plant.truth()[:3].tolist()
        time = self._steps * self.period
        warm = apply_motor_effects(self._motor, terms_at(self._own_terms), time, 0.0)
        current = achievable_current(warm, command, wheel_speed)
        motion = Motion(time, position, speed, self._angle, current)
        self._angle += wheel_speed * self.period
        self._plant.effect_terms[:] = self._own_terms
        for effect in self._effects:
            effect.write_terms(self._plant.effect_terms, self._context, motion)

    def truth(self) -> Array:
        """Return the truth of the rig by `truth_names`, shape (len(truth_names),)."""
        return self._plant.truth()

    def close(self) -> None:
        """Close the rig."""
        self._plant.close()


def true_values(hidden: HiddenEffect, case: Case) -> dict[str, float]:
    """Return the true values relative to the nominal model: hidden values plus parameter errors of the base.

    The errors matter where the base has the same quantity: torque constant, wheel radius, rail friction,
    load, traction.
    """
    rig = read_rig()
    true = {k: float(v) for k, v in hidden.values.items() if not isinstance(v, str)}
    base = case.base
    if hidden.effect == "torque_constant":
        true["scale"] *= base["motor.torque_constant"] / rig.motor.torque_constant
    elif hidden.effect == "wheel_radius":
        true["scale"] *= base["wheel.radius"] / rig.wheel.radius
    elif hidden.effect == "rail_coulomb":
        true["force"] += base["rig.rail_friction"] - rig.rig.rail_friction
    elif hidden.effect == "payload":
        loads = [run.mass for run in planned_runs(rig, case.seed)]
        true["mass"] += (base["mass.scale"] - 1.0) * sum(loads) / len(loads)
    elif hidden.effect == "floor_traction":
        for letter in true:
            scales = [base.get(f"{floor}.{letter}", 1.0) for floor in FLOORS]
            true[letter] *= sum(scales) / len(scales)
    return true
