"""Trials of a tuning: a draw driven with the gains of a candidate, its metrics, and batches of trials.

Controller and method are made for the nominal robot without faults; the plant is the true robot. Each trial
is stored and run only once.

The folder:
  tuning_plan.json               settings
  uses_NAME.json                 intervals of a draw in which wheels are in use
  trial_NAME_HASH.json           a draw driven with a candidate; the hash is that of its gains
"""

from __future__ import annotations

import dataclasses
import hashlib
import json
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from math import inf
from pathlib import Path
from typing import Any

import numpy as np

from omnimj.control.detection.robust.thresholds import Thresholds
from omnimj.errors import InputError, SimulationError
from omnimj.signals import KINDS_OF_DIAGNOSIS, Array, Trace, true_stretches
from omnimj.simulate.detectors import make_detector
from omnimj.simulate.judging import judge_diagnoses
from omnimj.simulate.metrics import rms
from omnimj.simulate.plants import make_plant
from omnimj.simulate.scenario.scenario import Scenario, read_scenario, scenario_gains, with_gains
from omnimj.simulate.summary import true_faults
from omnimj.studies.part_use import IN_USE, demanded_traction
from omnimj.studies.random_truth import drive_on_plant, with_errors
from omnimj.studies.runner import StudyFolder, TrialFolder, guarded
from omnimj.studies.tuning.draws import Draw, apply_draw
from omnimj.studies.tuning.search import Candidate, GainAxis, values_by_name
from omnimj.studies.workers import Progress, WorkerPool

METHOD = "robust"
"""Diagnosis method whose diagnoses trigger the recovery."""
Uses = Sequence[Sequence[Sequence[float]]]
"""Intervals [start, end] in which traction is demanded of each wheel [s]."""
MISSED = 2.0
"""Upper limit of a detection delay, also used for a fault that is never found [s]."""
_FULL = 0.999  # share of the current limit from which a wheel counts as saturated
PLAN = "tuning_plan.json"


@dataclass(frozen=True)
class TrialMetrics:
    """Metrics of tracking, effort, slip and diagnosis in one trial."""

    path: float
    """RMS distance of the centre from its target [m]."""
    velocity: float
    """RMS error of the velocity of the centre [m/s]."""
    heading: float
    """RMS error of the heading [rad]."""
    current: float
    """RMS commanded current over time and wheels [A]."""
    current_rate: float
    """RMS change of the commanded currents per control period [A/s]."""
    slip: float
    """RMS slip velocity over time and wheels [m/s]."""
    delay: float | None
    """Time from the first use of a faulty part to the first alarm, 0 … `MISSED` [s]; None if unused."""
    missed: bool
    """True if a fault was in use and not found."""
    false_alarms: int
    saturation: float
    """Longest time at the current limit of a wheel without a fault [s]."""
    broke: str | None = None
    """Reason of a failed run, for which all other metrics are unknown; None for a completed run."""


def read_metrics(result: Mapping[str, Any]) -> TrialMetrics:
    """Return the metrics in the stored result of a trial."""
    found = result["facts"]
    if found.get("broke"):
        return TrialMetrics(inf, inf, inf, inf, inf, inf, None, False, 0, inf, found["broke"])
    return TrialMetrics(**found)


def measure_trial(trace: Trace, truth: Scenario, uses: Sequence | None) -> TrialMetrics:
    """Compute the metrics of a completed run."""
    robot = truth.robot
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
        path=rms(np.hypot(off_x, off_y)),
        velocity=rms(np.hypot(*_velocity_error(trace))),
        heading=rms(turned),
        current=rms(command),
        current_rate=rms(np.diff(command, axis=0)) / truth.period,
        slip=rms(trace.wheels("slip_velocity")),
        delay=delay,
        missed=first is not None and verdict.detection_delay is None,
        false_alarms=verdict.false_alarms,
        saturation=_longest(np.abs(command[:, sound]) >= _FULL * limit) * truth.period,
    )


def _velocity_error(trace: Trace) -> tuple[Array, Array]:
    c, s = np.cos(trace["heading"]), np.sin(trace["heading"])
    v_x, v_y = trace["twist_x"], trace["twist_y"]
    return c * v_x - s * v_y - trace["target_velocity_x"], s * v_x + c * v_y - trace["target_velocity_y"]


def _longest(holds: np.ndarray) -> int:
    """Return the largest number of consecutive true rows in any column, shape (k, n)."""
    return max((int(end - start) for column in holds.T for start, end in true_stretches(column)), default=0)


def _first_use(records: Sequence[Mapping[str, Any]], uses: Sequence | None) -> float | None:
    """Return the first time at which a faulty part was in use [s]; None: never.

    A wheel is in use while traction is demanded of it; a sensor and a motor that runs away always are.
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


@guarded
def drive_healthy(draw: Draw, values: Mapping[str, float]) -> dict[str, Any]:
    """Find the intervals in which each wheel of a draw is in use, by a run without faults and diagnosis.

    Returns:
      `draw`: the truth. `uses`: intervals per wheel. Or `error`: the message of a run that failed.
    """
    nominal = apply_draw(_read(draw, values), draw, False)
    trace = _run(nominal, draw, "off", nominal)
    if trace.about["failure"]:
        raise SimulationError(f"{draw.name}: {trace.about['failure']}")
    return {"draw": draw.to_dict(), "uses": _uses(trace)}


@guarded
def drive_trial(
    draw: Draw, values: Mapping[str, float], uses: Uses | None, thresholds: Thresholds | None = None
) -> dict[str, Any]:
    """Drive one draw with the gains of a candidate.

    Returns:
      `draw`, `gains`, and `facts` from `measure_trial`; a failed run has the one fact `broke`: gains can
      cause that. Or `error`: the message of a trial that failed otherwise.
    """
    scenario = _read(draw, values)
    nominal, truth = apply_draw(scenario, draw, False), apply_draw(scenario, draw, True)
    trace = _run(nominal, draw, METHOD, truth, thresholds)
    facts = {"broke": trace.about["failure"]}
    if not trace.about["failure"]:
        facts = dataclasses.asdict(measure_trial(trace, truth, uses))
    return {"draw": draw.to_dict(), "gains": dict(values), "facts": facts}


def _read(draw: Draw, values: Mapping[str, float]) -> Scenario:
    scenario = read_scenario(draw.scenario, (), draw.model)
    return with_gains(scenario, scenario_gains(scenario).changed(values))


def _run(
    nominal: Scenario, draw: Draw, method: str, truth: Scenario, thresholds: Thresholds | None = None
) -> Trace:
    """Run the nominal scenario on a plant with the true parameters and faults."""
    detector = make_detector(method, nominal, thresholds)
    plant = make_plant(with_errors(truth, draw.errors, draw.floor), draw.plant, draw.noise)
    return drive_on_plant(nominal, plant, detector)


def _uses(healthy: Trace) -> list[list[list[float]]]:
    """Return the intervals of use of each wheel."""
    time, works = healthy["time"], demanded_traction(healthy) > IN_USE
    last = len(time) - 1
    return [
        [[float(time[start]), float(time[min(end, last)])] for start, end in true_stretches(wheel)]
        for wheel in works.T
    ]


class TrialBatch:
    """Batch of trials: candidates driven over draws."""

    def __init__(
        self,
        folder: Path,
        axes: Sequence[GainAxis],
        before: Mapping[str, float],
        thresholds: Thresholds | None,
        pool: WorkerPool,
        report: Progress,
    ):
        self._trials, self._axes, self._before = TrialFolder(folder), tuple(axes), dict(before)
        self._thresholds, self._pool, self._report = thresholds, pool, report
        self._uses: dict[str, Any] = {}

    def drive(self, candidates: Sequence[Candidate], draws: Sequence[Draw]) -> list[tuple[TrialMetrics, ...]]:
        """Return the metrics of every candidate, one per draw.

        Raises:
          SimulationError: A trial failed for a reason other than its gains, or a worker died.
          InputError: A stored trial has another truth.
        """
        self._find_uses(draws)
        gains = {one: {**self._before, **values_by_name(self._axes, one)} for one in candidates}
        tasks = {
            _name(draw, values): (draw, values, self._uses.get(draw.name), self._thresholds)
            for values in gains.values()
            for draw in draws
        }
        found = self._complete(drive_trial, tasks, "trials")
        return [tuple(read_metrics(found[_name(draw, gains[one])]) for draw in draws) for one in candidates]

    def _find_uses(self, draws: Sequence[Draw]) -> None:
        """Find the intervals of use of all draws with a fault."""
        tasks = {
            f"uses_{draw.name}": (draw, self._before)
            for draw in draws
            if draw.is_broken and draw.name not in self._uses
        }
        for name, result in self._complete(drive_healthy, tasks, "driving without faults").items():
            self._uses[name.removeprefix("uses_")] = result["uses"]

    def _complete(
        self, function: Callable[..., Any], tasks: Mapping[str, tuple], phrase: str
    ) -> dict[str, dict[str, Any]]:
        """Return the results of all tasks by name, after running those that are missing."""
        stored = {name: self._trials.finished(name, draw=task[0].to_dict()) for name, task in tasks.items()}
        missing = {name: tasks[name] for name, result in stored.items() if result is None}
        if missing:
            self._pool.run_all(function, missing, self._trials.write, phrase, self._report)
        found, errors = self._trials.collect(missing)
        errors |= {name: "its file vanished" for name in missing if name not in found and name not in errors}
        if errors:
            name, error = next(iter(errors.items()))
            raise SimulationError(f"{len(errors)} of {len(tasks)} trials failed; {name}: {error}")
        return {name: found[name] if result is None else result for name, result in stored.items()}


def _name(draw: Draw, values: Mapping[str, float]) -> str:
    text = json.dumps(dict(values), sort_keys=True)
    return f"trial_{draw.name}_{hashlib.sha256(text.encode()).hexdigest()[:16]}"


def claim_folder(folder: Path, plan: Mapping[str, Any], force: bool) -> None:
    """Make the folder hold the trials of this plan.

    Raises:
      InputError: It holds trials of another plan and `force` is not given, or something else; or it cannot be
        written.
    """
    if folder.is_dir() and any(folder.iterdir()) and not (folder / PLAN).is_file():
        rule = "trials are stored in a folder of this name; choose another --out"
        raise InputError(folder, "holds files other than the trials of a tuning", rule)
    StudyFolder(folder, PLAN, "a tuning", ("trial_*.json", "uses_*.json")).claim(plan, force)
