"""A wire in one program and simulated time: loses, delays, jitters, doubles, is cut, and remembers."""

from __future__ import annotations

import heapq
import random
from collections import deque
from dataclasses import dataclass

_MOST_UNDER_WAY = 10_000
_MOST_CAPTURED = 100_000


@dataclass(frozen=True, slots=True)
class WireFaults:
    """What a wire does to packets of one direction."""

    loss: float = 0.0
    """Share of the packets that never come, 0…1."""
    delay: float = 0.0
    """Of every packet [s]."""
    jitter: float = 0.0
    """More delay, evenly 0…jitter for each packet by itself, so that they overtake each other [s]."""
    duplication: float = 0.0
    """Share of the packets that come twice, each with a jitter of its own, 0…1."""
    cuts: tuple[tuple[float, float], ...] = ()
    """From and until when nothing goes through: what is sent then, or would come then, is lost [s]."""

    def is_cut(self, time: float) -> bool:
        """Whether nothing goes through."""
        return any(begin <= time < end for begin, end in self.cuts)


class _Direction:
    """One direction."""

    def __init__(self, faults: WireFaults, rng: random.Random):
        self.faults = faults
        self.captured: deque[tuple[float, bytes]] = deque(maxlen=_MOST_CAPTURED)
        self.lost = 0
        self._rng, self._count = rng, 0
        self._under_way: list[tuple[float, int, bytes]] = []

    def send(self, now: float, packet: bytes) -> None:
        self.captured.append((now, packet))
        # everything is drawn for every packet, so that one fault does not change what another does
        lost, twice, first, second = (self._rng.random() for _ in range(4))
        if lost < self.faults.loss or self.faults.is_cut(now):
            self.lost += 1
            return
        for late in (first, second) if twice < self.faults.duplication else (first,):
            self.put(now + self.faults.delay + self.faults.jitter * late, packet)

    def put(self, arrival: float, packet: bytes) -> None:
        if self.faults.is_cut(arrival) or len(self._under_way) >= _MOST_UNDER_WAY:
            self.lost += 1
            return
        self._count += 1
        heapq.heappush(self._under_way, (arrival, self._count, packet))

    def arrived(self, now: float) -> list[bytes]:
        found = []
        while self._under_way and self._under_way[0][0] <= now:
            found.append(heapq.heappop(self._under_way)[2])
        return found

    def is_due(self, now: float) -> bool:
        return bool(self._under_way) and self._under_way[0][0] <= now


class SimulatedTransport:
    """One end: a transport whose time is the wire's."""

    def __init__(self, wire: SimulatedWire, there: _Direction, here: _Direction):
        self.failures = 0
        self._wire, self._there, self._here = wire, there, here
        self._open = True

    @property
    def sent(self) -> tuple[tuple[float, bytes], ...]:
        """All that was sent from here and when [s], whether it came or not; the last 100000."""
        return tuple(self._there.captured)

    @property
    def lost(self) -> int:
        """How many packets from here never come."""
        return self._there.lost

    def send(self, packet: bytes) -> None:
        """Sends at the wire's time."""
        if self._open:
            self._there.send(self._wire.now, packet)
        else:
            self.failures += 1

    def receive(self) -> list[bytes]:
        """What has come until now, in the order it came."""
        return self._here.arrived(self._wire.now) if self._open else []

    def wait(self, longest: float) -> bool:
        """Whether something is there now: time stands still while one waits."""
        return self._open and self._here.is_due(self._wire.now)

    def close(self) -> None:
        """Sends and hears nothing from now on; may be called twice."""
        self._open = False


class SimulatedWire:
    """Both ends and the time between them."""

    def __init__(self, to_device: WireFaults | None = None, to_host: WireFaults | None = None, seed: int = 0):
        """A wire at time 0.

        Args:
          to_device: What happens to the host's packets; nothing, if None.
          to_host: And to the device's.
          seed: Of what is drawn, for each direction by itself.
        """
        self.now = 0.0
        """Simulated time [s]."""
        self._to_device = _Direction(to_device or WireFaults(), random.Random(f"{seed} to device"))
        self._to_host = _Direction(to_host or WireFaults(), random.Random(f"{seed} to host"))
        self.host = SimulatedTransport(self, self._to_device, self._to_host)
        self.device = SimulatedTransport(self, self._to_host, self._to_device)

    def advance(self, now: float) -> None:
        """Time is now `now` [s]; it never goes back."""
        self.now = max(self.now, now)

    def set_faults(self, to_device: WireFaults | None = None, to_host: WireFaults | None = None) -> None:
        """Other faults from now on; None leaves a direction as it is. What is under way stays so."""
        if to_device is not None:
            self._to_device.faults = to_device
        if to_host is not None:
            self._to_host.faults = to_host

    def inject(self, packet: bytes, to_device: bool = True) -> None:
        """Somebody else's packet arrives now, or one that was captured is played again."""
        (self._to_device if to_device else self._to_host).put(self.now, packet)

    def reconnect_host(self) -> SimulatedTransport:
        """A new end at the host's side, as a second host has: both send, either may hear the answers."""
        return SimulatedTransport(self, self._to_device, self._to_host)
