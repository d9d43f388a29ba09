"""The published method on the robot: section 5.3 and Fig. 6.9."""

from __future__ import annotations

import dataclasses
import math
from dataclasses import dataclass

import numpy as np

from omnimj.control.cascade.controller import Reconfiguration, is_good
from omnimj.control.cascade.heading import REST_WHEEL_SPEED
from omnimj.control.detection.detector import DetectorOptions
from omnimj.control.detection.published import robot_residuals
from omnimj.control.detection.published.decision import (
    LAYOUT_RULE,
    MOTOR,
    SLIP,
    PublishedThresholds,
    above_threshold,
    first_to_cross,
    isolate_robot_fault,
    layout_mismatch,
)
from omnimj.control.detection.published.residuals import bounded_time_step, matching_lags
from omnimj.control.detection.published.weighted_kinematics import (
    WeightedKinematics,
    motor_weights,
    slip_weights,
    torque_constant_loss,
)
from omnimj.errors import InputError
from omnimj.parameters import Floor, Robot
from omnimj.physics.effect_terms import zero_terms
from omnimj.physics.kinematics import rolling_matrix
from omnimj.physics.motor import TORQUE_SCALE, driven_by_measured_current, motor_parameters
from omnimj.physics.planar import planar_constants
from omnimj.signals import Array, Diagnosis, Measurement

SETTLING_TIME = 0.5
"""The torque constant has settled when H has not grown for so long [s]; Fig. 6.13 gives no number."""
LARGEST_HEIGHT = 100.0
"""No force of the robot's makes a larger H [N]: beyond it a sensor has failed."""
GROWTH = 0.01
"""H grows when it grows by more than this [N]."""

SAME_SLIP = 0.2
"""The weights switch with every crossing, up to a thousand times a second; a slip that comes back within this
time [s] is the same diagnosis."""

NORMAL, SLIPPING, ESTIMATING, RECOVERED = range(4)
"""Modes, Fig. 6.9: no fault; weights for a slipping wheel; a torque constant is being found; it has been."""


@dataclass(frozen=True, slots=True)
class PublishedRobotState:
    """State of the detector between two steps."""

    time: float
    """Time of the last good measurement [s]."""
    observer: Array
    """A row of `robot_residuals`."""
    motors: Array
    """Rows of the motors with their estimated torque constants, shape (n, MOTOR_SIZE)."""
    log: Array
    """Aligned with `PublishedRobot.log_names`."""
    weights: Array
    """W_i, shape (n,)."""
    reconfiguration: Reconfiguration | None
    """The kinematics that these weights make; None where the method only watches."""
    diagnoses: tuple[Diagnosis, ...] = ()
    first: int = -1
    """Wheel 0 … n−1 that crossed first in this event; −1 when all are below."""
    slipping: int = -1
    """Wheel that is diagnosed as slipping; −1 for none."""
    estimating: int = -1
    """Wheel whose torque constant is being found; −1 for none."""
    height: float = 0.0
    """H of Eq. 6.1 so far [N]."""
    grown: float = 0.0
    """When H grew last [s]."""
    grown_to: float = 0.0
    """Value of H at that time [N]."""
    share_before: float = 1.0
    """K_t of Eq. 6.2 over the nominal one: its estimate before this fault."""

    @property
    def fault_estimate(self) -> None:
        """None: the method recovers by itself."""
        return


class PublishedRobotDetector:
    """Chapters 5 and 6 beside the cascade.

    Args:
      robot: Nominal robot; effects of its model file are left out.
      floor: Nominal floor.
      thresholds: Thresholds of the residuals.
      choice: Variant, printed or repaired.

    Raises:
      InputError: Another layout than the four wheels of Table 5.2.
    """

    def __init__(self, robot: Robot, floor: Floor, thresholds: PublishedThresholds, choice: DetectorOptions):
        u, n = robot.drive_directions, len(robot.wheels)
        found = layout_mismatch(robot)
        if found:
            raise InputError(f"{robot.file}: [[wheels]]", found, LAYOUT_RULE)
        constants = planar_constants(robot)
        odometry = np.linalg.pinv(rolling_matrix(robot.wheel_positions, u))
        self._odometry, self._wheels, self._printed = odometry, n, choice.printed
        self._rows = constants.body, constants.wheels
        self._floors, self._terms = np.tile(floor.row, (n, 1)), zero_terms(n)
        motor = driven_by_measured_current(motor_parameters(robot.motor))
        self._healthy = np.tile(np.array(motor), (n, 1))
        self._lags = matching_lags(robot.sensors)
        self._most_current = robot.sensors.current_monitor_range
        self._radius, self._thresholds = robot.wheel.radius, thresholds
        self._axis = np.abs(u).argmax(axis=1).tolist()
        self._kinematics = WeightedKinematics(robot, choice.printed) if choice.recovery else None
        self._speeds = robot_residuals.residual_index(n)
        self.log_names = _log_names(n)

    def start(self, measurement: Measurement) -> PublishedRobotState:
        """State before the first step: model and residuals begin at the measured wheel speeds."""
        observer = np.zeros(robot_residuals.row_size(self._wheels))
        if is_good(measurement, self._wheels) and _is_bounded(measurement):
            self._align(observer, measurement)
        time = measurement.time if math.isfinite(measurement.time) else 0.0
        healthy = None if self._kinematics is None else self._kinematics.healthy
        log = np.zeros(len(self.log_names))
        state = PublishedRobotState(time, observer, self._healthy, log, np.ones(self._wheels), healthy)
        return dataclasses.replace(state, log=self._log(state))

    def begin(self, measurement: Measurement, bias: float = 0.0) -> PublishedRobotState:
        """State of a robot that may already be moving: as `start`, which takes the wheels' speeds."""
        return self.start(measurement)

    def resume(
        self, state: PublishedRobotState, measurement: Measurement, bias: float, is_long: bool
    ) -> PublishedRobotState:
        """State after a gap: the next step bridges a short one; after a long one the detector starts anew."""
        return self.start(measurement) if is_long else state

    def cannot_judge(self, state: PublishedRobotState) -> bool:
        """Always False: the published method judges every measurement."""
        return False

    def step(
        self,
        state: PublishedRobotState,
        measurement: Measurement,
        command: Array | None = None,
        bias: float = 0.0,
    ) -> PublishedRobotState:
        """State after a good measurement.

        Args:
          state: State before it.
          measurement: Newest measurement.
          command: Command of the period before it, shape (n,) [A]; not used.
          bias: Not used.
        """
        m = measurement
        if not _is_bounded(m):
            return state
        passed = bounded_time_step(state.time, m.time)
        observer = state.observer.copy()
        current = self._clipped_currents(m)
        measured = (current, m.wheel_speed, m.acceleration)
        machine = (*self._rows, state.motors, self._floors, self._terms)
        robot_residuals.update_observer(
            observer, measured, passed, machine, self._odometry, self._lags, self._printed
        )
        state = dataclasses.replace(state, time=m.time, observer=observer)
        state = self._estimate(state, m) if state.estimating >= 0 else self._judge(state)
        return dataclasses.replace(state, log=self._log(state))

    def _clipped_currents(self, measurement: Measurement) -> Array:
        """Currents within what their monitors can say, shape (n,) [A]."""
        return np.clip(measurement.current, -self._most_current, self._most_current)

    def _judge(self, state: PublishedRobotState) -> PublishedRobotState:
        """Left half of Fig. 6.9: which fault, and the weights while a wheel slips."""
        n, at, printed = self._wheels, self._speeds, self._printed
        residuals = state.observer[at : at + n].tolist()
        is_over = above_threshold(residuals, self._thresholds.wheel_speed, printed)
        first = first_to_cross(state.first, is_over, residuals)
        if first != state.first:
            state = dataclasses.replace(state, first=first)
        if state.slipping >= 0 and not is_over[state.slipping]:
            state = self._end_slip(state)
        if first < 0:
            return state
        forces = [rms > self._thresholds.force for rms in state.observer[at + n : at + n + 2].tolist()]
        fault = isolate_robot_fault(forces[self._axis[first]], forces[1 - self._axis[first]], printed)
        if fault == MOTOR:
            return self._begin_motor(state, first)
        if fault == SLIP and is_over[first] and state.slipping < 0:
            state = self._begin_slip(state, first)
        if state.slipping >= 0:
            state = self._weigh(state, slip_weights(np.array(residuals), printed))
        return state

    def _begin_slip(self, state: PublishedRobotState, wheel: int) -> PublishedRobotState:
        """A slip of the same wheel that comes back within `SAME_SLIP` is the one before."""
        last, diagnoses = state.diagnoses[-1:], state.diagnoses
        if last and last[0].kind == SLIP and last[0].wheels == (wheel + 1,) and _is_recent(last[0], state):
            diagnoses = (*diagnoses[:-1], dataclasses.replace(last[0], cleared=None))
        else:
            diagnoses = (*diagnoses, Diagnosis(state.time, SLIP, (wheel + 1,), 1.0))
        return dataclasses.replace(state, slipping=wheel, diagnoses=diagnoses)

    def _end_slip(self, state: PublishedRobotState) -> PublishedRobotState:
        """The residual is below its threshold again: the slip is over, all weights are as before."""
        diagnoses = (*state.diagnoses[:-1], dataclasses.replace(state.diagnoses[-1], cleared=state.time))
        state = dataclasses.replace(state, slipping=-1, diagnoses=diagnoses)
        return self._weigh(state, motor_weights(state.motors[:, TORQUE_SCALE]))

    def _begin_motor(self, state: PublishedRobotState, wheel: int) -> PublishedRobotState:
        """Right half of Fig. 6.9; a motor known to be faulty is estimated again, not diagnosed again."""
        if state.slipping >= 0:
            state = self._end_slip(state)
        diagnoses = state.diagnoses
        if not any(d.kind == MOTOR and d.wheels == (wheel + 1,) for d in diagnoses):
            diagnoses = (*diagnoses, Diagnosis(state.time, MOTOR, (wheel + 1,), 1.0))
        share = float(state.motors[wheel, TORQUE_SCALE])
        return dataclasses.replace(
            state,
            estimating=wheel,
            height=0.0,
            grown=state.time,
            grown_to=0.0,
            share_before=share,
            diagnoses=diagnoses,
        )

    def _estimate(self, state: PublishedRobotState, measurement: Measurement) -> PublishedRobotState:
        """Fig. 6.13: H and K_tm, at once in observer and weights; once it rests the residuals begin anew.

        Meanwhile nothing else is judged.
        """
        wheel, at = state.estimating, self._speeds + self._wheels
        rms = float(state.observer[at + self._axis[wheel]])
        height = min(rms - self._thresholds.force, LARGEST_HEIGHT)
        if height > state.height:
            state = self._weaken(state, wheel, height)
        if height > state.grown_to + GROWTH:
            state = dataclasses.replace(state, grown=state.time, grown_to=height)
        if state.time - state.grown < SETTLING_TIME:
            return state
        observer = np.zeros_like(state.observer)
        self._align(observer, measurement)
        return dataclasses.replace(state, observer=observer, estimating=-1, first=-1)

    def _weaken(self, state: PublishedRobotState, wheel: int, height: float) -> PublishedRobotState:
        """Eqs. 6.2 and 6.3 for a larger H: the torque constant in the model, the weight of its wheel."""
        share = state.share_before * (1.0 - torque_constant_loss(height, self._printed))
        motors = state.motors.copy()
        motors[wheel, TORQUE_SCALE] = share
        left = min(max(share, 0.0), 1.0)
        diagnoses = tuple(
            dataclasses.replace(d, effectiveness=left) if d.kind == MOTOR and d.wheels == (wheel + 1,) else d
            for d in state.diagnoses
        )
        state = dataclasses.replace(state, height=height, motors=motors, diagnoses=diagnoses)
        return self._weigh(state, motor_weights(motors[:, TORQUE_SCALE]))

    def _weigh(self, state: PublishedRobotState, weights: Array) -> PublishedRobotState:
        if self._kinematics is None or state.reconfiguration is None:
            return dataclasses.replace(state, weights=weights)
        reconfiguration = self._kinematics.reconfiguration(weights, state.reconfiguration)
        return dataclasses.replace(state, weights=weights, reconfiguration=reconfiguration)

    def _align(self, observer: Array, measurement: Measurement) -> None:
        """Puts the model where the wheel speeds say the robot is, at rest below their noise."""
        n, speeds = self._wheels, measurement.wheel_speed
        at = robot_residuals.previous_speed_index(n)
        observer[at : at + n] = speeds
        observer[at + 2 * n : at + 3 * n + 2] = (
            *self._clipped_currents(measurement),
            *measurement.acceleration,
        )
        if np.abs(speeds).max() > REST_WHEEL_SPEED:
            observer[n : 2 * n] = speeds
            observer[2 * n : 2 * n + 3] = self._odometry @ speeds * self._radius

    def _log(self, state: PublishedRobotState) -> Array:
        n, at, limits = self._wheels, self._speeds, self._thresholds
        log = np.empty(4 * n + 5)
        log[: n + 2] = state.observer[at : at + n + 2]
        log[n + 2 : 2 * n + 2] = limits.wheel_speed
        log[2 * n + 2 : 2 * n + 4] = limits.force
        log[2 * n + 4 : 3 * n + 4] = state.motors[:, TORQUE_SCALE]
        log[3 * n + 4 : 4 * n + 4] = state.weights
        log[4 * n + 4] = self._mode(state)
        return log

    def _mode(self, state: PublishedRobotState) -> int:
        if state.slipping >= 0:
            return SLIPPING
        if state.estimating >= 0:
            return ESTIMATING
        return RECOVERED if state.motors is not self._healthy else NORMAL


def _is_bounded(measurement: Measurement) -> bool:
    """True if the residuals' squares will be finite: speeds and accelerations not beyond any machine."""
    m = measurement
    return bool(np.abs(m.wheel_speed).max() < 1e6 and np.abs(m.acceleration).max() < 1e6)


def _is_recent(slip: Diagnosis, state: PublishedRobotState) -> bool:
    return slip.cleared is not None and state.time - slip.cleared <= SAME_SLIP


def _log_names(n: int) -> tuple[str, ...]:
    wheels = range(1, n + 1)
    return (
        *(f"residual_wheel_speed_{i}" for i in wheels),
        "residual_force_x",
        "residual_force_y",
        *(f"threshold_wheel_speed_{i}" for i in wheels),
        "threshold_force_x",
        "threshold_force_y",
        *(f"effectiveness_{i}" for i in wheels),
        *(f"weight_{i}" for i in wheels),
        "mode",
    )
