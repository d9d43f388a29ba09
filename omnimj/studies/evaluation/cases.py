"""Cases of an evaluation, each determined by suite, seed and case number alone."""

from __future__ import annotations

import dataclasses
import functools
import hashlib
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path
from types import MappingProxyType
from typing import Any

import numpy as np

from omnimj.effects.machine import check_effects
from omnimj.errors import InputError
from omnimj.parameters import Robot, read_floors, read_robot
from omnimj.plant.faults import Fault, fault_record
from omnimj.signals import Reference
from omnimj.simulate.scenario.drive import read_drive
from omnimj.simulate.scenario.motion import directions
from omnimj.simulate.scenario.overrides import split_override
from omnimj.simulate.scenario.scenario import Scenario, read_scenario
from omnimj.simulate.suites.missions import mission
from omnimj.studies.random_structure import DRAWN, NOMINAL, RandomStructure, draw_structure
from omnimj.studies.random_truth import (
    CLASSES,
    PAIRS,
    TWO,
    ParameterErrors,
    draw_class,
    draw_faults,
    draw_parameter_errors,
)

FLOORS = ("natural_stone", "pvc", "paperboard", "natural_stone_capped")
"""Names of the floors from which cases are drawn."""
PLANTS = ("planar", "twin")
TRAINING_SEEDS = range(100)
"""Seeds of the runs on which thresholds were set; not used to evaluate a method."""
WHEELS = 4

_SPEEDS = ("low", "high")  # by name in `scenario.drive_keys`
_START, _REST = 0.5, 0.5  # [s] at rest before and after a manoeuvre
_RISE = {"low": 0.5, "high": 1.0}  # [s] at 1 m/s²
# one random stream per aspect of a case, so that other faults leave all other aspects unchanged
_MOTION, _WORLD, _FAULTS, _NOISE, _ORDER, _PAIRS, _STRUCTURE = range(7)
_MANY = 1024  # cases whose classes are drawn together


@dataclass(frozen=True)
class Suite:
    """Kind of run."""

    name: str
    description: str
    duration: float
    """Duration of a run [s]."""
    healthy: float
    """Share of cases without a fault, if the population has such cases."""
    onsets: tuple[float, float]
    """Earliest and latest onset of the first fault, as shares of the duration."""
    passing: bool
    """True if a slip may end before the run does."""


SUITES: Mapping[str, Suite] = MappingProxyType(
    {
        "missions": Suite(
            "missions",
            "60 s of random legs at 0.2-1.0 m/s with turns, stops and reversals",
            60.0,
            0.5,
            (0.05, 0.75),
            True,
        ),
        "manoeuvres": Suite(
            "manoeuvres",
            "5 s from rest to rest in 24 directions at low and high speed",
            5.0,
            0.2,
            (_START / 5.0, 0.8),
            False,
        ),
    }
)
"""Suites by name, the default first."""


@dataclass(frozen=True)
class CasePopulation:
    """Population from which cases are drawn."""

    suite: str = "missions"
    seed: int = 0
    plants: tuple[str, ...] = ("planar",)
    floors: tuple[str, ...] = FLOORS
    faults: tuple[str, ...] = CLASSES
    duration: float | None = None
    """Duration of a run [s]; that of the suite when None."""
    structure: str = NOMINAL
    """Structure of the true robots, one of `random_structure.STRUCTURES`."""
    model: Path | None = None
    """Model file of the controller's robot, or the name of a shipped one; the shipped robot when None."""
    floors_file: Path | None = None
    """File with floors that are added to the shipped ones, or replace them."""

    def plan(self) -> dict[str, Any]:
        """Return the settings as JSON-compatible values, with the content of files as a hash."""
        content = dataclasses.asdict(self)
        del content["model"], content["floors_file"]
        files = {"model": None if self.model is None else read_robot(self.model).file}
        for name, file in (files | {"floors_file": self.floors_file}).items():
            if file is not None:
                digest = hashlib.sha256(file.read_bytes()).hexdigest()[:16]
                content[name] = {"file": str(file), "sha256": digest}
        return content


@dataclass(frozen=True)
class Case:
    """Case with its truth."""

    name: str
    """Name such as `case_00017`."""
    suite: str
    seed: int
    index: int
    plant: str
    floor: str
    duration: float
    """Duration of the run [s]."""
    speed: str
    """`low` or `high` for a manoeuvre; `mixed` for a mission."""
    direction: float | None
    """Direction of a manoeuvre in the world [rad]; None for a mission."""
    fault: str
    """One of `random_truth.ALL_CLASSES`."""
    faults: tuple[Fault, ...]
    errors: ParameterErrors
    noise: int
    """Seed of the sensor noise."""
    structure: RandomStructure | None = None
    """Structure of the true robot; None: that of the controller's model."""
    model: Path | None = None
    """As in `CasePopulation`."""
    floors_file: Path | None = None
    """As in `CasePopulation`."""

    def fault_records(self) -> list[dict[str, Any]]:
        """Return the faults as in `metrics.json`."""
        return [fault_record(fault) for fault in self.faults]

    def to_dict(self) -> dict[str, Any]:
        """Return the case as JSON-compatible values."""
        errors = dataclasses.asdict(dataclasses.replace(self.errors, constants={}, floor={}))
        errors |= {"constants": dict(self.errors.constants), "floor": dict(self.errors.floor)}
        errors["torque_constants"] = list(self.errors.torque_constants)
        apart = ("faults", "errors", "structure", "model", "floors_file")
        names = [f.name for f in dataclasses.fields(self) if f.name not in apart]
        files = {"model": self.model, "floors_file": self.floors_file}
        return {name: getattr(self, name) for name in names} | {
            **{name: str(file) for name, file in files.items() if file is not None},
            "faults": self.fault_records(),
            "errors": errors,
            "structure": None if self.structure is None else dataclasses.asdict(self.structure),
        }


def draw_cases(population: CasePopulation, indices: Iterable[int]) -> list[Case]:
    """Draw cases; the same suite, seed and number give the same motion, world, faults and noise.

    Args:
      population: Population to draw from; its plants, floors, faults and structure affect nothing else of a
        case.
      indices: Numbers of the cases, from 0.
    """
    robot = read_robot(population.model)
    return [_draw_case(population, index, robot) for index in indices]


def _draw_case(population: CasePopulation, index: int, robot: Robot) -> Case:
    suite = SUITES[population.suite]
    duration = suite.duration if population.duration is None else population.duration
    speed, direction = ("mixed", None) if population.suite == "missions" else _manoeuvre(population, index)
    world = _stream(population, index, _WORLD)
    floor, plant = world.random(), world.random()
    draws = _stream(population, index, _FAULTS)
    fault = draw_class(draws, population.faults, suite.healthy)
    onsets = (suite.onsets[0] * duration, suite.onsets[1] * duration)
    return Case(
        name=f"case_{index:05d}",
        suite=population.suite,
        seed=population.seed,
        index=index,
        plant=population.plants[int(plant * len(population.plants))],
        floor=population.floors[int(floor * len(population.floors))],
        duration=duration,
        speed=speed,
        direction=direction,
        fault=fault,
        faults=draw_faults(draws, fault, onsets, suite.passing, _pair(population, index, fault)),
        errors=draw_parameter_errors(world, robot),
        model=population.model,
        floors_file=population.floors_file,
        noise=int(_stream(population, index, _NOISE).integers(2**62)),
        structure=_structure(population, index, robot),
    )


def _stream(population: CasePopulation, index: int, what: int) -> np.random.Generator:
    key = (list(SUITES).index(population.suite), index, what)
    return np.random.default_rng(np.random.SeedSequence(population.seed, spawn_key=key))


def _structure(population: CasePopulation, index: int, robot: Robot) -> RandomStructure | None:
    if population.structure != DRAWN:
        return None
    return draw_structure(_stream(population, index, _STRUCTURE), robot)


def _pair(population: CasePopulation, index: int, fault: str) -> int | None:
    """Draw the pair of faults: every 28 cases with two faults have each pair once, in random order."""
    if fault != TWO:
        return None
    number = sum(_classes(population, block).count(TWO) for block in range(index // _MANY))
    number += _classes(population, index // _MANY)[: index % _MANY].count(TWO)
    order = _stream(population, number // len(PAIRS), _PAIRS).permutation(len(PAIRS))
    return int(order[number % len(PAIRS)])


@functools.lru_cache(maxsize=128)
def _classes(population: CasePopulation, block: int) -> tuple[str, ...]:
    """Return the fault classes of a block of `_MANY` cases, as `draw_cases` draws them."""
    cases, healthy = range(block * _MANY, (block + 1) * _MANY), SUITES[population.suite].healthy
    return tuple(draw_class(_stream(population, k, _FAULTS), population.faults, healthy) for k in cases)


def _manoeuvre(population: CasePopulation, index: int) -> tuple[str, float]:
    """Draw speed and direction: every 48 cases have each combination once, in random order."""
    angles = directions()
    both = len(_SPEEDS) * len(angles)
    order = _stream(population, index // both, _ORDER).permutation(both)
    place = int(order[index % both])
    return _SPEEDS[place % len(_SPEEDS)], float(angles[place // len(_SPEEDS)])


def case_reference(case: Case, period: float) -> Reference:
    """Return the commanded motion of a case.

    Args:
      case: The case.
      period: Control period, one sample each [s].
    """
    if case.direction is None:
        population = CasePopulation(case.suite, case.seed)
        return mission(_stream(population, case.index, _MOTION), case.duration, period)
    rise = _RISE[case.speed]
    cruise = max(case.duration - _START - _REST - 2.0 * rise, 0.0)
    table = {"kind": "profile", "speed": case.speed, "direction": case.direction}
    table |= {"start_time": _START, "cruise_time": cruise}
    return read_drive(table, case.name, case.duration, period).reference


def fault_label(record: Mapping[str, Any]) -> str:
    """Return the label of a fault or diagnosis: `motor 3`, `sensor yaw_rate`, `all_wheel_slip`."""
    kind = str(record["kind"])
    if kind == "sensor":
        return f"sensor {record.get('channel') or '?'}"
    wheels = record.get("wheels") or ([record["wheel"]] if record.get("wheel") else [])
    return " ".join([kind, *(str(wheel) for wheel in wheels)])


def is_judging_seed(seed: int) -> bool:
    """Return whether a seed may be used to evaluate a method."""
    return seed not in TRAINING_SEEDS


_TEMPLATE = "degraded_motor"  # any robot scenario with forces; case-specific entries are replaced
_SETTABLE = ("drive.yaw_loop", "drive.heading_hold", "drive.heading_feedback")


def require_four_wheels(population: CasePopulation) -> None:
    """Check the model, its effects and the floors of a population.

    Raises:
      InputError: A file is invalid, or the robot has another number of wheels.
      UnknownNameError: An effect of the model file does not exist.
    """
    robot = read_robot(population.model)
    check_effects(robot)
    wheels = robot.wheel_count
    if wheels != WHEELS:
        rule = f"cases are drawn for {WHEELS} wheels"
        raise InputError(f"--model {population.model}", f"has {wheels} [[wheels]]", rule)
    if population.floors_file is not None:
        read_floors(population.floors_file)


def check_settings(settings: Iterable[str]) -> None:
    """Check that these are settings of the method or the cascade, not of the cases.

    Raises:
      InputError: A text is not KEY=VALUE, a key belongs to the cases, or a value breaks its rule.
    """
    for text in settings:
        key = split_override(text)[0]
        if not key.startswith("diagnosis.") and key not in _SETTABLE:
            rule = "cases are drawn at random; only method and cascade loops have settings"
            raise InputError(f"--set {key}", "cannot be set here", rule, ("diagnosis.…", *_SETTABLE))
    read_scenario(_TEMPLATE, ("faults=[]", "checks={}", *settings))


def nominal_scenario(case: Case, settings: Iterable[str] = ()) -> Scenario:
    """Return the case as the nominal scenario with some settings, without faults and parameter errors."""
    healthy = ("faults=[]", "checks={}", f"floor={case.floor}", f"duration={case.duration!r}")
    scenario = read_scenario(_TEMPLATE, (*healthy, *settings), case.model, case.floors_file)
    drive = dataclasses.replace(
        scenario.robot_drive, reference=case_reference(case, scenario.period), start=(0.0, 0.0, 0.0)
    )
    return dataclasses.replace(scenario, name=case.name, description=case.suite, drive=drive)
