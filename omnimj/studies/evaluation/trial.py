"""Drives one case: with the method, and, where something breaks, without any and without the fault.

The controller and the method get the nominal robot and the nominal floor, the plant the true ones.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from pathlib import Path
from types import MappingProxyType
from typing import Any

import numpy as np

from omnimj.control.detection.robust.thresholds import Thresholds
from omnimj.control.gains import Gains
from omnimj.errors import SimulationError
from omnimj.parameters import Robot
from omnimj.plant.faults import Fault
from omnimj.plant.interface import Plant, robot_channels
from omnimj.recording.dataset import Run
from omnimj.recording.dataset_file import DATASET_FILE
from omnimj.recording.folder import atomic_file
from omnimj.recording.json_files import run_guarded, to_jsonable
from omnimj.recording.write_dataset import dataset_text, write_table
from omnimj.signals import Array, Trace
from omnimj.simulate.detectors import make_detector
from omnimj.simulate.loop import drive
from omnimj.simulate.run import make_diagnosing_controller
from omnimj.simulate.scenario.drive import Drive
from omnimj.simulate.scenario.scenario import Scenario, with_gains
from omnimj.studies.evaluation.cases import WHEELS, Case, nominal_scenario
from omnimj.studies.part_use import demanded_traction, excursions, first_time, in_use, time_after_use
from omnimj.studies.random_truth import true_floor, true_robot

# What the sensors of evaluated cases said, as a dataset: for `omnimj calibrate` and `omnimj diagnose`.

RECORDINGS = "recordings"
"""The dataset's folder inside the evaluation's."""
_PLANT = "uto_robot"


def is_recorded(folder: Path, case: Case) -> bool:
    """Whether the recording of a case is there."""
    return _file(folder, case).is_file()


def write_recording(folder: Path, case: Case, trace: Trace) -> None:
    """Writes the recording of a case, in full or not at all."""
    targets = [f"current_target_{i}" for i in range(1, WHEELS + 1)]
    columns = {name: trace[name] for name in ("time", *robot_channels(WHEELS), *targets)}
    folder.mkdir(parents=True, exist_ok=True)
    with atomic_file(_file(folder, case)) as temporary:
        write_table(temporary, _recordings_run(case, columns))


def write_recordings_index(folder: Path, cases: Iterable[Case]) -> None:
    """Makes the recordings that are there a dataset."""
    runs = [_recordings_run(case, {}) for case in cases if is_recorded(folder, case)]
    if runs:
        with atomic_file(folder / DATASET_FILE) as temporary:
            temporary.write_text(dataset_text(_PLANT, {}, runs), encoding="utf-8", newline="\n")


def _file(folder: Path, case: Case) -> Path:
    return folder / f"{case.name}.parquet"


def _recordings_run(case: Case, columns: dict[str, Array]) -> Run:
    return Run(case.name, columns, MappingProxyType({}), MappingProxyType({"floor": case.floor}))


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
        return to_jsonable({"case": case.to_dict(), **found})

    return run_guarded(driven)


def _driven(
    case: Case,
    method: str,
    settings: Sequence[str],
    thresholds: Thresholds | None,
    recordings: Path | None,
    gains: Gains | None,
) -> dict[str, Any]:
    scenario = nominal_scenario(case, settings)
    if gains is not None:
        scenario = with_gains(scenario, gains)
    asked = _run(case, scenario, case.faults, method, thresholds)
    if recordings is not None:
        write_recording(recordings, case, asked)
    speed = float(asked.about["realtime_factor"])
    if not case.faults:
        return {"method": _summarize_run(asked, None), "off": None, "use": [], "speed": speed}
    onset = min(fault.onset for fault in case.faults)
    healthy = _run(case, scenario, (), OFF)
    without = None if method == OFF else _run(case, scenario, case.faults, OFF)
    return {
        "method": _summarize_run(asked, onset),
        "off": None if without is None else _summarize_run(without, onset),
        "healthy": _summarize_run(healthy, onset),
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
    plant = make_true_plant(case, scenario, faults)
    try:
        own = () if thresholds is None else (thresholds,)
        drives = make_diagnosing_controller(scenario, make_detector(method, scenario, *own))
        assert isinstance(scenario.drive, Drive)
        trace = drive(plant, drives, scenario.drive.reference)
    finally:
        plant.close()
    if trace.about["failure"]:
        raise SimulationError(f"{case.name}, {method}: {trace.about['failure']}")
    if trace.about["interrupted"]:
        raise KeyboardInterrupt
    return trace


def make_true_plant(case: Case, scenario: Scenario, faults: Sequence[Fault]) -> Plant:
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
    from omnimj.plant.mujoco.twin import RobotTwin  # MuJoCo is loaded for the twin only

    return RobotTwin(robot, laid, faults, seed=case.noise, floors={laid.name: laid})


def _summarize_run(trace: Trace, onset: float | None) -> dict[str, Any]:
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
