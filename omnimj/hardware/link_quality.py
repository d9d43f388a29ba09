"""How good a link is, counted from what arrived: the two clocks against each other, and what was lost."""

from __future__ import annotations

import math
from collections import deque

WINDOW = 20
"""Frames over which losses are counted."""
_PINGS = 16


class ClockOffset:
    """The device's clock less the host's, from the ping with the shortest round trip among the last 16.

    offset = t_device − (t_sent + t_received)/2, known to half the round trip.
    """

    def __init__(self):
        """Nothing is known yet."""
        self.answers = 0
        """Pings that came back."""
        self._sent: deque[tuple[int, float]] = deque(maxlen=_PINGS)
        self._found: deque[tuple[float, float]] = deque(maxlen=_PINGS)

    def sent(self, nonce: int, now: float) -> None:
        """A ping went out [s]."""
        self._sent.append((nonce, now))

    def answered(self, nonce: int, now: float, device_time: float) -> None:
        """A pong came back [s, s]; counted once, and only if the ping is known."""
        for entry in self._sent:
            if entry[0] == nonce:
                self._sent.remove(entry)
                self.answers += 1
                self._found.append((now - entry[1], device_time - 0.5 * (entry[1] + now)))
                return

    @property
    def known(self) -> bool:
        """Whether a ping has come back."""
        return bool(self._found)

    @property
    def offset(self) -> float:
        """[s]; NaN while nothing is known."""
        return min(self._found)[1] if self._found else math.nan

    @property
    def round_trip(self) -> float:
        """Of the ping that counts [s]; infinite while nothing is known."""
        return min(self._found)[0] if self._found else math.inf


class Arrivals:
    """Which of the sender's last 20 frames came; what comes late has been lost."""

    def __init__(self):
        """As if all had come that were sent before."""
        self.newest = 0
        self.lost_in_all = 0
        """Since the beginning; what came late is among them."""
        self._came = (1 << WINDOW) - 1

    def take(self, sequence: int) -> bool:
        """Notes a frame; False if it is not newer than all before: a repeat, or too late."""
        if sequence <= self.newest:
            return False
        self.lost_in_all += sequence - self.newest - 1
        gap = min(sequence - self.newest, WINDOW)
        self._came = ((self._came << gap) | 1) & ((1 << WINDOW) - 1)
        self.newest = sequence
        return True

    @property
    def lost(self) -> int:
        """Of the last 20."""
        return WINDOW - self._came.bit_count()
