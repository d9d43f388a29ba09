"""Small motions of any plant for the wiring check: one motor after the other, then turns on the spot.

The current rises slowly until the wheel turns, which is gentle both in the air and on the floor, and then
returns to zero at once.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from omnimj.plant.interface import Plant
from omnimj.signals import Array, CurrentCommand, Measurement

CURRENT_RATE = 1.0
"""Rate of the current [A/s]."""
WHEEL_SPEED_REACHED, YAW_RATE_REACHED = 2.0, 0.5
"""Wheel speed [rad/s] and yaw rate [rad/s] at which a motion is large enough."""
HOLD_TIME = 0.08
"""Time for which the motion then continues [s]."""
COAST_TIME, REST_TIME = 0.3, 0.4
"""Recorded time without current after a turn, and pause between two motions [s]."""


@dataclass(frozen=True)
class Motion:
    """Recording of one motion, k samples of a robot with n wheels."""

    wheel: int
    """Driven wheel 0…n−1; −1: all wheels."""
    commanded: Array
    """Commanded current of the driven wheels, shape (k,) [A]."""
    current: Array
    """Measured currents, shape (k, n) [A]."""
    wheel_speed: Array
    """Measured wheel speeds, shape (k, n) [rad/s]."""
    acceleration: Array
    """Measured acceleration, shape (k, 2) [m/s²]."""
    yaw_rate: Array
    """Measured yaw rate, shape (k,) [rad/s]."""
    yaw: Array
    """Measured heading, unwrapped, shape (k,) [rad]."""
    driven: int
    """Number of samples with current; the robot coasts afterwards."""
    period: float
    """Time between two samples [s]."""


class MotionSequence:
    """Sequence of small motions of a robot, whose measurements are recorded."""

    def __init__(self, plant: Plant, max_current: float, report: Callable[[str], None] = lambda phrase: None):
        """Prepare the motions.

        Args:
          plant: Robot, which `rest` resets.
          max_current: Largest current [A].
          report: Called with a description before each motion.
        """
        self._plant, self._max_current, self._report = plant, max_current, report
        self._wheels = 0

    def rest(self, time: float) -> Motion:
        """Reset the plant and record it at rest for this time [s]."""
        self._report("at rest")
        first = self._plant.reset()
        assert isinstance(first, Measurement)
        self._wheels = len(first.current)
        return self._record(-1, 0.0, time)

    def one(self, wheel: int, sign: float) -> Motion:
        """Drive one motor, forwards (sign 1) or backwards (−1)."""
        self._report(f"motor {wheel + 1} {'forwards' if sign > 0.0 else 'backwards'}")
        return self._record(wheel, sign, REST_TIME)

    def turn(self, sign: float) -> Motion:
        """Drive all motors alike, so that the robot turns on the spot, and let it coast."""
        self._report("a turn on the spot")
        return self._record(-1, sign, COAST_TIME + REST_TIME)

    def _record(self, wheel: int, sign: float, coasting: float) -> Motion:
        period = self._plant.period
        driven_wheels = np.arange(self._wheels) == wheel if wheel >= 0 else np.ones(self._wheels, bool)
        fast = WHEEL_SPEED_REACHED if wheel >= 0 else 2 * WHEEL_SPEED_REACHED
        commanded, measurements, moving, driven = [], [], 0, 0
        ramp = math.ceil(self._max_current / CURRENT_RATE / period) if sign else 0
        for k in range(ramp + math.ceil(coasting / period)):
            flows = k < ramp and moving * period < HOLD_TIME
            current = sign * CURRENT_RATE * (k + 1) * period if flows else 0.0
            driven = k + 1 if flows else driven
            measured = self._plant.step(CurrentCommand(np.where(driven_wheels, current, 0.0)))
            assert isinstance(measured, Measurement)
            commanded.append(current)
            measurements.append(measured)
            turns = abs(measured.yaw_rate) > YAW_RATE_REACHED and wheel >= 0
            moving += bool(turns or np.abs(measured.wheel_speed).max() > fast)
            if not flows and k - driven >= coasting / period:
                break
        return Motion(
            wheel,
            np.array(commanded),
            np.array([m.current for m in measurements]),
            np.array([m.wheel_speed for m in measurements]),
            np.array([m.acceleration for m in measurements]),
            np.array([m.yaw_rate for m in measurements]),
            np.unwrap([m.yaw for m in measurements]),
            driven,
            period,
        )
