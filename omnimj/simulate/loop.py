"""Steps a plant and fills one row per control step; whatever ends it early keeps what was recorded."""

from __future__ import annotations

import dataclasses
import math
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from omnimj.control.detection.detector import FaultDetector
from omnimj.errors import LinkLost, SimulationError
from omnimj.plant.interface import RIG_CHANNELS, Plant, robot_channels
from omnimj.signals import (
    Array,
    CurrentCommand,
    Diagnosis,
    Measurement,
    Reference,
    RigMeasurement,
    Target,
    Trace,
)

SNAPSHOT_PERIOD = 0.02
"""Time between two poses of the 3-D recording [s]."""

Progress = Callable[[int, int], None]
"""Called now and then with the rows done and the rows in all."""
Snapshot = Callable[[float, Array], None]
"""Called every `SNAPSHOT_PERIOD` with the time [s] and the plant's pose (the twin's qpos)."""
Rows = Callable[[tuple[str, ...], Array], None]
"""Called now and then with the columns' names and the rows since the call before, shape (m, columns)."""

LARGEST_TRUTH = 1e10
"""A truth beyond it, in whatever unit, is no robot's: MuJoCo gives up there too."""

_PROGRESS_EVERY = 100  # [rows]
_LONG_STEP = 0.1  # [s] in a step that takes longer code is compiled, or the machine stands still


@dataclass(frozen=True)
class Callbacks:
    """Who looks on while the loop runs."""

    progress: Progress | None = None
    snapshot: Snapshot | None = None
    rows: Rows | None = None


NO_CALLBACKS = Callbacks()
"""Nobody does."""


def record(
    plant: Plant,
    measurement: Measurement | RigMeasurement,
    control: Callable[[int, Array, Any], CurrentCommand],
    names: tuple[str, ...],
    rows: int,
    watch: Callbacks,
    about: Mapping[str, Any],
) -> Trace:
    """Steps the plant and fills one row per step: first `names` (by `control`), then the plant's truth.

    A failure inside is a value, so that nothing recorded is lost; the outermost call raises.
    """
    names = (*names, *plant.truth_names)
    if len(set(names)) != len(names):
        raise ValueError(f"two columns share a name: {sorted(n for n in set(names) if names.count(n) > 1)}")
    # filled before the clock runs: memory that is only promised takes up to 8 ms when a row first touches it
    table = np.full((rows, len(names)), np.nan)
    first_truth = len(names) - len(plant.truth_names)
    show = _row_callback(plant, watch, names, table)
    done, begin = 0, time.perf_counter()
    last = begin
    interrupted, failure = False, None
    try:
        for k, row in enumerate(table):
            command = control(k, row, measurement)
            truth = plant.truth()
            row[first_truth:] = truth
            check_truth(plant.truth_names, truth.tolist())
            done = k + 1
            show(done, row[0])
            if done < rows:
                measurement = plant.step(command)
            now = time.perf_counter()
            if now - last > _LONG_STEP:
                begin += now - last
            last = now
    except KeyboardInterrupt:
        interrupted = True
    except (SimulationError, ArithmeticError, LinkLost) as error:
        interrupted, failure = True, f"at {done * plant.period:.4f} s: {error}"
    wall = time.perf_counter() - begin
    columns = np.ascontiguousarray(table[:done].T)
    simulated = max(done - 1, 0) * plant.period
    described = {
        **about,
        "interrupted": interrupted,
        "failure": failure,
        "realtime_factor": simulated / wall if wall > 0.0 else 0.0,
    }
    return Trace(dict(zip(names, columns, strict=True)), described)


def _row_callback(
    plant: Plant, watch: Callbacks, names: tuple[str, ...], table: Array
) -> Callable[[int, float], None]:
    """What to do after each row: progress and rows now and then, a snapshot every `SNAPSHOT_PERIOD`."""
    progress, snapshot, pose, total = watch.progress, watch.snapshot, getattr(plant, "pose", None), len(table)
    each = max(1, round(SNAPSHOT_PERIOD / plant.period))

    def show(done: int, now: float) -> None:
        if snapshot is not None and pose is not None and (done - 1) % each == 0:
            snapshot(float(now), pose())
        if done % _PROGRESS_EVERY and done != total:
            return
        if progress is not None:
            progress(done, total)
        if watch.rows is not None:
            watch.rows(names, table[(done - 1) // _PROGRESS_EVERY * _PROGRESS_EVERY : done])

    return show


def check_truth(names: tuple[str, ...], truth: list[float]) -> None:
    """Refuses a truth that is not finite or beyond `LARGEST_TRUTH`; for twenty numbers the quickest way.

    Raises:
      SimulationError: It names the columns.
    """
    if (
        math.isfinite(sum(truth))
        and max(truth, default=0.0) <= LARGEST_TRUTH
        and min(truth, default=0.0) >= -LARGEST_TRUTH
    ):
        return
    broken = [
        f"{name} is {value:g}"
        for name, value in zip(names, truth, strict=True)
        if not abs(value) <= LARGEST_TRUTH
    ]
    raise SimulationError(", ".join(broken))


# The loop that drives a plant: measurement to controller, command to plant, one row per control step.

TARGET_NAMES = (
    "target_x",
    "target_y",
    "target_heading",
    "target_velocity_x",
    "target_velocity_y",
)
"""Columns of the reference, world frame: m, m, rad, m/s, m/s; the demanded yaw rate is the controller's."""


class ControllerState(Protocol):
    """What the loop asks of a controller's state."""

    @property
    def log(self) -> Array:
        """Numbers of the last step, aligned with the controller's `log_names`."""
        ...

    @property
    def diagnoses(self) -> tuple[Diagnosis, ...]:
        """Everything that was diagnosed since the start."""
        ...

    @property
    def pace(self) -> float:
        """How fast the plan is to run from now on, 1: as planned, 0: not at all."""
        ...


class Controller(Protocol):
    """State goes in and comes out; the loop keeps it."""

    @property
    def log_names(self) -> tuple[str, ...]:
        """Column names of `State.log`."""
        ...

    def start(self, measurement: Measurement) -> Any:
        """State before the first step."""
        ...

    def step(self, state: Any, measurement: Measurement, target: Target) -> tuple[CurrentCommand, Any]:
        """Command for the coming period, and the state after it."""
        ...


def drive(
    plant: Plant,
    controller: Controller,
    reference: Reference,
    watch: Callbacks = NO_CALLBACKS,
    about: Mapping[str, Any] | None = None,
) -> Trace:
    """Drives a robot along a reference, one control period per sample.

    The plan runs at the pace that the controller asks for: at half of it the robot is given every sample for
    two steps, at half the speed. Whatever ends the run early keeps what was recorded: `about["interrupted"]`
    is then true. When it was the plant that failed, `about["failure"]` says when and how; else it is None.
    `about["diagnoses"]` are the controller's, a table each.

    Args:
      plant: Reset by this call; the caller closes it.
      controller: Gets measurements and targets, never the truth.
      reference: Sampled at the plant's period.
      watch: Progress and snapshots.
      about: What the run was; goes into the trace beside the realtime factor.

    Returns:
      Columns of the measured channels, `current_target_i`, the controller's log, the plant's truth, the plan.
    """
    measurement = plant.reset()
    assert isinstance(measurement, Measurement)
    n = len(measurement.current)
    state = controller.start(measurement)
    velocity, heading = reference.velocity, reference.heading.tolist()
    yaw_rate = reference.yaw_rate.tolist()
    last = len(reference.time) - 1
    planned, paces, progress = np.zeros(last + 1, int), np.ones(last + 1), 0.0

    def control(k: int, row: Array, measured: Any) -> CurrentCommand:
        nonlocal state, progress
        at, pace = int(progress), state.pace
        planned[k], paces[k] = at, pace
        command, state = controller.step(
            state, measured, Target(pace * velocity[at], pace * yaw_rate[at], heading[at])
        )
        progress = min(progress + pace, last)
        fill_row(row, measured, command, state.log)
        return command

    names = row_names(n, controller.log_names)
    trace = record(plant, measurement, control, names, len(reference.time), watch, about or {})
    return _with_diagnoses(_with_targets(trace, reference, planned, paces), state.diagnoses)


def row_names(wheels: int, log_names: tuple[str, ...]) -> tuple[str, ...]:
    """Columns of one step of a robot: time, measured channels, set currents, the controller's log."""
    targets = (f"current_target_{i}" for i in range(1, wheels + 1))
    return ("time", *robot_channels(wheels), *targets, *log_names)


def fill_row(row: Array, measured: Measurement, command: CurrentCommand, log: Array) -> None:
    """Writes the columns of `row_names` into the beginning of a row."""
    n = len(command.current)
    row[0] = measured.time
    row[1 : n + 1] = measured.current
    row[n + 1 : 2 * n + 1] = measured.wheel_speed
    row[2 * n + 1 : 2 * n + 3] = measured.acceleration
    row[2 * n + 3] = measured.yaw_rate
    row[2 * n + 4] = measured.yaw
    row[2 * n + 5 : 3 * n + 5] = command.current
    row[3 * n + 5 : 3 * n + 5 + len(log)] = log


def drive_rig(
    plant: Plant,
    current: Array,
    watch: Callbacks = NO_CALLBACKS,
    about: Mapping[str, Any] | None = None,
    method: FaultDetector | None = None,
) -> Trace:
    """Drives the test rig with given currents, as the identification tests do.

    Args:
      plant: Reset by this call; the caller closes it.
      current: Set value per control period, shape (k,) [A].
      watch: Progress and snapshots.
      about: What the run was.
      method: Diagnoses beside it; it changes nothing, since the currents are given.

    Returns:
      Columns of the measured channels, `current_target`, the method's log and the plant's truth; ended early
      and told as by `drive`.
    """
    set_values, measurement = current.tolist(), plant.reset()
    state = None if method is None else method.start(measurement)

    def control(k: int, row: Array, measured: Any) -> CurrentCommand:
        nonlocal state
        row[0] = measured.time
        row[1] = measured.current
        row[2] = measured.wheel_speed
        row[3] = measured.carriage_speed
        row[4] = measured.carriage_acceleration
        row[5] = measured.lateral_speed
        row[6] = set_values[k]
        if method is not None:
            state = method.step(state, measured, current[k - 1 : k] if k else None)
            row[7 : 7 + len(method.log_names)] = state.log
        return CurrentCommand(current[k : k + 1])

    names = ("time", *RIG_CHANNELS, "current_target", *(method.log_names if method else ()))
    trace = record(plant, measurement, control, names, len(current), watch, about or {})
    return _with_diagnoses(trace, () if state is None else state.diagnoses)


def _with_diagnoses(trace: Trace, diagnoses: tuple[Diagnosis, ...]) -> Trace:
    return Trace(trace.columns, {**trace.about, "diagnoses": [dataclasses.asdict(d) for d in diagnoses]})


def _with_targets(trace: Trace, reference: Reference, planned: NDArray[np.int_], paces: Array) -> Trace:
    """What was asked for beside what came of it: the plan's samples at the pace at which they were driven."""
    k = len(trace["time"])
    at, pace = planned[:k], paces[:k]
    targets = (
        reference.position[at, 0],
        reference.position[at, 1],
        reference.heading[at],
        pace * reference.velocity[at, 0],
        pace * reference.velocity[at, 1],
    )
    columns = {name: np.array(values) for name, values in zip(TARGET_NAMES, targets, strict=True)}
    return Trace({**trace.columns, **columns}, trace.about)
