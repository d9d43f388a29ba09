"""Interfaces of the transports: they carry packets, never wait for an answer, and never raise once open.

A wire that cannot send or is disconnected appears as silence, which both sides handle.
"""

from __future__ import annotations

from collections.abc import Hashable, Sequence
from typing import Protocol

from omnimj.link.codec.layout import DropCounts

Peer = Hashable
"""Sender of a packet on a wire with several far ends."""


class Packet(bytes):
    """Packet with the time that it has waited in the receive queue of the system."""

    waited: float = 0.0
    """Time between arrival at the socket and reception [s]; 0 where the system does not measure it."""


class Transport(Protocol):
    """End of a wire with a single far end."""

    failures: int
    """Number of failed transmissions and receptions."""

    @property
    def drops(self) -> DropCounts:
        """Received data that are no packet: oversized datagrams, broken stuffing."""
        ...

    @property
    def is_open(self) -> bool:
        """False while the wire is gone, such as a serial port that was unplugged."""
        ...

    def send(self, packet: bytes) -> None:
        """Send, or count a failure; never waits."""
        ...

    def receive(self) -> Sequence[bytes]:
        """Received packets, oldest first, at most a fixed number, perhaps as `Packet`; never waits."""
        ...

    def wait(self, longest: float) -> bool:
        """True if a packet arrives within this time [s]."""
        ...

    def close(self) -> None:
        """Close the wire; may be called twice."""
        ...


class Listener(Protocol):
    """Device's end of a wire, which accepts packets from any sender."""

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

    def send(self, packet: bytes, peer: Peer) -> None:
        """Send to a peer from which a packet was received."""
        ...

    def receive(self) -> Sequence[tuple[bytes, Peer]]:
        """Received packets with their senders, at most a fixed number; never waits."""
        ...

    def wait(self, longest: float) -> bool:
        """True if a packet arrives within this time [s]."""
        ...

    def close(self) -> None:
        """Close the wire; may be called twice."""
        ...


def waiting_time(packet: bytes) -> float:
    """Time that a packet has waited in the receive queue of the system [s]; 0 if unknown."""
    return packet.waited if isinstance(packet, Packet) else 0.0


class SinglePeerListener:
    """Device's end of a wire with a single far end, such as a serial line."""

    def __init__(self, transport: Transport):
        self._transport = transport

    @property
    def failures(self) -> int:
        """Number of failures of the transport."""
        return self._transport.failures

    @property
    def drops(self) -> DropCounts:
        """Data received on the transport that are no packet."""
        return self._transport.drops

    @property
    def is_open(self) -> bool:
        """False while the wire is gone."""
        return self._transport.is_open

    def send(self, packet: bytes, peer: Peer = None) -> None:
        """Send to the far end."""
        self._transport.send(packet)

    def receive(self) -> list[tuple[bytes, Peer]]:
        """Received packets, all from the far end."""
        return [(packet, None) for packet in self._transport.receive()]

    def wait(self, longest: float) -> bool:
        """True if a packet arrives within this time [s]."""
        return self._transport.wait(longest)

    def close(self) -> None:
        """Close the wire; may be called twice."""
        self._transport.close()
