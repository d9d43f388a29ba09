"""Datagrams of the standard library, one packet in each, without waiting.

Off loopback a link must have a key: everybody can write a sender's address on a datagram.
"""

from __future__ import annotations

import select
import socket

from omnimj.errors import InputError
from omnimj.link.codec.layout import MAX_FRAME_SIZE
from omnimj.link.transport.address import UdpAddress, is_loopback
from omnimj.link.transport.interface import Peer

_AT_ONCE = 64  # datagrams in one call: a flood must not keep the caller from its period
_BUFFER = 2048


def _resolved(address: UdpAddress, keyed: bool, passive: bool) -> tuple[socket.AddressFamily, tuple]:
    """Family and numeric address.

    Raises:
      InputError: There is no such host, or it is not this machine and there is no key.
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
    """What both ends have in common."""

    def __init__(self, family: socket.AddressFamily):
        self.failures = 0
        self._socket = socket.socket(family, socket.SOCK_DGRAM)
        self._socket.setblocking(False)

    def _received(self) -> list[tuple[bytes, Peer]]:
        found, failed = [], False
        for _ in range(_AT_ONCE):
            try:
                packet, peer = self._socket.recvfrom(_BUFFER)
            except BlockingIOError:
                break
            except OSError:  # nobody listens there, it says; or the network is gone, or we are closed
                self.failures += 1
                if failed:
                    break
                failed = True
                continue
            if len(packet) > MAX_FRAME_SIZE:
                self.failures += 1
            else:
                found.append((packet, peer))
        return found

    def wait(self, longest: float) -> bool:
        """Whether something has come within this time [s]."""
        if self._socket.fileno() < 0:
            return False
        return bool(select.select([self._socket], [], [], max(0.0, longest))[0])

    def close(self) -> None:
        """Lets go of the socket; may be called twice."""
        self._socket.close()


class UdpTransport(_Socket):
    """The host's end: connected, so that the system lets in nobody but the device's address."""

    def __init__(self, address: UdpAddress, keyed: bool = False):
        """Opens a socket; nothing is sent.

        Args:
          address: The device's.
          keyed: Whether this link has a key.

        Raises:
          InputError: No such host, no way there, or it is off loopback without a key.
        """
        family, numeric = _resolved(address, keyed, passive=False)
        super().__init__(family)
        try:
            self._socket.connect(numeric)
        except OSError as error:
            self.close()
            raise InputError(address, f"cannot be reached ({error.strerror})") from None

    def send(self, packet: bytes) -> None:
        """Sends one datagram, or counts a failure."""
        try:
            self._socket.send(packet)
        except OSError:
            self.failures += 1

    def receive(self) -> list[bytes]:
        """The datagrams that have come, at most 64."""
        return [packet for packet, _ in self._received()]


class UdpListener(_Socket):
    """The device's end: hears everybody who finds it."""

    def __init__(self, address: UdpAddress, keyed: bool = False):
        """Binds a socket.

        Args:
          address: Its own; the loopback one lets in this machine only.
          keyed: Whether this link has a key.

        Raises:
          InputError: Not ours or taken, or it is off loopback without a key.
        """
        family, numeric = _resolved(address, keyed, passive=True)
        super().__init__(family)
        try:
            self._socket.bind(numeric)
        except OSError as error:
            self.close()
            raise InputError(address, f"cannot be bound ({error.strerror})") from None

    @property
    def port(self) -> int:
        """That it is bound to."""
        return self._socket.getsockname()[1]

    def send(self, packet: bytes, peer: Peer) -> None:
        """Sends one datagram, or counts a failure."""
        try:
            self._socket.sendto(packet, peer)  # type: ignore[arg-type]  # as `receive` gave it
        except (OSError, TypeError):
            self.failures += 1

    def receive(self) -> list[tuple[bytes, Peer]]:
        """The datagrams that have come and from where, at most 64."""
        return self._received()
