"""One run of a study: the plant has some numbers other than the controller believes."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from omnimj.errors import InputError, SimulationError
from omnimj.scenario.methods import default_method, make_method, methods_of, require_method
from omnimj.scenario.plants import KINEMATIC, PLANT_NAMES, plant_name
from omnimj.scenario.running import run_scenario
from omnimj.scenario.scenario import Scenario, read_scenario
from omnimj.sensitivity.results import result_units, results_of
from omnimj.sensitivity.truth import truth_with
from omnimj.trials.results import guarded, plain


@dataclass(frozen=True)
class Asked:
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


def scenario_of(asked: Asked) -> Scenario:
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
    method = method_of(asked, scenario)
    require_method(method)
    make_method(method, scenario)  # one that this robot's wheels are not for is refused
    if method not in methods_of(scenario):
        raise InputError("--method", f"found {method!r}", "the rig has one wheel", methods_of(scenario))
    return scenario


def method_of(asked: Asked, scenario: Scenario) -> str:
    """The method that is meant."""
    return default_method(scenario) if asked.method is None else asked.method


def drive_changed(asked: Asked, values: Mapping[str, float], seed: int) -> dict[str, Any]:
    """Drives the scenario once.

    Args:
      asked: What is driven; the controller believes it.
      values: What the plant has instead, by name as in `varied.Varied`.
      seed: Of the sensors' noise.

    Returns:
      `values`, `seed` and `results` by name; or `error`: what went wrong.
    """

    def driven() -> dict[str, Any]:
        scenario = scenario_of(asked)
        method = method_of(asked, scenario)
        run = run_scenario(scenario, asked.plant, method, seed, truth=truth_with(scenario, values))
        if run.trace.about["failure"]:
            raise SimulationError(run.trace.about["failure"])
        if run.interrupted:
            raise KeyboardInterrupt
        results = results_of(run, result_units(scenario, method))
        return plain({"values": values, "seed": seed, "results": results})

    return guarded(driven)
