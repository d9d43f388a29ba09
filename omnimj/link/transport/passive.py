"""A transport that only receives: a listener, of which nothing is ever sent."""

from __future__ import annotations

from omnimj.link.codec.layout import DropCounts
from omnimj.link.transport.interface import Listener


class PassiveTransport:
    """Receiving end for a monitor of a device, which sends its copies here."""

    def __init__(self, listener: Listener):
        self._listener, self.failures = listener, 0

    @property
    def drops(self) -> DropCounts:
        """Received data that are no packet."""
        return self._listener.drops

    @property
    def is_open(self) -> bool:
        """False while the wire is gone."""
        return self._listener.is_open

    def send(self, packet: bytes) -> None:
        """Send nothing and count a failure."""
        self.failures += 1

    def receive(self) -> list[bytes]:
        """Received packets of any sender; on a keyed link the tags identify the sender."""
        return [packet for packet, _ in self._listener.receive()]

    def wait(self, longest: float) -> bool:
        """True if a packet arrives within this time [s]."""
        return self._listener.wait(longest)

    def close(self) -> None:
        """Close the wire; may be called twice."""
        self._listener.close()
