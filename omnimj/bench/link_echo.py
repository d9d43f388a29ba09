"""The far end of the round trips, in a process of its own: answers frames, and beside it bare bytes."""

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
"""Of the twelve channels, the last one counts."""
_COUNTS = 1 << 11
_IDLE = 30.0  # [s] without a frame after which nobody is there any more
_AT_ONCE = 4096


def command(sequence: int) -> Frame:
    """What is asked."""
    return Frame(Command((0.3, -0.8, 0.1, 0.7), 0.05), 7, sequence, 1000 * sequence)


def telemetry(sequence: int) -> Frame:
    """What is answered to that."""
    said = Telemetry(sequence, 0.0006, Status.ARMED, FaultCode.NONE, 0, 0, RAW, _COUNTS)
    return Frame(said, 7, sequence, 1000 * sequence)


ASKED_SIZE, ANSWERED_SIZE = len(encode(command(1))), len(encode(telemetry(1)))
"""Of a datagram; on a serial line two bytes more."""


def _answer(packet: bytes) -> bytes | None:
    found = decode(packet)
    return None if isinstance(found, DropReason) else encode(telemetry(found.sequence))


def _echo_udp() -> None:
    bare = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    bare.bind((LOOPBACK, 0))
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as asked:
        asked.bind((LOOPBACK, 0))
        port = asked.getsockname()[1]
    listener = UdpListener(UdpAddress(LOOPBACK, port))
    reply = bytes(ANSWERED_SIZE)

    def echo() -> None:
        while True:
            _, peer = bare.recvfrom(2048)
            bare.sendto(reply, peer)

    _begin(echo, f"{port} {bare.getsockname()[1]}")
    while listener.wait(_IDLE):
        for packet, peer in listener.receive():
            answer = _answer(packet)
            if answer is not None:
                listener.send(answer, peer)


def _echo_serial(framed: int, bare: int) -> None:
    """Both are far ends of pseudo-terminals."""
    stream, reply = PacketStream(), bytes(ANSWERED_SIZE + 2)

    def echo() -> None:
        had = 0
        while True:
            had += len(os.read(bare, _AT_ONCE))
            if had >= ASKED_SIZE + 2:
                had = 0
                os.write(bare, reply)

    _begin(echo, "ready")
    while select.select([framed], [], [], _IDLE)[0]:
        for packet in stream.feed(os.read(framed, _AT_ONCE)):
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
