"""What both machines share: a wheel's force from its joint, what rest leaves open, RMS since the start."""

from __future__ import annotations

import math

from omnimj.control.standstill import REST_WHEEL_SPEED
from omnimj.physics.native import kernel

RESIDUAL_LAG = 0.015
"""Time constant of the filter on force residuals [s]: wheel accelerations are differences of a noisy speed.
The text has none, and says nothing of how it differentiates."""

LONGEST_GAP = 0.1
"""The observer bridges no longer gap between two measurements [s]."""


@kernel
def moving_or_resting(low, high, wheel_speed):
    """A set-valued quantity once the direction is known, as the interval that it may lie in.

    `low` belongs to turning forward and `high` to turning backward; at rest it may be anything between.

    Args:
      low: At forward speed.
      high: At backward speed; not below `low`.
      wheel_speed: φ̇ [rad/s].
    """
    if wheel_speed > REST_WHEEL_SPEED:
        return low, low
    if wheel_speed < -REST_WHEEL_SPEED:
        return high, high
    return low, high


@kernel
def beyond(value, low, high):
    """How far a value lies outside an interval: 0 inside, else with its sign."""
    return max(value - high, 0.0) + min(value - low, 0.0)


@kernel
def lagged(before, now, time):
    """First-order lag of `RESIDUAL_LAG` after `time` seconds of a constant input, from `before` to `now`."""
    return now + (before - now) * math.exp(-time / RESIDUAL_LAG)


@kernel
def root_mean_square(squares, span):
    """‖r‖_RMS since the start, from ∫ r² dt and the time since then, Eqs. 5.2, 5.7 and 5.20."""
    return math.sqrt(squares / span) if span > 0.0 else 0.0
