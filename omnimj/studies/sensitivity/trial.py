"""One run of a study: the plant has some numbers other than the controller believes."""

from __future__ import annotations

import dataclasses
import math
import re
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from types import MappingProxyType
from typing import Any

import numpy as np

from omnimj.errors import InputError, SimulationError
from omnimj.parameters import Floor
from omnimj.recording.json_files import run_guarded, to_jsonable
from omnimj.signals import KINDS_OF_DIAGNOSIS
from omnimj.simulate.detectors import available_methods, default_method, make_detector, require_known_method
from omnimj.simulate.metrics import DIAGNOSIS_UNITS
from omnimj.simulate.plants import KINEMATIC, PLANT_NAMES, plant_name
from omnimj.simulate.run import RunResult, run_scenario
from omnimj.simulate.scenario.scenario import Scenario, read_scenario
from omnimj.studies.sensitivity.factors import FLOOR

# The scenario as it really is: some numbers of machine and floors other than the model files say.


def true_scenario(scenario: Scenario, values: Mapping[str, float]) -> Scenario:
    """The same scenario for a plant to be made of; the controller is made of the one that is given.

    Args:
      scenario: As the model files have it.
      values: New value by name, as in `factors.Factor`.
    """
    machine: Any = scenario.constants
    floors = dict(scenario.floors)
    for name, value in values.items():
        table, _, key = name.partition(".")
        if table == FLOOR:
            floor, _, letter = key.rpartition(".")
            floors[floor] = _floor(floors[floor], letter, value)
        elif table == "effects":
            machine = _with_effect(machine, key, value)
        elif table == "wheels":
            machine = _with_mount(machine, key, value)
        else:
            changed = _replaced(getattr(machine, table), key, value)
            machine = dataclasses.replace(machine, **{table: changed})
    return dataclasses.replace(scenario, constants=machine, floors=MappingProxyType(floors))


def _floor(floor: Floor, letter: str, value: float) -> Floor:
    return dataclasses.replace(floor, numbers=MappingProxyType({**floor.numbers, letter: value}))


def _with_effect(machine: Any, key: str, value: float) -> Any:
    effect, _, parameter = key.partition(".")
    changed = {**machine.effects[effect], parameter: value}
    return dataclasses.replace(machine, effects={**machine.effects, effect: changed})


def _with_mount(machine: Any, key: str, value: float) -> Any:
    number, _, entry = key.partition(".")
    mounts = list(machine.wheels)
    mounts[int(number) - 1] = _replaced(mounts[int(number) - 1], entry, value)
    return dataclasses.replace(machine, wheels=tuple(mounts))


def _replaced(table: Any, key: str, value: float) -> Any:
    """The table with one new value; all numbers of a list keep their ratios, its largest gets the value."""
    before = getattr(table, key)
    if isinstance(before, tuple):
        factor = value / max(map(abs, before))
        return dataclasses.replace(table, **{key: tuple(factor * entry for entry in before)})
    return dataclasses.replace(table, **{key: int(value) if isinstance(before, int) else value})


# What a run of a scenario amounts to, as numbers that can be compared between runs.

RESOLUTION: Mapping[str, float] = MappingProxyType(
    {"m": 1e-3, "m/s": 1e-3, "rad": 1e-3, "A": 1e-3, "s": 1e-3}
)
"""Changes below it, by unit, are nothing that a robot's sensors or a check could tell: a millimetre, a
milliradian (the heading converter has steps of 1.5), a milliampere (the monitor: 2.4), one control period."""

_PLACE = {"final_x": "m", "final_y": "m", "final_heading": "rad"}
_OF_ONE_WHEEL = re.compile(r".*_\d+")


def result_units(scenario: Scenario, method: str) -> dict[str, str]:
    """The results of a scenario and their units.

    The metrics of `metrics.json`, of single wheels those alone that the scenario's checks ask for; where it
    ends; rms of the slip over time and wheels. Without a method there is nothing to say of diagnoses.
    """
    asked = {check.name for check in scenario.checks}
    single = len(scenario.wheel_positions) == 1
    units = {
        name: unit
        for name, unit in scenario.metric_units.items()
        if (single or name in asked or not _OF_ONE_WHEEL.fullmatch(name))
        and (method != "off" or name not in DIAGNOSIS_UNITS)
    }
    units["rms_slip"] = "m/s"
    return units if single else {**units, **_PLACE}


def read_results(run: RunResult, units: Mapping[str, str]) -> dict[str, float | None]:
    """The results of a run; None for one that it does not have.

    A fault that was never noticed has a delay until the end of the run: less than it is, and finite.

    Args:
      run: That came to its end.
      units: From `result_units`.
    """
    metrics, trace = run.metrics, run.trace
    found: dict[str, Any] = {name: metrics.get(name) for name in units}
    if "detection_delay" in units:
        found["detection_delay"] = _delay(metrics)
    if "slip_velocity_1" in trace:
        found["rms_slip"] = np.sqrt(np.mean(np.square(trace.wheels("slip_velocity"))))
    if "heading" in trace:
        last = (trace["x"][-1], trace["y"][-1], np.unwrap(trace["heading"])[-1])
        found |= dict(zip(_PLACE, last, strict=True))
    return {name: _number(found.get(name)) for name in units}


def _delay(metrics: Mapping[str, Any]) -> float | None:
    if metrics["detection_delay"] is not None:
        return metrics["detection_delay"]
    onsets = [fault["onset"] for fault in metrics["faults"] if fault["kind"] in KINDS_OF_DIAGNOSIS]
    return metrics["duration"] - min(onsets) if onsets else None


def _number(value: Any) -> float | None:
    return None if value is None or not math.isfinite(value) else float(value)


@dataclass(frozen=True)
class TrialConfig:
    """What is driven; a worker reads it for itself."""

    scenario: str
    """A shipped scenario's name, or the path of a file."""
    overrides: tuple[str, ...] = ()
    """`KEY=VALUE` texts."""
    model: Path | None = None
    """The model file that the controller believes; the shipped one when None."""
    floors: Path | None = None
    plant: str = "planar"
    method: str | None = None
    """Of diagnosis; the scenario's own when None."""


def nominal_scenario(asked: TrialConfig) -> Scenario:
    """The scenario as the controller believes it.

    Raises:
      InputError: As `read_scenario`; or it has no forces, or the plant is a real one.
      UnknownNameError: As `read_scenario`, or there is no such plant or method.
    """
    scenario = read_scenario(asked.scenario, asked.overrides, asked.model, asked.floors)
    if scenario.level == KINEMATIC:
        rule = "without forces no number of the model acts"
        raise InputError(scenario.name, "is at the kinematic level", rule)
    if plant_name(scenario, asked.plant) not in PLANT_NAMES:
        rule = "numbers can be changed in a simulation only"
        raise InputError("--plant", f"found {asked.plant!r}", rule, PLANT_NAMES)
    method = resolve_method(asked, scenario)
    require_known_method(method)
    make_detector(method, scenario)  # one that this robot's wheels are not for is refused
    if method not in available_methods(scenario):
        raise InputError(
            "--method", f"found {method!r}", "the rig has one wheel", available_methods(scenario)
        )
    return scenario


def resolve_method(asked: TrialConfig, scenario: Scenario) -> str:
    """The method that is meant."""
    return default_method(scenario) if asked.method is None else asked.method


def drive_with(asked: TrialConfig, values: Mapping[str, float], seed: int) -> dict[str, Any]:
    """Drives the scenario once.

    Args:
      asked: What is driven; the controller believes it.
      values: What the plant has instead, by name as in `factors.Factor`.
      seed: Of the sensors' noise.

    Returns:
      `values`, `seed` and `results` by name; or `error`: what went wrong.
    """

    def driven() -> dict[str, Any]:
        scenario = nominal_scenario(asked)
        method = resolve_method(asked, scenario)
        run = run_scenario(scenario, asked.plant, method, seed, truth=true_scenario(scenario, values))
        if run.trace.about["failure"]:
            raise SimulationError(run.trace.about["failure"])
        if run.interrupted:
            raise KeyboardInterrupt
        results = read_results(run, result_units(scenario, method))
        return to_jsonable({"values": values, "seed": seed, "results": results})

    return run_guarded(driven)
