"""Interfaces of the transports: they carry packets, never wait for an answer, and never raise once open.

A wire that cannot send or is disconnected appears as silence, which both sides handle.
"""

from __future__ import annotations

from collections.abc import Hashable, Sequence
from typing import Generic, Protocol, TypeVar

from omnimj.link.codec.layout import DropCounts

Peer = Hashable
"""Sender of a packet on a wire with several far ends."""


W = TypeVar("W", bound="Wire")


class Packet(bytes):
    """Packet with the time that it has waited in the receive queue of the system."""

    waited: float = 0.0
    """Time between arrival at the socket and reception [s]; 0 where the system does not measure it."""


class Wire(Protocol):
    """Properties common to both ends of a link."""

    @property
    def failures(self) -> int:
        """Number of failed transmissions and receptions."""
        ...

    @property
    def drops(self) -> DropCounts:
        """Received data that are no packet: oversized datagrams, broken stuffing."""
        ...

    @property
    def is_open(self) -> bool:
        """False while the wire is gone, such as a serial port that was unplugged."""
        ...

    def wait(self, longest: float) -> bool:
        """True if a packet arrives within this time [s]."""
        ...

    def close(self) -> None:
        """Close the wire; may be called twice."""
        ...


class Transport(Wire, Protocol):
    """End of a wire with a single far end."""

    def send(self, packet: bytes) -> None:
        """Send, or count a failure; never waits."""
        ...

    def receive(self) -> Sequence[bytes]:
        """Received packets, oldest first, at most a fixed number, perhaps as `Packet`; never waits."""
        ...


class Listener(Wire, Protocol):
    """Device's end of a wire, which accepts packets from any sender."""

    def send(self, packet: bytes, peer: Peer) -> None:
        """Send to a peer from which a packet was received."""
        ...

    def receive(self) -> Sequence[tuple[bytes, Peer]]:
        """Received packets with their senders, at most a fixed number; never waits."""
        ...


def waiting_time(packet: bytes) -> float:
    """Time that a packet has waited in the receive queue of the system [s]; 0 if unknown."""
    return packet.waited if isinstance(packet, Packet) else 0.0


class _OnWire(Generic[W]):
    """End that passes everything but packets on to another one."""

    def __init__(self, wire: W):
        self._wire = wire

    @property
    def failures(self) -> int:
        """Number of failed transmissions and receptions."""
        return self._wire.failures

    @property
    def drops(self) -> DropCounts:
        """Received data that are no packet."""
        return self._wire.drops

    @property
    def is_open(self) -> bool:
        """False while the wire is gone."""
        return self._wire.is_open

    def wait(self, longest: float) -> bool:
        """True if a packet arrives within this time [s]."""
        return self._wire.wait(longest)

    def close(self) -> None:
        """Close the wire; may be called twice."""
        self._wire.close()


class SinglePeerListener(_OnWire[Transport]):
    """Device's end of a wire with a single far end, such as a serial line."""

    def send(self, packet: bytes, peer: Peer = None) -> None:
        """Send to the far end."""
        self._wire.send(packet)

    def receive(self) -> list[tuple[bytes, Peer]]:
        """Received packets, all from the far end."""
        return [(packet, None) for packet in self._wire.receive()]


class PassiveTransport(_OnWire[Listener]):
    """Receiving end for a monitor of a device, which sends its copies here; nothing is ever sent."""

    def __init__(self, wire: Listener):
        super().__init__(wire)
        self._unsent = 0

    @property
    def failures(self) -> int:
        """Number of packets that were not sent."""
        return self._unsent

    def send(self, packet: bytes) -> None:
        """Send nothing and count a failure."""
        self._unsent += 1

    def receive(self) -> list[bytes]:
        """Received packets of any sender; on a keyed link the tags identify the sender."""
        return [packet for packet, _ in self._wire.receive()]
