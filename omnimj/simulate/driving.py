"""Robots driven along references by controllers or at given wheel speeds, and rigs driven by currents.

Plants and controllers with kernels of their own run in a compiled loop (`compiled`), all others step by step
(`loop`); both record the same trace.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator, Mapping
from typing import Any, Protocol

import numpy as np

from omnimj.control.detection.detector import FaultDetector
from omnimj.errors import SimulationError
from omnimj.parameters import Robot
from omnimj.plant.interface import RIG_CHANNELS, Plant
from omnimj.signals import (
    Array,
    CurrentCommand,
    Diagnosis,
    Measurement,
    Reference,
    RigMeasurement,
    Target,
    Trace,
    robot_channels,
)
from omnimj.simulate import loop
from omnimj.simulate.compiled.row import RIG_COLUMNS, wheel_speed_loops
from omnimj.simulate.compiled.run import (
    CompiledFollowing,
    CompiledRigRun,
    CompiledRun,
    compiled_loop,
    compiled_rig_loop,
)
from omnimj.simulate.loop import (
    LARGEST_TRUTH,
    NO_CALLBACKS,
    Callbacks,
    Snapshot,
    check_truth,
    record,
    record_rows,
    snapshot_rows,
)

TARGET_NAMES = ("target_x", "target_y", "target_heading", "target_velocity_x", "target_velocity_y")
"""Column names of the reference, world frame: m, m, rad, m/s, m/s; the yaw-rate target is in the log."""
_RIG_NAMES = ("time", *RIG_CHANNELS, "current_target")


class Controller(Protocol):
    """A controller as a pure function: the loop keeps its state and passes it to every step.

    Of the state, the loop reads `log`, the logged values of the last step, shape (len(log_names),);
    `diagnoses`, a tuple of all since the start; and `time_scaling`, the rate at which the plan proceeds from
    now on (1: as planned, 0: stopped).
    """

    @property
    def log_names(self) -> tuple[str, ...]:
        """Column names of the state's `log`."""
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
        """Write the columns of `names` into the beginning of a row.

        Args:
          row: Row to fill, shape (columns,).
          measured: Readings of n wheels and the body.
          command: Set currents, shape (n,) [A].
          log: Logged signals of the controller, in the order of its `log_names`.
        """
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
    kernel = None if callbacks.start is not None else compiled_loop(plant, controller)
    if kernel is None:
        return drive_stepwise(plant, controller, reference, callbacks, about)
    run = CompiledRun(kernel, plant, controller, reference)
    controlled = ControllerRow(run.wheels, controller.log_names).names
    source = _Compiled(run, plant, callbacks.snapshot, len(controlled))
    names = (*controlled, *plant.truth_names, *TARGET_NAMES)
    trace = record_rows(source, names, (len(reference.time), plant.period), callbacks, about)
    return _with_diagnoses(trace, run.state.diagnoses)


def drive_stepwise(
    plant: Plant,
    controller: Controller,
    reference: Reference,
    callbacks: Callbacks = NO_CALLBACKS,
    about: Mapping[str, Any] | None = None,
) -> Trace:
    """Like `drive`, but calls plant and controller from Python in every period, so that any will do."""
    measurement = plant.reset()
    assert isinstance(measurement, Measurement)
    policy = _FollowReference(controller, reference, measurement)
    trace = record(plant, policy, measurement, len(reference.time), callbacks, about)
    return _with_diagnoses(trace, policy.state.diagnoses)


class _Compiled:
    """Rows of a compiled run."""

    def __init__(self, run: CompiledRun | CompiledRigRun, plant: Any, snapshot: Snapshot | None, first: int):
        self._run, self._plant, self._snapshot, self._first = run, plant, snapshot, first
        self._poses = hasattr(plant, "pose") and snapshot is not None

    @property
    def done(self) -> int:
        """Rows that are finished."""
        return self._run.done

    def fill(self, table: Array) -> Iterator[int]:
        every, shown = snapshot_rows(self._plant), 0
        poses = np.empty((-(-len(table) // every), len(self._plant.pose())) if self._poses else (0, 0))
        for done in self._run.advance(table, poses, every, loop.LARGEST_TRUTH):
            while self._poses and shown * every < done and self._snapshot is not None:
                self._snapshot(float(table[shown * every, 0]), poses[shown])
                shown += 1
            yield done
        if self.done < len(table):
            names = self._plant.truth_names
            truth = table[self.done, self._first : self._first + len(names)]
            check_truth(names, truth.tolist())


class _ReplayCurrents:
    """Policy that applies set currents to a rig in turn while a fault detector observes it."""

    target_names = ()

    def __init__(self, current: Array, detector: FaultDetector | None, measurement: Any):
        self._current, self._set_values, self._k = current, current.tolist(), 0
        self._detector = detector
        self.state = None if detector is None else detector.start(measurement)
        log_names = () if detector is None else tuple(detector.log_names)
        self.names = (*_RIG_NAMES, *log_names)

    def command(self, measurement: Any, row: Array) -> CurrentCommand:
        k, m = self._k, measurement
        row[:6] = m.time, m.current, m.wheel_speed, m.carriage_speed, m.carriage_acceleration, m.lateral_speed
        row[6] = self._set_values[k]
        if self._detector is not None:
            self.state = self._detector.step(self.state, m, self._current[k - 1 : k] if k else None)
            row[7 : len(self.names)] = self.state.log
        self._k += 1
        return CurrentCommand(self._current[k : k + 1])


def drive_rig(
    plant: Plant,
    current: Array,
    callbacks: Callbacks = NO_CALLBACKS,
    about: Mapping[str, Any] | None = None,
    detector: FaultDetector | None = None,
) -> Trace:
    """Drive the test rig with given currents, as the identification tests do.

    Without a detector, a planar rig or a twin runs in the compiled loop, everything else step by step; both
    give the same trace.

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
    stepped = detector is not None or callbacks.start is not None
    kernel = None if stepped else compiled_rig_loop(plant)
    if kernel is None:
        return drive_rig_stepwise(plant, current, callbacks, about, detector)
    measurement = plant.reset()
    assert isinstance(measurement, RigMeasurement)
    run = CompiledRigRun(kernel, plant, measurement, current)
    source = _Compiled(run, plant, callbacks.snapshot, RIG_COLUMNS)
    names = (*_RIG_NAMES, *plant.truth_names)
    return _with_diagnoses(record_rows(source, names, (len(current), plant.period), callbacks, about), ())


def drive_rig_stepwise(
    plant: Plant,
    current: Array,
    callbacks: Callbacks = NO_CALLBACKS,
    about: Mapping[str, Any] | None = None,
    detector: FaultDetector | None = None,
) -> Trace:
    """Like `drive_rig`, but calls plant and detector from Python in every period, so that any will do.

    The current has the shape (k,) [A].
    """
    measurement = plant.reset()
    policy = _ReplayCurrents(current, detector, measurement)
    trace = record(plant, policy, measurement, len(current), callbacks, about)
    return _with_diagnoses(trace, () if policy.state is None else policy.state.diagnoses)


def _with_diagnoses(trace: Trace, diagnoses: tuple[Diagnosis, ...]) -> Trace:
    return Trace(trace.columns, {**trace.about, "diagnoses": [dataclasses.asdict(d) for d in diagnoses]})


def follow_wheel_speeds(plant: Any, robot: Robot, targets: Array) -> Trace:
    """Drive a simulated robot by wheel-speed control alone, stiffer than the robot's own.

    Args:
      plant: `RobotTwin` or `PlanarRobot`; reset by this call.
      robot: Gives inertia, motor and current limits.
      targets: Wheel speeds of every control period, shape (rows, n) [rad/s].

    Returns:
      `time`, readings, set currents and truth of every control period.

    Raises:
      SimulationError: The simulation left finite numbers.
    """
    sets = tuple(f"current_target_{i}" for i in range(1, robot.wheel_count + 1))
    names = ("time", *robot_channels(robot.wheel_count), *sets, *plant.truth_names)
    table = np.full((len(targets), len(names)), np.nan)
    run = CompiledFollowing(plant, wheel_speed_loops(robot, plant.period), targets)
    for _ in run.advance(table, np.empty((0, 0)), 1, LARGEST_TRUTH):
        pass
    if run.done < len(targets):
        raise SimulationError(f"the truth is not finite after {run.done * plant.period:.4g} s")
    return Trace(dict(zip(names, np.ascontiguousarray(table.T), strict=True)), {})
