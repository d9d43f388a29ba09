"""Trial of a sensitivity study: a scenario on a plant whose parameters differ from the controller's."""

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
from omnimj.signals import KINDS_OF_DIAGNOSIS
from omnimj.simulate.detectors import available_methods, default_method, make_detector, require_known_method
from omnimj.simulate.metrics import DIAGNOSIS_UNITS, rms
from omnimj.simulate.plants import KINEMATIC, PLANT_NAMES, plant_name
from omnimj.simulate.run import RunResult, run_scenario
from omnimj.simulate.scenario.scenario import Scenario, read_scenario
from omnimj.studies.runner import guarded
from omnimj.studies.sensitivity.factors import FLOOR


def true_scenario(scenario: Scenario, values: Mapping[str, float]) -> Scenario:
    """Return the scenario with true parameter values, from which a plant is made."""
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
    """Return the table with one new value; a list is scaled until its largest entry has the value."""
    before = getattr(table, key)
    if isinstance(before, tuple):
        factor = value / max(map(abs, before))
        return dataclasses.replace(table, **{key: tuple(factor * entry for entry in before)})
    return dataclasses.replace(table, **{key: int(value) if isinstance(before, int) else value})


RESOLUTION: Mapping[str, float] = MappingProxyType(
    {"m": 1e-3, "m/s": 1e-3, "rad": 1e-3, "A": 1e-3, "s": 1e-3}
)
"""Resolution of results by unit: a millimetre, a milliradian (the heading converter resolves 1.5), a
milliampere (the current monitor: 2.4), one control period."""

_PLACE = {"final_x": "m", "final_y": "m", "final_heading": "rad"}
_OF_ONE_WHEEL = re.compile(r".*_\d+")


def result_units(scenario: Scenario, method: str) -> dict[str, str]:
    """Return the results of a scenario with their units.

    These are the metrics of `metrics.json` (of single wheels only those that the scenario's checks use; of
    diagnoses only with a method), the final pose, and the RMS slip velocity over time and wheels.
    """
    checked = {check.name for check in scenario.checks}
    single = len(scenario.wheel_positions) == 1
    units = {
        name: unit
        for name, unit in scenario.metric_units.items()
        if (single or name in checked or not _OF_ONE_WHEEL.fullmatch(name))
        and (method != "off" or name not in DIAGNOSIS_UNITS)
    }
    units["rms_slip"] = "m/s"
    return units if single else {**units, **_PLACE}


def read_results(run: RunResult, units: Mapping[str, str]) -> dict[str, float | None]:
    """Return the results of a run; None for one that it does not have.

    A fault that was never detected counts with the time until the end of the run, a finite lower bound of its
    detection delay.
    """
    metrics, trace = run.metrics, run.trace
    found: dict[str, Any] = {name: metrics.get(name) for name in units}
    if "detection_delay" in units:
        found["detection_delay"] = _delay(metrics)
    if "slip_velocity_1" in trace:
        found["rms_slip"] = rms(trace.wheels("slip_velocity"))
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
    """Scenario of the trials, read anew by every worker."""

    scenario: str
    """Name of a shipped scenario, or path of a file."""
    overrides: tuple[str, ...] = ()
    """`KEY=VALUE` texts."""
    model: Path | None = None
    """Model file of the controller; the shipped one when None."""
    floors: Path | None = None
    plant: str = "planar"
    method: str | None = None
    """Diagnosis method; the default of the scenario when None."""


def nominal_scenario(config: TrialConfig) -> Scenario:
    """Read the nominal scenario, which the controller is made for.

    Raises:
      InputError: As `read_scenario`; or the scenario has no forces, or the plant is hardware.
      UnknownNameError: As `read_scenario`, or the plant or method does not exist.
    """
    scenario = read_scenario(config.scenario, config.overrides, config.model, config.floors)
    if scenario.level == KINEMATIC:
        rule = "without forces no parameter of the model has an effect"
        raise InputError(scenario.name, "is at the kinematic level", rule)
    if plant_name(scenario, config.plant) not in PLANT_NAMES:
        rule = "parameters can be changed in a simulation only"
        raise InputError("--plant", f"found {config.plant!r}", rule, PLANT_NAMES)
    method = resolve_method(config, scenario)
    require_known_method(method)
    make_detector(method, scenario)  # raises for a method that does not suit the wheels of this robot
    if method not in available_methods(scenario):
        raise InputError(
            "--method", f"found {method!r}", "the rig has one wheel", available_methods(scenario)
        )
    return scenario


def resolve_method(config: TrialConfig, scenario: Scenario) -> str:
    """Return the diagnosis method of the trials."""
    return default_method(scenario) if config.method is None else config.method


@guarded
def drive_with(config: TrialConfig, values: Mapping[str, float], seed: int) -> dict[str, Any]:
    """Drive the scenario once.

    Returns:
      `values`, `seed` and `results` by name; or `error`: the message of a run that failed.
    """
    scenario = nominal_scenario(config)
    method = resolve_method(config, scenario)
    run = run_scenario(scenario, config.plant, method, seed, truth=true_scenario(scenario, values))
    if run.trace.about["failure"]:
        raise SimulationError(run.trace.about["failure"])
    if run.interrupted:
        raise KeyboardInterrupt
    results = read_results(run, result_units(scenario, method))
    return {"values": values, "seed": seed, "results": results}
