"""How good a link is, counted from what arrived: the two clocks against each other, and what was lost."""

from __future__ import annotations

import dataclasses
import math
from collections import deque
from dataclasses import dataclass, field
from typing import Any

LOSS_WINDOW = 20
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


class LossCounter:
    """Which of the sender's last 20 frames came; what comes late has been lost."""

    def __init__(self):
        """As if all had come that were sent before."""
        self.newest = 0
        self.total_lost = 0
        """Since the beginning; what came late is among them."""
        self._came = (1 << LOSS_WINDOW) - 1

    def take(self, sequence: int) -> bool:
        """Notes a frame; False if it is not newer than all before: a repeat, or too late."""
        if sequence <= self.newest:
            return False
        self.total_lost += sequence - self.newest - 1
        gap = min(sequence - self.newest, LOSS_WINDOW)
        self._came = ((self._came << gap) | 1) & ((1 << LOSS_WINDOW) - 1)
        self.newest = sequence
        return True

    @property
    def lost(self) -> int:
        """Of the last 20."""
        return LOSS_WINDOW - self._came.bit_count()


# How well a link in real time keeps its deadlines, counted as it goes, in memory that does not grow.

_SHORTEST, _PER_DECADE, _DECADES = 1e-7, 64, 9


class TimeHistogram:
    """Quantiles of positive times, each known to 2 % (64 bins per decade from 0.1 µs to 100 s)."""

    def __init__(self):
        self._bins = [0] * (_PER_DECADE * _DECADES)
        self.count, self.largest = 0, 0.0

    def add(self, time: float) -> None:
        """One more [s]; what is below 0.1 µs counts as that."""
        where = int(_PER_DECADE * math.log10(time / _SHORTEST)) if time > _SHORTEST else 0
        self._bins[min(where, len(self._bins) - 1)] += 1
        self.count += 1
        self.largest = max(self.largest, time)

    def quantile(self, share: float) -> float:
        """The time that this share of all does not exceed [s]; 0 where there was none."""
        left = share * self.count
        for k, number in enumerate(self._bins):
            left -= number
            if number and left <= 0.0:
                return min(_SHORTEST * 10.0 ** ((k + 0.5) / _PER_DECADE), self.largest)
        return 0.0

    def as_record(self) -> dict[str, float]:
        """`p50`, `p99` and `max` [s]."""
        return {"p50": self.quantile(0.5), "p99": self.quantile(0.99), "max": self.largest}


@dataclass
class Deadlines:
    """Of a control loop that answers each reading of the device by a command."""

    periods: int = 0
    """Commands that were asked for."""
    missed: int = 0
    """Whose command left more than a period after its reading had come."""
    held: int = 0
    """In which no reading came in time: the controller got the one before once more."""
    skipped: int = 0
    """Of the device, whose reading nobody used, since a newer one had come."""
    response: TimeHistogram = field(default_factory=TimeHistogram)
    """From a reading's arrival until its command has left."""
    late: TimeHistogram = field(default_factory=TimeHistogram)
    """By how much a reading came later than a period after the one before."""
    command_age: TimeHistogram = field(default_factory=TimeHistogram)
    """Of the newest command, as the device says in each telemetry."""

    def as_record(self) -> dict[str, Any]:
        """For `metrics.json`; times in [s]."""
        told = {f.name: getattr(self, f.name) for f in dataclasses.fields(self)}
        return {k: v.as_record() if isinstance(v, TimeHistogram) else v for k, v in told.items()}


@dataclass(frozen=True)
class LinkRecord:
    """A link at its end."""

    address: str
    mode: str
    """`lock-step`, `real time`, `readonly` or `dry run`."""
    is_keyed: bool
    deadlines: Deadlines
    sent: int
    received: int
    """Frames."""
    resent: int
    """In lock-step: commands that had to be asked for again."""
    lost: int
    """Frames of the device that never came, or too late."""
    dropped: int
    """Packets that came and did not count."""
    device_dropped: int
    """The same at the device, as it says."""
    device_refused: int
    """Frames that the device refused."""
    round_trip: float | None
    """Shortest of the last pings [s]; None without one."""
    ended_by: str
    """Why the link ended; empty: it was closed."""

    def as_record(self) -> dict[str, Any]:
        """For `metrics.json`."""
        told = {f.name: getattr(self, f.name) for f in dataclasses.fields(self)}
        return {**told, "deadlines": self.deadlines.as_record()}
