"""The last gate on current commands: independent of how they were computed, and says why it acted.

Nothing here knows targets or gains. A gate that must close does so at once: the rate limit never delays zero.
"""

from __future__ import annotations

import enum
import math

import numpy as np

from omnimj.parameters.robot import Control
from omnimj.physics.native import kernel


class Reason(enum.IntEnum):
    """Why a current differs from what was wanted; where several apply, the last one in this list."""

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


def limits_row(control: Control, period: float) -> np.ndarray:
    """[largest current [A], largest change per step [A], wheel-speed limit [rad/s]] for the kernels."""
    return np.array([control.current_limit, control.current_rate_limit * period, control.wheel_speed_limit])


@kernel
def limited_current(row, wanted, last, wheel_speed):
    """One wheel's current within range, rate and wheel speed [A], and the reason.

    Args:
      row: From `limits_row`.
      wanted: Current asked for, finite [A].
      last: Current commanded one step ago, within range [A].
      wheel_speed: Measured, finite [rad/s].
    """
    current, reason = wanted, 0
    if abs(current) > row[0]:
        current, reason = math.copysign(row[0], current), RANGE
    if abs(current - last) > row[1]:
        current, reason = last + math.copysign(row[1], current - last), RATE
    if abs(wheel_speed) > row[2] and current * wheel_speed > 0.0:
        current, reason = 0.0, OVERSPEED
    return current, reason


@kernel
def limit_all(row, wanted, last, wheel_speed, measurement_is_good, current, reason):
    """Fills `current` [A] and `reason`, shape (n,): limited, or all zero if anything is not finite.

    Args:
      row: From `limits_row`.
      wanted: Currents asked for, shape (n,) [A].
      last: Currents commanded one step ago, shape (n,) [A].
      wheel_speed: Measured, shape (n,) [rad/s]; not looked at when the measurement is bad.
      measurement_is_good: Whether all sensor values are there and finite.
      current: Output [A].
      reason: Output, numbers of `Reason`.
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
            current[i], reason[i] = limited_current(row, wanted[i], last[i], wheel_speed[i])
