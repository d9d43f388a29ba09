"""Supervisor of recovery: from target and fault estimate to a target and a reconfiguration for the
cascade."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from omnimj.control.cascade.allocation import inverse_kinematics
from omnimj.control.cascade.controller import Reconfiguration, nominal_reconfiguration
from omnimj.control.cascade.heading import to_body, wrapped
from omnimj.control.detection.detector import FaultEstimate
from omnimj.control.gains import RecoveryGains
from omnimj.control.records import Record, packed
from omnimj.control.recovery.demand import (
    next_time_scaling,
    pivot_yaw_rate,
    place_correction,
    slip_bounds,
    time_scaling_of_pivot,
    time_scaling_on_slippery_floor,
)
from omnimj.control.recovery.dither import (
    DITHER_SPEED,
    SELF_TEST,
    SELF_TEST_SPEED,
    Dither,
    next_dither,
    next_self_test,
    null_space_speeds,
)
from omnimj.control.recovery.force_allocation import BodyMotion, creep_offsets
from omnimj.control.recovery.modes import (
    CAPPING,
    COMPENSATING,
    NO_ACTION,
    NORMAL,
    PIVOTING,
    REVERTED,
    SLOWING,
    STOPPING,
    RecoveryAction,
    choose_action,
)
from omnimj.control.recovery.tracking import Tracking, TrackingInput, update_tracking
from omnimj.control.robot_constants import GRAVITY, robot_constants
from omnimj.parameters import Robot
from omnimj.signals import Array, Measurement, Target

LEAST_EFFECTIVENESS = 0.3
"""Currents are scaled by at most 1/0.3: more does not help a dead motor."""
_JUDGED = 0.3  # [s] after a decision until its recovery is judged
_WORSE, _MARGIN = (
    2.0,
    0.06,
)  # tracking error from which a recovery is reverted: factor on that before, [m/s] more
_BLAMED = 0.05  # [m/s] by which a recovery must change speeds to be held responsible
_GRIP_FADES = 0.5  # [1/s] rate at which the grip of a slippery floor is forgotten
_FILTER = 0.03  # [s] filter of the wheels' traction


class RecoveryState(NamedTuple):
    """State of the recovery between two steps, and its answer to the last measurement."""

    target: Target
    """For the cascade."""
    tracking: Tracking
    tracking_record: Record
    """The same packed, for `update_tracking`."""
    traction: Array
    """Low-passed traction of the wheels, shape (n,) [N]."""
    dither: Record
    """Packed `Dither`."""
    test_left: float = 0.0
    """Remaining time of the self-test [s]."""
    time_scaling: float = 1.0
    """Speed of the plan, 1: as planned."""
    fault_estimate: FaultEstimate | None = None
    """Estimate that `action` answers to."""
    action: RecoveryAction = NO_ACTION
    decided: float = -math.inf
    """Time of the detector's newest decision [s]."""
    error_before: float = 0.0
    """Tracking error at that time [m/s]."""
    reverted: bool = False
    """True if the action is reverted since it made tracking worse."""
    correction: float = 0.0
    """Largest change of a speed by the recovery [m/s]."""
    grip: float = 0.0
    """Friction coefficient felt on a slippery floor [1]."""
    reconfiguration: Reconfiguration | None = None
    """For the cascade; None: nominal."""
    brake: tuple[int, ...] = ()
    """Wheels 1…n whose motors are shorted."""

    @property
    def log(self) -> Array:
        """Signals of the last step, aligned with `Recovery.log_names`."""
        mode = REVERTED if self.reverted else self.action.mode
        return np.array((float(mode), self.time_scaling, self.tracking.place_x, self.tracking.place_y))


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
        self.period = 1.0 / robot.sensors.sample_rate if period is None else period
        self.wheels, self._holds_heading = len(robot.wheels), holds_heading
        self._gains = RecoveryGains() if gains is None else gains
        self._robot = robot_constants(robot)
        self._arm = float(np.abs(self._robot.forces[2]).max())
        limit = min(robot.motor.current_limit, robot.control.current_limit)
        self._strongest = self._robot.torque * limit
        self._dithers, self._self_test = dithers, self_test
        self._rolling = np.ascontiguousarray(
            inverse_kinematics(robot.wheel_positions, robot.rolling_directions) / robot.wheel.radius
        )
        self._nominal = nominal_reconfiguration(self._rolling)
        self._null_space = null_space_speeds(self._robot.forces) / robot.wheel.radius

    def start(self) -> RecoveryState:
        """State of a healthy robot at rest."""
        standing = Target(np.zeros(2), 0.0, 0.0)
        tracking, test = Tracking(), SELF_TEST if self._self_test else 0.0
        return RecoveryState(
            standing,
            tracking,
            packed(tracking),
            np.zeros(self.wheels),
            packed(Dither()),
            test,
            time_scaling=float(not self._self_test),
        )

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
        action, last = state.action, state.fault_estimate
        if estimate is not last and (last is None or not estimate.same_faults_as(last)):
            action = choose_action(estimate, self._robot.forces, action)
        traction = state.traction + min(self.period / _FILTER, 1.0) * (estimate.force - state.traction)
        healthy, velocity = action.mode == NORMAL, estimate.velocity
        v_x, v_y = float(target.velocity[0]), float(target.velocity[1])
        now = TrackingInput(
            velocity[0], velocity[1], heading, yaw_rate, v_x, v_y, target.yaw_rate, target.heading
        )
        record = update_tracking(
            state.tracking_record, now, self.period, self._arm, healthy, action.mode != SLOWING
        )
        tracking = Tracking._make(record.item())
        decided, error_before, reverted = _judge_recovery(
            state, tracking, action, estimate.decided, float(measurement.time)
        )
        speed = math.hypot(v_x, v_y)
        wave, test_left = next_self_test(state.test_left, self.period)
        dither, scaling, grip = state.dither, state.time_scaling, state.grip
        wave *= SELF_TEST_SPEED
        if not wave:
            wave, dither = self._dither(dither, tracking, healthy, speed, traction)
        reconfiguration = self._nominal._replace(offset=wave * self._null_space) if wave else None
        if test_left <= 0.0:
            scaling, grip = self._next_time_scaling(state, tracking, action.mode, traction, speed)
        correction, brake = state.correction, ()
        if (
            healthy and reconfiguration is not None
        ):  # dither loosens the bristles: the robot would fall behind
            back = self._place_correction(tracking, v_x, v_y)
            target = Target(np.array((v_x + back[0], v_y + back[1])), target.yaw_rate, target.heading)
        elif not healthy:
            action_now = RecoveryAction(REVERTED) if reverted else action
            target, correction = self._demand(
                tracking, action_now, measurement.wheel_speed, heading, target, correction
            )
            reconfiguration, correction = self._reconfigure(
                tracking, action_now, estimate, traction, now, target, correction
            )
            brake = action_now.brake
        return RecoveryState(
            target, tracking, record, traction, dither, test_left, scaling, estimate, action, decided,
            error_before, reverted, correction, grip, reconfiguration, brake,
        )  # fmt: skip

    def _place_correction(self, tracking: Tracking, v_x: float, v_y: float) -> tuple[float, float]:
        gains = self._gains
        return place_correction(
            tracking.place_x, tracking.place_y, v_x, v_y, gains.place_proportional, gains.place_speed
        )

    def _dither(
        self, dither: Record, tracking: Tracking, healthy: bool, speed: float, traction: Array
    ) -> tuple[float, Record]:
        """Speed of the square wave [m/s], and the next state of the excitation."""
        acceleration = math.hypot(tracking.acceleration_x, tracking.acceleration_y)
        acceleration += abs(tracking.yaw_acceleration) * self._arm
        may = healthy and self._dithers
        sign, dither = next_dither(dither, self.period, may, speed, acceleration, traction)
        return sign * DITHER_SPEED, dither

    def _next_time_scaling(
        self, state: RecoveryState, tracking: Tracking, mode: int, traction: Array, speed: float
    ) -> tuple[float, float]:
        """Time scaling and the grip felt on a slippery floor."""
        scaling, grip, goal, most = state.time_scaling, 0.0, 1.0, GRAVITY
        if mode == SLOWING:
            share = float(np.abs(traction).max()) / self._robot.load
            grip = max(share, state.grip * (1.0 - _GRIP_FADES * self.period))
            goal, most = time_scaling_on_slippery_floor(
                grip, tracking.hardest, GRAVITY, self._gains.grip_share
            )
        if mode == PIVOTING:
            goal = time_scaling_of_pivot(scaling, speed)
        elif mode == STOPPING:
            goal = 0.0
        if goal != scaling:
            scaling = next_time_scaling(scaling, self.period, goal, speed, most)
        return scaling, grip

    def _demand(
        self,
        tracking: Tracking,
        action: RecoveryAction,
        wheel_speed: Array,
        heading: float,
        target: Target,
        correction: float,
    ) -> tuple[Target, float]:
        """Target with the position corrected and a heading that can be held, and the change of speed
        [m/s]."""
        if action.mode == STOPPING:
            return Target(target.velocity, 0.0, heading), correction
        v_x, v_y = float(target.velocity[0]), float(target.velocity[1])
        corrects = action.mode in (COMPENSATING, PIVOTING)
        back = self._place_correction(tracking, v_x, v_y) if corrects else (0.0, 0.0)
        velocity = np.array((v_x + back[0], v_y + back[1]))
        if action.mode == PIVOTING:
            b_x, b_y = to_body(velocity[0], velocity[1], heading)
            way = float(wheel_speed[action.pivot]) if action.pivot + 1 in action.brake else 0.0
            target = Target(
                velocity, float(pivot_yaw_rate(self._robot, action.pivot, way, b_x, b_y)), heading
            )
        else:
            held = (
                target.heading if self._holds_heading else wrapped(target.heading + tracking.heading_offset)
            )
            target = Target(velocity, target.yaw_rate, held)
        return target, math.hypot(*back)

    def _reconfigure(
        self,
        tracking: Tracking,
        action: RecoveryAction,
        estimate: FaultEstimate,
        traction: Array,
        now: TrackingInput,
        target: Target,
        correction: float,
    ) -> tuple[Reconfiguration, float]:
        """Scaled currents, creep of the shares f* and bounds of slipping wheels; the change of speed
        [m/s]."""
        changed = self._nominal._replace(trusts_gyro=estimate.trusts_gyro)
        if action.mode == REVERTED:
            return changed, correction
        radius = self._robot.radius
        left = np.maximum(1.0 - estimate.losses, LEAST_EFFECTIVENESS)
        changed = changed._replace(
            current_scale=np.where(estimate.held, 0.0, 1.0 / left),
            holds_heading=action.mode not in (PIVOTING, STOPPING),
        )
        v_x, v_y = to_body(target.velocity[0], target.velocity[1], now.heading)
        if action.mode == CAPPING:
            lowest, highest = slip_bounds(
                self._robot, estimate.velocity, now.yaw_rate, estimate.slipping, self._gains.slip_cap
            )
            speeds = self._rolling @ (v_x, v_y, target.yaw_rate)
            correction = radius * max(0.0, (lowest - speeds).max(), (speeds - highest).max())
            return changed._replace(lowest=lowest, highest=highest), correction
        if action.mode in (COMPENSATING, PIVOTING) and (target.velocity.any() or target.yaw_rate != 0.0):
            available = estimate.available & ~estimate.slipping
            if action.pivot >= 0:
                available[action.pivot] = True
            most = np.maximum(self._strongest * (1.0 - estimate.losses) - self._robot.dry, 0.0)
            # demanded acceleration in the frame that turns with the body: the world one, turned
            a_x, a_y = to_body(tracking.acceleration_x, tracking.acceleration_y, now.heading)
            motion = BodyMotion(v_x, v_y, float(target.yaw_rate), a_x, a_y, tracking.yaw_acceleration)
            offset = creep_offsets(self._robot, self._arm, motion, available, action.pivot, most, traction)
            return changed._replace(offset=offset), correction + radius * np.abs(offset).max()
        return changed, correction


def _judge_recovery(
    state: RecoveryState, tracking: Tracking, action: RecoveryAction, decided: float, time: float
) -> tuple[float, float, bool]:
    """Time of the decision, tracking error at that time, and whether its recovery is reverted.

    A fault makes tracking worse by itself; only a recovery that changes speeds by more than `_BLAMED` is
    blamed.
    """
    if decided > state.decided:
        return decided, max(tracking.error, tracking.usual_error), False
    active = action.mode in (COMPENSATING, CAPPING)
    worse = state.correction > _BLAMED and tracking.error > _WORSE * state.error_before + _MARGIN
    reverted = active and (state.reverted or (worse and time > state.decided + _JUDGED))
    return state.decided, state.error_before, reverted
