"""UDP transport: one packet per datagram, non-blocking.

On Linux the kernel stamps datagrams on arrival, so that their time in the queue of a busy program is known.
Beyond loopback a link must have a key, since the sender's address of a datagram can be forged.
"""

from __future__ import annotations

import contextlib
import select
import socket
import struct
import sys
import time

from omnimj.errors import InputError
from omnimj.link.codec.layout import MAX_FRAME_SIZE, DropCounts, DropReason
from omnimj.link.transport.address import UdpAddress, is_loopback
from omnimj.link.transport.interface import Packet, Peer

_MAX_DATAGRAMS = 64  # datagrams per call, so that a flood cannot delay the caller
_BUFFER = 2048
_TIMESTAMPNS = 35  # SO_TIMESTAMPNS of Linux, which the socket module does not name
_STAMP = struct.Struct("@ll")  # timespec: seconds, nanoseconds
_ANCILLARY = socket.CMSG_SPACE(_STAMP.size) if hasattr(socket, "CMSG_SPACE") else 0


def resolve(address: UdpAddress, keyed: bool, passive: bool) -> tuple[socket.AddressFamily, tuple]:
    """Resolve the host name into address family and numeric address, an own one if passive.

    Raises:
      InputError: Unknown host, or an address beyond loopback without a key.
    """
    flags = socket.AI_PASSIVE if passive else 0
    try:
        found = socket.getaddrinfo(address.host, address.port, type=socket.SOCK_DGRAM, flags=flags)
    except (OSError, UnicodeError) as error:
        raise InputError(address, f"host '{address.host}' not found ({error})") from None
    family, _, _, _, numeric = found[0]
    if not keyed and not is_loopback(str(numeric[0])):
        raise InputError(address, "not on loopback, and no key", "a key file is required (--key-file)")
    return family, numeric


class _Socket:
    """Non-blocking socket, common to both ends."""

    def __init__(self, family: socket.AddressFamily):
        self.failures, self.drops = 0, DropCounts()
        self._socket = socket.socket(family, socket.SOCK_DGRAM)
        self._socket.setblocking(False)
        self._stamps = False
        if sys.platform == "linux":
            with contextlib.suppress(OSError):
                self._socket.setsockopt(socket.SOL_SOCKET, _TIMESTAMPNS, 1)
                self._stamps = True

    def _received(self) -> list[tuple[bytes, Peer]]:
        found, failed = [], False
        for _ in range(_MAX_DATAGRAMS):
            try:
                packet, peer = self._receive_one()
            except BlockingIOError:
                break
            except OSError:  # port unreachable, network down, or closed
                self.failures += 1
                if failed:
                    break
                failed = True
                continue
            if len(packet) > MAX_FRAME_SIZE:
                self.drops.add(DropReason.TOO_LONG)
            else:
                found.append((packet, peer))
        return found

    def _receive_one(self) -> tuple[Packet, Peer]:
        """Receive a datagram with its sender and the time that it has waited."""
        if not self._stamps:
            content, peer = self._socket.recvfrom(_BUFFER)
            return Packet(content), peer
        content, ancillary, _, peer = self._socket.recvmsg(_BUFFER, _ANCILLARY)
        packet = Packet(content)
        for level, kind, stamp in ancillary:
            if (level, kind, len(stamp)) == (socket.SOL_SOCKET, _TIMESTAMPNS, _STAMP.size):
                seconds, nanoseconds = _STAMP.unpack(stamp)
                arrived = seconds * 1_000_000_000 + nanoseconds
                # a clock of the day that is set back must not let a packet arrive in the future
                packet.waited = max(0.0, 1e-9 * (time.time_ns() - arrived))
        return packet, peer

    @property
    def is_open(self) -> bool:
        """False once the socket is closed; a network that is down is only silent."""
        return self._socket.fileno() >= 0

    def wait(self, longest: float) -> bool:
        """True if a packet arrives within this time [s]."""
        if not self.is_open:
            return False
        return bool(select.select([self._socket], [], [], max(0.0, longest))[0])

    def close(self) -> None:
        """Close the socket; may be called twice."""
        self._socket.close()


class UdpTransport(_Socket):
    """Host's end: a connected socket, which receives from the device's address only."""

    def __init__(self, address: UdpAddress, keyed: bool = False):
        """Open a socket; nothing is sent.

        Args:
          address: Address of the device.
          keyed: Whether the link has a key.

        Raises:
          InputError: Unknown host, no route, or an address beyond loopback without a key.
        """
        family, numeric = resolve(address, keyed, passive=False)
        super().__init__(family)
        try:
            self._socket.connect(numeric)
        except OSError as error:
            self.close()
            raise InputError(address, f"cannot be reached ({error.strerror})") from None

    def send(self, packet: bytes) -> None:
        """Send one datagram, or count a failure."""
        try:
            self._socket.send(packet)
        except OSError:
            self.failures += 1

    def receive(self) -> list[bytes]:
        """Received datagrams, at most 64."""
        return [packet for packet, _ in self._received()]


class UdpListener(_Socket):
    """Device's end: accepts datagrams from any sender."""

    def __init__(self, address: UdpAddress, keyed: bool = False):
        """Bind a socket.

        Args:
          address: Own address; loopback restricts the senders to this machine.
          keyed: Whether the link has a key.

        Raises:
          InputError: The address is not available, or beyond loopback without a key.
        """
        family, numeric = resolve(address, keyed, passive=True)
        super().__init__(family)
        try:
            self._socket.bind(numeric)
        except OSError as error:
            self.close()
            reason = (error.strerror or str(error)).lower()
            raise InputError(
                address, f"cannot be used, {reason}", "another port, or an address of this machine, is needed"
            ) from None

    @property
    def port(self) -> int:
        """Port to which the socket is bound."""
        return self._socket.getsockname()[1]

    def send(self, packet: bytes, peer: Peer) -> None:
        """Send one datagram, or count a failure."""
        try:
            self._socket.sendto(packet, peer)  # type: ignore[arg-type]  # as `receive` gave it
        except (OSError, TypeError):
            self.failures += 1

    def receive(self) -> list[tuple[bytes, Peer]]:
        """Received datagrams with their senders, at most 64."""
        return self._received()
