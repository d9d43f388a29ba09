"""What carries packets; nothing here knows what is in them, waits for an answer, or raises once it is open.

A wire that cannot send or is gone is silence, and both sides know what to do about silence.
"""

from __future__ import annotations

from collections.abc import Hashable
from typing import Protocol

Peer = Hashable
"""Who a packet came from, where a wire has more than one far end."""


class Transport(Protocol):
    """One end of a wire with one far end."""

    failures: int
    """How often the system could not send or receive, or a packet was dropped here."""

    def send(self, packet: bytes) -> None:
        """Sends, or counts a failure; never waits."""
        ...

    def receive(self) -> list[bytes]:
        """What has come, oldest first, a bounded number; never waits."""
        ...

    def wait(self, longest: float) -> bool:
        """Whether something has come within this time [s]."""
        ...

    def close(self) -> None:
        """Lets go of the wire; may be called twice."""
        ...


class Listener(Protocol):
    """A device's end of a wire: anybody may speak to it."""

    @property
    def failures(self) -> int:
        """As for a transport."""
        ...

    def send(self, packet: bytes, peer: Peer) -> None:
        """Sends to one of those who have spoken."""
        ...

    def receive(self) -> list[tuple[bytes, Peer]]:
        """What has come, and from whom; a bounded number; never waits."""
        ...

    def wait(self, longest: float) -> bool:
        """Whether something has come within this time [s]."""
        ...

    def close(self) -> None:
        """Lets go of the wire; may be called twice."""
        ...


class SinglePeerListener:
    """A device's end of a wire that has one far end, such as a serial line."""

    def __init__(self, transport: Transport):
        self._transport = transport

    @property
    def failures(self) -> int:
        """Of the transport."""
        return self._transport.failures

    def send(self, packet: bytes, peer: Peer = None) -> None:
        """Sends to the far end."""
        self._transport.send(packet)

    def receive(self) -> list[tuple[bytes, Peer]]:
        """What has come, all of it from the far end."""
        return [(packet, None) for packet in self._transport.receive()]

    def wait(self, longest: float) -> bool:
        """Whether something has come within this time [s]."""
        return self._transport.wait(longest)

    def close(self) -> None:
        """Lets go of the wire; may be called twice."""
        self._transport.close()
