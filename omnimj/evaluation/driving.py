"""Drives one case: with the method, and, where something breaks, without any and without the fault.

The controller and the method get the nominal robot and the nominal floor, the plant the true ones.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from omnimj.control.gains import Gains
from omnimj.control.robust.verdict import Thresholds
from omnimj.errors import SimulationError
from omnimj.evaluation.believed import believed
from omnimj.evaluation.cases import Case
from omnimj.evaluation.recordings import record
from omnimj.evaluation.true_robot import true_floor, true_robot
from omnimj.evaluation.use import demanded_traction, excursions, first_time, in_use, time_after_use
from omnimj.loop import drive
from omnimj.parameters import Robot
from omnimj.plant.conditions import Fault
from omnimj.plant.interface import Plant
from omnimj.scenario.drive import Drive
from omnimj.scenario.gains import with_gains
from omnimj.scenario.methods import make_method
from omnimj.scenario.running import make_diagnosing
from omnimj.scenario.scenario import Scenario
from omnimj.signals import Trace
from omnimj.trials.results import guarded, plain

OFF = "off"


def drive_case(
    case: Case,
    method: str,
    settings: Sequence[str] = (),
    thresholds: Thresholds | None = None,
    recordings: Path | None = None,
    gains: Gains | None = None,
) -> dict[str, Any]:
    """All runs of a case, as facts for scoring.

    Args:
      case: With its truth, which the method does not get.
      method: Its name.
      settings: `KEY=VALUE` texts for method and cascade.
      thresholds: Of the robust method; the shipped ones when None.
      recordings: Folder for what the sensors said in the run with the method; nowhere when None.
      gains: Of cascade, recovery and observer, in all runs of the case; the shipped ones when None.

    Returns:
      `case`: the truth. `method`: diagnoses, and with a fault heading [rad] and path [m] excursions since its
      onset. `off`: the same without any method (None where the method is `off`, or nothing broke). `healthy`:
      the same without any method and any fault. `use`: per fault, when its part was in use, and what was said
      of the wheel's effectiveness after 5 s of it. `speed`: seconds simulated per second. Or `error`: what
      went wrong.
    """

    def driven() -> dict[str, Any]:
        found = _driven(case, method, settings, thresholds, recordings, gains)
        return plain({"case": case.as_plain(), **found})

    return guarded(driven)


def _driven(
    case: Case,
    method: str,
    settings: Sequence[str],
    thresholds: Thresholds | None,
    recordings: Path | None,
    gains: Gains | None,
) -> dict[str, Any]:
    scenario = believed(case, settings)
    if gains is not None:
        scenario = with_gains(scenario, gains)
    asked = _run(case, scenario, case.faults, method, thresholds)
    if recordings is not None:
        record(recordings, case, asked)
    speed = float(asked.about["realtime_factor"])
    if not case.faults:
        return {"method": _told(asked, None), "off": None, "use": [], "speed": speed}
    onset = min(fault.onset for fault in case.faults)
    healthy = _run(case, scenario, (), OFF)
    without = None if method == OFF else _run(case, scenario, case.faults, OFF)
    return {
        "method": _told(asked, onset),
        "off": None if without is None else _told(without, onset),
        "healthy": _told(healthy, onset),
        "use": _use(case.faults, healthy, asked),
        "speed": speed,
    }


def _use(faults: Sequence[Fault], healthy: Trace, asked: Trace) -> list[dict[str, float | None]]:
    """Per fault when its part was in use, and the estimate after long use."""
    time, traction = healthy["time"], demanded_traction(healthy)
    found = []
    for fault in faults:
        used = in_use(fault, time, traction)
        late = time_after_use(time, used)
        estimate = _estimate(asked, fault, late)
        found.append({"first": first_time(time, used), "after_long_use": late, "effectiveness": estimate})
    return found


def _run(
    case: Case,
    scenario: Scenario,
    faults: Sequence[Fault],
    method: str,
    thresholds: Thresholds | None = None,
) -> Trace:
    """One run; the method is told the scenario, which knows of no fault and no error."""
    plant = make_plant(case, scenario, faults)
    try:
        own = () if thresholds is None else (thresholds,)
        drives = make_diagnosing(scenario, make_method(method, scenario, *own))
        assert isinstance(scenario.drive, Drive)
        trace = drive(plant, drives, scenario.drive.reference)
    finally:
        plant.close()
    if trace.about["failure"]:
        raise SimulationError(f"{case.name}, {method}: {trace.about['failure']}")
    if trace.about["interrupted"]:
        raise KeyboardInterrupt
    return trace


def make_plant(case: Case, scenario: Scenario, faults: Sequence[Fault]) -> Plant:
    """The plant of a case: the true robot on the true floor.

    Args:
      case: Which errors, which kind of plant, which noise.
      scenario: With the nominal robot and floor that the errors are relative to.
      faults: The case's, or none.
    """
    nominal = scenario.constants
    assert isinstance(nominal, Robot)
    robot, laid = true_robot(nominal, case.errors), true_floor(scenario.floors[case.floor], case.errors)
    if case.plant == "planar":
        from omnimj.plant.planar import PlanarRobot

        return PlanarRobot(robot, laid.name, faults=faults, seed=case.noise, floors={laid.name: laid})
    from omnimj.twin.twin import RobotTwin  # MuJoCo is loaded for the twin only

    return RobotTwin(robot, laid, faults, seed=case.noise, floors={laid.name: laid})


def _told(trace: Trace, onset: float | None) -> dict[str, Any]:
    """What came of one run."""
    heading, path = (None, None) if onset is None else excursions(trace, onset)
    return {"diagnoses": trace.about["diagnoses"], "heading": heading, "path": path}


def _estimate(trace: Trace, fault: Fault, time: float | None) -> float | None:
    """What the method said of a weak motor's effectiveness at a time; None without that."""
    column = f"effectiveness_{fault.wheel}"
    if time is None or fault.kind != "motor" or "loss" not in fault.numbers or column not in trace:
        return None
    row = min(int(np.searchsorted(trace["time"], time - 1e-9)), len(trace["time"]) - 1)
    return float(trace[column][row])
