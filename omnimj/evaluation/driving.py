"""Drives one case: with the method, and, where something breaks, without any and without the fault.

The controller and the method get the nominal robot and the nominal floor, the plant the true ones.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from omnimj.control.controller import Controller
from omnimj.control.diagnosing import DiagnosingController
from omnimj.errors import SimulationError
from omnimj.evaluation.cases import Case, reference_of
from omnimj.evaluation.true_robot import true_floor, true_robot
from omnimj.evaluation.use import demanded_traction, excursions, first_time, in_use, time_after_use
from omnimj.loop import drive
from omnimj.parameters import Floor, Robot, read_floors, read_robot
from omnimj.plant.conditions import Fault
from omnimj.plant.interface import Plant
from omnimj.scenario.methods import make_method
from omnimj.signals import Reference, Trace
from omnimj.trials.results import guarded, plain

OFF = "off"


def drive_case(case: Case, method: str) -> dict[str, Any]:
    """All runs of a case, as facts for scoring.

    Args:
      case: With its truth, which the method does not get.
      method: Its name.

    Returns:
      `case`: the truth. `method`: diagnoses, and with a fault heading [rad] and path [m] excursions since its
      onset, and what was said of the wheel's effectiveness after 5 s in use. `off`: the excursions without
      any method (None where the method is `off`, or nothing broke). `use`: per fault, when its part was in
      use. `speed`: seconds simulated per second. Or `error`: what went wrong.
    """
    return guarded(lambda: plain({"case": case.as_plain(), **_driven(case, method)}))


def _driven(case: Case, method: str) -> dict[str, Any]:
    nominal, floors = read_robot(), read_floors()
    reference = reference_of(case, 1.0 / nominal.sensors.sample_rate)
    asked = _run(case, nominal, floors[case.floor], reference, case.faults, method)
    if not case.faults:
        return {"method": _told(asked, None), "off": None, "use": [], "speed": _speed(asked)}
    onset = min(fault.onset for fault in case.faults)
    healthy = _run(case, nominal, floors[case.floor], reference, (), OFF)
    without = None if method == OFF else _run(case, nominal, floors[case.floor], reference, case.faults, OFF)
    time, traction = healthy["time"], demanded_traction(healthy)
    used = [in_use(fault, time, traction) for fault in case.faults]
    use = [
        {
            "first": first_time(time, rows),
            "after_long_use": time_after_use(time, rows),
            "effectiveness": _estimate(asked, fault, time_after_use(time, rows)),
        }
        for fault, rows in zip(case.faults, used, strict=True)
    ]
    return {
        "method": _told(asked, onset),
        "off": None if without is None else _told(without, onset),
        "healthy": _told(healthy, onset),
        "use": use,
        "speed": _speed(asked),
    }


def _run(
    case: Case, nominal: Robot, floor: Floor, reference: Reference, faults: Sequence[Fault], method: str
) -> Trace:
    plant = make_plant(case, nominal, floor, faults)
    try:
        diagnosing = make_method(method, nominal, plant.period)
        cascade = Controller(nominal, period=plant.period)
        controller = cascade if diagnosing is None else DiagnosingController(cascade, diagnosing)
        trace = drive(plant, controller, reference)
    finally:
        plant.close()
    if trace.about["failure"]:
        raise SimulationError(f"{case.name}, {method}: {trace.about['failure']}")
    if trace.about["interrupted"]:
        raise KeyboardInterrupt
    return trace


def make_plant(case: Case, nominal: Robot, floor: Floor, faults: Sequence[Fault]) -> Plant:
    """The plant of a case: the true robot on the true floor.

    Args:
      case: Which errors, which kind of plant, which noise.
      nominal: What the errors are relative to.
      floor: The case's floor by its nominal numbers.
      faults: The case's, or none.
    """
    robot, laid = true_robot(nominal, case.errors), true_floor(floor, case.errors)
    if case.plant == "planar":
        from omnimj.plant.planar import PlanarRobot

        return PlanarRobot(robot, laid.name, faults=faults, seed=case.noise, floors={laid.name: laid})
    from omnimj.twin.twin import RobotTwin  # MuJoCo is loaded for the twin only

    return RobotTwin(robot, laid, faults, seed=case.noise, floors={laid.name: laid})


def _told(trace: Trace, onset: float | None) -> dict[str, Any]:
    """What came of one run."""
    heading, path = (None, None) if onset is None else excursions(trace, onset)
    return {"diagnoses": trace.about["diagnoses"], "heading": heading, "path": path}


def _speed(trace: Trace) -> float:
    return float(trace.about["realtime_factor"])


def _estimate(trace: Trace, fault: Fault, time: float | None) -> float | None:
    """What the method said of a weak motor's effectiveness at a time; None without that."""
    column = f"effectiveness_{fault.wheel}"
    if time is None or fault.kind != "motor" or "loss" not in fault.numbers or column not in trace:
        return None
    row = min(int(np.searchsorted(trace["time"], time - 1e-9)), len(trace["time"]) - 1)
    return float(trace[column][row])
