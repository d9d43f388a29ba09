"""`metrics.json`: description, true faults, diagnoses, metrics and checks of a run."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from omnimj.plant.faults import fault_record
from omnimj.recording.json_files import to_jsonable
from omnimj.signals import Trace
from omnimj.simulate.judging import judge_diagnoses, patch_records
from omnimj.simulate.metrics import DIAGNOSIS_UNITS, compute_metrics
from omnimj.simulate.scenario.checks import CheckResult, evaluate_checks
from omnimj.simulate.scenario.scenario import Scenario
from omnimj.simulate.scenario.tables import kinematic_faults


def summarize(scenario: Scenario, trace: Trace) -> dict[str, Any]:
    """Content of `metrics.json`.

    An interrupted run never passes, whatever its checks yield. On hardware the truth is unknown: `faults` is
    empty, `scenario_faults` lists the faults of the scenario file, which hold only if the device emulates the
    same scenario, and checks that need the truth are not judged.

    Args:
      scenario: The scenario that was driven.
      trace: Trace of at least one row; its `about` has plant, method, seed, realtime_factor and interrupted.
    """
    about, has_truth = trace.about, "link" not in trace.about
    faults = true_faults(scenario, trace)
    diagnosed = _diagnosis(faults, about.get("diagnoses", ()), len(scenario.wheel_positions))
    measured = compute_metrics(
        trace, {name: unit for name, unit in scenario.metric_units.items() if name not in DIAGNOSIS_UNITS}
    )
    if not has_truth:
        diagnosed |= {"detection_delay": None, "isolated": None, "false_alarms": 0}
    scores = {name: None if diagnosed[name] is None else float(diagnosed[name]) for name in DIAGNOSIS_UNITS}
    known = {**measured, **scores}
    unknown = () if has_truth else [name for name in known if known[name] is None or name in DIAGNOSIS_UNITS]
    judgements = evaluate_checks(scenario.checks, known, str(about["method"]), unknown)
    interrupted = bool(about["interrupted"])
    content = {
        "scenario": scenario.name,
        "plant": about["plant"],
        "robot": scenario.plant,
        "method": about["method"],
        "seed": about["seed"],
        "floor": scenario.floor,
        "duration": float(trace["time"][-1]) if interrupted else scenario.duration,
        "overrides": list(scenario.overrides),
        "realtime_factor": about["realtime_factor"],
        "interrupted": interrupted,
        "passed": all(judgement.ok for judgement in judgements if judgement.judged) and not interrupted,
        "faults": faults if has_truth else [],
        **diagnosed,
        **dict.fromkeys(("max_yaw_excursion", "path_error_max", "path_error_rms")),
        **measured,
        "checks": [_check_record(judgement) for judgement in judgements],
        **({} if has_truth else {"truth": False, "scenario_faults": faults, "link": about["link"]}),
    }
    return to_jsonable(content)


def true_faults(scenario: Scenario, trace: Trace) -> list[dict[str, Any]]:
    """Faults of the run in the order of onset: scheduled ones, slip on patches, and lost demands."""
    records = [fault_record(fault) for fault in scenario.faults]
    records += patch_records(trace, scenario.patches, scenario.floor, scenario.wheel_positions)
    if scenario.kinematics is not None:
        records += kinematic_faults(scenario.kinematics)
    return sorted(records, key=lambda record: record["onset"])


def _diagnosis(
    faults: Sequence[Mapping[str, Any]], diagnoses: Sequence[Mapping[str, Any]], wheels: int
) -> dict[str, Any]:
    """Entries for the diagnoses and their scores; empty without a detector."""
    score = judge_diagnoses(faults, diagnoses, wheels)
    return {
        "diagnoses": diagnoses,
        "detection_delay": score.detection_delay,
        "isolated": score.isolated,
        "false_alarms": score.false_alarms,
    }


def _check_record(judgement: CheckResult) -> dict[str, Any]:
    check = judgement.check
    record = {
        "name": check.name,
        "value": judgement.value,
        "limit": check.limit,
        "ok": judgement.ok,
        "bound": check.bound,
    }
    return record if judgement.judged else {**record, "judged": False}
