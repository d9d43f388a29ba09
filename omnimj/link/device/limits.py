"""Limits that the device enforces, as pure functions of plain numbers that can be ported to C.

Nothing is clamped: a frame is accepted unchanged or refused, and the refusal names limit, wheel and value.
**A value equal to its limit passes.** Currents, valid_for and all seven limits travel as float32, which a
double represents exactly: the device rounds its own limits to float32 first (`round_to_float32`), so that a
command of 1.6 A equals a limit of 1.6 A. Products with times (rate, heating, age) are in double precision.
"""

from __future__ import annotations

import dataclasses
import math
import struct
from dataclasses import dataclass

from omnimj.errors import InputError
from omnimj.link.codec.messages import Arm, Command, FaultCode, Limits

BURST_DURATION = 0.05
"""Frames that may arrive at once, since links bunch them: the message rate over this time [s]."""

CURRENT_TOLERANCE, CURRENT_SETTLING = 1.0 / 3.0, 0.5
"""Allowed deviation of a measured current from its set value, as a share of the limit `current`, and time for
which a larger one is allowed [s]: a current loop settles in milliseconds."""

MAX_TELEMETRY_AGE = 0.020
"""Oldest telemetry that a host may refer to when it arms the device [s]."""


@dataclass(frozen=True, slots=True)
class Refusal:
    """Violation of a limit."""

    code: FaultCode
    wheel: int
    """Wheel 1…n; 0 if no wheel is concerned."""
    value: float
    """Offending value."""
    limit: float
    """Limit that it violates."""


@dataclass(frozen=True, slots=True)
class AmplifierState:
    """Currents and motor heating of the amplifiers of n wheels up to now."""

    currents: tuple[float, ...]
    """Set values of the amplifiers since the last tick, shape (n,) [A]."""
    since: float
    """Time of arrival of the command with these currents [s]."""
    heat: tuple[float, ...]
    """I²t of each motor, shape (n,) [A²s]."""


def round_to_float32(limits: Limits) -> Limits:
    """Limits rounded to the float32 numbers that travel on the wire.

    Raises:
      InputError: A limit is not a finite number above zero in float32.
    """
    rounded = []
    for field in dataclasses.fields(limits):
        given = getattr(limits, field.name)
        try:
            (value,) = struct.unpack("<f", struct.pack("<f", given))
        except OverflowError:
            value = math.inf
        if not 0.0 < value < math.inf:
            raise InputError(f"limits.{field.name}", f"found {given!r}", "must be finite and above 0")
        rounded.append(value)
    return Limits(*rounded)


def check_command(
    limits: Limits, period: float, before: AmplifierState, command: Command, now: float
) -> Refusal | None:
    """First limit that a command violates, or None.

    The order is brake and current, finite, valid_for, current, rate, heating.

    Args:
      limits: Limits in float32.
      period: Time between two ticks [s].
      before: Currents and heating up to now.
      command: New command with as many currents as `before`.
      now: Time of its arrival [s].
    """
    for wheel, current in enumerate(command.currents, start=1):
        if current != 0.0 and command.brake >> (wheel - 1) & 1:
            return Refusal(FaultCode.BRAKE_AND_CURRENT, wheel, current, 0.0)
    for wheel, current in enumerate(command.currents, start=1):
        if not math.isfinite(current):
            return Refusal(FaultCode.NOT_FINITE, wheel, current, limits.current)
    if not math.isfinite(command.valid_for):
        return Refusal(FaultCode.NOT_FINITE, 0, command.valid_for, limits.valid_for)
    if command.valid_for <= 0.0 or command.valid_for > limits.valid_for:
        return Refusal(FaultCode.VALID_FOR, 0, command.valid_for, limits.valid_for)
    for wheel, current in enumerate(command.currents, start=1):
        if abs(current) > limits.current:
            return Refusal(FaultCode.CURRENT, wheel, current, limits.current)
    return _check_current_rate(limits, period, before, command, now) or check_heating(
        limits, period, before.heat, command.currents
    )


def _check_current_rate(
    limits: Limits, period: float, before: AmplifierState, command: Command, now: float
) -> Refusal | None:
    """Require |i − i_before| ≤ rate · (t − t_before), with at least one period for t − t_before.

    Links bunch frames: several commands between two ticks are all compared with the applied one. A current
    of zero always passes.
    """
    allowed = limits.current_rate * max(now - before.since, period)
    for wheel, (current, flows) in enumerate(zip(command.currents, before.currents, strict=True), start=1):
        change = abs(current - flows)
        if current != 0.0 and change > allowed:
            return Refusal(FaultCode.CURRENT_RATE, wheel, change, allowed)
    return None


def heat_after(limits: Limits, heat: float, current: float, elapsed: float) -> float:
    """I²t after a current has flowed: max(0, heat + (i² − i_continuous²) t) [A²s].

    Args:
      limits: Limits in float32.
      heat: I²t before [A²s].
      current: Constant current [A].
      elapsed: Duration [s].
    """
    return max(0.0, heat + (current * current - limits.continuous_current**2) * elapsed)


def check_heating(
    limits: Limits, period: float, heat: tuple[float, ...], currents: tuple[float, ...]
) -> Refusal | None:
    """Refusal if one more period of these currents would heat a motor beyond its limit.

    A current up to the continuous one always passes.

    Args:
      limits: Limits in float32.
      period: Time between two ticks [s].
      heat: I²t of each motor, shape (n,) [A²s].
      currents: Set values, shape (n,) [A].
    """
    for wheel, (now, current) in enumerate(zip(heat, currents, strict=True), start=1):
        then = heat_after(limits, now, current, period)
        if then > limits.heating and abs(current) > limits.continuous_current:
            return Refusal(FaultCode.HEATING, wheel, then, limits.heating)
    return None


def check_wheel_speeds(limits: Limits, speeds: tuple[float, ...]) -> Refusal | None:
    """Refusal if a wheel speed after the gear, shape (n,) [rad/s], exceeds its limit or is not finite."""
    for wheel, speed in enumerate(speeds, start=1):
        if not math.isfinite(speed):
            return Refusal(FaultCode.SENSOR, wheel, speed, limits.wheel_speed)
        if abs(speed) > limits.wheel_speed:
            return Refusal(FaultCode.WHEEL_SPEED, wheel, speed, limits.wheel_speed)
    return None


def check_freshness(limits: Limits, command: Command, age: float) -> Refusal | None:
    """Refusal if a command answers a telemetry that was sent longer ago than its valid_for.

    Args:
      limits: Limits in float32; their valid_for replaces one that is not allowed, which another rule refuses.
      command: New command.
      age: Age of the telemetry that it answers, infinite if unknown [s].
    """
    is_allowed = 0.0 < command.valid_for <= limits.valid_for
    allowed = command.valid_for if is_allowed else limits.valid_for
    return Refusal(FaultCode.STALE, 0, age, allowed) if age > allowed else None


def deviates(limits: Limits, current: float, measured: float) -> bool:
    """True if a measured current [A] is not that of its set value [A]; one that is not finite never is."""
    return not abs(measured - current) <= CURRENT_TOLERANCE * limits.current


def check_deviation(since: tuple[float, ...], now: float) -> Refusal | None:
    """Refusal if a measured current has deviated from its set value for longer than it may.

    Args:
      since: Times since which the currents deviate, infinite for those that do not, shape (n,) [s].
      now: Time [s].
    """
    for wheel, begin in enumerate(since, start=1):
        if now - begin > CURRENT_SETTLING:
            return Refusal(FaultCode.CURRENT_DEVIATION, wheel, now - begin, CURRENT_SETTLING)
    return None


def check_command_age(age: float, valid_for: float) -> Refusal | None:
    """Refusal if a command is older than its valid_for [s]."""
    return Refusal(FaultCode.COMMAND_TOO_OLD, 0, age, valid_for) if age > valid_for else None


def max_credit(limits: Limits) -> float:
    """Capacity of the token bucket: frames within `BURST_DURATION`, at least one."""
    return max(1.0, BURST_DURATION * limits.message_rate)


def credit_after(limits: Limits, credit: float, elapsed: float) -> float:
    """Tokens in the bucket after `elapsed` seconds without a frame; each frame needs one."""
    return min(max_credit(limits), credit + limits.message_rate * max(0.0, elapsed))


def is_zero_command(command: Command) -> bool:
    """True if a command has neither a current nor a brake."""
    return command.brake == 0 and all(current == 0.0 for current in command.currents)


def check_arming(
    arm: Arm,
    same_schema: bool,
    fault: FaultCode,
    stopped: bool,
    hashes: tuple[int, int],
    command: Command,
    age: float,
    telemetry_age: float,
) -> Refusal | None:
    """First reason to refuse arming, in the order of the arguments, or None.

    Args:
      arm: Request of the host.
      same_schema: Whether the host lays out every payload as the device does.
      fault: Latched fault.
      stopped: Whether a stop is latched.
      hashes: The device's own hashes of limits and calibration.
      command: Newest command.
      age: Age of that command, as its lifetime counts [s].
      telemetry_age: Age of the telemetry that the host refers to [s].
    """
    if not same_schema:
        return Refusal(FaultCode.ARM_SCHEMA, 0, 0.0, 0.0)
    if fault is not FaultCode.NONE:
        return Refusal(FaultCode.ARM_FAULTY, 0, float(fault), 0.0)
    if stopped:
        return Refusal(FaultCode.ARM_STOPPED, 0, 0.0, 0.0)
    if arm.limits_hash != hashes[0]:
        return Refusal(FaultCode.ARM_LIMITS, 0, 0.0, 0.0)
    if arm.calibration_hash != hashes[1]:
        return Refusal(FaultCode.ARM_CALIBRATION, 0, 0.0, 0.0)
    if not is_zero_command(command) or check_command_age(age, command.valid_for):
        return Refusal(FaultCode.ARM_NOT_ZERO, 0, age, command.valid_for)
    if telemetry_age > MAX_TELEMETRY_AGE:
        return Refusal(FaultCode.ARM_STALE_TELEMETRY, 0, telemetry_age, MAX_TELEMETRY_AGE)
    return None


class RateLimiter:
    """Token bucket that limits the frames of one sender."""

    def __init__(self, limits: Limits, now: float):
        """Start with a full bucket at the device's time `now` [s]."""
        self._limits, self._time = limits, now
        self.credit = max_credit(limits)

    def allows(self, now: float) -> bool:
        """True if a frame at time `now` [s] is within the rate; if so, it takes a token."""
        self.credit = credit_after(self._limits, self.credit, now - self._time)
        self._time = max(self._time, now)
        if self.credit < 1.0:
            return False
        self.credit -= 1.0
        return True
