"""Simulated wire with loss, delay, jitter, duplication and interruptions, in simulated time."""

from __future__ import annotations

import heapq
import random
from collections import deque
from dataclasses import dataclass

from omnimj.link.codec.layout import DropCounts

_MAX_IN_TRANSIT = 10_000
_MAX_CAPTURED = 100_000


@dataclass(frozen=True, slots=True)
class WireFaults:
    """Disturbances of the packets in one direction."""

    loss: float = 0.0
    """Share of lost packets, 0…1."""
    delay: float = 0.0
    """Delay of every packet [s]."""
    jitter: float = 0.0
    """Additional delay, uniform in 0…jitter and independent for each packet, which can reorder them [s]."""
    duplication: float = 0.0
    """Share of duplicated packets, with independent jitter, 0…1."""
    cuts: tuple[tuple[float, float], ...] = ()
    """Intervals of interruption; packets sent or arriving within them are lost [s]."""

    def is_cut(self, time: float) -> bool:
        """True if the wire is interrupted at a time [s]."""
        return any(begin <= time < end for begin, end in self.cuts)


class _Direction:
    """One direction of the wire."""

    def __init__(self, faults: WireFaults, rng: random.Random):
        self.faults = faults
        self.captured: deque[tuple[float, bytes]] = deque(maxlen=_MAX_CAPTURED)
        self.lost = 0
        self._rng, self._count = rng, 0
        self._in_transit: list[tuple[float, int, bytes]] = []

    def send(self, now: float, packet: bytes) -> None:
        self.captured.append((now, packet))
        # all numbers are drawn for every packet, so that one disturbance does not change another
        lost, twice, first, second = (self._rng.random() for _ in range(4))
        if lost < self.faults.loss or self.faults.is_cut(now):
            self.lost += 1
            return
        for late in (first, second) if twice < self.faults.duplication else (first,):
            self.put(now + self.faults.delay + self.faults.jitter * late, packet)

    def put(self, arrival: float, packet: bytes) -> None:
        if self.faults.is_cut(arrival) or len(self._in_transit) >= _MAX_IN_TRANSIT:
            self.lost += 1
            return
        self._count += 1
        heapq.heappush(self._in_transit, (arrival, self._count, packet))

    def arrived(self, now: float) -> list[bytes]:
        found = []
        while self._in_transit and self._in_transit[0][0] <= now:
            found.append(heapq.heappop(self._in_transit)[2])
        return found

    def is_due(self, now: float) -> bool:
        return bool(self._in_transit) and self._in_transit[0][0] <= now


class SimulatedTransport:
    """End of the wire: a transport in the wire's simulated time."""

    def __init__(self, wire: SimulatedWire, outgoing: _Direction, incoming: _Direction):
        self.failures, self.drops = 0, DropCounts()
        self.is_open = True
        self._wire, self._outgoing, self._incoming = wire, outgoing, incoming

    @property
    def sent(self) -> tuple[tuple[float, bytes], ...]:
        """Times [s] and packets sent from this end, including lost ones; the last 100000."""
        return tuple(self._outgoing.captured)

    @property
    def lost(self) -> int:
        """Number of lost packets from this end."""
        return self._outgoing.lost

    def send(self, packet: bytes) -> None:
        """Send at the wire's time."""
        if self.is_open:
            self._outgoing.send(self._wire.now, packet)
        else:
            self.failures += 1

    def receive(self) -> list[bytes]:
        """Packets that have arrived by now, in the order of arrival."""
        return self._incoming.arrived(self._wire.now) if self.is_open else []

    def wait(self, longest: float) -> bool:
        """True if a packet has arrived by now; simulated time does not advance while waiting."""
        return self.is_open and self._incoming.is_due(self._wire.now)

    def close(self) -> None:
        """Stop sending and receiving; may be called twice."""
        self.is_open = False


class SimulatedWire:
    """Wire with both ends and its own time."""

    def __init__(self, to_device: WireFaults | None = None, to_host: WireFaults | None = None, seed: int = 0):
        """Start at time 0.

        Args:
          to_device: Disturbances of the host's packets; none if None.
          to_host: Disturbances of the device's packets; none if None.
          seed: Seed of the random numbers, independent for each direction.
        """
        self.now = 0.0
        """Simulated time [s]."""
        self._to_device = _Direction(to_device or WireFaults(), random.Random(f"{seed} to device"))
        self._to_host = _Direction(to_host or WireFaults(), random.Random(f"{seed} to host"))
        self.host = SimulatedTransport(self, self._to_device, self._to_host)
        self.device = SimulatedTransport(self, self._to_host, self._to_device)

    def advance(self, now: float) -> None:
        """Advance time to `now` [s]; it never decreases."""
        self.now = max(self.now, now)

    def set_faults(self, to_device: WireFaults | None = None, to_host: WireFaults | None = None) -> None:
        """Change the disturbances of packets sent from now on; None leaves a direction unchanged."""
        if to_device is not None:
            self._to_device.faults = to_device
        if to_host is not None:
            self._to_host.faults = to_host

    def inject(self, packet: bytes, to_device: bool = True) -> None:
        """Deliver a foreign or replayed packet now."""
        (self._to_device if to_device else self._to_host).put(self.now, packet)

    def reconnect_host(self) -> SimulatedTransport:
        """Additional end at the host's side, as of a second host; answers go to whichever receives first."""
        return SimulatedTransport(self, self._to_device, self._to_host)
