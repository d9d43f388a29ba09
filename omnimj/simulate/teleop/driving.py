"""The loop that drives a robot for as long as somebody asks for motion."""

from __future__ import annotations

import math
import time
from collections import deque
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from types import MappingProxyType
from typing import Any, Protocol

import numpy as np

from omnimj.control.cascade.heading import wrapped
from omnimj.control.detection.detector import DetectorOptions
from omnimj.effects import check_effects
from omnimj.errors import OmnimjError
from omnimj.parameters import read_robot
from omnimj.parameters.floor import all_floors, find_floor
from omnimj.plant.interface import Plant
from omnimj.signals import Array, Diagnosis, Measurement, Reference, Target, Trace
from omnimj.simulate.loop import SNAPSHOT_PERIOD, Controller, Rows, Snapshot, check_truth, fill_row, row_names
from omnimj.simulate.scenario.drive import Drive
from omnimj.simulate.scenario.scenario import Scenario

TELEOP_TARGET_NAMES = ("target_heading", "target_velocity_x", "target_velocity_y")
"""Columns of what was asked for, world frame: rad, m/s, m/s."""
HEADING_COLUMN = "heading_estimate"
"""Column of the controller's log that says how the robot is turned."""

_BLOCK = 100  # rows that are handed on together


class TargetSource(Protocol):
    """Who asks for motion: `Operator`."""

    def target(self, heading: float, pace: float) -> Target | None:
        """The target of the coming control period; None to end.

        Args:
          heading: Of the robot, as the controller believes [rad].
          pace: Share of the demand that recovery allows, 0…1.
        """
        ...


@dataclass(frozen=True)
class TeleopResult:
    """How it ended; the rows went to those who look on."""

    steps: int
    interrupted: bool
    """By Ctrl-C."""
    failure: str | None
    """When and how the plant failed."""
    diagnoses: tuple[Diagnosis, ...]
    """Everything decided since the start."""


@dataclass(frozen=True)
class TeleopCallbacks:
    """Who looks on while the robot is driven; nothing is kept here."""

    rows: tuple[Rows, ...] = ()
    """Each is called with the columns' names and the newest rows, which it may not keep."""
    snapshot: Snapshot | None = None
    before_step: Callable[[], object] | None = None
    """Called before every step of the plant, to hold a simulation to the wall clock."""
    diagnosed: Callable[[tuple[Diagnosis, ...]], object] | None = None
    """Called when what is believed has changed."""


_NO_TELEOP_CALLBACKS = TeleopCallbacks()


def drive_by_hand(
    plant: Plant, controller: Controller, asks: TargetSource, watch: TeleopCallbacks = _NO_TELEOP_CALLBACKS
) -> TeleopResult:
    """Drives a robot until nobody asks any more, or Ctrl-C, or the plant fails.

    A failure is a value, as in `loop.drive`: what was recorded is not lost, the outermost call raises.

    Args:
      plant: Reset by this call; the caller closes it, and with that stops a real robot.
      controller: Gets measurements and targets, never the truth.
      asks: For every step's target.
      watch: Gets the rows.
    """
    measurement: Any = plant.reset()
    assert isinstance(measurement, Measurement)
    state = controller.start(measurement)
    own = row_names(len(measurement.current), controller.log_names)
    names = (*own, *plant.truth_names, *TELEOP_TARGET_NAMES)
    at = controller.log_names.index(HEADING_COLUMN)
    block = np.empty((_BLOCK, len(names)))
    heading = wrapped(measurement.yaw) if math.isfinite(measurement.yaw) else 0.0
    pose, each = getattr(plant, "pose", None), max(1, round(SNAPSHOT_PERIOD / plant.period))
    steps, interrupted, failure, known = 0, False, None, ()
    try:
        while (target := asks.target(heading, state.pace)) is not None:
            command, state = controller.step(state, measurement, target)
            heading = float(state.log[at])
            row, truth = block[steps % _BLOCK], plant.truth()
            fill_row(row, measurement, command, state.log)
            row[len(own) : len(own) + len(truth)] = truth
            row[-3:] = target.heading, *target.velocity
            check_truth(plant.truth_names, truth.tolist())
            if watch.snapshot is not None and pose is not None and steps % each == 0:
                watch.snapshot(measurement.time, pose())
            steps += 1
            if steps % _BLOCK == 0:
                _flush_rows(watch, names, block)
            if watch.diagnosed is not None and state.diagnoses is not known:
                known = state.diagnoses
                watch.diagnosed(known)
            if watch.before_step is not None:
                watch.before_step()
            measurement = plant.step(command)
    except KeyboardInterrupt:
        interrupted = True
    except (OmnimjError, ArithmeticError) as error:
        failure = f"after {steps * plant.period:.3f} s: {error}"
    _flush_rows(watch, names, block[: steps % _BLOCK])
    return TeleopResult(steps, interrupted, failure, state.diagnoses)


def _flush_rows(watch: TeleopCallbacks, names: tuple[str, ...], rows: np.ndarray) -> None:
    if len(rows):
        for take in watch.rows:
            take(names, rows)


# A simulation held to the wall clock.

_MIN_SLEEP = 0.002  # [s] ahead from which it is worth to sleep
_MAX_LAG = 0.1  # [s] behind from which it is not caught up


class RealTimePacer:
    """`wait()` before every step; a simulation that cannot keep up loses time instead of racing after it."""

    def __init__(
        self,
        period: float,
        clock: Callable[[], float] = time.monotonic,
        sleep: Callable[[float], object] = time.sleep,
    ):
        """Starts with the first `wait`.

        Args:
          period: Of one step [s].
          clock: Goes forward only [s].
          sleep: Waits so many seconds.
        """
        self._period, self._clock, self._sleep = period, clock, sleep
        self._due: float | None = None
        self._begin = self._now = 0.0
        self._steps = 0
        self.lost = 0.0
        """By how much the simulation has fallen behind for good [s]."""

    @property
    def factor(self) -> float:
        """Simulated time over wall time since the first step; 1: it keeps up."""
        wall = self._now - self._begin
        return self._steps * self._period / wall if wall > 0.0 else 1.0

    def wait(self) -> None:
        """Waits until the next step is due."""
        self._now = self._clock()
        if self._due is None:
            self._due = self._begin = self._now
            return
        self._steps += 1
        self._due += self._period
        ahead = self._due - self._now
        if ahead > _MIN_SLEEP:
            self._sleep(ahead)
        elif ahead < -_MAX_LAG:
            self.lost -= ahead
            self._due = self._now


# The newest minutes of a drive that has no planned end.


class RowBuffer:
    """Keeps blocks of rows, the oldest of which go."""

    def __init__(self, rows: int):
        """At least so many of the newest rows are kept; none with 0."""
        self._most, self._held = rows, 0
        self._names: tuple[str, ...] = ()
        self._blocks: deque[Array] = deque()

    @property
    def rows(self) -> int:
        """That are held now."""
        return self._held

    def add(self, names: tuple[str, ...], block: Array) -> None:
        """Takes rows, shape (m, columns), which the caller may write over afterwards."""
        if self._most == 0:
            return
        self._names = names
        self._blocks.append(block.copy())
        self._held += len(block)
        while self._held - len(self._blocks[0]) >= self._most:
            self._held -= len(self._blocks.popleft())

    def trace(self, about: Mapping[str, Any]) -> Trace:
        """What is held, as a trace; its time is that of the plant."""
        table = np.concatenate(self._blocks) if self._blocks else np.empty((0, len(self._names)))
        columns = np.ascontiguousarray(table.T)
        return Trace(dict(zip(self._names, columns, strict=True)), about)


# A flat floor and a robot on it, without a plan: where somebody drives by hand.

DEFAULT_FLOOR = "natural_stone"
"""Unless told otherwise."""


def free_drive(
    floor: str = DEFAULT_FLOOR, model_file: Path | None = None, floors_file: Path | None = None
) -> Scenario:
    """A scenario without plan, end, faults and checks.

    The heading is held, so that straight is straight; nothing shakes the wheels to ask its motors, since by
    hand nothing moves that nobody asked for.

    Args:
      floor: A name.
      model_file: The robot's; the shipped one when None.
      floors_file: Floors beside the shipped ones, or in their place.

    Raises:
      InputError: A file is wrong.
      UnknownNameError: No such floor.
    """
    robot, floors = read_robot(model_file), all_floors(floors_file)
    check_effects(robot)
    nowhere = Reference(np.zeros(1), np.zeros((1, 2)), np.zeros(1), np.zeros(1), np.zeros((1, 2)))
    return Scenario(
        name="teleop",
        description="Driven by hand",
        constants=robot,
        floor=find_floor(floor, "--floor", floors).name,
        floors=MappingProxyType(floors),
        duration=0.0,
        level="physics",
        drive=Drive(nowhere, yaw_loop=True, heading_hold=True, heading_feedback=True, start=(0.0, 0.0, 0.0)),
        faults=(),
        patches=(),
        kinematics=None,
        checks=(),
        equations="corrected",
        scene=None,
        diagnosis=DetectorOptions(dither=False),
        overrides=(),
    )
