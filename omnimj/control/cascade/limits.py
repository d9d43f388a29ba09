"""The last gate on current commands: independent of how they were computed, with a reason for every change.

Nothing here knows targets or gains. A gate that must close does so at once: the rate limit never delays zero.
"""

from __future__ import annotations

import enum
import math
from typing import NamedTuple

from omnimj.parameters.robot import Control
from omnimj.physics.native import kernel


class Reason(enum.IntEnum):
    """Cause of the difference between limited and wanted current; of several, the last one listed."""

    NONE = 0
    """Passed unchanged."""
    RANGE = 1
    """Beyond the largest current."""
    RATE = 2
    """Changed faster than allowed."""
    OVERSPEED = 3
    """Would have driven a wheel that is beyond its speed limit."""
    COMMAND_NOT_FINITE = 4
    """The command of this or another wheel was NaN or infinite."""
    BAD_MEASUREMENT = 5
    """A sensor value was NaN or infinite, or one was missing."""


RANGE, RATE, OVERSPEED = int(Reason.RANGE), int(Reason.RATE), int(Reason.OVERSPEED)
COMMAND_NOT_FINITE, BAD_MEASUREMENT = int(Reason.COMMAND_NOT_FINITE), int(Reason.BAD_MEASUREMENT)


class CurrentLimits(NamedTuple):
    """Bounds of the gate, the same for every wheel."""

    current: float
    """Largest current [A]."""
    change: float
    """Largest change per step [A]."""
    wheel_speed: float
    """Wheel speed beyond which a current may only brake [rad/s]."""


def current_limits(control: Control, period: float) -> CurrentLimits:
    """Bounds at a control period [s]."""
    return CurrentLimits(
        control.current_limit, control.current_rate_limit * period, control.wheel_speed_limit
    )


@kernel
def limited_current(limits, wanted, last, wheel_speed):
    """One wheel's current within range, rate and wheel speed [A], and the reason.

    Args:
      limits: `CurrentLimits`.
      wanted: Wanted current, finite [A].
      last: Current commanded one step ago, within range [A].
      wheel_speed: Measured, finite [rad/s].
    """
    current, reason = wanted, 0
    if abs(current) > limits.current:
        current, reason = math.copysign(limits.current, current), RANGE
    if abs(current - last) > limits.change:
        current, reason = last + math.copysign(limits.change, current - last), RATE
    if abs(wheel_speed) > limits.wheel_speed and current * wheel_speed > 0.0:
        current, reason = 0.0, OVERSPEED
    return current, reason


@kernel
def limit_all(limits, wanted, last, wheel_speed, measurement_is_good, current, reason):
    """Fill `current` [A] and `reason`, shape (n,): limited, or all zero if anything is not finite.

    Args:
      limits: `CurrentLimits`.
      wanted: Wanted currents, shape (n,) [A].
      last: Currents commanded one step ago, shape (n,) [A].
      wheel_speed: Measured, shape (n,) [rad/s]; ignored when the measurement is bad.
      measurement_is_good: Whether all sensor values are there and finite.
      current: Output, shape (n,) [A].
      reason: Output, shape (n,), numbers of `Reason`.
    """
    closed = 0 if measurement_is_good else BAD_MEASUREMENT
    if closed == 0:
        for i in range(wanted.size):
            if not math.isfinite(wanted[i]):
                closed = COMMAND_NOT_FINITE
    for i in range(wanted.size):
        if closed:
            current[i], reason[i] = 0.0, closed
        else:
            current[i], reason[i] = limited_current(limits, wanted[i], last[i], wheel_speed[i])
