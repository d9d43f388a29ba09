"""The cascade: heading → inverse kinematics → wheel-speed PI → limits. State goes in and comes out."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from omnimj.control.cascade.allocation import wheel_speed_target
from omnimj.control.cascade.creep import CreepParameters, creep_parameters, update_creep
from omnimj.control.cascade.heading import (
    GyroBias,
    YawRateGain,
    is_standing,
    to_body,
    update_gyro_bias,
    update_heading,
    wrapped,
    yaw_rate_by_wheels,
    yaw_rate_demand,
    yaw_rate_gain,
    yaw_rate_row,
)
from omnimj.control.cascade.limits import CurrentLimits, current_limits, limit_all
from omnimj.control.cascade.wheel_speed import SpeedGains, amplifier_parameters, speed_gains, speed_loop
from omnimj.control.records import Record, copied, packed, packed_like, plain_array
from omnimj.parameters import Floor, Robot
from omnimj.physics.kinematics import rolling_matrix
from omnimj.physics.motor import MotorParameters
from omnimj.physics.native import kernel
from omnimj.signals import Array, CurrentCommand, Diagnosis, Measurement, Target

_BODY_LOG = ("target_twist_x", "target_twist_y", "target_yaw_rate", "heading_estimate", "gyro_bias")
_WHEEL_LOG = ("target_wheel_speed", "limit_reason")


class Reconfiguration(NamedTuple):
    """Changes of the cascade by a recovery: φ̇_target = clip(B·twist/r + offset, lowest, highest)."""

    speed_per_twist: Array
    """Inverse kinematics B/r, shape (n, 3)."""
    current_scale: Array
    """Factor on every set current, the inverse of the remaining share of the torque constant; 0 gives the
    motor no command. Shape (n,)."""
    offset: Array
    """Added to the wheel-speed targets, shape (n,) [rad/s]."""
    lowest: Array
    """Lower bounds of the wheel-speed targets, shape (n,) [rad/s]."""
    highest: Array
    """Upper bounds of the wheel-speed targets, shape (n,) [rad/s]."""
    trusts_gyro: bool = True
    """False: the yaw rate is taken from the wheels, since the gyro is faulty."""
    holds_heading: bool = False
    """True if the heading is held even if the scenario does not ask for it."""


def nominal_reconfiguration(speed_per_twist: Array) -> Reconfiguration:
    """Inverse kinematics B/r, shape (n, 3), without any other change."""
    n = len(speed_per_twist)
    endless = np.full(n, np.inf)
    return Reconfiguration(speed_per_twist, np.ones(n), np.zeros(n), -endless, endless)


class CascadeParameters(NamedTuple):
    """Constants of a cascade."""

    yaw_rate: YawRateGain
    heading_gain: float
    """P gain of the heading hold [1/s]."""
    holds_heading: bool
    """True if the heading is held without a reconfiguration."""
    uses_heading: bool
    """True if world demands are rotated by the estimated heading; else by the planned one."""
    gyro_range: float
    """Largest reading of the gyro [rad/s]."""
    period: float
    """Control period [s]."""
    turn: Array
    """From `yaw_rate_row`, shape (n,)."""
    speed: SpeedGains
    amplifier: MotorParameters
    """From `amplifier_parameters`."""
    limits: CurrentLimits
    creep: CreepParameters


class CascadeInput(NamedTuple):
    """Measurement and target of one step."""

    good: bool
    """True if the measurement may be acted upon."""
    wheel_speed: Array
    """Measured, shape (n,) [rad/s]."""
    measured_yaw_rate: float
    """Gyro [rad/s]."""
    yaw: float
    """Heading converter [rad]."""
    velocity_x: float
    """World demand [m/s]."""
    velocity_y: float
    """World demand [m/s]."""
    yaw_rate: float
    """Demand [rad/s]."""
    heading: float
    """Planned heading [rad]."""


class CascadeState(NamedTuple):
    """Fields of the record behind `ControlState`, n wheels."""

    heading: float
    """Estimate, unwrapped [rad]."""
    gyro_bias: GyroBias
    slow_yaw_error: float
    """Slow part of the yaw-rate error [rad/s]."""
    integral: Array
    """Integrals q of the wheel-speed loops, shape (n,) [A]."""
    current: Array
    """Last command, shape (n,) [A]."""
    creep: Array
    """r φ̇ beyond rolling by the feed-forward of creep, shape (n,) [m/s]."""
    log: Array
    """Signals of the last step by `Controller.log_names`, shape (len(log_names),)."""


class ControlState:
    """State of the cascade between two steps.

    Args:
      record: Packed state, for `cascade_step`.
    """

    __slots__ = ("record",)

    def __init__(self, record: Record):
        self.record = record

    @property
    def heading(self) -> float:
        """Estimate, unwrapped [rad]."""
        return float(self.record["heading"][0])

    @property
    def gyro_bias(self) -> GyroBias:
        """Estimate of the gyro's bias."""
        return GyroBias(*self.record["gyro_bias"].item())

    @property
    def integral(self) -> Array:
        """Integrals q of the wheel-speed loops, shape (n,) [A]."""
        return self.record["integral"][0]

    @property
    def current(self) -> Array:
        """Last command, shape (n,) [A]."""
        return self.record["current"][0]

    @property
    def log(self) -> Array:
        """Signals of the last step by `Controller.log_names`, shape (len(log_names),)."""
        return self.record["log"][0]

    @property
    def diagnoses(self) -> tuple[Diagnosis, ...]:
        """Always empty: the cascade alone diagnoses nothing."""
        return ()

    @property
    def time_scaling(self) -> float:
        """Always 1: the cascade alone follows the plan at its own speed."""
        return 1.0


@kernel
def _all_finite(values):
    for value in values:  # noqa: SIM110 a loop is what compiles well
        if not math.isfinite(value):
            return False
    return True


@kernel
def is_good_sample(wheels, time, current, wheel_speed, acceleration, yaw_rate, yaw):
    """`is_good` for the fields of a `Measurement`."""
    complete = current.size == wheels and wheel_speed.size == wheels and acceleration.size == 2
    scalars = math.isfinite(time) and math.isfinite(yaw_rate) and math.isfinite(yaw)
    return (
        complete
        and scalars
        and _all_finite(current)
        and _all_finite(wheel_speed)
        and _all_finite(acceleration)
    )


def is_good(measurement: Measurement, wheels: int) -> bool:
    """True if a measurement of a robot with that many wheels is complete and finite.

    Any other measurement must not be acted upon. A controller asks once per measurement and gives only good
    ones to its detector and its recovery.
    """
    m = measurement
    arrays = plain_array(m.current), plain_array(m.wheel_speed), plain_array(m.acceleration)
    return bool(is_good_sample(wheels, float(m.time), *arrays, float(m.yaw_rate), float(m.yaw)))


@kernel
def advance_cascade(p, changed, state, now):
    """One step of the whole cascade, in place.

    A measurement that is not good sets the command to zero, empties the integrals and ends the rest; heading
    and gyro bias stay as they are.

    Args:
      p: `CascadeParameters`.
      changed: `Reconfiguration`.
      state: `CascadeState`, changed in place.
      now: `CascadeInput`.
    """
    last, wheel_speed, good = state.current.copy(), now.wheel_speed, now.good
    n, measured_yaw_rate = p.turn.size, now.measured_yaw_rate
    log, currents, integral, wanted = state.log, state.current, state.integral, np.empty(n)
    targets, reasons = log[5 : 5 + n], log[5 + n :]
    heading_gain = p.heading_gain if p.holds_heading or changed.holds_heading else 0.0

    bias = state.gyro_bias
    if good and not changed.trusts_gyro:
        measured_yaw_rate = yaw_rate_by_wheels(p.turn, wheel_speed) + bias.bias
    heading, yaw_rate = state.heading, measured_yaw_rate - bias.bias
    if good:
        heading = update_heading(heading, now.yaw, yaw_rate, p.gyro_range, p.period)
    error = wrapped(now.heading - heading) if heading_gain > 0.0 else 0.0
    standing = is_standing(now.velocity_x, now.velocity_y, now.yaw_rate, error, yaw_rate, wheel_speed)
    bias.bias, bias.still, bias.turned, bias.averaged = update_gyro_bias(
        GyroBias(bias.bias, bias.still, bias.turned, bias.averaged),
        p.turn,
        good and standing,
        measured_yaw_rate,
        wheel_speed,
        p.period,
    )
    x = y = turn = slow_error = 0.0
    if not standing:
        x, y = to_body(now.velocity_x, now.velocity_y, heading if p.uses_heading else now.heading)
        held = now.yaw_rate + heading_gain * error
        turn, slow_error = yaw_rate_demand(held, yaw_rate, state.slow_yaw_error, p.yaw_rate)
    added = np.zeros(n)
    if p.creep.feeds:
        planned = np.array((x, y, 0.0 if standing else now.yaw_rate))
        update_creep(p.creep, changed.speed_per_twist, planned, state.creep, added)
    for i in range(n):
        speed = wheel_speed_target(changed.speed_per_twist, i, x, y, turn) + changed.offset[i] + added[i]
        targets[i] = min(max(speed, changed.lowest[i]), changed.highest[i])
        wanted[i] = 0.0
        if good:
            wanted[i], integral[i] = speed_loop(
                p.speed, p.amplifier, targets[i], wheel_speed[i], integral[i], changed.current_scale[i]
            )
    limit_all(p.limits, wanted, last, wheel_speed, good, currents, reasons)
    if not (good and _all_finite(wanted)):
        integral[:] = 0.0
    else:
        state.slow_yaw_error = min(max(slow_error, -p.gyro_range), p.gyro_range)
    state.heading = heading
    log[0], log[1], log[2], log[3], log[4] = x, y, turn, heading, bias.bias


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
      period: Control period [s]; that of the robot's sensors when None.
      creep_floor: Floor whose creep is fed forward, as the controller assumes it; no feed-forward when None.

    Raises:
      InputError: Effects of the model file that do not suit the floor.
    """

    def __init__(
        self,
        robot: Robot,
        yaw_loop: bool = True,
        heading_hold: bool = False,
        heading_feedback: bool = True,
        period: float | None = None,
        creep_floor: Floor | None = None,
    ):
        self.period = 1.0 / robot.sensors.sample_rate if period is None else period
        gains, n = robot.control, len(robot.wheels)
        inverse = rolling_matrix(robot.wheel_positions, robot.rolling_directions)
        loop = yaw_rate_gain(gains, self.period)
        parameters = CascadeParameters(
            yaw_rate=loop if yaw_loop else loop._replace(slow=0.0),
            heading_gain=gains.heading_proportional,
            holds_heading=heading_hold,
            uses_heading=heading_feedback,
            gyro_range=robot.sensors.gyro_range,
            period=self.period,
            turn=yaw_rate_row(robot),
            speed=speed_gains(robot, self.period),
            amplifier=amplifier_parameters(robot),
            limits=current_limits(gains, self.period),
            creep=creep_parameters(robot, creep_floor),
        )
        self.robot, self.constants = robot, parameters
        self.nominal = nominal_reconfiguration(inverse / robot.wheel.radius)
        self._turn, self._parameters, self._nominal = (
            parameters.turn,
            packed(parameters),
            packed(self.nominal),
        )
        self.wheels = n
        self.log_names = _BODY_LOG + tuple(f"{name}_{i}" for name in _WHEEL_LOG for i in range(1, n + 1))

    def yaw_rate(self, measurement: Measurement, state: ControlState, trusts_gyro: bool = True) -> float:
        """Yaw rate by a good measurement: gyro less its bias, or by the wheels [rad/s]."""
        if trusts_gyro:
            return float(measurement.yaw_rate - state.gyro_bias.bias)
        return float(yaw_rate_by_wheels(self._turn, plain_array(measurement.wheel_speed)))

    def initial_fields(self, measurement: Measurement) -> CascadeState:
        """Fields before the first step: heading as measured, within ±π, no current, gyro bias unknown."""
        yaw, n = measurement.yaw, self.wheels
        heading = wrapped(yaw) if math.isfinite(yaw) else 0.0
        log = np.zeros(len(self.log_names))
        return CascadeState(heading, GyroBias(), 0.0, np.zeros(n), np.zeros(n), np.zeros(n), log)

    def start(self, measurement: Measurement) -> ControlState:
        """State before the first step."""
        return ControlState(packed(self.initial_fields(measurement)))

    def step(
        self,
        state: ControlState,
        measurement: Measurement,
        target: Target,
        reconfiguration: Reconfiguration | None = None,
        good: bool | None = None,
    ) -> tuple[CurrentCommand, ControlState]:
        """Currents for the next period; zero current for bad data, never an exception.

        Args:
          state: From the step before.
          measurement: The newest.
          target: Demanded motion.
          reconfiguration: Changes by a recovery; none when None.
          good: Result of `is_good` where the caller has asked already.
        """
        m, changed = measurement, self._nominal
        good = is_good(m, self.wheels) if good is None else good
        if reconfiguration is not None:
            changed = packed_like(changed, reconfiguration)
        wheel_speed, yaw_rate, yaw = plain_array(m.wheel_speed), float(m.yaw_rate), float(m.yaw)
        velocity_x, velocity_y = map(float, target.velocity)
        demand = velocity_x, velocity_y, float(target.yaw_rate), float(target.heading)
        now = CascadeInput(good, wheel_speed, yaw_rate, yaw, *demand)
        after = ControlState(copied(state.record))
        _step(self._parameters, changed, after.record, now)
        return CurrentCommand(after.current), after


@kernel
def _step(parameters, reconfiguration, state, now):
    advance_cascade(parameters[0], reconfiguration[0], state[0], now)
