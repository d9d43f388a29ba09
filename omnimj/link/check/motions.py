"""Small motions for the bench check, on any plant: one motor after the other, then a turn on the spot.

Current rises slowly until the wheel turns, so that a wheel in the air and one on the floor are both moved
gently, and falls back to zero at once.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from omnimj.plant.interface import Plant
from omnimj.signals import Array, CurrentCommand, Measurement

CURRENT_RATE = 1.0
"""Of the current [A/s]."""
WHEEL_SPEED_REACHED, YAW_RATE_REACHED = 2.0, 0.5
"""Wheel speed [rad/s] or yaw rate [rad/s] at which a motor has shown what it does."""
HOLD_TIME = 0.08
"""Time for which it goes on then [s]."""
COAST_TIME, REST_TIME = 0.3, 0.4
"""Time without current that is looked at after a turn, and between two motions [s]."""


@dataclass(frozen=True)
class Motion:
    """What the channels said while currents were given, k samples."""

    wheel: int
    """0…n−1; −1: all of them."""
    asked: Array
    """Current of the wheels that were driven, shape (k,) [A]."""
    current: Array
    """Shape (k, n) [A]."""
    wheel_speed: Array
    """Shape (k, n) [rad/s]."""
    acceleration: Array
    """Shape (k, 2) [m/s²]."""
    yaw_rate: Array
    """Shape (k,) [rad/s]."""
    yaw: Array
    """Unwrapped, shape (k,) [rad]."""
    driven: int
    """Samples until the current ended; behind it the robot coasts."""
    period: float
    """Between two samples [s]."""


class MotionSequence:
    """Moves a plant and keeps what it said.

    Args:
      plant: Reset by `rest`; of a robot.
      most: Largest current [A].
      report: Called with a phrase before each motion.
    """

    def __init__(self, plant: Plant, most: float, report: Callable[[str], None] = lambda phrase: None):
        self._plant, self._most, self._report = plant, most, report
        self._wheels = 0

    def rest(self, time: float) -> Motion:
        """The robot at rest, from its start."""
        self._report("at rest")
        first = self._plant.reset()
        assert isinstance(first, Measurement)
        self._wheels = len(first.current)
        return self._moved(-1, 0.0, time)

    def one(self, wheel: int, sign: float) -> Motion:
        """One motor, forwards or backwards."""
        self._report(f"motor {wheel + 1} {'forwards' if sign > 0.0 else 'backwards'}")
        return self._moved(wheel, sign, REST_TIME)

    def turn(self, sign: float) -> Motion:
        """All motors alike: the robot turns on the spot, and coasts."""
        self._report("a turn on the spot")
        return self._moved(-1, sign, COAST_TIME + REST_TIME)

    def _moved(self, wheel: int, sign: float, coasting: float) -> Motion:
        n, period = self._wheels, self._plant.period
        asked, said, shown, driven = [], [], 0, 0
        longest = math.ceil(self._most / CURRENT_RATE / period) if sign else 0
        for k in range(longest + math.ceil(coasting / period)):
            flows = k < longest and shown * period < HOLD_TIME
            current = sign * CURRENT_RATE * (k + 1) * period if flows else 0.0
            driven = k + 1 if flows else driven
            wanted = np.full(n, current)
            if wheel >= 0:
                wanted[np.arange(n) != wheel] = 0.0
            measured = self._plant.step(CurrentCommand(wanted))
            assert isinstance(measured, Measurement)
            asked.append(current)
            said.append(measured)
            swings = abs(measured.yaw_rate) > YAW_RATE_REACHED and wheel >= 0
            shown += bool(
                swings
                or np.abs(measured.wheel_speed).max()
                > (WHEEL_SPEED_REACHED if wheel >= 0 else 2 * WHEEL_SPEED_REACHED)
            )
            if not flows and k - driven >= coasting / period:
                break
        return Motion(
            wheel,
            np.array(asked),
            np.array([m.current for m in said]),
            np.array([m.wheel_speed for m in said]),
            np.array([m.acceleration for m in said]),
            np.array([m.yaw_rate for m in said]),
            np.unwrap([m.yaw for m in said]),
            driven,
            period,
        )
