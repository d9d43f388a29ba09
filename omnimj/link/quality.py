"""Quality of a link: offset of the clocks, lost frames, and deadlines in real time."""

from __future__ import annotations

import dataclasses
import math
from collections import deque
from dataclasses import dataclass, field
from typing import Any

LOSS_WINDOW = 20
"""Number of recent frames among which losses are counted."""
_PINGS = 16
_SHORTEST, _PER_DECADE, _DECADES = 1e-7, 64, 9


class ClockOffset:
    """Offset of the device's clock, from the ping with the shortest round trip among the last 16.

    offset = t_device − (t_sent + t_received)/2, accurate to half the round trip.
    """

    def __init__(self):
        """Start with an unknown offset."""
        self.answers = 0
        """Number of answered pings."""
        self._sent: deque[tuple[int, float]] = deque(maxlen=_PINGS)
        self._found: deque[tuple[float, float]] = deque(maxlen=_PINGS)

    def sent(self, nonce: int, now: float) -> None:
        """Note a ping sent at `now` [s]."""
        self._sent.append((nonce, now))

    def answered(self, nonce: int, now: float, device_time: float) -> None:
        """Note the answer to a ping; repeated and unknown ones are ignored.

        Args:
          nonce: Nonce of the ping.
          now: Time of arrival on the host's clock [s].
          device_time: Time of the device's clock in the answer [s].
        """
        for entry in self._sent:
            if entry[0] == nonce:
                self._sent.remove(entry)
                self.answers += 1
                self._found.append((now - entry[1], device_time - 0.5 * (entry[1] + now)))
                return

    @property
    def known(self) -> bool:
        """True if a ping has been answered."""
        return bool(self._found)

    @property
    def offset(self) -> float:
        """Device's clock minus the host's [s]; NaN while unknown."""
        return min(self._found)[1] if self._found else math.nan

    @property
    def round_trip(self) -> float:
        """Round trip of the ping that determines the offset [s]; infinite while unknown."""
        return min(self._found)[0] if self._found else math.inf


class LossCounter:
    """Counter of losses among the last 20 frames of a sender; a frame out of order counts as lost."""

    def __init__(self):
        """Start without losses."""
        self.newest = 0
        self.total_lost = 0
        """Lost frames since the beginning, including those out of order."""
        self._received = (1 << LOSS_WINDOW) - 1

    def take(self, sequence: int) -> bool:
        """Note a frame; False if it is repeated or out of order."""
        if sequence <= self.newest:
            return False
        self.total_lost += sequence - self.newest - 1
        gap = min(sequence - self.newest, LOSS_WINDOW)
        self._received = ((self._received << gap) | 1) & ((1 << LOSS_WINDOW) - 1)
        self.newest = sequence
        return True

    @property
    def lost(self) -> int:
        """Lost frames among the last 20."""
        return LOSS_WINDOW - self._received.bit_count()


class TimeHistogram:
    """Histogram of positive times in constant memory (64 bins per decade, 0.1 µs to 100 s)."""

    def __init__(self):
        self._bins = [0] * (_PER_DECADE * _DECADES)
        self.count, self.largest = 0, 0.0

    def add(self, time: float) -> None:
        """Add a time [s]; shorter ones count as 0.1 µs."""
        where = int(_PER_DECADE * math.log10(time / _SHORTEST)) if time > _SHORTEST else 0
        self._bins[min(where, len(self._bins) - 1)] += 1
        self.count += 1
        self.largest = max(self.largest, time)

    def quantile(self, share: float) -> float:
        """Quantile of the times, accurate to 2 % [s]; 0 if there are none."""
        left = share * self.count
        for k, number in enumerate(self._bins):
            left -= number
            if number and left <= 0.0:
                return min(_SHORTEST * 10.0 ** ((k + 0.5) / _PER_DECADE), self.largest)
        return 0.0

    def as_record(self) -> dict[str, float]:
        """Quantiles `p50` and `p99`, and `max` [s]."""
        return {"p50": self.quantile(0.5), "p99": self.quantile(0.99), "max": self.largest}


@dataclass
class Deadlines:
    """Statistics of the deadlines of a control loop that answers each reading with a command."""

    periods: int = 0
    """Number of commands."""
    missed: int = 0
    """Commands sent more than a period after their reading arrived."""
    held: int = 0
    """Periods without a reading in time, in which the controller received the previous one again."""
    skipped: int = 0
    """Readings that were skipped because a newer one had arrived."""
    response: TimeHistogram = field(default_factory=TimeHistogram)
    """Time from the arrival of a reading to the sending of its command."""
    late: TimeHistogram = field(default_factory=TimeHistogram)
    """Delay of a reading beyond one period after the previous one."""
    command_age: TimeHistogram = field(default_factory=TimeHistogram)
    """Age of the newest command as reported in each telemetry."""

    def as_record(self) -> dict[str, Any]:
        """Record for `metrics.json`, with times in [s]."""
        record = {f.name: getattr(self, f.name) for f in dataclasses.fields(self)}
        return {k: v.as_record() if isinstance(v, TimeHistogram) else v for k, v in record.items()}


@dataclass(frozen=True)
class LinkRecord:
    """Summary of a link at its end."""

    address: str
    mode: str
    """`lock-step`, `real time`, `readonly` or `dry run`."""
    is_keyed: bool
    deadlines: Deadlines
    sent: int
    received: int
    """Numbers of sent and received frames."""
    resent: int
    """Frames that were sent again in lock-step."""
    lost: int
    """Frames of the device that were lost or arrived too late."""
    dropped: int
    """Received packets that were dropped."""
    device_dropped: int
    """Packets that the device dropped, by its own report."""
    device_refused: int
    """Frames that the device refused."""
    round_trip: float | None
    """Shortest round trip of the last pings [s]; None without one."""
    ended_by: str
    """Reason for which the link ended; empty if it was closed."""

    def as_record(self) -> dict[str, Any]:
        """Record for `metrics.json`."""
        record = {f.name: getattr(self, f.name) for f in dataclasses.fields(self)}
        return {**record, "deadlines": self.deadlines.as_record()}
