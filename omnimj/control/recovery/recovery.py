"""Recovery: from target and fault estimate to a target and a reconfiguration for the cascade."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from omnimj.control.cascade.controller import Reconfiguration, nominal_reconfiguration
from omnimj.control.detection.detector import FaultEstimate
from omnimj.control.gains import RecoveryGains
from omnimj.control.records import Record, copied, packed, plain_array
from omnimj.control.recovery.dither import SELF_TEST, Dither, null_space_speeds
from omnimj.control.recovery.modes import NORMAL, REVERTED, RecoveryAction, choose_action
from omnimj.control.recovery.step import (
    Demand,
    RecoveryFields,
    RecoveryInput,
    RecoveryParameters,
    advance_recovery,
)
from omnimj.control.recovery.tracking import Tracking
from omnimj.control.robot_constants import robot_constants
from omnimj.parameters import Robot
from omnimj.physics.kinematics import rolling_matrix
from omnimj.physics.native import kernel
from omnimj.signals import Array, Measurement, Target


class RecoveryState(NamedTuple):
    """State of the recovery between two steps, and its answer to the last measurement."""

    record: Record
    """Packed `RecoveryFields`."""
    estimate: FaultEstimate | None = None
    """Estimate that the mode answers to."""
    estimate_record: Record | None = None
    """The same packed."""

    @property
    def target(self) -> Target:
        """For the cascade."""
        x, y, yaw_rate, heading = self.record["demand"][0].item()
        return Target(np.array((x, y)), yaw_rate, heading)

    @property
    def reconfiguration(self) -> Reconfiguration:
        """For the cascade."""
        return Reconfiguration(*self.record["reconfiguration"][0])

    @property
    def brake(self) -> tuple[int, ...]:
        """Wheels 1…n whose motors are shorted."""
        return shorted_wheels(self.record["brake"][0])

    @property
    def time_scaling(self) -> float:
        """Speed of the plan, 1: as planned."""
        return float(self.record["time_scaling"][0])

    @property
    def log(self) -> Array:
        """Signals of the last step by `Recovery.log_names`, shape (len(log_names),)."""
        log = np.empty(len(Recovery.log_names))
        _fill_log(self.record, log)
        return log


class Recovery:
    """Recovery of a robot with n wheels.

    Args:
      robot: Nominal robot.
      period: Control period [s]; that of the robot's sensors when None.
      holds_heading: Whether the cascade holds the planned heading anyway; else recovery holds the heading
        offset that the robot had when the fault occurred.
      dithers: Whether the motors are excited while the drive reveals nothing about them.
      self_test: Whether they are excited before the first drive.
      gains: As shipped when None.
    """

    log_names = ("recovery", "pace", "place_error_x", "place_error_y")

    def __init__(
        self,
        robot: Robot,
        period: float | None = None,
        holds_heading: bool = False,
        dithers: bool = True,
        self_test: bool = False,
        gains: RecoveryGains | None = None,
    ):
        gains, constants = RecoveryGains() if gains is None else gains, robot_constants(robot)
        inverse = rolling_matrix(robot.wheel_positions, robot.rolling_directions)
        limit = min(robot.motor.current_limit, robot.control.current_limit)
        self.wheels, self._self_test = len(robot.wheels), self_test
        self.constants = RecoveryParameters(
            period=1.0 / robot.sensors.sample_rate if period is None else period,
            arm=float(np.abs(constants.forces[2]).max()),
            strongest=float(constants.torque.min() * limit),
            holds_heading=holds_heading,
            dithers=dithers,
            place_proportional=gains.place_proportional,
            place_speed=gains.place_speed,
            slip_cap=gains.slip_cap,
            grip_share=gains.grip_share,
            robot=constants,
            speed_per_twist=np.ascontiguousarray(inverse / robot.wheel.radius),
            null_space=null_space_speeds(constants.forces) / robot.wheel.radius,
        )
        self._parameters = packed(self.constants)

    def initial_fields(self) -> RecoveryFields:
        """Fields of the state of a healthy robot at rest."""
        n = self.wheels
        return RecoveryFields(
            demand=Demand(),
            reconfiguration=nominal_reconfiguration(self.constants.speed_per_twist),
            brake=np.zeros(n, bool),
            tracking=Tracking(),
            dither=Dither(),
            traction=np.zeros(n),
            test_left=SELF_TEST if self._self_test else 0.0,
            time_scaling=float(not self._self_test),
            mode=NORMAL,
            pivot=-1,
            shorts=np.zeros(n, bool),
        )

    def start(self) -> RecoveryState:
        """State of a healthy robot at rest."""
        return RecoveryState(packed(self.initial_fields()))

    def choose_mode(self, record: Record, estimate: FaultEstimate) -> None:
        """Choose the mode for an estimate and write it into a record of `RecoveryFields`."""
        shorts = record["shorts"][0]
        before = RecoveryAction(
            int(record["mode"][0]), int(record["pivot"][0]), shorted_wheels(record["shorts"][0])
        )
        action = choose_action(estimate, self.constants.robot.forces, before)
        record["mode"], record["pivot"] = action.mode, action.pivot
        shorts[:] = False
        shorts[[wheel - 1 for wheel in action.brake]] = True

    def step(
        self,
        state: RecoveryState,
        estimate: FaultEstimate,
        measurement: Measurement,
        heading: float,
        yaw_rate: float,
        target: Target,
    ) -> RecoveryState:
        """State after a good measurement.

        Args:
          state: From the step before.
          estimate: From the detector.
          measurement: The newest.
          heading: Estimate [rad].
          yaw_rate: Gyro less its bias [rad/s].
          target: As planned, at the time scaling of the step before.
        """
        last, known, record = state.estimate, state.estimate_record, copied(state.record)
        if estimate is not last:
            known = packed(estimate)
            if last is None or not estimate.same_faults_as(last):
                self.choose_mode(record, estimate)
        velocity = target.velocity
        demand = Demand(float(velocity[0]), float(velocity[1]), float(target.yaw_rate), float(target.heading))
        time, wheel_speed = float(measurement.time), plain_array(measurement.wheel_speed)
        now = RecoveryInput(time, wheel_speed, heading, yaw_rate, demand)
        _step(self._parameters, known, now, record)
        return RecoveryState(record, estimate, known)


@kernel
def _step(parameters, estimate, now, record):
    advance_recovery(parameters[0], estimate[0], now, record[0])


@kernel
def _fill_log(record, log):
    write_log(record[0], log)


@kernel
def write_log(x, log):
    """Write the signals of `Recovery.log_names`.

    Args:
      x: `RecoveryFields`.
      log: Output, shape (4,).
    """
    log[0] = REVERTED if x.reverted else x.mode
    log[1], log[2], log[3] = x.time_scaling, x.tracking.place_x, x.tracking.place_y


def shorted_wheels(mask: Array) -> tuple[int, ...]:
    """Wheels 1…n of a mask, shape (n,)."""
    return tuple(i + 1 for i, shorted in enumerate(mask.tolist()) if shorted)
