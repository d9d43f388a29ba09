"""Recovery: target and beliefs in, a target that can be followed and advice for the cascade out."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from omnimj.control.cascade.allocation import inverse_kinematics
from omnimj.control.cascade.heading import to_body, wrapped
from omnimj.control.detection.detector import FaultEstimate, Reconfiguration, nominal_reconfiguration
from omnimj.control.gains import RecoveryGains
from omnimj.control.recovery.demand import (
    cap_slip,
    creep_offsets,
    next_time_scaling,
    pivot_yaw_rate,
    place_correction,
    time_scaling_of_pivot,
    time_scaling_on_slippery_floor,
)
from omnimj.control.recovery.dither import (
    DITHER_SPEED,
    SELF_TEST_SPEED,
    TEST_LEFT,
    initial_dither,
    next_dither,
    next_self_test,
    null_space_speeds,
)
from omnimj.control.recovery.modes import (
    CAPPING,
    COMPENSATING,
    NORMAL,
    PIVOTING,
    REVERTED,
    SLOWING,
    STOPPING,
    RecoveryAction,
    choose_action,
)
from omnimj.control.recovery.tracking import (
    CORRECTION,
    ERROR,
    ERROR_BEFORE,
    FLOOR_GRIP,
    FORWARD_X,
    FORWARD_Y,
    HARDEST,
    NUMBERS,
    PACE,
    PLACE_X,
    PLACE_Y,
    SPIN,
    TURNED,
    USUAL_ERROR,
    update_tracking,
)
from omnimj.control.robot_constants import DRY, GRAVITY, LOAD, RADIUS, TORQUE, robot_constants, wheel_geometry
from omnimj.parameters import Robot
from omnimj.signals import Array, Measurement, Target

LEAST_EFFECTIVENESS = 0.3
"""Current is scaled by at most 1/0.3: a dead motor gets none the wiser for more."""
_JUDGED = 0.3  # [s] after a decision until its recovery is judged
_WORSE, _MARGIN = 2.0, 0.06  # a recovery that follows so much worse is taken back [1, m/s]
_BLAMED = 0.05  # [m/s] by which speeds must be moved for the help to be to blame
_FADES = 0.5  # [1/s] of the friction that was felt on a slippery floor
_FILTER = 0.03  # [s] for the traction of wheels that do not obey


@dataclass(frozen=True, slots=True)
class RecoveryState:
    """What recovery carries from one step to the next."""

    memory: Array
    """Of `memory`."""
    felt: Array
    """Traction of the wheels as their motors tell, low-passed, shape (n,) [N]."""
    fault_estimate: FaultEstimate | None
    """What `means` answer to."""
    means: RecoveryAction
    decided: float
    """Time of the decision that `means` answer to [s]."""
    reverted: bool
    """Whether what was done about it is taken back."""
    target: Target
    """For the cascade."""
    reconfiguration: Reconfiguration | None
    """For the cascade; None: drive as ever."""
    dither: Array
    """Of `dither`."""

    @property
    def time_scaling(self) -> float:
        """How fast the plan is to run, 1: as planned."""
        return float(self.memory[PACE])

    @property
    def log(self) -> Array:
        """Aligned with `Recovery.log_names`."""
        x = self.memory
        mode = REVERTED if self.reverted else self.means.mode
        return np.array((float(mode), x[PACE], x[PLACE_X], x[PLACE_Y]))


class Recovery:
    """Of a robot with n wheels.

    Args:
      robot: What the controller believes the robot to be.
      period: Control period [s]; that of the robot's sensors when None.
      holds_heading: Whether the cascade holds the planned heading anyway; else recovery holds the robot as it
        was turned when it broke.
      dithers: Whether motors are asked what they can do while nothing else tells it.
      self_test: Whether they are asked before the first drive.
      gains: What it feeds back with; as shipped when None.
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
        own = RecoveryGains() if gains is None else gains
        self._place = own.place_proportional, own.place_speed
        self._cap, self._share = own.slip_cap, own.grip_share
        shape = wheel_geometry(robot)
        self._forces, self._across = shape.forces, np.ascontiguousarray(shape.across)
        self._numbers = robot_constants(robot, self.period)
        self._arm = float(np.abs(shape.forces[2]).max())
        limit = min(robot.motor.current_limit, robot.control.current_limit)
        self._strongest = self._numbers[TORQUE] * limit
        self._dithers, self._self_test = dithers, self_test
        self._rolling = np.ascontiguousarray(
            inverse_kinematics(robot.wheel_positions, robot.rolling_directions) / robot.wheel.radius
        )
        self._usual = nominal_reconfiguration(self._rolling)
        self._against = null_space_speeds(shape.forces) / robot.wheel.radius

    def start(self, target: Target | None = None) -> RecoveryState:
        """A healthy robot at rest."""
        x = np.zeros(NUMBERS)
        x[PACE] = float(not self._self_test)
        asked = Target(np.zeros(2), 0.0, 0.0) if target is None else target
        return RecoveryState(
            x,
            np.zeros(self.wheels),
            None,
            RecoveryAction(),
            -math.inf,
            False,
            asked,
            None,
            initial_dither(self._self_test),
        )

    def step(
        self,
        state: RecoveryState,
        fault_estimate: FaultEstimate,
        measurement: Measurement,
        heading: float,
        turning: float,
        target: Target,
    ) -> RecoveryState:
        """The state after a good measurement.

        Args:
          state: From the step before.
          beliefs: Of the method.
          measurement: The newest.
          heading: Estimate [rad].
          turning: Gyro less its bias [rad/s].
          target: As planned, at the pace of the step before.
        """
        x, means, last = state.memory.copy(), state.means, state.fault_estimate
        if fault_estimate is not last and (last is None or not fault_estimate.same_faults_as(last)):
            means = choose_action(fault_estimate, self._forces, means)
        felt = state.felt + min(self.period / _FILTER, 1.0) * (fault_estimate.force - state.felt)
        healthy, v_x, v_y = means.mode == NORMAL, float(target.velocity[0]), float(target.velocity[1])
        update_tracking(
            x, self.period, self._arm, healthy, means.mode != SLOWING, fault_estimate.velocity, heading,
            turning,
            v_x, v_y, float(target.yaw_rate), float(target.heading),
        )  # fmt: skip
        decided, reverted = _judge_recovery(state, x, means, fault_estimate.decided, float(measurement.time))
        dither, reconfiguration = self._dither(state.dither, x, healthy, math.hypot(v_x, v_y), felt)
        if dither[TEST_LEFT] <= 0.0:
            self._set_pace(x, means.mode, felt, math.hypot(v_x, v_y))
        if (
            healthy and reconfiguration is not None
        ):  # shaken bristles hold nothing: the robot would fall behind
            back = place_correction(x, v_x, v_y, *self._place)
            velocity = np.array((v_x + back[0], v_y + back[1]))
            target = Target(velocity, target.yaw_rate, target.heading)
        elif not healthy:
            mode = REVERTED if reverted else means.mode
            target = self._demand(x, mode, means, measurement.wheel_speed, heading, target)
            reconfiguration = self._advice(x, mode, means, fault_estimate, felt, heading, turning, target)
        return RecoveryState(
            x, felt, fault_estimate, means, decided, reverted, target, reconfiguration, dither
        )

    def _dither(
        self, before: Array, x: Array, healthy: bool, speed: float, felt: Array
    ) -> tuple[Array, Reconfiguration | None]:
        """The numbers of `dither`, and what it adds to the wheels."""
        d = before.copy()
        wave = next_self_test(d, self.period)
        if wave:
            return d, replace(self._usual, offset=wave * SELF_TEST_SPEED * self._against)
        hard = math.hypot(x[FORWARD_X], x[FORWARD_Y]) + abs(x[SPIN]) * self._arm
        wave = next_dither(d, self.period, healthy and self._dithers, speed, hard, np.abs(felt).max())
        return d, replace(self._usual, offset=wave * DITHER_SPEED * self._against) if wave else None

    def _set_pace(self, x: Array, mode: int, felt: Array, speed: float) -> None:
        goal, most = 1.0, GRAVITY
        if mode == SLOWING:
            share = float(np.abs(felt).max()) / self._numbers[LOAD]
            x[FLOOR_GRIP] = max(share, x[FLOOR_GRIP] * (1.0 - _FADES * self.period))
            goal, most = time_scaling_on_slippery_floor(x[FLOOR_GRIP], x[HARDEST], GRAVITY, self._share)
        else:
            x[FLOOR_GRIP] = 0.0
        if mode == PIVOTING:
            goal = time_scaling_of_pivot(x[PACE], speed)
        elif mode == STOPPING:
            goal = 0.0
        if goal != x[PACE]:
            x[PACE] = next_time_scaling(x[PACE], self.period, goal, speed, most)

    def _demand(
        self, x: Array, mode: int, means: RecoveryAction, wheel_speed: Array, heading: float, target: Target
    ) -> Target:
        """The demand with the place corrected, and the heading that can be held."""
        if mode == STOPPING:
            return Target(target.velocity, 0.0, heading)
        v_x, v_y = float(target.velocity[0]), float(target.velocity[1])
        drives_back = mode in (COMPENSATING, PIVOTING)
        back = place_correction(x, v_x, v_y, *self._place) if drives_back else (0.0, 0.0)
        x[CORRECTION] = math.hypot(*back)
        velocity = np.array((v_x + back[0], v_y + back[1]))
        if mode != PIVOTING:
            held = target.heading if self._holds_heading else wrapped(target.heading + x[TURNED])
            return Target(velocity, target.yaw_rate, held)
        b_x, b_y = to_body(velocity[0], velocity[1], heading)
        way = float(wheel_speed[means.pivot]) if means.pivot + 1 in means.brake else 0.0
        yaw_rate = pivot_yaw_rate(self._forces, self._numbers[RADIUS], means.pivot, way, b_x, b_y)
        return Target(velocity, float(yaw_rate), heading)

    def _advice(
        self,
        x: Array,
        mode: int,
        means: RecoveryAction,
        fault_estimate: FaultEstimate,
        felt: Array,
        heading: float,
        turning: float,
        asked: Target,
    ) -> Reconfiguration:
        """For the cascade: scaled currents, creep of the shares f*, bounds of wheels that slip, brakes."""
        n, gyro = self.wheels, fault_estimate.trusts_gyro
        offset, lowest, highest = np.zeros(n), np.full(n, -np.inf), np.full(n, np.inf)
        if mode == REVERTED:
            return Reconfiguration(self._rolling, np.ones(n), offset, lowest, highest, gyro)
        scale = np.where(
            fault_estimate.held, 0.0, 1.0 / np.maximum(1.0 - fault_estimate.losses, LEAST_EFFECTIVENESS)
        )
        if mode == CAPPING:
            cap_slip(
                self._numbers, self._forces, fault_estimate.velocity, turning, fault_estimate.slipping,
                self._cap,
                lowest, highest,
            )  # fmt: skip
            asks = self._rolling @ (*to_body(asked.velocity[0], asked.velocity[1], heading), asked.yaw_rate)
            x[CORRECTION] = self._numbers[RADIUS] * max(0.0, (lowest - asks).max(), (asks - highest).max())
        elif mode in (COMPENSATING, PIVOTING) and (asked.velocity.any() or asked.yaw_rate != 0.0):
            v_x, v_y = to_body(asked.velocity[0], asked.velocity[1], heading)
            used = fault_estimate.available & ~fault_estimate.slipping
            if means.pivot >= 0:
                used[means.pivot] = True
            most = np.maximum(self._strongest * (1.0 - fault_estimate.losses) - self._numbers[DRY], 0.0)
            creep_offsets(
                self._numbers, self._forces, self._across, self._arm, x, heading,
                np.array((v_x, v_y, asked.yaw_rate)), most, used, means.pivot, felt, offset,
            )  # fmt: skip
            x[CORRECTION] += self._numbers[RADIUS] * np.abs(offset).max()
        holds = mode not in (PIVOTING, STOPPING)
        return Reconfiguration(self._rolling, scale, offset, lowest, highest, gyro, holds, means.brake)


def _judge_recovery(
    state: RecoveryState, x: Array, means: RecoveryAction, decided: float, time: float
) -> tuple[float, bool]:
    """Time of the decision that is answered, and whether the answer is taken back: it made following worse.

    A fault makes following worse by itself; only help that moves speeds by more than `_BLAMED` is to blame.
    """
    if decided > state.decided:
        x[ERROR_BEFORE] = max(x[ERROR], x[USUAL_ERROR])
        return decided, False
    helps = means.mode in (COMPENSATING, CAPPING)
    worse = x[CORRECTION] > _BLAMED and x[ERROR] > _WORSE * x[ERROR_BEFORE] + _MARGIN
    return state.decided, helps and (state.reverted or (worse and time > state.decided + _JUDGED))
