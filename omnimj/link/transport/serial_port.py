"""Serial port, USB or pseudo-terminal as a transport: stuffed packets ended by zeros, non-blocking."""

from __future__ import annotations

import os
import select
import time

import serial

from omnimj.errors import InputError
from omnimj.link.codec.layout import DropCounts
from omnimj.link.codec.stream import DELIMITER, PacketStream, stuff
from omnimj.link.transport.address import SerialAddress

_CHUNK = 4096  # bytes per call, so that noise on the line cannot delay the caller
_POLL_INTERVAL = 0.0005  # [s] between polls where the system cannot wait for a port


class SerialTransport:
    """End of a serial line; opens the port exclusively where the system can."""

    def __init__(self, address: SerialAddress):
        """Open the port and send a zero, which ends anything that was on the line before.

        Raises:
          InputError: No such port, it is in use, or it does not support the rate.
        """
        self.failures = 0
        exclusive = True if os.name == "posix" else None
        try:
            self._port = serial.Serial(
                address.path, address.baud, timeout=0, write_timeout=0, exclusive=exclusive
            )
        except (OSError, ValueError, OverflowError) as error:  # pyserial's errors are OSErrors
            raise InputError(address, f"cannot be opened ({error})") from None
        self._stream = PacketStream()
        self._rest = b""  # rest of a partly sent packet
        self._write(DELIMITER)

    @property
    def drops(self) -> DropCounts:
        """Dropped pieces of the stream by reason."""
        return self._stream.drops

    def send(self, packet: bytes) -> None:
        """Send a packet; it is dropped if the port's buffer is full, since a late packet is useless."""
        self._send_rest()
        stuffed = stuff(packet)
        sent = 0 if self._rest else self._write(stuffed)
        if sent == 0:
            self.failures += 1
        else:
            self._rest = stuffed[sent:]

    def _send_rest(self) -> None:
        """Send the rest of a partly sent packet."""
        if self._rest:
            self._rest = self._rest[self._write(self._rest) :]

    def _write(self, content: bytes) -> int:
        """Write and return the number of bytes written."""
        try:
            # the library retries for ever on a port that would block
            if os.name == "posix" and not select.select([], [self._port], [], 0.0)[1]:
                return 0
            return self._port.write(content) or 0
        except (OSError, TypeError, ValueError):  # unplugged, or closed
            return 0

    def receive(self) -> list[bytes]:
        """Packets that end in the received bytes, at most 4096 of them; checksums are not verified."""
        try:
            self._send_rest()
            waiting = self._port.in_waiting
            chunk = self._port.read(min(waiting, _CHUNK)) if waiting else b""
        except (OSError, TypeError, ValueError):
            self.failures += 1
            return []
        return self._stream.feed(chunk) if chunk else []

    def wait(self, longest: float) -> bool:
        """True if bytes arrive within this time [s]."""
        if not self._port.is_open:
            return False
        try:
            if os.name == "posix":
                return bool(select.select([self._port], [], [], max(0.0, longest))[0])
            until = time.monotonic() + longest
            while not self._port.in_waiting and time.monotonic() < until:
                time.sleep(_POLL_INTERVAL)
            return bool(self._port.in_waiting)
        except OSError:
            self.failures += 1
            return False

    def close(self) -> None:
        """Close the port; may be called twice."""
        self._port.close()
