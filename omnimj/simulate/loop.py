"""Loop that steps a plant: one generator for recorded runs, the test rig, driving by hand and hardware.

A policy decides the command of every control period from the measurement; the plant, a simulation or
hardware, holds it for one period. Row k of a recording holds what was measured at t_k, the set currents, the
controller's log, the truth at t_k where the plant has one, and the target.
"""

from __future__ import annotations

import dataclasses
import math
import time
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from types import TracebackType
from typing import Any, Protocol

import numpy as np

from omnimj.control.detection.detector import FaultDetector
from omnimj.errors import LinkLost, SimulationError
from omnimj.plant.interface import RIG_CHANNELS, Plant, robot_channels
from omnimj.signals import Array, CurrentCommand, Diagnosis, Measurement, Reference, Target, Trace
from omnimj.simulate.compiled.run import CompiledRun, compiled_loop

SNAPSHOT_PERIOD = 0.02
"""Time between two poses of the 3-D recording [s]."""
LARGEST_TRUTH = 1e10
"""Largest magnitude of every true value, in any unit; MuJoCo stops beyond it as well."""
TARGET_NAMES = ("target_x", "target_y", "target_heading", "target_velocity_x", "target_velocity_y")
"""Column names of the reference, world frame: m, m, rad, m/s, m/s; the yaw-rate target is in the log."""

_PROGRESS_EVERY = 100  # [rows]

Progress = Callable[[int, int], None]
"""Called with the number of finished rows and the total number of rows."""
Snapshot = Callable[[float, Array], None]
"""Called every `SNAPSHOT_PERIOD` with the time [s] and the plant's pose (the twin's qpos)."""
Rows = Callable[[tuple[str, ...], Array], None]
"""Called with the column names and the rows since the last call, shape (m, columns)."""


@dataclass(frozen=True)
class Callbacks:
    """Functions that are called while a run goes on; each may be left out."""

    progress: Progress | None = None
    """Called every hundred rows, and at the end."""
    snapshot: Snapshot | None = None
    rows: Rows | None = None
    """Called every hundred rows, and at the end."""
    start: Callable[[Plant], None] | None = None
    """Called by `run_scenario` with the plant before the first step."""


NO_CALLBACKS = Callbacks()


class Policy(Protocol):
    """Source of the command of every control period, which also fills its part of each row.

    A row consists of `names`, the plant's truth and `target_names`.
    """

    @property
    def names(self) -> tuple[str, ...]:
        """Column names before the plant's truth, beginning with `time`."""
        ...

    @property
    def target_names(self) -> tuple[str, ...]:
        """Column names after the plant's truth."""
        ...

    def command(self, measurement: Any, row: Array) -> CurrentCommand | None:
        """Command for the coming period; None ends the run.

        Args:
          measurement: Newest measurement of the plant.
          row: Row to fill: the columns of `names` at its beginning, those of `target_names` at its end.
        """
        ...


class Ending:
    """Context manager that keeps Ctrl-C and failures of the plant as values, so that no row is lost."""

    def __init__(self, *failures: type[Exception]):
        """Treat exceptions of these types as failures of the plant; all others propagate."""
        self._failures = failures
        self.interrupted = False
        """True if Ctrl-C ended the run."""
        self.error: BaseException | None = None
        """The failure that ended the run."""

    def __enter__(self) -> Ending:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> bool:
        self.interrupted = isinstance(error, KeyboardInterrupt)
        if isinstance(error, self._failures):
            self.error = error
        return self.interrupted or self.error is not None


def column_names(plant: Plant, policy: Policy) -> tuple[str, ...]:
    """Column names of a row: the policy's, those of the plant's truth, the policy's targets.

    Raises:
      ValueError: Two columns share a name.
    """
    names = (*policy.names, *plant.truth_names, *policy.target_names)
    if len(set(names)) != len(names):
        raise ValueError(f"two columns share a name: {sorted(n for n in set(names) if names.count(n) > 1)}")
    return names


def steps(
    plant: Plant, policy: Policy, measurement: Any, table: Array, limit: int | None = None
) -> Iterator[int]:
    """Step a plant under a policy, one row per control period.

    Row k goes to `table[k % len(table)]`, so that a short table serves a run without a planned end. Each row
    is yielded before the plant takes the next step, so that the caller may wait, inspect it or stop.

    Args:
      plant: Plant that has been reset.
      policy: Source of the commands.
      measurement: First measurement of the plant.
      table: Array to fill, shape (rows, columns), with the columns of `column_names`.
      limit: Number of rows after which the run ends; when None, the policy ends it.

    Yields:
      The number of rows so far.

    Raises:
      SimulationError: The truth is not finite or beyond `LARGEST_TRUTH`; errors of the plant propagate.
    """
    truth_names, first = plant.truth_names, len(policy.names)
    last, done = first + len(truth_names), 0
    while (command := policy.command(measurement, row := table[done % len(table)])) is not None:
        truth = plant.truth()
        row[first:last] = truth
        _check_truth(truth_names, truth.tolist())
        done += 1
        yield done
        if done == limit:
            return
        measurement = plant.step(command)


def _check_truth(names: tuple[str, ...], truth: list[float]) -> None:
    """Refuse numbers that are not finite or beyond `LARGEST_TRUTH`; plain floats are fastest for so few."""
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


def snapshot_rows(plant: Plant) -> int:
    """Number of rows from one pose of the 3-D recording to the next."""
    return max(1, round(SNAPSHOT_PERIOD / plant.period))


def take_snapshot(plant: Plant, snapshot: Snapshot | None) -> Callable[[int, float], None]:
    """Function of (rows so far, time [s]) that calls `snapshot` with the pose every `SNAPSHOT_PERIOD`."""
    pose, every = getattr(plant, "pose", None), snapshot_rows(plant)
    if snapshot is None or pose is None:
        return lambda done, now: None

    def take(done: int, now: float) -> None:
        if (done - 1) % every == 0:
            snapshot(float(now), pose())

    return take


class _RowSource(Protocol):
    """Source of the rows of a trace."""

    @property
    def done(self) -> int:
        """Rows that are finished."""
        ...

    def fill(self, table: Array) -> Iterator[int]:
        """Fill a table, shape (rows, columns), and yield the number of finished rows now and then."""
        ...


class _Stepwise:
    """Rows of a policy, step by step."""

    def __init__(self, plant: Plant, policy: Policy, measurement: Any, snapshot: Snapshot | None):
        self._plant, self._policy, self._measurement = plant, policy, measurement
        self._snapshot, self.done = take_snapshot(plant, snapshot), 0

    def fill(self, table: Array) -> Iterator[int]:
        for done in steps(self._plant, self._policy, self._measurement, table, len(table)):
            self.done = done
            self._snapshot(done, table[done - 1, 0])
            yield done


def record(
    plant: Plant,
    policy: Policy,
    measurement: Any,
    rows: int,
    callbacks: Callbacks = NO_CALLBACKS,
    about: Mapping[str, Any] | None = None,
) -> Trace:
    """Run a policy for a number of control periods and return the recorded trace.

    A run that ends early keeps its rows, and `about["interrupted"]` is then true. If the plant failed,
    `about["failure"]` holds time and reason; otherwise it is None.

    Args:
      plant: Plant that has been reset; the caller closes it.
      policy: Source of the commands.
      measurement: First measurement of the plant.
      rows: Number of control periods.
      callbacks: Callbacks for progress and live view.
      about: Description of the run, to which `realtime_factor`, `interrupted` and `failure` are added.
    """
    source = _Stepwise(plant, policy, measurement, callbacks.snapshot)
    return _recorded(source, column_names(plant, policy), (rows, plant.period), callbacks, about)


def _recorded(
    source: _RowSource,
    names: tuple[str, ...],
    size: tuple[int, float],
    callbacks: Callbacks,
    about: Mapping[str, Any] | None,
) -> Trace:
    """Trace of a source, with a number of rows and their period [s]."""
    rows, period = size
    # filled before the clock runs: the first touch of lazily allocated memory takes up to 8 ms in a row
    table, begin = np.full((rows, len(names)), np.nan), time.perf_counter()
    with Ending(SimulationError, ArithmeticError, LinkLost) as ending:
        for done in source.fill(table):
            if done % _PROGRESS_EVERY == 0 or done == rows:
                _report(callbacks, names, table, done)
    wall, done = time.perf_counter() - begin, source.done
    columns = np.ascontiguousarray(table[:done].T)
    described = {
        **(about or {}),
        "interrupted": ending.interrupted or ending.error is not None,
        "failure": None if ending.error is None else f"at {done * period:.4f} s: {ending.error}",
        "realtime_factor": max(done - 1, 0) * period / wall if wall > 0.0 else 0.0,
    }
    return Trace(dict(zip(names, columns, strict=True)), described)


def _report(callbacks: Callbacks, names: tuple[str, ...], table: Array, done: int) -> None:
    if callbacks.progress is not None:
        callbacks.progress(done, len(table))
    if callbacks.rows is not None:
        callbacks.rows(names, table[(done - 1) // _PROGRESS_EVERY * _PROGRESS_EVERY : done])


class ControllerState(Protocol):
    """Part of a controller's state that the loop reads."""

    @property
    def log(self) -> Array:
        """Logged values of the last step, aligned with the controller's `log_names`."""
        ...

    @property
    def diagnoses(self) -> tuple[Diagnosis, ...]:
        """All diagnoses since the start."""
        ...

    @property
    def time_scaling(self) -> float:
        """Rate at which the plan proceeds from now on; 1: as planned, 0: stopped."""
        ...


class Controller(Protocol):
    """A controller as a pure function: the loop keeps its state and passes it to every step."""

    @property
    def log_names(self) -> tuple[str, ...]:
        """Column names of `ControllerState.log`."""
        ...

    def start(self, measurement: Measurement) -> Any:
        """State before the first step."""
        ...

    def step(self, state: Any, measurement: Measurement, target: Target) -> tuple[CurrentCommand, Any]:
        """Command for the coming period, and the state after the step."""
        ...


class ControllerRow:
    """Row of a robot under a controller: time, measured channels, set currents, the controller's log."""

    def __init__(self, wheels: int, log_names: tuple[str, ...]):
        """Name the columns for this number of wheels."""
        targets = (f"current_target_{i}" for i in range(1, wheels + 1))
        self.names = ("time", *robot_channels(wheels), *targets, *log_names)
        self._wheels, self._first, self._end = wheels, 3 * wheels + 5, 3 * wheels + 5 + len(log_names)

    def fill(self, row: Array, measured: Measurement, command: CurrentCommand, log: Array) -> None:
        """Write the columns of `names` into the beginning of a row."""
        n = self._wheels
        row[0] = measured.time
        row[1 : n + 1] = measured.current
        row[n + 1 : 2 * n + 1] = measured.wheel_speed
        row[2 * n + 1 : 2 * n + 3] = measured.acceleration
        row[2 * n + 3] = measured.yaw_rate
        row[2 * n + 4] = measured.yaw
        row[2 * n + 5 : self._first] = command.current
        row[self._first : self._end] = log


class _FollowReference:
    """Policy in which a controller follows a reference at the time scaling that it requests."""

    target_names = TARGET_NAMES

    def __init__(self, controller: Controller, reference: Reference, measurement: Measurement):
        self._controller, self._row = (
            controller,
            ControllerRow(len(measurement.current), controller.log_names),
        )
        self.names = self._row.names
        self.state = controller.start(measurement)
        self._plan = np.column_stack([reference.position, reference.heading, reference.velocity])
        self._heading, self._yaw_rate = reference.heading.tolist(), reference.yaw_rate.tolist()
        self._progress, self._last = 0.0, len(reference.time) - 1

    def command(self, measurement: Measurement, row: Array) -> CurrentCommand:
        at, scaling = int(self._progress), self.state.time_scaling
        row[-5:] = self._plan[at]
        velocity = scaling * self._plan[at, 3:]
        target = Target(velocity, scaling * self._yaw_rate[at], self._heading[at])
        command, self.state = self._controller.step(self.state, measurement, target)
        self._progress = min(self._progress + scaling, self._last)
        self._row.fill(row, measurement, command, self.state.log)
        row[-2:] = velocity
        return command


def drive(
    plant: Plant,
    controller: Controller,
    reference: Reference,
    callbacks: Callbacks = NO_CALLBACKS,
    about: Mapping[str, Any] | None = None,
) -> Trace:
    """Drive a robot along a reference, one control period per sample.

    The plan proceeds at the time scaling that the controller requests: at 0.5 the robot gets every sample for
    two steps, at half the speed. A `CompiledController` on a planar robot or a twin runs in the compiled
    loop, everything else step by step; both give the same trace.

    Args:
      plant: Reset by this call; the caller closes it.
      controller: Receives measurements and targets, never the truth.
      reference: Reference sampled at the plant's period.
      callbacks: Callbacks for progress and live view.
      about: Description of the run.

    Returns:
      Columns of the measured channels, `current_target_i`, the controller's log, the plant's truth and
      `TARGET_NAMES`; described as by `record`, with the controller's diagnoses, a table each, in
      `about["diagnoses"]`.
    """
    loop = None if callbacks.start is not None else compiled_loop(plant, controller)
    if loop is None:
        return drive_stepwise(plant, controller, reference, callbacks, about)
    run = CompiledRun(loop, plant, controller, reference)
    controlled = ControllerRow(run.wheels, controller.log_names).names
    source = _Compiled(run, plant, callbacks.snapshot, len(controlled))
    names = (*controlled, *plant.truth_names, *TARGET_NAMES)
    trace = _recorded(source, names, (len(reference.time), plant.period), callbacks, about)
    return _with_diagnoses(trace, run.state.diagnoses)


def drive_stepwise(
    plant: Plant,
    controller: Controller,
    reference: Reference,
    callbacks: Callbacks = NO_CALLBACKS,
    about: Mapping[str, Any] | None = None,
) -> Trace:
    """Drive a robot as `drive` does, any plant with any controller, with a call of both in every period."""
    measurement = plant.reset()
    assert isinstance(measurement, Measurement)
    policy = _FollowReference(controller, reference, measurement)
    trace = record(plant, policy, measurement, len(reference.time), callbacks, about)
    return _with_diagnoses(trace, policy.state.diagnoses)


class _Compiled:
    """Rows of a compiled run."""

    def __init__(self, run: CompiledRun, plant: Any, snapshot: Snapshot | None, first: int):
        self._run, self._plant, self._snapshot, self._first = run, plant, snapshot, first
        self._poses = hasattr(plant, "pose") and snapshot is not None

    @property
    def done(self) -> int:
        """Rows that are finished."""
        return self._run.done

    def fill(self, table: Array) -> Iterator[int]:
        every, shown = snapshot_rows(self._plant), 0
        poses = np.empty((-(-len(table) // every), len(self._plant.pose())) if self._poses else (0, 0))
        for done in self._run.advance(table, poses, every, LARGEST_TRUTH):
            while self._poses and shown * every < done and self._snapshot is not None:
                self._snapshot(float(table[shown * every, 0]), poses[shown])
                shown += 1
            yield done
        if self.done < len(table):
            names = self._plant.truth_names
            truth = table[self.done, self._first : self._first + len(names)]
            _check_truth(names, truth.tolist())


class _ReplayCurrents:
    """Policy that applies set currents to a rig in turn while a fault detector observes it."""

    target_names = ()

    def __init__(self, current: Array, detector: FaultDetector | None, measurement: Any):
        self._current, self._set_values, self._k = current, current.tolist(), 0
        self._detector = detector
        self.state = None if detector is None else detector.start(measurement)
        log_names = () if detector is None else tuple(detector.log_names)
        self.names = ("time", *RIG_CHANNELS, "current_target", *log_names)

    def command(self, measurement: Any, row: Array) -> CurrentCommand:
        k, m = self._k, measurement
        row[:6] = m.time, m.current, m.wheel_speed, m.carriage_speed, m.carriage_acceleration, m.lateral_speed
        row[6] = self._set_values[k]
        if self._detector is not None:
            self.state = self._detector.step(self.state, m, self._current[k - 1 : k] if k else None)
            row[7 : len(self.names)] = self.state.log
        self._k += 1
        return CurrentCommand(self._current[k : k + 1])


def require_complete(trace: Trace, name: str) -> None:
    """Raise the failure or interruption that ended a recorded run early.

    Args:
      trace: Trace from `record`, `drive` or `drive_rig`.
      name: Name of the run in messages.

    Raises:
      SimulationError: The plant failed.
      KeyboardInterrupt: Ctrl-C was pressed.
    """
    if trace.about["failure"]:
        raise SimulationError(f"{name}: {trace.about['failure']}")
    if trace.about["interrupted"]:
        raise KeyboardInterrupt


def drive_rig(
    plant: Plant,
    current: Array,
    callbacks: Callbacks = NO_CALLBACKS,
    about: Mapping[str, Any] | None = None,
    detector: FaultDetector | None = None,
) -> Trace:
    """Drive the test rig with given currents, as the identification tests do.

    Args:
      plant: Reset by this call; the caller closes it.
      current: Set value per control period, shape (k,) [A].
      callbacks: Callbacks for progress and live view.
      about: Description of the run.
      detector: Fault detector that diagnoses the run without acting on it.

    Returns:
      Columns of the measured channels, `current_target`, the detector's log and the plant's truth; described
      as by `drive`.
    """
    measurement = plant.reset()
    policy = _ReplayCurrents(current, detector, measurement)
    trace = record(plant, policy, measurement, len(current), callbacks, about)
    return _with_diagnoses(trace, () if policy.state is None else policy.state.diagnoses)


def _with_diagnoses(trace: Trace, diagnoses: tuple[Diagnosis, ...]) -> Trace:
    return Trace(trace.columns, {**trace.about, "diagnoses": [dataclasses.asdict(d) for d in diagnoses]})
