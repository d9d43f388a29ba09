"""A simulation held to the wall clock."""

from __future__ import annotations

import time
from collections.abc import Callable

_NAP = 0.002  # [s] ahead from which it is worth to sleep
_GIVEN_UP = 0.1  # [s] behind from which it is not caught up


class RealTime:
    """`wait()` before every step; a simulation that cannot keep up loses time instead of racing after it."""

    def __init__(
        self,
        period: float,
        clock: Callable[[], float] = time.monotonic,
        sleep: Callable[[float], object] = time.sleep,
    ):
        """Starts with the first `wait`.

        Args:
          period: Of one step [s].
          clock: Goes forward only [s].
          sleep: Waits so many seconds.
        """
        self._period, self._clock, self._sleep = period, clock, sleep
        self._due: float | None = None
        self._begin = self._now = 0.0
        self._steps = 0
        self.lost = 0.0
        """By how much the simulation has fallen behind for good [s]."""

    @property
    def factor(self) -> float:
        """Simulated time over wall time since the first step; 1: it keeps up."""
        wall = self._now - self._begin
        return self._steps * self._period / wall if wall > 0.0 else 1.0

    def wait(self) -> None:
        """Waits until the next step is due."""
        self._now = self._clock()
        if self._due is None:
            self._due = self._begin = self._now
            return
        self._steps += 1
        self._due += self._period
        ahead = self._due - self._now
        if ahead > _NAP:
            self._sleep(ahead)
        elif ahead < -_GIVEN_UP:
            self.lost -= ahead
            self._due = self._now
