"""Drives one draw with one candidate's gains, and what came of it in numbers.

Controller and method believe in the nominal robot and in nothing being wrong; the plant is the true robot.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from math import inf
from types import MappingProxyType
from typing import Any

import numpy as np

from omnimj.control.detection.robust.thresholds import Thresholds
from omnimj.errors import SimulationError
from omnimj.parameters import Robot
from omnimj.recording.json_files import run_guarded, to_jsonable
from omnimj.signals import KINDS_OF_DIAGNOSIS, Array, Trace
from omnimj.simulate.detectors import make_detector
from omnimj.simulate.judging import judge_diagnoses
from omnimj.simulate.loop import drive
from omnimj.simulate.plants import make_plant
from omnimj.simulate.run import make_diagnosing_controller
from omnimj.simulate.scenario.drive import Drive
from omnimj.simulate.scenario.scenario import Scenario, read_scenario, scenario_gains, with_gains
from omnimj.simulate.summary import true_faults
from omnimj.studies.part_use import IN_USE, demanded_traction
from omnimj.studies.random_truth import true_floor, true_robot
from omnimj.studies.tuning.draws import Draw, apply_draw

# What came of one trial in numbers: following, effort, slip, diagnosis, saturation.

MISSED = 2.0
"""Delay that a fault counts which is never found, and the largest that counts [s]."""
_FULL = 0.999  # of the largest current: a wheel is at its limit


@dataclass(frozen=True)
class TrialMetrics:
    """Of one trial."""

    path: float
    """RMS distance to where the centre should be at that instant [m]."""
    velocity: float
    """RMS error of the centre's velocity [m/s]."""
    heading: float
    """RMS [rad]."""
    current: float
    """RMS of the set currents over time and wheels [A]."""
    current_rate: float
    """RMS of their changes over the control period [A/s]."""
    slip: float
    """RMS slip velocity over time and wheels [m/s]."""
    delay: float | None
    """From the first use of a faulty part to the first alarm, 0 … `MISSED` [s]; None: nothing to find."""
    missed: bool
    """Whether something was to be found and nothing was."""
    false_alarms: int
    saturation: float
    """Longest time at the largest current of a wheel that no fault sits on [s]."""
    broke: str | None = None
    """How the run broke down; then nothing else is known."""


def read_metrics(result: Mapping[str, Any]) -> TrialMetrics:
    """The facts out of a trial's kept result."""
    found = result["facts"]
    if found.get("broke"):
        return TrialMetrics(inf, inf, inf, inf, inf, inf, None, False, 0, inf, found["broke"])
    return TrialMetrics(**found)


def measure_trial(trace: Trace, truth: Scenario, uses: Sequence | None) -> TrialMetrics:
    """The facts of a run that came to its end.

    Args:
      trace: With truth and plan.
      truth: The scenario with its faults and patches.
      uses: From `trial.drive_healthy`; None where nothing goes wrong.
    """
    robot = truth.constants
    assert isinstance(robot, Robot)
    command = trace.wheels("current_target")
    records = [r for r in true_faults(truth, trace) if r["kind"] in KINDS_OF_DIAGNOSIS]
    verdict = judge_diagnoses(records, trace.about["diagnoses"], len(robot.wheels))
    first = _first_use(records, uses)
    delay = None
    if first is not None:
        alarm = inf if verdict.detection_delay is None else verdict.detection_delay
        onset = min(record["onset"] for record in records)
        delay = min(max(onset + alarm - first, 0.0), MISSED)
    limit = min(robot.motor.current_limit, robot.control.current_limit)
    touched = {record["wheel"] for record in records}
    sound = [i for i in range(len(robot.wheels)) if i + 1 not in touched and None not in touched]
    off_x, off_y = trace["x"] - trace["target_x"], trace["y"] - trace["target_y"]
    turned = np.unwrap(trace["heading"] - trace["target_heading"])
    turned -= 2.0 * np.pi * np.round(turned[0] / (2.0 * np.pi))
    return TrialMetrics(
        path=_rms(np.hypot(off_x, off_y)),
        velocity=_rms(np.hypot(*_velocity_error(trace))),
        heading=_rms(turned),
        current=_rms(command),
        current_rate=_rms(np.diff(command, axis=0)) / truth.period,
        slip=_rms(trace.wheels("slip_velocity")),
        delay=delay,
        missed=first is not None and verdict.detection_delay is None,
        false_alarms=verdict.false_alarms,
        saturation=_longest(np.abs(command[:, sound]) >= _FULL * limit) * truth.period,
    )


def _rms(values: Array) -> float:
    return float(np.sqrt(np.mean(np.square(values))))


def _velocity_error(trace: Trace) -> tuple[Array, Array]:
    c, s = np.cos(trace["heading"]), np.sin(trace["heading"])
    v_x, v_y = trace["twist_x"], trace["twist_y"]
    return c * v_x - s * v_y - trace["target_velocity_x"], s * v_x + c * v_y - trace["target_velocity_y"]


def _longest(holds: np.ndarray) -> int:
    """Most rows in a row for which one of the columns holds, shape (k, wheels)."""
    longest = 0
    for column in holds.T:
        edges = np.flatnonzero(np.diff(np.concatenate(([False], column, [False])).astype(int)))
        longest = max([longest, *(int(b - a) for a, b in edges.reshape(-1, 2))])
    return longest


def _first_use(records: Sequence[Mapping[str, Any]], uses: Sequence | None) -> float | None:
    """When a faulty part was first asked to work [s]; None: never.

    Wheels are in use while they pull; sensors and motors that run away show themselves.
    """
    times = []
    for record in records:
        end = inf if record["end"] is None else record["end"]
        if record["kind"] in ("sensor", "hard_over"):
            times.append(record["onset"])
            continue
        if uses is None:
            continue
        own = uses if record["wheel"] is None else uses[record["wheel"] - 1 : record["wheel"]]
        times += [
            max(a, record["onset"]) for wheel in own for a, b in wheel if b > record["onset"] and a < end
        ]
    return min(times, default=None)


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
        believed = apply_draw(scenario, draw, False)
        trace = _run(believed, draw, "off", believed)
        if trace.about["failure"]:
            raise SimulationError(f"{draw.name}: {trace.about['failure']}")
        return to_jsonable({"draw": draw.to_dict(), "uses": _uses(trace)})

    return run_guarded(driven)


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
      `draw`, `gains`, and `facts` of `trial.measure_trial`; or `error`: what went wrong. A run that broke
      down is a fact, `broke`, since gains can do that.
    """

    def driven() -> dict[str, Any]:
        scenario = _read(draw, values)
        believed, truth = apply_draw(scenario, draw, False), apply_draw(scenario, draw, True)
        trace = _run(believed, draw, METHOD, truth, thresholds)
        found = {"broke": trace.about["failure"]}
        if not trace.about["failure"]:
            found = dataclasses.asdict(measure_trial(trace, truth, uses))
        return to_jsonable({"draw": draw.to_dict(), "gains": dict(values), "facts": found})

    return run_guarded(driven)


def _read(draw: Draw, values: Mapping[str, float]) -> Scenario:
    scenario = read_scenario(draw.scenario, (), draw.model)
    return with_gains(scenario, scenario_gains(scenario).changed(values))


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
        controller = make_diagnosing_controller(believed, make_detector(method, believed, thresholds))
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
