"""Recovery: target and beliefs in, a target that can be followed and advice for the cascade out."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from omnimj.control.allocation import inverse_kinematics
from omnimj.control.heading import to_body, wrapped
from omnimj.control.method import Advice, Beliefs
from omnimj.control.recovery.demand import cap_slip, creep_offsets, pivot_yaw_rate, place_correction
from omnimj.control.recovery.dither import (
    SELF_TEST_SIZE,
    SIZE,
    TEST_LEFT,
    against_each_other,
    next_dither,
    next_self_test,
    no_dither,
)
from omnimj.control.recovery.memory import (
    ERROR,
    ERROR_BEFORE,
    FORWARD_X,
    FORWARD_Y,
    SPIN,
    FLOOR_GRIP,
    HARDEST,
    NUMBERS,
    PACE,
    PLACE_X,
    PLACE_Y,
    TURNED,
    USUAL_ERROR,
    remember,
)
from omnimj.control.recovery.modes import (
    CAPPING,
    COMPENSATING,
    NORMAL,
    PIVOTING,
    REVERTED,
    SLOWING,
    STOPPING,
    Means,
    means_for,
)
from omnimj.control.recovery.pace import next_pace, pace_of_pivot, pace_on_slippery_floor
from omnimj.control.robust.constants import DRY, GRAVITY, LOAD, RADIUS, TORQUE, geometry, numbers
from omnimj.control.target import Target
from omnimj.parameters import Robot
from omnimj.signals import Array, Measurement

LEAST_LEFT = 0.3
"""Current is scaled by at most 1/0.3: a dead motor gets none the wiser for more."""
_JUDGED = 0.3  # [s] after a decision until its recovery is judged
_WORSE, _MARGIN = 2.0, 0.06  # a recovery that follows so much worse is taken back [1, m/s]
_FADES = 0.5  # [1/s] of the friction that was felt on a slippery floor
_FILTER = 0.03  # [s] for the traction of wheels that do not obey
_REST_PACE = 1e-3


@dataclass(frozen=True, slots=True)
class RecoveryState:
    """What recovery carries from one step to the next."""

    memory: Array
    """Of `memory`."""
    felt: Array
    """Traction of the wheels as their motors tell, low-passed, shape (n,) [N]."""
    beliefs: Beliefs | None
    """What `means` answer to."""
    means: Means
    decided: float
    """Time of the decision that `means` answer to [s]."""
    reverted: bool
    """Whether what was done about it is taken back."""
    target: Target
    """For the cascade."""
    advice: Advice | None
    """For the cascade; None: drive as ever."""
    dither: Array
    """Of `dither`."""

    @property
    def pace(self) -> float:
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
    """

    log_names = ("recovery", "pace", "place_error_x", "place_error_y")

    def __init__(self, robot: Robot, period: float | None = None, holds_heading: bool = False, dithers: bool = True, self_test: bool = False):
        self.period = 1.0 / robot.sensors.sample_rate if period is None else period
        self.wheels, self._holds_heading = len(robot.wheels), holds_heading
        shape = geometry(robot)
        self._forces, self._across = shape.forces, np.ascontiguousarray(shape.across)
        self._numbers = numbers(robot, self.period)
        self._arm = float(np.abs(shape.forces[2]).max())
        limit = min(robot.motor.current_limit, robot.control.current_limit)
        self._strongest = self._numbers[TORQUE] * limit
        self._dithers, self._self_test = dithers, self_test
        self._rolling = np.ascontiguousarray(
            inverse_kinematics(robot.wheel_positions, robot.drive_directions) / robot.wheel.radius
        )
        n, endless = self.wheels, np.full(self.wheels, np.inf)
        against = against_each_other(shape.forces) / robot.wheel.radius
        self._pushing, self._testing = (
            [Advice(self._rolling, np.ones(n), k * size * against, -endless, endless) for k in (-1.0, 0.0, 1.0)]
            for size in (SIZE, SELF_TEST_SIZE)
        )

    def start(self, target: Target | None = None) -> RecoveryState:
        """A healthy robot at rest."""
        x = np.zeros(NUMBERS)
        x[PACE] = float(not self._self_test)
        asked = Target(np.zeros(2), 0.0, 0.0) if target is None else target
        return RecoveryState(x, np.zeros(self.wheels), None, Means(), -math.inf, False, asked, None, no_dither(self._self_test))

    def step(
        self,
        state: RecoveryState,
        beliefs: Beliefs,
        measurement: Measurement,
        heading: float,
        turning: float,
        target: Target,
    ) -> RecoveryState:
        """The state after a measurement.

        Args:
          state: From the step before.
          beliefs: Of the method.
          measurement: The newest.
          heading: Estimate [rad].
          turning: Gyro less its bias [rad/s].
          target: As planned, at the pace of the step before.
        """
        x, healthy = state.memory.copy(), beliefs.is_healthy
        felt = state.felt + min(self.period / _FILTER, 1.0) * (beliefs.force - state.felt)
        known = state.means.mode != SLOWING
        v_x, v_y = float(target.velocity[0]), float(target.velocity[1])
        if not (math.isfinite(turning) and math.isfinite(heading)):
            return replace(state, target=target)
        remember(
            x, self.period, self._arm, healthy, known, beliefs.velocity, heading, turning,
            v_x, v_y, float(target.yaw_rate), float(target.heading),
        )  # fmt: skip
        state = self._decide(replace(state, memory=x, felt=felt), beliefs, float(measurement.time))
        self._set_pace(x, state, felt, math.hypot(v_x, v_y))
        advice, dither = self._dither(state, healthy, math.hypot(v_x, v_y), felt)
        if healthy:
            return replace(state, target=target, advice=advice, dither=dither)
        state = replace(state, dither=dither)
        target, advice = self._act(state, beliefs, measurement, heading, turning, target)
        return replace(state, target=target, advice=advice)

    def _dither(
        self, state: RecoveryState, healthy: bool, speed: float, felt: Array
    ) -> tuple[Advice | None, Array]:
        x, d = state.memory, state.dither.copy()
        tested = int(next_self_test(d, self.period))
        if tested:
            return self._testing[tested + 1], d
        hard = math.hypot(x[FORWARD_X], x[FORWARD_Y]) + abs(x[SPIN]) * self._arm
        sign = next_dither(d, self.period, healthy and self._dithers, speed, hard, np.abs(felt).max())
        return (self._pushing[int(sign) + 1] if sign else None), d

    def _decide(self, state: RecoveryState, beliefs: Beliefs, time: float) -> RecoveryState:
        """Means for what is believed now; taken back where following got worse by them."""
        x, means = state.memory, state.means
        if beliefs is not state.beliefs:
            means = means_for(beliefs, self._forces, means)
        if beliefs.decided > state.decided:
            x[ERROR_BEFORE] = max(x[ERROR], x[USUAL_ERROR])
            return replace(state, beliefs=beliefs, means=means, decided=beliefs.decided, reverted=False)
        helps = means.mode in (COMPENSATING, CAPPING)
        worse = x[ERROR] > _WORSE * x[ERROR_BEFORE] + _MARGIN
        reverted = helps and (state.reverted or (worse and time > state.decided + _JUDGED))
        return replace(state, beliefs=beliefs, means=means, reverted=reverted)

    def _set_pace(self, x: Array, state: RecoveryState, felt: Array, speed: float) -> None:
        goal, most, mode = 1.0, GRAVITY, state.means.mode
        if state.dither[TEST_LEFT] > 0.0:
            return
        share = float(np.abs(felt).max()) / self._numbers[LOAD]
        if mode == SLOWING:
            x[FLOOR_GRIP] = max(share, x[FLOOR_GRIP] * (1.0 - _FADES * self.period))
            goal, most = pace_on_slippery_floor(x[FLOOR_GRIP], x[HARDEST], GRAVITY)
        elif mode == PIVOTING:
            goal = pace_of_pivot(x[PACE], speed)
        elif mode == STOPPING:
            goal = 0.0
        if mode != SLOWING:
            x[FLOOR_GRIP] = 0.0
        if goal != x[PACE]:
            x[PACE] = next_pace(x[PACE], self.period, goal, speed, most)
            if x[PACE] < _REST_PACE and goal == 0.0:
                x[PACE] = 0.0

    def _act(
        self,
        state: RecoveryState,
        beliefs: Beliefs,
        measurement: Measurement,
        heading: float,
        turning: float,
        target: Target,
    ) -> tuple[Target, Advice]:
        n, x, means = self.wheels, state.memory, state.means
        offset, lowest, highest = np.zeros(n), np.full(n, -np.inf), np.full(n, np.inf)
        obeys = beliefs.obeys
        scale = np.where(beliefs.held, 0.0, 1.0 / np.maximum(1.0 - beliefs.losses, LEAST_LEFT))
        gyro = beliefs.trusts_gyro
        if state.reverted or means.mode == NORMAL:
            return target, Advice(self._rolling, np.ones(n), offset, lowest, highest, gyro)
        if means.mode == STOPPING:
            still = Target(target.velocity, 0.0, heading)
            return still, Advice(self._rolling, scale, offset, lowest, highest, gyro, False, means.brake)
        asked = self._demand(state, measurement, heading, target)
        if means.mode == CAPPING:
            cap_slip(self._numbers, self._forces, beliefs.velocity, turning, beliefs.slipping, lowest, highest)
        elif means.mode != SLOWING:
            v_x, v_y = to_body(asked.velocity[0], asked.velocity[1], heading)
            twist = np.array((v_x, v_y, asked.yaw_rate))
            used = obeys & ~beliefs.slipping
            if means.pivot >= 0:
                used[means.pivot] = True
            most = np.maximum(self._strongest * (1.0 - beliefs.losses) - self._numbers[DRY], 0.0)
            creep_offsets(
                self._numbers, self._forces, self._across, self._arm, x, heading, twist,
                most, used, means.pivot, state.felt, offset,
            )  # fmt: skip
        holds = means.mode != PIVOTING
        return asked, Advice(self._rolling, scale, offset, lowest, highest, gyro, holds, means.brake)

    def _demand(self, state: RecoveryState, measurement: Measurement, heading: float, target: Target) -> Target:
        """The demand with the place corrected, and the heading that can be held."""
        x, pivot = state.memory, state.means.pivot
        v_x, v_y = float(target.velocity[0]), float(target.velocity[1])
        back = place_correction(x, v_x, v_y) if state.means.mode in (COMPENSATING, PIVOTING) else (0.0, 0.0)
        velocity = np.array((v_x + back[0], v_y + back[1]))
        if pivot < 0:
            held = target.heading if self._holds_heading else wrapped(target.heading + x[TURNED])
            return Target(velocity, target.yaw_rate, held)
        b_x, b_y = to_body(velocity[0], velocity[1], heading)
        braked = pivot + 1 in state.means.brake
        way = float(measurement.wheel_speed[pivot]) if braked else 0.0
        yaw_rate = pivot_yaw_rate(self._forces, self._numbers[RADIUS], pivot, way, b_x, b_y)
        return Target(velocity, float(yaw_rate), heading)
