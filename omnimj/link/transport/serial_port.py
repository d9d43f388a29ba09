"""A serial port, USB or pseudo-terminal: packets stuffed and ended by zero, without waiting."""

from __future__ import annotations

import os
import select
import time

import serial

from omnimj.errors import InputError
from omnimj.link.codec.layout import DropCounts
from omnimj.link.codec.stream import DELIMITER, PacketStream, stuff
from omnimj.link.transport.address import SerialAddress

_AT_ONCE = 4096  # bytes in one call: a babbling line must not keep the caller from its period
_NAP = 0.0005  # [s] between looks where the system cannot wait for a port


class SerialTransport:
    """Either end of a serial line; the port is ours alone, where the system has such locks."""

    def __init__(self, address: SerialAddress):
        """Opens the port; a zero goes out, so that what was on the line before ends there.

        Raises:
          InputError: There is no such port, it is in use, or it does not do this rate.
        """
        self.failures = 0
        exclusive = True if os.name == "posix" else None
        try:
            self._port = serial.Serial(
                address.path, address.baud, timeout=0, write_timeout=0, exclusive=exclusive
            )
        except (OSError, ValueError, OverflowError) as error:  # serial's own are OSErrors
            raise InputError(address, f"cannot be opened ({error})") from None
        self._stream = PacketStream()
        self._unsent = b""  # of a packet that is out in part
        self._write(DELIMITER)

    @property
    def drops(self) -> DropCounts:
        """What was no packet."""
        return self._stream.drops

    def send(self, packet: bytes) -> None:
        """Sends; a packet that the port has no room for is dropped, since a late one is worth nothing."""
        self._finish()
        stuffed = stuff(packet)
        sent = 0 if self._unsent else self._write(stuffed)
        if sent == 0:
            self.failures += 1
        else:
            self._unsent = stuffed[sent:]

    def _finish(self) -> None:
        """The end of a packet whose beginning is out already."""
        if self._unsent:
            self._unsent = self._unsent[self._write(self._unsent) :]

    def _write(self, content: bytes) -> int:
        """Bytes that went out."""
        try:
            # where a port would have to wait, the library tries for ever
            if os.name == "posix" and not select.select([], [self._port], [], 0.0)[1]:
                return 0
            return self._port.write(content) or 0
        except (OSError, TypeError, ValueError):  # unplugged, or closed
            return 0

    def receive(self) -> list[bytes]:
        """The packets that end in what is there, at most 4096 bytes; checksums are not looked at."""
        try:
            self._finish()
            waiting = self._port.in_waiting
            chunk = self._port.read(min(waiting, _AT_ONCE)) if waiting else b""
        except (OSError, TypeError, ValueError):
            self.failures += 1
            return []
        return self._stream.feed(chunk) if chunk else []

    def wait(self, longest: float) -> bool:
        """Whether bytes have come within this time [s]."""
        if not self._port.is_open:
            return False
        try:
            if os.name == "posix":
                return bool(select.select([self._port], [], [], max(0.0, longest))[0])
            until = time.monotonic() + longest
            while not self._port.in_waiting and time.monotonic() < until:
                time.sleep(_NAP)
            return bool(self._port.in_waiting)
        except OSError:
            self.failures += 1
            return False

    def close(self) -> None:
        """Lets go of the port; may be called twice."""
        self._port.close()
