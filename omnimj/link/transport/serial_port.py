"""Serial port, USB or pseudo-terminal as a transport: stuffed packets ended by zeros, non-blocking.

A port that fails, such as an adapter that is unplugged, is closed and opened again when it is back.
"""

from __future__ import annotations

import contextlib
import os
import select
import time
from typing import Any

from omnimj.errors import InputError, MissingLibrary
from omnimj.link.codec.layout import DropCounts
from omnimj.link.codec.stream import DELIMITER, PacketStream, stuff
from omnimj.link.transport.address import SerialAddress

REOPEN_INTERVAL = 0.2
"""Time between two attempts to open a port that is gone [s]."""
_CHUNK = 4096  # bytes per call, so that noise on the line cannot delay the caller
_POLL_INTERVAL = 0.0005  # [s] between polls where the system cannot wait for a port
_ERRORS = (OSError, TypeError, ValueError)  # unplugged or closed; pyserial's own errors are OSErrors


def require_library(address: object) -> Any:
    """Import pyserial, an optional extra: others have no serial port.

    Raises:
      MissingLibrary: It is not installed.
    """
    try:
        import serial
    except ImportError:
        raise MissingLibrary(address, "pyserial", "hardware") from None
    return serial


class SerialTransport:
    """End of a serial line; opens the port exclusively where the system can."""

    def __init__(self, address: SerialAddress, *, passive: bool = False):
        """Open the port and send a zero, which ends anything that was on the line before.

        Args:
          address: Port and rate.
          passive: Whether to receive only; then not even the zero is sent.

        Raises:
          InputError: No such port, it is in use, or it does not support the rate.
          MissingLibrary: pyserial is not installed.
        """
        self.failures, self.is_open = 0, True
        self._address, self._passive, self._is_closed = address, passive, False
        self._stream, self._rest = PacketStream(), b""  # rest of a partly sent packet
        self._next_attempt = 0.0
        self._library = require_library(address)
        try:
            self._port = self._opened()
        except (OSError, ValueError, OverflowError) as error:
            number = getattr(error, "errno", None)
            reason = os.strerror(number).lower() if number else str(error)
            choices = "python -m serial.tools.list_ports lists the ports of this machine"
            raise InputError(address, f"cannot be opened, {reason}", choices) from None
        if not passive:
            self._write(DELIMITER)

    @property
    def drops(self) -> DropCounts:
        """Dropped pieces of the stream by reason."""
        return self._stream.drops

    def send(self, packet: bytes) -> None:
        """Send a packet; it is dropped if the port's buffer is full, since a late packet is useless."""
        self._send_rest()
        stuffed = stuff(packet)
        sent = 0 if self._rest or self._passive else self._write(stuffed)
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
        if not self.is_open:
            return 0
        try:
            # the library retries for ever on a port that would block
            if os.name == "posix" and not select.select([], [self._port], [], 0.0)[1]:
                return 0
            return self._port.write(content) or 0
        except _ERRORS:
            self._lose()
            return 0

    def receive(self) -> list[bytes]:
        """Packets that end in the received bytes, at most 4096 of them; checksums are not verified."""
        if not self.is_open and not self._reopen():
            return []
        try:
            self._send_rest()
            waiting = self._port.in_waiting
            chunk = self._port.read(min(waiting, _CHUNK)) if waiting else b""
        except _ERRORS:
            self._lose()
            return []
        return self._stream.feed(chunk) if chunk else []

    def wait(self, longest: float) -> bool:
        """True if bytes arrive within this time [s]."""
        if not self.is_open:
            time.sleep(0.0 if self._is_closed else min(max(0.0, longest), REOPEN_INTERVAL))
            return False
        try:
            if os.name == "posix":
                return bool(select.select([self._port], [], [], max(0.0, longest))[0])
            until = time.monotonic() + longest
            while not self._port.in_waiting and time.monotonic() < until:
                time.sleep(_POLL_INTERVAL)
            return bool(self._port.in_waiting)
        except _ERRORS:
            self._lose()
            return False

    def close(self) -> None:
        """Close the port for good; may be called twice."""
        self.is_open, self._is_closed = False, True
        self._port.close()

    def _opened(self) -> Any:
        exclusive = True if os.name == "posix" else None
        address = self._address
        return self._library.Serial(
            address.path, address.baud, timeout=0, write_timeout=0, exclusive=exclusive
        )

    def _lose(self) -> None:
        """Close the port, which is gone; `receive` opens it again."""
        self.failures += 1
        self.is_open, self._rest = False, b""
        self._stream.skip()  # a packet that was cut off ends nowhere
        with contextlib.suppress(*_ERRORS):
            self._port.close()

    def _reopen(self) -> bool:
        """Open a port that has come back, at most every `REOPEN_INTERVAL`; True if it is open."""
        if self._is_closed or time.monotonic() < self._next_attempt:
            return False
        self._next_attempt = time.monotonic() + REOPEN_INTERVAL
        try:
            self._port = self._opened()
        except (OSError, ValueError, OverflowError):
            return False
        self.is_open = True
        if not self._passive:
            self._write(DELIMITER)
        return self.is_open
