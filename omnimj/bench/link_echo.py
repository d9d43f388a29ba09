"""Far end of the round trips, a separate process that answers frames and, for comparison, bare bytes."""

from __future__ import annotations

import os
import select
import socket
import sys
import threading
from collections.abc import Callable

from omnimj.link.codec.frames import decode, encode
from omnimj.link.codec.layout import DropReason
from omnimj.link.codec.messages import Command, FaultCode, Frame, Status, Telemetry
from omnimj.link.codec.stream import PacketStream, stuff
from omnimj.link.transport.address import LOOPBACK, UdpAddress
from omnimj.link.transport.udp import UdpListener

RAW = (0.1, -0.2, 0.3, -0.4, 1.0, 2.0, 3.0, 4.0, 0.5, 0.6, 0.7, 1234)
"""Readings of twelve channels; the last one is in counts."""
_COUNTS = 1 << 11
_IDLE_TIMEOUT = 30.0  # [s] without a frame before the process ends
_CHUNK = 4096


def command(sequence: int) -> Frame:
    """Make a command frame with the given sequence number."""
    return Frame(Command((0.3, -0.8, 0.1, 0.7), 0.05), 7, sequence, 1000 * sequence)


def telemetry(sequence: int) -> Frame:
    """Make the telemetry frame that answers the command with this sequence number."""
    message = Telemetry(sequence, 0.0006, Status.ARMED, FaultCode.NONE, 0, 0, RAW, _COUNTS)
    return Frame(message, 7, sequence, 1000 * sequence)


COMMAND_SIZE, TELEMETRY_SIZE = len(encode(command(1))), len(encode(telemetry(1)))
"""Sizes of the datagrams [bytes]; two bytes more on a serial line."""


def _answer(packet: bytes) -> bytes | None:
    found = decode(packet)
    return None if isinstance(found, DropReason) else encode(telemetry(found.sequence))


def _echo_udp() -> None:
    bare = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    bare.bind((LOOPBACK, 0))
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as free:
        free.bind((LOOPBACK, 0))
        port = free.getsockname()[1]
    listener = UdpListener(UdpAddress(LOOPBACK, port))
    reply = bytes(TELEMETRY_SIZE)

    def echo() -> None:
        while True:
            _, peer = bare.recvfrom(2048)
            bare.sendto(reply, peer)

    _begin(echo, f"{port} {bare.getsockname()[1]}")
    while listener.wait(_IDLE_TIMEOUT):
        for packet, peer in listener.receive():
            answer = _answer(packet)
            if answer is not None:
                listener.send(answer, peer)


def _echo_serial(framed: int, bare: int) -> None:
    """Serve the far ends of two pseudo-terminals, given as file descriptors."""
    stream, reply = PacketStream(), bytes(TELEMETRY_SIZE + 2)

    def echo() -> None:
        received = 0
        while True:
            received += len(os.read(bare, _CHUNK))
            if received >= COMMAND_SIZE + 2:
                received = 0
                os.write(bare, reply)

    _begin(echo, "ready")
    while select.select([framed], [], [], _IDLE_TIMEOUT)[0]:
        for packet in stream.feed(os.read(framed, _CHUNK)):
            answer = _answer(packet)
            if answer is not None:
                os.write(framed, stuff(answer))


def _begin(echo: Callable[[], None], word: str) -> None:
    _answer(encode(command(1)))
    threading.Thread(target=echo, daemon=True).start()
    print(word, flush=True)


if __name__ == "__main__":
    if sys.argv[1] == "udp":
        _echo_udp()
    else:
        _echo_serial(int(sys.argv[2]), int(sys.argv[3]))
