"""The cascade: heading → allocation → wheel-speed PI → limits. State goes in and comes out."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from omnimj.control.cascade.allocation import inverse_kinematics, wheel_speed_target
from omnimj.control.cascade.heading import (
    BIAS,
    initial_gyro_bias,
    is_standing,
    to_body,
    update_gyro_bias,
    update_heading,
    wrapped,
    yaw_rate_demand,
    yaw_rate_row,
)
from omnimj.control.cascade.limits import limit_all, limits_row
from omnimj.control.cascade.wheel_speed import amplifier_row, speed_loop, speed_loop_row
from omnimj.control.detection.detector import Reconfiguration, nominal_reconfiguration
from omnimj.parameters import Robot
from omnimj.physics.native import kernel
from omnimj.signals import Array, CurrentCommand, Diagnosis, Measurement, Target

_BODY_LOG = ("target_twist_x", "target_twist_y", "target_yaw_rate", "heading_estimate", "gyro_bias")
_WHEEL_LOG = ("target_wheel_speed", "limit_reason")


@dataclass(frozen=True, slots=True)
class ControlState:
    """What the controller carries from one step to the next."""

    heading: float
    """Estimate, unwrapped [rad]."""
    rest: Array
    """Of `gyro_bias`, shape (4,): the bias and what was averaged for it."""
    integral: Array
    """q of the wheel-speed loops, shape (n,) [A]."""
    current: Array
    """Last command, shape (n,) [A]."""
    log: Array
    """What was asked in the last step, aligned with `Controller.log_names`."""

    @property
    def diagnoses(self) -> tuple[Diagnosis, ...]:
        """None: the cascade alone diagnoses nothing."""
        return ()

    @property
    def time_scaling(self) -> float:
        """1: the cascade alone follows the plan as it is."""
        return 1.0


@kernel
def _all_finite(values):
    for value in values:  # noqa: SIM110 a loop is what compiles well
        if not math.isfinite(value):
            return False
    return True


@kernel
def is_good(wheels, time, current, wheel_speed, acceleration, yaw_rate, yaw):
    """Whether a measurement is complete and finite; any other is not acted upon."""
    complete = current.size == wheels and wheel_speed.size == wheels and acceleration.size == 2
    scalars = math.isfinite(time) and math.isfinite(yaw_rate) and math.isfinite(yaw)
    return (
        complete
        and scalars
        and _all_finite(current)
        and _all_finite(wheel_speed)
        and _all_finite(acceleration)
    )


@kernel
def demanded_twist(loops, heading, error, turns_at, velocity_x, velocity_y, yaw_rate, target_heading):
    """World demand → body twist (v_x, v_y [m/s], yaw rate [rad/s]), Fig. 3.3 upper level.

    Args:
      loops: [yaw-rate gain, heading gain, 1 to rotate by the measured heading or 0 by the planned one, …].
      heading: Estimate [rad].
      error: What the heading hold corrects [rad].
      turns_at: Gyro less its bias [rad/s].
      velocity_x: World demand [m/s].
      velocity_y: World demand [m/s].
      yaw_rate: Demand [rad/s].
      target_heading: Planned [rad].
    """
    frame = heading if loops[2] != 0.0 else target_heading
    twist_x, twist_y = to_body(velocity_x, velocity_y, frame)
    return twist_x, twist_y, yaw_rate_demand(yaw_rate, turns_at, error, loops[0], loops[1])


@kernel
def cascade_step(
    loops, turn, speed_row, amplifier, limits, speed_per_twist, current_scale, offset, lowest, highest,
    heading, rest, integral, last,
    good, wheel_speed, measured_yaw_rate, yaw,
    velocity_x, velocity_y, yaw_rate, target_heading,
):  # fmt: skip
    """One step of the whole controller: heading, gyro's rest, integrals [A], currents [A] and the log.

    A measurement that is not good changes nothing but the command, which is zero, and empties the integrals;
    it also ends the rest.

    Args:
      loops: And all up to `limits`: rows of the laws.
      speed_per_twist: And all up to `highest`: of `Reconfiguration`.
      heading: And all up to `last`: of `ControlState`.
      good: Whether the measurement may be acted upon.
      wheel_speed: Measured, shape (n,) [rad/s].
      measured_yaw_rate: Gyro [rad/s].
      yaw: Converter [rad].
      velocity_x: And all behind it: of `Target`.
    """
    n = speed_per_twist.shape[0]
    log = np.empty(5 + 2 * n)
    targets, reasons = log[5 : 5 + n], log[5 + n :]
    currents, wanted, integrals = np.empty(n), np.empty(n), np.zeros(n)

    turns_at = measured_yaw_rate - rest[BIAS]
    if good:
        heading = update_heading(heading, yaw, turns_at, loops[3], loops[4])
    error = wrapped(target_heading - heading) if loops[1] > 0.0 else 0.0
    standing = is_standing(velocity_x, velocity_y, yaw_rate, error, turns_at, wheel_speed)
    rest = update_gyro_bias(rest, turn, good and standing, measured_yaw_rate, wheel_speed, loops[4])
    twist = (0.0, 0.0, 0.0)
    if not standing:
        twist = demanded_twist(
            loops, heading, error, turns_at, velocity_x, velocity_y, yaw_rate, target_heading
        )
    for i in range(n):
        asked = wheel_speed_target(speed_per_twist, i, twist[0], twist[1], twist[2]) + offset[i]
        targets[i] = min(max(asked, lowest[i]), highest[i])
        if good:
            wanted[i], integrals[i] = speed_loop(
                speed_row, amplifier, targets[i], wheel_speed[i], integral[i], current_scale[i]
            )
    limit_all(limits, wanted, last, wheel_speed, good, currents, reasons)
    if not (good and _all_finite(wanted)):
        integrals[:] = 0.0

    log[0], log[1], log[2], log[3], log[4] = twist[0], twist[1], twist[2], heading, rest[BIAS]
    return heading, rest, integrals, currents, log


class Controller:
    """Cascade control of a robot with n wheels: section 3.1.2, without diagnosis.

    ```
    state = controller.start(measurement)
    command, state = controller.step(state, measurement, target)
    ```

    Args:
      robot: Geometry, motor, gains, limits.
      yaw_loop: P on the yaw rate.
      heading_hold: P on the heading, on top of the yaw-rate demand.
      heading_feedback: Rotate world demands by the measured heading; by the planned one when False.
      scale: Inverse kinematics, `corrected` or `published`.
      weights: W_i of the published scale, shape (n,); ones when None.
      period: Control period [s]; that of the robot's sensors when None.

    Raises:
      UnknownNameError: No such scale.
      InputError: Weights that are not n positive numbers.
    """

    def __init__(
        self,
        robot: Robot,
        yaw_loop: bool = True,
        heading_hold: bool = False,
        heading_feedback: bool = True,
        scale: str = "corrected",
        weights: ArrayLike | None = None,
        period: float | None = None,
    ):
        self.period = 1.0 / robot.sensors.sample_rate if period is None else period
        gains, n = robot.control, len(robot.wheels)
        loops = (
            gains.yaw_rate_proportional if yaw_loop else 0.0,
            gains.heading_proportional if heading_hold else 0.0,
            float(heading_feedback),
            robot.sensors.gyro_range,
            self.period,
        )
        inverse = inverse_kinematics(robot.wheel_positions, robot.rolling_directions, scale, weights)
        self._turn = yaw_rate_row(robot)
        self._asked_loops = np.array(loops)
        self._holding_loops = self._asked_loops.copy()
        self._holding_loops[1] = gains.heading_proportional
        self._laws = (
            self._turn,
            speed_loop_row(robot, self.period),
            amplifier_row(robot),
            limits_row(gains, self.period),
        )
        self._usual = nominal_reconfiguration(np.ascontiguousarray(inverse / robot.wheel.radius))
        self.wheels = n
        self.log_names = _BODY_LOG + tuple(f"{name}_{i}" for name in _WHEEL_LOG for i in range(1, n + 1))

    def is_good(self, measurement: Measurement) -> bool:
        """Whether a measurement is complete and finite; any other is not acted upon."""
        m = measurement
        return bool(is_good(self.wheels, m.time, m.current, m.wheel_speed, m.acceleration, m.yaw_rate, m.yaw))

    def turning(self, measurement: Measurement, state: ControlState, trusts_gyro: bool = True) -> float:
        """How fast the robot turns by a good measurement: gyro less its bias, or by its wheels [rad/s]."""
        if trusts_gyro:
            return float(measurement.yaw_rate - state.rest[BIAS])
        return float(self._turn @ measurement.wheel_speed)

    def _loops(self, reconfiguration: Reconfiguration) -> Array:
        return self._holding_loops if reconfiguration.holds_heading else self._asked_loops

    def start(self, measurement: Measurement) -> ControlState:
        """The state before the first step: heading as measured, within ±π, no current, no bias known."""
        yaw = measurement.yaw
        heading = wrapped(yaw) if math.isfinite(yaw) else 0.0
        n = self.wheels
        return ControlState(
            heading, initial_gyro_bias(), np.zeros(n), np.zeros(n), np.zeros(len(self.log_names))
        )

    def step(
        self,
        state: ControlState,
        measurement: Measurement,
        target: Target,
        reconfiguration: Reconfiguration | None = None,
    ) -> tuple[CurrentCommand, ControlState]:
        """Currents for the next period. Bad data gives zero current, never an exception.

        Args:
          state: From the step before.
          measurement: The newest.
          target: What is asked for.
          advice: What a recovery changes; nothing when None.
        """
        reconfiguration = self._usual if reconfiguration is None else reconfiguration
        loops, laws = self._loops(reconfiguration), self._laws
        m, velocity, good = measurement, target.velocity, self.is_good(measurement)
        turns = m.yaw_rate
        if good and not reconfiguration.trusts_gyro:
            turns = self.turning(m, state, False) + state.rest[BIAS]
        heading, rest, integral, current, log = cascade_step(
            loops, *laws, reconfiguration.speed_per_twist, reconfiguration.current_scale,
            reconfiguration.offset, reconfiguration.lowest,
            reconfiguration.highest, state.heading, state.rest, state.integral, state.current, good,
            m.wheel_speed,
            turns, m.yaw, velocity[0], velocity[1], target.yaw_rate, target.heading,
        )  # fmt: skip
        return CurrentCommand(current, reconfiguration.brake), ControlState(
            heading, rest, integral, current, log
        )
