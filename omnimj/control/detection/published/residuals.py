"""Filters of the residuals on robot and rig: stiction at rest, low-pass, RMS since the start."""

from __future__ import annotations

import math

import numpy as np

from omnimj.control.cascade.heading import REST_WHEEL_SPEED
from omnimj.parameters.parts import Sensors
from omnimj.physics.native import kernel

RESIDUAL_LAG = 0.015
"""Time constant of the filter on force residuals [s]: wheel accelerations are differences of a noisy speed.
The text has none, and says nothing of how it differentiates."""

LONGEST_GAP, SHORTEST_GAP = 0.1, 1e-6
"""Longest gap between two measurements that the observer bridges, shortest that rates are taken over [s]."""


def matching_lags(sensors: Sensors) -> np.ndarray:
    """Lags that make currents and accelerations as late as the wheel speeds are, shape (2,) [s].

    The amplifiers filter their speeds; a wheel that spins up takes most of its torque itself, so that a
    current that leads its acceleration produces a spurious force.
    """
    accelerometer = 1.0 / (2.0 * math.pi * sensors.accelerometer_bandwidth)
    return np.array([sensors.speed_filter, max(sensors.speed_filter - accelerometer, 0.0)])


@kernel
def interval_at_speed(low, high, wheel_speed):
    """Interval of a set-valued quantity such as friction at a wheel speed.

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
def outside_interval(value, low, high):
    """Signed distance of a value from an interval: 0 inside."""
    return max(value - high, 0.0) + min(value - low, 0.0)


@kernel
def low_pass(before, now, time, lag):
    """First-order lag after `time` seconds of a constant input, from `before` to `now`; a lag of 0: none."""
    return now + (before - now) * math.exp(-time / lag) if lag > 0.0 else now


@kernel
def root_mean_square(squares, span):
    """‖r‖_RMS since the start, from ∫ r² dt and the time since then, Eqs. 5.2, 5.7 and 5.20."""
    return math.sqrt(squares / span) if span > 0.0 else 0.0


def bounded_time_step(before: float, now: float) -> float:
    """Time between two samples, at most `LONGEST_GAP` [s]; 0 where it is too short to divide by."""
    passed = min(now - before, LONGEST_GAP)
    return passed if passed >= SHORTEST_GAP else 0.0
