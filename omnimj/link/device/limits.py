"""The last gate on the device: what it refuses, as pure functions of plain numbers, to be ported to C.

Nothing is clamped: a frame passes as it came or it is refused, and the refusal says which limit, which wheel,
which value. **What is equal to its limit passes.** Currents, valid-for and all seven limits travel as
float32, which a double holds exactly: the device rounds its own limits to float32 first
(`round_to_float32`), so that
1.6 A asked for equals a limit of 1.6 A. Products with times (rate, heating, age) are in double precision.
"""

from __future__ import annotations

import dataclasses
import math
import struct
from dataclasses import dataclass

from omnimj.errors import InputError
from omnimj.link.codec.messages import Arm, Command, FaultCode, Limits

BURST_DURATION = 0.05
"""So many seconds' worth of frames may come at once, since links bunch them."""


MAX_TELEMETRY_AGE = 0.020
"""Oldest telemetry that a host may arm by [s]."""


@dataclass(frozen=True, slots=True)
class Refusal:
    """Which limit was broken, by what."""

    code: FaultCode
    wheel: int
    """1…n; 0 where it is of no wheel."""
    value: float
    """What was found."""
    limit: float
    """What is allowed."""


@dataclass(frozen=True, slots=True)
class AmplifierState:
    """What the device did until now; n wheels."""

    currents: tuple[float, ...]
    """That the amplifiers carry since the last tick [A]."""
    since: float
    """When the command with these currents came [s]."""
    heat: tuple[float, ...]
    """I²t of each motor [A²s]."""


def round_to_float32(limits: Limits) -> Limits:
    """The limits as they are after their way through float32.

    Raises:
      InputError: One is not a number above zero there.
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
    """Why a command may not be carried out; None: it may.

    The first limit that is broken, in the order: finite, valid-for, current, rate, heating.

    Args:
      limits: As sent.
      period: Between two ticks [s].
      before: Up to now.
      command: With as many currents as `before` has.
      now: When it came [s].
    """
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
    """|i − i_before| ≤ rate · (t − t_before), with at least one period between, since links bunch frames.

    Several commands between two ticks are all held against the one that flows. Zero is never too quick.
    """
    allowed = limits.current_rate * max(now - before.since, period)
    for wheel, (current, flows) in enumerate(zip(command.currents, before.currents, strict=True), start=1):
        change = abs(current - flows)
        if current != 0.0 and change > allowed:
            return Refusal(FaultCode.CURRENT_RATE, wheel, change, allowed)
    return None


def heat_after(limits: Limits, heat: float, current: float, elapsed: float) -> float:
    """I²t after a current has flowed: max(0, heat + (i² − i_continuous²) t) [A²s]."""
    return max(0.0, heat + (current * current - limits.continuous_current**2) * elapsed)


def check_heating(
    limits: Limits, period: float, heat: tuple[float, ...], currents: tuple[float, ...]
) -> Refusal | None:
    """Whether one more period of these currents would heat a motor beyond its limit.

    A current that its motor may carry for ever is never refused.
    """
    for wheel, (now, current) in enumerate(zip(heat, currents, strict=True), start=1):
        then = heat_after(limits, now, current, period)
        if then > limits.heating and abs(current) > limits.continuous_current:
            return Refusal(FaultCode.HEATING, wheel, then, limits.heating)
    return None


def check_wheel_speeds(limits: Limits, speeds: tuple[float, ...]) -> Refusal | None:
    """Whether a wheel turns faster than it may, or nobody knows; after the gear, shape (n,) [rad/s]."""
    for wheel, speed in enumerate(speeds, start=1):
        if not math.isfinite(speed):
            return Refusal(FaultCode.SENSOR, wheel, speed, limits.wheel_speed)
        if abs(speed) > limits.wheel_speed:
            return Refusal(FaultCode.WHEEL_SPEED, wheel, speed, limits.wheel_speed)
    return None


def check_command_age(age: float, valid_for: float) -> Refusal | None:
    """Whether a command has outlived its valid-for [s]."""
    return Refusal(FaultCode.COMMAND_TOO_OLD, 0, age, valid_for) if age > valid_for else None


def max_credit(limits: Limits) -> float:
    """Frames that may come at once: `BURST_DURATION` seconds' worth, one at least."""
    return max(1.0, BURST_DURATION * limits.message_rate)


def credit_after(limits: Limits, credit: float, elapsed: float) -> float:
    """Frames that may come now, if `credit` could come so many seconds ago and none has since.

    A frame is let through where this is 1 or more, and uses up 1.
    """
    return min(max_credit(limits), credit + limits.message_rate * max(0.0, elapsed))


def is_zero_command(command: Command) -> bool:
    """Whether it asks for nothing: no current, no brake."""
    return command.brake == 0 and all(current == 0.0 for current in command.currents)


def check_arming(
    arm: Arm,
    same_schema: bool,
    fault: FaultCode,
    hashes: tuple[int, int],
    command: Command,
    age: float,
    telemetry_age: float,
) -> Refusal | None:
    """Why the device may not be armed; None: it may. The first reason, in the order of the arguments.

    Args:
      arm: What the host says.
      same_schema: Whether it lays out every payload as the device does.
      fault: That is latched.
      hashes: The device's own, of limits and calibration.
      command: The last one.
      age: Of the command [s].
      telemetry_age: Of the telemetry that the host names [s].
    """
    if not same_schema:
        return Refusal(FaultCode.ARM_SCHEMA, 0, 0.0, 0.0)
    if fault is not FaultCode.NONE:
        return Refusal(FaultCode.ARM_FAULTY, 0, float(fault), 0.0)
    if arm.limits_hash != hashes[0]:
        return Refusal(FaultCode.ARM_LIMITS, 0, 0.0, 0.0)
    if arm.calibration_hash != hashes[1]:
        return Refusal(FaultCode.ARM_CALIBRATION, 0, 0.0, 0.0)
    if not is_zero_command(command) or check_command_age(age, command.valid_for):
        return Refusal(FaultCode.ARM_NOT_ZERO, 0, age, command.valid_for)
    if telemetry_age > MAX_TELEMETRY_AGE:
        return Refusal(FaultCode.ARM_STALE_TELEMETRY, 0, telemetry_age, MAX_TELEMETRY_AGE)
    return None


# How many frames a device answers: as many as its message rate allows, a burst at once.


class RateLimiter:
    """Credit of one sender, in frames."""

    def __init__(self, limits: Limits, now: float):
        """Full at first; `now` is the device's clock [s]."""
        self._limits, self._at = limits, now
        self.credit = max_credit(limits)

    def spend(self, now: float) -> bool:
        """Whether one more frame may be answered now; if so, it is paid for."""
        self.credit = credit_after(self._limits, self.credit, now - self._at)
        self._at = max(self._at, now)
        if self.credit < 1.0:
            return False
        self.credit -= 1.0
        return True
