"""Drives one draw with one candidate's gains, and what came of it in numbers.

Controller and method believe in the nominal robot and in nothing being wrong; the plant is the true robot.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping, Sequence
from types import MappingProxyType
from typing import Any

import numpy as np

from omnimj.control.robust.verdict import Thresholds
from omnimj.errors import SimulationError
from omnimj.evaluation.true_robot import true_floor, true_robot
from omnimj.evaluation.use import IN_USE, demanded_traction
from omnimj.loop import drive
from omnimj.parameters import Robot
from omnimj.scenario.drive import Drive
from omnimj.scenario.gains import gains_of, with_gains
from omnimj.scenario.methods import make_method
from omnimj.scenario.plants import make_plant
from omnimj.scenario.running import make_diagnosing
from omnimj.scenario.scenario import Scenario, read_scenario
from omnimj.signals import Trace
from omnimj.trials.results import guarded, plain
from omnimj.tuning.draws import Draw, in_draw
from omnimj.tuning.facts import measure_trial

METHOD = "robust"
"""How what goes wrong is diagnosed; recovery acts upon it."""
Uses = Sequence[Sequence[Sequence[float]]]
"""Per wheel the stretches of time in which it is asked to pull, [from, to] each [s]."""


def drive_healthy(draw: Draw, values: Mapping[str, float]) -> dict[str, Any]:
    """When each wheel is in use in a draw, told by the run without faults or diagnosis.

    Args:
      draw: With its truth.
      values: Gains by their names, over those of the model: those before the search.

    Returns:
      `draw`: the truth. `uses`: of the wheels. Or `error`: what went wrong.
    """

    def driven() -> dict[str, Any]:
        scenario = _read(draw, values)
        believed = in_draw(scenario, draw, False)
        trace = _run(believed, draw, "off", believed)
        if trace.about["failure"]:
            raise SimulationError(f"{draw.name}: {trace.about['failure']}")
        return plain({"draw": draw.as_plain(), "uses": _uses(trace)})

    return guarded(driven)


def drive_trial(
    draw: Draw, values: Mapping[str, float], uses: Uses | None, thresholds: Thresholds | None = None
) -> dict[str, Any]:
    """One draw with a candidate's gains.

    Args:
      draw: With its truth, which controller and method do not get.
      values: Gains by their names, over those of the model.
      uses: From `drive_healthy`; None where nothing goes wrong.
      thresholds: Of the method; the shipped ones when None.

    Returns:
      `draw`, `gains`, and `facts` of `facts.measure_trial`; or `error`: what went wrong. A run that broke
      down is a fact, `broke`, since gains can do that.
    """

    def driven() -> dict[str, Any]:
        scenario = _read(draw, values)
        believed, truth = in_draw(scenario, draw, False), in_draw(scenario, draw, True)
        trace = _run(believed, draw, METHOD, truth, thresholds)
        found = {"broke": trace.about["failure"]}
        if not trace.about["failure"]:
            found = dataclasses.asdict(measure_trial(trace, truth, uses))
        return plain({"draw": draw.as_plain(), "gains": dict(values), "facts": found})

    return guarded(driven)


def _read(draw: Draw, values: Mapping[str, float]) -> Scenario:
    scenario = read_scenario(draw.scenario, (), draw.model)
    return with_gains(scenario, gains_of(scenario).changed(values))


def _run(
    believed: Scenario, draw: Draw, method: str, truth: Scenario, thresholds: Thresholds | None = None
) -> Trace:
    """The run of a scenario that knows of nothing wrong on a plant that has the truth."""
    nominal, asked = believed.constants, believed.drive
    assert isinstance(nominal, Robot)
    assert isinstance(asked, Drive)
    laid = true_floor(believed.floors[draw.floor], draw.errors)
    real = dataclasses.replace(
        truth,
        constants=true_robot(nominal, draw.errors),
        floors=MappingProxyType({**believed.floors, laid.name: laid}),
    )
    plant = make_plant(real, draw.plant, draw.noise)
    try:
        controller = make_diagnosing(believed, make_method(method, believed, thresholds))
        trace = drive(plant, controller, asked.reference)
    finally:
        plant.close()
    if trace.about["interrupted"] and not trace.about["failure"]:
        raise KeyboardInterrupt
    return trace


def _uses(healthy: Trace) -> list[list[list[float]]]:
    time, works = healthy["time"], demanded_traction(healthy) > IN_USE
    found = []
    for wheel in works.T:
        edges = np.flatnonzero(np.diff(np.concatenate(([False], wheel, [False])).astype(int)))
        found.append([[float(time[a]), float(time[min(b, len(time) - 1)])] for a, b in edges.reshape(-1, 2)])
    return found
