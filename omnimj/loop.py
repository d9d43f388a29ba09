"""The loop that drives a plant: measurement to controller, command to plant, one row per control step.

The plant is a simulation or hardware, the controller cannot tell. Row k holds what was measured at t_k, the
truth at t_k where the plant has one, what was asked for and what the controller made of it.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from omnimj.control.method import Method
from omnimj.control.target import Target
from omnimj.plant.channels import RIG_CHANNELS, robot_channels
from omnimj.plant.interface import Plant
from omnimj.signals import Array, CurrentCommand, Diagnosis, Measurement, Reference, Trace
from omnimj.stepping import NOBODY, Watch, record

TARGET_NAMES = (
    "target_x",
    "target_y",
    "target_heading",
    "target_velocity_x",
    "target_velocity_y",
)
"""Columns of the reference, world frame: m, m, rad, m/s, m/s; the demanded yaw rate is the controller's."""


class State(Protocol):
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
    watch: Watch = NOBODY,
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
    return _told(_with_targets(trace, reference, planned, paces), state.diagnoses)


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
    watch: Watch = NOBODY,
    about: Mapping[str, Any] | None = None,
    method: Method | None = None,
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
    return _told(trace, () if state is None else state.diagnoses)


def _told(trace: Trace, diagnoses: tuple[Diagnosis, ...]) -> Trace:
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
