"""Drive a robot by hand: the loop without a planned end, held to the wall clock in simulation."""

from __future__ import annotations

import math
import time
from collections import deque
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from types import MappingProxyType
from typing import Any

import numpy as np

from omnimj.control.cascade.heading import wrapped
from omnimj.control.detection.detector import DetectorOptions
from omnimj.effects import check_effects
from omnimj.errors import OmnimjError
from omnimj.parameters import read_robot
from omnimj.parameters.floor import all_floors, find_floor, own_floors
from omnimj.plant.interface import Plant
from omnimj.signals import Array, CurrentCommand, Diagnosis, Measurement, Reference, Target, Trace
from omnimj.simulate.driving import Controller, ControllerRow
from omnimj.simulate.loop import Ending, Rows, Snapshot, column_names, steps, take_snapshot
from omnimj.simulate.scenario.drive import Drive
from omnimj.simulate.scenario.scenario import Scenario

TELEOP_TARGET_NAMES = ("target_heading", "target_velocity_x", "target_velocity_y")
"""Column names of the target, world frame: rad, m/s, m/s."""
HEADING_COLUMN = "heading_estimate"
"""Column of the controller's log with its heading estimate [rad]."""
DEFAULT_FLOOR = "natural_stone"
"""Floor of a drive by hand."""

_BLOCK = 100  # number of rows that are passed on together
_MIN_SLEEP = 0.002  # [s] ahead of time from which on sleeping is worthwhile
_MAX_LAG = 0.1  # [s] behind time from which on the lag is dropped


TargetSource = Callable[[float, float], Target | None]
"""Function such as `Operator.target`, of (heading that the controller estimates [rad], share of the demanded
speed that recovery allows, 0…1), that returns the target of the coming period, or None to end the drive."""


@dataclass(frozen=True)
class TeleopResult:
    """Result of a drive; its rows have gone to the callbacks."""

    steps: int
    interrupted: bool
    """True if Ctrl-C ended the drive."""
    failure: str | None
    """Time and reason of a failure of the plant; None without one."""
    diagnoses: tuple[Diagnosis, ...]
    """All diagnoses since the start."""


@dataclass(frozen=True)
class TeleopCallbacks:
    """Functions that are called while the robot is driven."""

    rows: tuple[Rows, ...] = ()
    """Each is called with the column names and the newest rows, which are overwritten afterwards."""
    snapshot: Snapshot | None = None
    before_step: Callable[[], object] | None = None
    """Called before every step of the plant, to hold a simulation to the wall clock."""
    diagnosed: Callable[[tuple[Diagnosis, ...]], object] | None = None
    """Called with all diagnoses whenever they change."""


_NO_CALLBACKS = TeleopCallbacks()


class _FollowOperator:
    """Policy of a controller whose targets come from a person."""

    target_names = TELEOP_TARGET_NAMES

    def __init__(self, controller: Controller, source: TargetSource, measurement: Measurement):
        self._controller, self._source = controller, source
        self._row = ControllerRow(len(measurement.current), controller.log_names)
        self.names = self._row.names
        self.state = controller.start(measurement)
        self._heading_at = controller.log_names.index(HEADING_COLUMN)
        self._heading = wrapped(measurement.yaw) if math.isfinite(measurement.yaw) else 0.0

    def command(self, measurement: Measurement, row: Array) -> CurrentCommand | None:
        target = self._source(self._heading, self.state.time_scaling)
        if target is None:
            return None
        command, self.state = self._controller.step(self.state, measurement, target)
        self._heading = float(self.state.log[self._heading_at])
        self._row.fill(row, measurement, command, self.state.log)
        row[-3:] = target.heading, *target.velocity
        return command


def drive_by_hand(
    plant: Plant, controller: Controller, source: TargetSource, callbacks: TeleopCallbacks = _NO_CALLBACKS
) -> TeleopResult:
    """Drive a robot until the source ends it, Ctrl-C is pressed, or the plant fails.

    Args:
      plant: Reset by this call; the caller closes it, which stops a real robot.
      controller: Receives measurements and targets, never the truth.
      source: Source of the target of every step.
      callbacks: Functions that receive rows and diagnoses.

    Returns:
      Result of the drive; a failure is a value, as in `loop.record`, so that the rows are kept.
    """
    measurement: Any = plant.reset()
    assert isinstance(measurement, Measurement)
    policy = _FollowOperator(controller, source, measurement)
    names, done, known = column_names(plant, policy), 0, ()
    block = np.empty((_BLOCK, len(names)))
    snapshot = take_snapshot(plant, callbacks.snapshot)
    with Ending(OmnimjError, ArithmeticError) as ending:
        for done in steps(plant, policy, measurement, block):
            snapshot(done, block[(done - 1) % _BLOCK, 0])
            if done % _BLOCK == 0:
                _pass_on(callbacks, names, block)
            if callbacks.diagnosed is not None and policy.state.diagnoses is not known:
                known = policy.state.diagnoses
                callbacks.diagnosed(known)
            if callbacks.before_step is not None:
                callbacks.before_step()
    _pass_on(callbacks, names, block[: done % _BLOCK])
    failure = None if ending.error is None else f"after {done * plant.period:.3f} s: {ending.error}"
    return TeleopResult(done, ending.interrupted, failure, policy.state.diagnoses)


def _pass_on(callbacks: TeleopCallbacks, names: tuple[str, ...], rows: Array) -> None:
    if len(rows):
        for take in callbacks.rows:
            take(names, rows)


class RealTimePacer:
    """Pacer that holds a simulation to the wall clock; `wait()` is called before every step.

    A simulation that cannot keep up loses time instead of catching up later.
    """

    def __init__(
        self,
        period: float,
        clock: Callable[[], float] = time.monotonic,
        sleep: Callable[[float], object] = time.sleep,
    ):
        """Prepare a pacer that starts with the first `wait`.

        Args:
          period: Duration of one step [s].
          clock: Monotonic clock [s].
          sleep: Function that waits for a number of seconds.
        """
        self._period, self._clock, self._sleep = period, clock, sleep
        self._due: float | None = None
        self._begin = self._now = 0.0
        self._steps = 0
        self.lost = 0.0
        """Time by which the simulation has fallen behind and which it does not catch up [s]."""

    @property
    def factor(self) -> float:
        """Simulated time over wall time since the first step; 1 when the simulation keeps up."""
        wall = self._now - self._begin
        return self._steps * self._period / wall if wall > 0.0 else 1.0

    def wait(self) -> None:
        """Wait until the next step is due."""
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


class RowBuffer:
    """Buffer of the newest rows of a drive without a planned end, in blocks."""

    def __init__(self, rows: int):
        """Prepare a buffer for at least this number of rows; with 0 it keeps none."""
        self._most, self._held = rows, 0
        self._names: tuple[str, ...] = ()
        self._blocks: deque[Array] = deque()

    @property
    def rows(self) -> int:
        """Number of rows held now."""
        return self._held

    def add(self, names: tuple[str, ...], block: Array) -> None:
        """Append a copy of rows.

        Args:
          names: Names of the columns.
          block: Rows, shape (m, len(names)).
        """
        if self._most == 0:
            return
        self._names = names
        self._blocks.append(block.copy())
        self._held += len(block)
        while self._held - len(self._blocks[0]) >= self._most:
            self._held -= len(self._blocks.popleft())

    def trace(self, about: Mapping[str, Any]) -> Trace:
        """Trace of the rows held now; its time is that of the plant."""
        table = np.concatenate(self._blocks) if self._blocks else np.empty((0, len(self._names)))
        columns = np.ascontiguousarray(table.T)
        return Trace(dict(zip(self._names, columns, strict=True)), about)


def free_drive(
    floor: str = DEFAULT_FLOOR, model_file: Path | None = None, floors_file: Path | None = None
) -> Scenario:
    """Scenario of a robot on a flat floor, without plan, end, faults and checks.

    The heading is held, so that the robot drives straight. Detection does not excite the wheels, since the
    robot must move on command only.

    Args:
      floor: Name of the floor.
      model_file: Model file of the robot; the shipped one when None.
      floors_file: File with floors that are added to the shipped ones or replace them.

    Raises:
      InputError: A file breaks a rule.
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
        own_floors=own_floors(floors_file),
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
