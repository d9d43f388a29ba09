"""What an evaluation drives: cases, each drawn from suite, seed and number alone."""

from __future__ import annotations

import dataclasses
import functools
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from types import MappingProxyType
from typing import Any

import numpy as np

from omnimj.errors import InputError
from omnimj.plant.faults import Fault, fault_record
from omnimj.signals import Reference
from omnimj.simulate.scenario.drive import Drive, read_drive
from omnimj.simulate.scenario.motion import directions
from omnimj.simulate.scenario.overrides import split_override
from omnimj.simulate.scenario.scenario import Scenario, read_scenario
from omnimj.simulate.suites.missions import mission
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
"""Floors of the cases."""
PLANTS = ("planar", "twin")
TRAINING_SEEDS = range(100)
"""Seeds of runs that thresholds are set with; nothing is judged by them."""
WHEELS = 4

_SPEEDS = ("low", "high")  # by name in `scenario.drive_keys`
_START, _REST = 0.5, 0.5  # [s] at rest before and after a manoeuvre
_RISE = {"low": 0.5, "high": 1.0}  # [s] at 1 m/s²
# what a case draws has a stream of its own: asking for other faults changes nothing else of it
_MOTION, _WORLD, _FAULTS, _NOISE, _ORDER, _PAIRS = range(6)
_MANY = 1024  # cases whose classes are drawn together


@dataclass(frozen=True)
class Suite:
    """A kind of runs."""

    name: str
    description: str
    duration: float
    """Of a run [s]."""
    healthy: float
    """Share of cases without a fault, unless faults are chosen."""
    onsets: tuple[float, float]
    """Shares of the duration between which the first fault begins."""
    passing: bool
    """Whether a slip may end before the run does."""


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
"""Suites by name, the usual one first."""


@dataclass(frozen=True)
class CasePopulation:
    """What cases are drawn from."""

    suite: str = "missions"
    seed: int = 0
    plants: tuple[str, ...] = ("planar",)
    floors: tuple[str, ...] = FLOORS
    faults: tuple[str, ...] = CLASSES
    duration: float | None = None
    """Of a run [s]; as the suite has it when None."""


@dataclass(frozen=True)
class Case:
    """One case and its truth."""

    name: str
    """`case_00017`."""
    suite: str
    seed: int
    index: int
    plant: str
    floor: str
    duration: float
    """[s]."""
    speed: str
    """`low` or `high` of a manoeuvre; `mixed` of a mission."""
    direction: float | None
    """Of a manoeuvre, in the world [rad]."""
    fault: str
    """One of `random_truth.ALL_CLASSES`."""
    faults: tuple[Fault, ...]
    errors: ParameterErrors
    noise: int
    """Seed of the sensors."""

    def fault_records(self) -> list[dict[str, Any]]:
        """The truth as `metrics.json` has it."""
        return [fault_record(fault) for fault in self.faults]

    def to_dict(self) -> dict[str, Any]:
        """In JSON's own kinds."""
        errors = dataclasses.asdict(dataclasses.replace(self.errors, constants={}, floor={}))
        errors |= {"constants": dict(self.errors.constants), "floor": dict(self.errors.floor)}
        errors["torque_constants"] = list(self.errors.torque_constants)
        names = [f.name for f in dataclasses.fields(self) if f.name not in ("faults", "errors")]
        return {name: getattr(self, name) for name in names} | {
            "faults": self.fault_records(),
            "errors": errors,
        }


def draw_case(choice: CasePopulation, index: int) -> Case:
    """Case number `index`; the same suite, seed and number draw the same motion, world, faults and noise.

    Args:
      choice: What to draw from; plants, floors and faults that are left out change nothing else of a case.
      index: From 0.
    """
    suite = SUITES[choice.suite]
    duration = suite.duration if choice.duration is None else choice.duration
    speed, direction = ("mixed", None) if choice.suite == "missions" else _manoeuvre(choice, index)
    world = _stream(choice, index, _WORLD)
    floor, plant = world.random(), world.random()
    draws = _stream(choice, index, _FAULTS)
    fault = draw_class(draws, choice.faults, suite.healthy)
    onsets = (suite.onsets[0] * duration, suite.onsets[1] * duration)
    return Case(
        name=f"case_{index:05d}",
        suite=choice.suite,
        seed=choice.seed,
        index=index,
        plant=choice.plants[int(plant * len(choice.plants))],
        floor=choice.floors[int(floor * len(choice.floors))],
        duration=duration,
        speed=speed,
        direction=direction,
        fault=fault,
        faults=draw_faults(draws, fault, onsets, suite.passing, _pair(choice, index, fault)),
        errors=draw_parameter_errors(world, WHEELS),
        noise=int(_stream(choice, index, _NOISE).integers(2**62)),
    )


def _stream(choice: CasePopulation, index: int, what: int) -> np.random.Generator:
    key = (list(SUITES).index(choice.suite), index, what)
    return np.random.default_rng(np.random.SeedSequence(choice.seed, spawn_key=key))


def _pair(choice: CasePopulation, index: int, fault: str) -> int | None:
    """Every 28 cases with two faults have each pair once, in random order."""
    if fault != TWO:
        return None
    number = sum(_classes(choice, block).count(TWO) for block in range(index // _MANY))
    number += _classes(choice, index // _MANY)[: index % _MANY].count(TWO)
    order = _stream(choice, number // len(PAIRS), _PAIRS).permutation(len(PAIRS))
    return int(order[number % len(PAIRS)])


@functools.lru_cache(maxsize=128)
def _classes(choice: CasePopulation, block: int) -> tuple[str, ...]:
    """Classes of the cases of a block of `_MANY`, as `draw_case` draws them."""
    cases, healthy = range(block * _MANY, (block + 1) * _MANY), SUITES[choice.suite].healthy
    return tuple(draw_class(_stream(choice, k, _FAULTS), choice.faults, healthy) for k in cases)


def _manoeuvre(choice: CasePopulation, index: int) -> tuple[str, float]:
    """Every 48 cases have each direction at each speed once, in random order."""
    angles = directions()
    both = len(_SPEEDS) * len(angles)
    order = _stream(choice, index // both, _ORDER).permutation(both)
    place = int(order[index % both])
    return _SPEEDS[place % len(_SPEEDS)], float(angles[place // len(_SPEEDS)])


def case_reference(case: Case, period: float) -> Reference:
    """What the robot is asked to do, one sample per control period [s]."""
    if case.direction is None:
        choice = CasePopulation(case.suite, case.seed)
        return mission(_stream(choice, case.index, _MOTION), case.duration, period)
    rise = _RISE[case.speed]
    cruise = max(case.duration - _START - _REST - 2.0 * rise, 0.0)
    table = {"kind": "profile", "speed": case.speed, "direction": case.direction}
    table |= {"start_time": _START, "cruise_time": cruise}
    return read_drive(table, case.name, case.duration, period).reference


def fault_label(record: Mapping[str, Any]) -> str:
    """A fault or diagnosis in words: `motor 3`, `sensor yaw_rate`, `all_wheel_slip`."""
    kind = str(record["kind"])
    if kind == "sensor":
        return f"sensor {record.get('channel') or '?'}"
    wheels = record.get("wheels") or ([record["wheel"]] if record.get("wheel") else [])
    return " ".join([kind, *(str(wheel) for wheel in wheels)])


def is_judging_seed(seed: int) -> bool:
    """Whether a seed may judge a method."""
    return seed not in TRAINING_SEEDS


# What controller and method of a case believe: the nominal robot on the nominal floor, nothing wrong.

_TEMPLATE = "degraded_motor"  # any robot scenario at the physics level: what is a case's own is replaced
_SETTABLE = ("drive.yaw_loop", "drive.heading_hold", "drive.heading_feedback")


def check_settings(settings: Iterable[str]) -> None:
    """Whether these are settings of method or cascade, not of the cases.

    Raises:
      InputError: A text that is not KEY=VALUE, a key that is the cases' own, or a value that breaks its rule.
    """
    for text in settings:
        key = split_override(text)[0]
        if not key.startswith("diagnosis.") and key not in _SETTABLE:
            rule = "cases are drawn; settings are those of the method and of the cascade's loops"
            raise InputError(f"--set {key}", "is none of them", rule, ("diagnosis.…", *_SETTABLE))
    read_scenario(_TEMPLATE, ("faults=[]", "checks={}", *settings))


def nominal_scenario(case: Case, settings: Iterable[str] = ()) -> Scenario:
    """The case as a scenario without any fault.

    Args:
      case: Its errors and faults are left out.
      settings: `KEY=VALUE` texts for method and cascade, as `check_settings` allows them.
    """
    healthy = ("faults=[]", "checks={}", f"floor={case.floor}", f"duration={case.duration!r}")
    scenario = read_scenario(_TEMPLATE, (*healthy, *settings))
    assert isinstance(scenario.drive, Drive)
    drive = dataclasses.replace(
        scenario.drive, reference=case_reference(case, scenario.period), start=(0.0, 0.0, 0.0)
    )
    return dataclasses.replace(scenario, name=case.name, description=case.suite, drive=drive)
