"""Trial of an evaluation: one case with the method; if it has a fault, also without method and without fault.

Controller and method are made for the nominal robot and floor, the plant for the true ones.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from types import MappingProxyType
from typing import Any

import numpy as np

from omnimj.control.detection.robust.thresholds import Thresholds
from omnimj.control.gains import Gains
from omnimj.control.recovery.modes import PIVOTING, STOPPING
from omnimj.errors import SimulationError
from omnimj.plant.faults import Fault
from omnimj.plant.interface import Plant, robot_channels
from omnimj.recording.dataset import Run
from omnimj.recording.dataset_file import DATASET_FILE
from omnimj.recording.folder import atomic_file
from omnimj.recording.json_files import write_text
from omnimj.recording.write_dataset import dataset_text, write_table
from omnimj.signals import Array, Trace
from omnimj.simulate.detectors import make_detector
from omnimj.simulate.plants import make_plant
from omnimj.simulate.scenario.scenario import Scenario, with_gains
from omnimj.studies.evaluation.cases import WHEELS, Case, nominal_scenario
from omnimj.studies.part_use import (
    demanded_traction,
    departures,
    excursions,
    first_time,
    held_slip,
    in_use,
    time_after_use,
)
from omnimj.studies.random_structure import with_structure
from omnimj.studies.random_truth import drive_on_plant, with_errors
from omnimj.studies.runner import guarded

OFF = "off"
RECORDINGS = "recordings"
"""Folder of the recorded dataset inside that of the evaluation."""
SLIP_MEMORY = 0.5
"""Time before a diagnosis of slip within which its wheel must slip, for the diagnosis to be true [s]."""
_PLANT = "uto_robot"


@guarded
def drive_case(
    case: Case,
    method: str,
    settings: Sequence[str] = (),
    thresholds: Thresholds | None = None,
    recordings: Path | None = None,
    gains: Gains | None = None,
) -> dict[str, Any]:
    """Drive all runs of a case.

    Args:
      case: The case with its truth, which is hidden from the method.
      method: Name of the diagnosis method.
      settings: `KEY=VALUE` texts for method and cascade.
      thresholds: Thresholds of the robust method; the shipped ones when None.
      recordings: Folder for the sensor signals of the run with the method; not kept when None.
      gains: Gains of cascade, recovery and observer in all runs of the case; the shipped ones when None.

    Returns:
      Facts for scoring. `case`: the truth. `method`: diagnoses; with a fault the excursions of heading [rad]
      and path [m] since its onset, and whether the recovery gave the heading up since then; without any the
      slip velocity that the wheels of each diagnosis of slip really held before it [m/s]. `off`: the
      same without any method (None if the method is `off`, or without a fault). `healthy`: the same without
      method and fault. `change`: largest departure of heading [rad] and position [m] of the run without any
      method from the healthy one. `use`: per fault the time at which its part was first in use, the estimated
      effectiveness of the wheel after 5 s of use, and of a slip the slip velocity held without any method
      [m/s]. `speed`: simulated seconds per second. Or `error`: the message of a trial that failed.
    """
    scenario = nominal_scenario(case, settings)
    if gains is not None:
        scenario = with_gains(scenario, gains)
    diagnosed = _run(case, scenario, case.faults, method, thresholds)
    if recordings is not None:
        write_recording(recordings, case, diagnosed)
    truth, speed = case.to_dict(), float(diagnosed.about["realtime_factor"])
    if not case.faults:
        summary = _summarize_run(diagnosed, None)
        return {"case": truth, "method": summary, "off": None, "use": [], "speed": speed}
    onset = min(fault.onset for fault in case.faults)
    healthy = _run(case, scenario, (), OFF)
    without = None if method == OFF else _run(case, scenario, case.faults, OFF)
    unaided = diagnosed if without is None else without
    heading, path = departures(unaided, healthy, onset)
    return {
        "case": truth,
        "method": _summarize_run(diagnosed, onset),
        "off": None if without is None else _summarize_run(without, onset),
        "healthy": _summarize_run(healthy, onset),
        "change": {"heading": heading, "path": path},
        "use": [_use(fault, healthy, diagnosed) | _slip(fault, unaided) for fault in case.faults],
        "speed": speed,
    }


def _run(
    case: Case,
    scenario: Scenario,
    faults: Sequence[Fault],
    method: str,
    thresholds: Thresholds | None = None,
) -> Trace:
    """Drive one run; the method is given the nominal scenario without any fault."""
    detector = make_detector(method, scenario, thresholds)
    trace = drive_on_plant(scenario, make_true_plant(case, scenario, faults), detector)
    if trace.about["failure"]:
        raise SimulationError(f"{case.name}, {method}: {trace.about['failure']}")
    return trace


def make_true_plant(case: Case, scenario: Scenario, faults: Sequence[Fault]) -> Plant:
    """Make the plant of a case: the true robot on the true floor, with the given faults."""
    truth = with_errors(scenario, case.errors, case.floor)
    if case.structure is not None:
        payload = case.errors.payload * scenario.robot.body.mass
        robot = with_structure(truth.robot, case.structure, payload)
        truth = dataclasses.replace(truth, constants=robot)
    return make_plant(dataclasses.replace(truth, faults=tuple(faults)), case.plant, case.noise)


def _summarize_run(trace: Trace, onset: float | None) -> dict[str, Any]:
    diagnoses = trace.about["diagnoses"]
    if onset is None:
        slips = [_slip_before(trace, one) for one in diagnoses]
        return {"diagnoses": diagnoses, "heading": None, "path": None, "slips": slips}
    heading, path = excursions(trace, onset)
    gave_up = _gave_up_heading(trace, onset)
    return {"diagnoses": diagnoses, "heading": heading, "path": path, "gave_up_heading": gave_up}


def _slip_before(trace: Trace, diagnosis: Mapping[str, Any]) -> float | None:
    """Return the largest slip velocity held within `SLIP_MEMORY` before a diagnosis of slip; else None."""
    if diagnosis["kind"] != "slip":
        return None
    at = diagnosis["time"]
    return max(held_slip(trace, wheel, at - SLIP_MEMORY, at) for wheel in diagnosis["wheels"])


def _gave_up_heading(trace: Trace, onset: float) -> bool:
    """Return whether the recovery turned about a wheel or stopped at some time since an onset."""
    if "recovery" not in trace:
        return False
    modes = trace["recovery"][trace["time"] >= onset - 1e-9]
    return bool(np.isin(modes, (PIVOTING, STOPPING)).any())


def _slip(fault: Fault, unaided: Trace) -> dict[str, float | None]:
    """Return the slip velocity that a slipping wheel holds without any method; None for other faults."""
    if fault.kind != "slip" or fault.wheel is None:
        return {"slip": None}
    end = math.inf if fault.end is None else fault.end
    return {"slip": held_slip(unaided, fault.wheel, fault.onset, end)}


def _use(fault: Fault, healthy: Trace, diagnosed: Trace) -> dict[str, float | None]:
    """Return the first time of use of a faulty part, and the estimate after long use."""
    time = healthy["time"]
    used = in_use(fault, time, demanded_traction(healthy))
    late = time_after_use(time, used)
    estimate = _estimate(diagnosed, fault, late)
    return {"first": first_time(time, used), "after_long_use": late, "effectiveness": estimate}


def _estimate(trace: Trace, fault: Fault, time: float | None) -> float | None:
    """Return the estimated effectiveness of a weak motor at a time; None where there is no estimate."""
    column = f"effectiveness_{fault.wheel}"
    if time is None or fault.kind != "motor" or "loss" not in fault.numbers or column not in trace:
        return None
    row = min(int(np.searchsorted(trace["time"], time - 1e-9)), len(trace["time"]) - 1)
    return float(trace[column][row])


def is_recorded(folder: Path, case: Case) -> bool:
    """Return whether the recording of a case exists."""
    return _recording_file(folder, case).is_file()


def write_recording(folder: Path, case: Case, trace: Trace) -> None:
    """Write the recording of a case, in full or not at all."""
    targets = [f"current_target_{i}" for i in range(1, WHEELS + 1)]
    columns = {name: trace[name] for name in ("time", *robot_channels(WHEELS), *targets)}
    folder.mkdir(parents=True, exist_ok=True)
    with atomic_file(_recording_file(folder, case)) as temporary:
        write_table(temporary, _recorded_run(case, columns))


def write_recordings_index(folder: Path, cases: Iterable[Case]) -> None:
    """Write the dataset file of the recordings that exist."""
    runs = [_recorded_run(case, {}) for case in cases if is_recorded(folder, case)]
    if runs:
        write_text(folder / DATASET_FILE, dataset_text(_PLANT, {}, runs))


def _recording_file(folder: Path, case: Case) -> Path:
    return folder / f"{case.name}.parquet"


def _recorded_run(case: Case, columns: dict[str, Array]) -> Run:
    return Run(case.name, columns, MappingProxyType({}), MappingProxyType({"floor": case.floor}))
