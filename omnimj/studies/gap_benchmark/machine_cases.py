"""Cases of the benchmark on any machine with an MJCF file, and their datasets.

The library of a machine depends on its parts and on the size of its motion, so the effects to hide are those
that the search would try on a recording without any.
"""

from __future__ import annotations

import dataclasses
import functools
from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np

from omnimj.effects import MJCF
from omnimj.effects.parts import JOINT
from omnimj.errors import InputError
from omnimj.estimate.replay.interface import CandidateEffect
from omnimj.estimate.replay.mjcf.replay import MachineReplay
from omnimj.plant.mujoco.machine import Machine, read_machine_file
from omnimj.plant.mujoco.quantities import QUANTITIES
from omnimj.recording.dataset import Dataset, Run
from omnimj.resources import models_folder
from omnimj.simulate.machine.drive import (
    MachineLoop,
    Plan,
    declared_values,
    logged_run,
    machine_loop,
    simulated_rows,
)
from omnimj.simulate.machine.truth import MachineTruth, machine_truth
from omnimj.studies.gap_benchmark.cases import (
    DEVIATION,
    FOREIGN,
    SIZES,
    WITHIN,
    Case,
    HiddenEffect,
    value_at,
)
from omnimj.studies.gap_benchmark.datasets import write_whole_dataset
from omnimj.studies.gap_benchmark.hand_equations import has_hand_equations, integrated_rows
from omnimj.studies.gap_benchmark.unmodelled import UnmodelledEffect

SHIPPED = ("servo_arm", "two_link_arm", "linear_axis")
"""Machines of the shipped models; any other is given by the path of its MJCF file."""
EQUATIONS, MUJOCO = "equations", "mujoco"
"""Makers of datasets: equations written by hand, integrated by scipy, and MuJoCo in fine steps."""

_EMPTY, _SINGLE, _PAIRS = 15, 27, 18  # numbers of cases per trial
_BY_HAND = 1 / 3  # share of the cases by equations, where there are some
_RUNS, _PROBES = 8, 3  # runs of a dataset, and of the recording that shows the library
_BESIDE_MOTOR = ("compliance", "backlash")
"""Effects between motor and link: they need a motor with inertia, which hand-written equations lack."""
_ALIKE = (
    frozenset({"actuator_delay", "sensor_delay"}),
    frozenset({"gain", "torque_constant", "back_emf"}),
    frozenset({"saturation", "soft_saturation"}),
    frozenset({"armature", "payload"}),
    frozenset({"load_friction", "back_driving"}),
    frozenset({"force_offset", "grade"}),
    frozenset(_BESIDE_MOTOR),
)
"""Effects that one joint's logs hardly separate: two of a set are never hidden together."""
_FOREIGN_SIZES = {"friction_law": 0.015, "drive_ripple": 0.015, "gear_law": 0.05}
"""Noticeable deviations: dry friction and ripple over the joint's RMS force, share of the force lost at top
speed."""
_LENGTHS = {"friction_law": (0.05, 0.3), "drive_ripple": (3.0, 9.0), "gear_law": (1.0, 1.0)}
"""Ranges: speed over the top speed, waves in the range of the motion."""


class JointSize(NamedTuple):
    """Sizes of the motion and force of a joint, to which physics outside the library is relative."""

    force: float
    """RMS [N.m or N]."""
    speed: float
    """Largest [rad/s or m/s]."""
    reach: float
    """Range of its positions [rad or m]."""


class MachineLibrary(NamedTuple):
    """Machine of a benchmark, its loop, and what the search would try on its logs."""

    loop: MachineLoop
    candidates: tuple[CandidateEffect, ...]
    sizes: tuple[JointSize, ...]

    @property
    def machine(self) -> Machine:
        """The nominal machine."""
        return self.loop.machine


@functools.lru_cache(maxsize=4)
def machine_library(plant: str) -> MachineLibrary:
    """The machine of a plant's name and its library, from a recording without hidden effects.

    Args:
      plant: One of `SHIPPED`, or the path of an MJCF file.

    Raises:
      InputError: The file cannot be read, or describes a machine that the search refuses.
    """
    file = models_folder() / plant / f"{plant}.xml" if plant in SHIPPED else Path(plant)
    machine = read_machine_file(file)
    if machine.effects:
        raise InputError(
            f"{machine.facts}: effects", f"found {', '.join(machine.effects)}", "must be empty here"
        )
    loop = machine_loop(machine)
    truth = machine_truth(machine, declared_values(machine))
    runs = tuple(_run(truth, loop, k, MUJOCO, k) for k in range(_PROBES))
    replay = MachineReplay(Dataset(machine.file, MJCF, runs), machine)
    spans = [replay.spans[name] for name in machine.joints]
    sizes = tuple(JointSize(s.force, s.speed, s.high - s.low) for s in spans)
    still = {name for name, own in zip(machine.joints, truth.joints, strict=True) if own.armature <= 0.0}
    candidates = tuple(c for c in replay.candidates if _can_be_simulated(c, still))
    return MachineLibrary(loop, candidates, sizes)


def _can_be_simulated(candidate: CandidateEffect, without_motor: set[str]) -> bool:
    """False for a spring or play behind a motor without inertia."""
    return candidate.effect not in _BESIDE_MOTOR or candidate.selectors[JOINT] not in without_motor


def draw_machine_cases(plant: str, seed: int, trials: int = 1) -> list[Case]:
    """Draw all cases in the order of their names; the first of them are a random choice.

    Args:
      plant: One of `SHIPPED`, or the path of an MJCF file.
      seed: Seed of the draw.
      trials: Number of times that the whole set is drawn.
    """
    library = machine_library(plant)
    generator = np.random.default_rng(np.random.SeedSequence(seed))
    wanted: list[tuple[str, str, str]] = []
    for _ in range(trials):
        names = list(dict.fromkeys(c.effect for c in library.candidates))
        order = [names[k] for k in generator.permutation(len(names))]
        sizes = list(SIZES)
        turns = [divmod(k, len(order)) for k in range(_SINGLE)]
        wanted += [("single", order[k], sizes[(k + turn) % len(sizes)]) for turn, k in turns]
        wanted += [("pair", "", "")] * _PAIRS + [("null", "", "")] * _EMPTY
    cases = []
    digits = max(3, len(str(len(wanted) - 1)))
    for k, place in enumerate(generator.permutation(len(wanted)).tolist()):
        random = np.random.default_rng(np.random.SeedSequence(seed, spawn_key=(1, place)))
        cases.append(_drawn_case(library, plant, f"case_{k:0{digits}d}", wanted[place], random))
    return cases


def _drawn_case(
    library: MachineLibrary, plant: str, name: str, wanted: tuple[str, str, str], random: np.random.Generator
) -> Case:
    kind, effect, size = wanted
    hidden: tuple[HiddenEffect, ...] = ()
    if kind == "single":
        own = [c for c in library.candidates if c.effect == effect]
        hidden = (_hide(own[random.integers(len(own))], size, random),)
    elif kind == "pair":
        sizes = [str(random.choice(["clear", "obvious"])) for _ in range(2)]
        both = _together(library.candidates, random)
        hidden = tuple(_hide(c, s, random) for c, s in zip(both, sizes, strict=True))
    structure = _deviation(random) if random.random() < FOREIGN else None
    by_hand = has_hand_equations(library.machine) and random.random() < _BY_HAND
    if any(one.effect in _BESIDE_MOTOR for one in hidden):
        by_hand = False
    maker = EQUATIONS if by_hand else MUJOCO
    seed = int(random.integers(2**62))
    base = _true_base(library.machine, random)
    return Case(name, kind, hidden, None, structure, base, seed, plant, maker)


def _together(
    candidates: Sequence[CandidateEffect], random: np.random.Generator
) -> tuple[CandidateEffect, CandidateEffect]:
    """Draw two effects that can be hidden together."""
    names = list(dict.fromkeys(c.effect for c in candidates))
    while True:
        one, other = (str(n) for n in random.choice(names, 2, replace=False))
        if not any({one, other} <= alike for alike in _ALIKE):
            options = [[c for c in candidates if c.effect == name] for name in (one, other)]
            first, second = (own[random.integers(len(own))] for own in options)
            return first, second


def _hide(candidate: CandidateEffect, size: str, random: np.random.Generator) -> HiddenEffect:
    """Draw the values of an effect: amplitudes at a size, one sign for all, shapes within their trials."""
    share = SIZES[size]
    amplitudes = [p for p in candidate.parameters if p.null_value is not None]
    signs = [s for s in (1.0, -1.0) if all(p.low <= value_at(p, s * share) <= p.high for p in amplitudes)]
    sign = float(random.choice(signs)) if signs else 1.0
    values: dict[str, float | str] = {}
    for p in candidate.parameters:
        if p.null_value is None:
            trials = p.trials or (p.typical,)
            values[p.name] = float(random.uniform(min(trials), max(trials)))
        else:
            values[p.name] = float(np.clip(value_at(p, sign * share), p.low, p.high))
    chosen = {key: str(value) for key, value in candidate.selectors.items()}
    return HiddenEffect(candidate.effect, {**values, **chosen}, size)


def _deviation(random: np.random.Generator) -> UnmodelledEffect:
    """Draw a deviation from the equations of the library, relative to the sizes of each joint."""
    kind = str(random.choice(list(_FOREIGN_SIZES)))
    amplitude = _FOREIGN_SIZES[kind] * float(random.uniform(*DEVIATION))
    length, phase = float(random.uniform(*_LENGTHS[kind])), float(random.uniform(0.0, 2.0 * np.pi))
    return UnmodelledEffect(kind, amplitude, length, phase)


def _true_base(machine: Machine, random: np.random.Generator) -> dict[str, float]:
    found = {}
    for one in machine.uncertain:
        lowest = QUANTITIES[one.part[0]][one.part[2]].lowest + one.beyond
        value = one.value + WITHIN * one.half_width * float(random.uniform(-1.0, 1.0))
        found[one.name] = max(value, lowest)
    return found


def make_machine_dataset(case: Case, folder: Path) -> None:
    """Drive and write all runs of a case; the folder appears in full or not at all.

    Raises:
      InputError: The folder cannot be written.
    """
    library = machine_library(case.plant)
    truth = true_machine(case)
    seeds = np.random.SeedSequence(case.seed).generate_state(2 * _RUNS, np.uint64).tolist()
    runs = [_run(truth, library.loop, k, case.maker, seeds[k], seeds[_RUNS + k]) for k in range(_RUNS)]
    write_whole_dataset(folder, MJCF, runs, library.machine.file)


def true_machine(case: Case) -> MachineTruth:
    """The true machine of a case, with parameter errors and hidden effects."""
    library = machine_library(case.plant)
    effects = {one.effect: one.values for one in case.hidden}  # two hidden effects are never of one name
    hidden = dataclasses.replace(library.machine, effects=effects)
    own = case.structure
    foreign = [] if own is None else [_foreign(own, size) for size in library.sizes]
    return machine_truth(hidden, case.base, foreign)


def _foreign(structure: UnmodelledEffect, size: JointSize) -> dict[str, float]:
    """Fields of `JointTruth` for physics outside the library, one of `_FOREIGN_SIZES`."""
    if structure.kind == "friction_law":
        growing = {"growing_dry": structure.amplitude * size.force}
        return {**growing, "growing_speed": structure.length * size.speed}
    if structure.kind == "drive_ripple":
        waves = 2.0 * np.pi * structure.length / size.reach
        found = {"ripple": structure.amplitude * size.force, "ripple_waves": waves}
        return {**found, "ripple_phase": structure.phase}
    return {"fast_loss": structure.amplitude, "loss_speed": size.speed}


def _run(
    truth: MachineTruth, loop: MachineLoop, number: int, maker: str, seed: int, noise: int | None = None
) -> Run:
    """Record one run; its plan is drawn by `seed`."""
    plan: Plan = loop.plan(seed)
    rows = (integrated_rows if maker == EQUATIONS else simulated_rows)(truth, loop.loop, plan)
    return logged_run(f"run_{number:02d}", truth, rows, seed if noise is None else noise)


def machine_true_values(hidden: HiddenEffect, case: Case) -> dict[str, float]:
    """Values of an effect relative to the nominal machine: hidden ones plus the errors of the base.

    The errors matter where the base has the same quantity; the sum is clipped at the quantity's lowest value.
    """
    library = machine_library(case.plant)
    true = {k: float(v) for k, v in hidden.values.items() if not isinstance(v, str)}
    shared = next((c.quantity for c in library.candidates if c.label == hidden.label), "")
    for one in library.machine.uncertain:
        if one.name == shared:
            key, error = next(iter(true)), case.base[one.name] - one.value
            if key == "scale":
                true[key] *= 1.0 + error / one.value
            else:
                lowest = QUANTITIES[one.part[0]][one.part[2]].lowest
                true[key] = max(true[key] + error, lowest - one.value)
    return true
