"""How well a link in real time keeps its deadlines, counted as it goes, in memory that does not grow."""

from __future__ import annotations

import dataclasses
import math
from dataclasses import dataclass, field
from typing import Any

_SHORTEST, _PER_DECADE, _DECADES = 1e-7, 64, 9


class Spread:
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
    response: Spread = field(default_factory=Spread)
    """From a reading's arrival until its command has left."""
    late: Spread = field(default_factory=Spread)
    """By how much a reading came later than a period after the one before."""
    command_age: Spread = field(default_factory=Spread)
    """Of the newest command, as the device says in each telemetry."""

    def as_record(self) -> dict[str, Any]:
        """For `metrics.json`; times in [s]."""
        told = {f.name: getattr(self, f.name) for f in dataclasses.fields(self)}
        return {k: v.as_record() if isinstance(v, Spread) else v for k, v in told.items()}


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
