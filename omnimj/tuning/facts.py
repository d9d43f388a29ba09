"""What came of one trial in numbers: following, effort, slip, diagnosis, saturation."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from math import inf
from typing import Any

import numpy as np

from omnimj.parameters import Robot
from omnimj.scenario.judging import judge_diagnoses
from omnimj.scenario.scenario import Scenario
from omnimj.scenario.summary import true_faults
from omnimj.signals import KINDS_OF_DIAGNOSIS, Array, Trace

MISSED = 2.0
"""Delay that a fault counts which is never found, and the largest that counts [s]."""
_FULL = 0.999  # of the largest current: a wheel is at its limit


@dataclass(frozen=True)
class Facts:
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


def facts_of(result: Mapping[str, Any]) -> Facts:
    """The facts out of a trial's kept result."""
    found = result["facts"]
    if found.get("broke"):
        return Facts(inf, inf, inf, inf, inf, inf, None, False, 0, inf, found["broke"])
    return Facts(**found)


def measure_trial(trace: Trace, truth: Scenario, uses: Sequence | None) -> Facts:
    """The facts of a run that came to its end.

    Args:
      trace: With truth and plan.
      truth: The scenario with its faults and patches.
      uses: From `driving.drive_healthy`; None where nothing goes wrong.
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
    return Facts(
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
