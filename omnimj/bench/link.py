"""Codec times, and round-trip times of frames compared with bare bytes of the same size."""

from __future__ import annotations

import contextlib
import os
import random
import socket
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from typing import IO, Any

import numpy as np

from omnimj.bench.link_echo import COMMAND_SIZE, TELEMETRY_SIZE, command
from omnimj.errors import OmnimjError
from omnimj.link.codec.frames import decode, encode
from omnimj.link.codec.key import KEY_SIZE, Key
from omnimj.link.codec.layout import DropReason
from omnimj.link.codec.messages import Command, FaultCode, Frame, Status, Telemetry
from omnimj.link.codec.stream import stuff, unstuff
from omnimj.link.transport.address import LOOPBACK, SerialAddress, UdpAddress
from omnimj.link.transport.interface import Transport
from omnimj.link.transport.serial_port import SerialTransport
from omnimj.link.transport.udp import UdpTransport

_SEED = 1
_CHANNELS = 12
_TIMEOUT = 5.0  # [s] to wait for one answer
_PART = 200  # round trips of one kind before the other, so that both run under the same load
_WARM_UP_TRIPS = 100


def _codec_frames() -> dict[str, Frame]:
    rng = random.Random(_SEED)
    raw = tuple(rng.gauss(0.0, 1.0) for _ in range(_CHANNELS - 1))
    telemetry = Telemetry(1200, 0.0006, Status.ARMED, FaultCode.NONE, 0, 0, (*raw, -4), 1 << _CHANNELS - 1)
    session = rng.getrandbits(32)
    return {
        "telemetry": Frame(telemetry, session, 1234, 1_234_567),
        "telemetry at rest": Frame(
            Telemetry(0, float("inf"), Status(0), FaultCode.NONE, 0, 0, (0.0,) * _CHANNELS), session, 1, 1
        ),
        "command": Frame(Command((0.3, -0.8, 0.1, 0.7), 0.05), session, 1234, 1_234_567),
    }


def _min_mean_time(work: Callable[[], object], times: int, rounds: int) -> float:
    """Return the shortest mean time of a call [s] over several rounds, which excludes other load."""
    means = []
    for _ in range(rounds):
        begin = time.perf_counter()
        for _ in range(times):
            work()
        means.append((time.perf_counter() - begin) / times)
    return min(means)


def codec_times(times: int = 10_000, rounds: int = 5) -> dict[str, tuple[float, float]]:
    """Measure the codec with telemetry of 12 channels and commands of 4 currents on every kind of link.

    Args:
      times: Frames per round.
      rounds: Number of rounds; the shortest mean is reported.

    Returns:
      Frame and link, such as `telemetry serial keyed` → time from record to bytes, and back [s].
    """
    found = {}
    for name, frame in _codec_frames().items():
        for key in (None, Key(random.Random(1).randbytes(KEY_SIZE))):
            keyed = " keyed" if key else ""
            packet = encode(frame, key)
            stuffed = stuff(packet)[:-1]
            found[f"{name} udp{keyed}"] = (
                _min_mean_time(lambda f=frame, k=key: encode(f, k), times, rounds),
                _min_mean_time(lambda p=packet, k=key: decode(p, k), times, rounds),
            )
            found[f"{name} serial{keyed}"] = (
                _min_mean_time(lambda f=frame, k=key: stuff(encode(f, k)), times, rounds),
                _min_mean_time(lambda s=stuffed, k=key: decode(unstuff(s) or b"", k), times, rounds),
            )
    return found


class EchoLost(OmnimjError, ConnectionError):
    """Error raised when the far end of a round trip does not answer."""


def measure_link(times: int, trips: int) -> dict[str, float]:
    """Measure codec times and round trips [µs].

    Args:
      times: Frames per round of the codec; the slowest kind of frame is reported.
      trips: Round trips of command and telemetry per connection, and as many of bare bytes.

    Raises:
      EchoLost: The far end does not answer.
    """
    codec = codec_times(times)
    found = {}
    for keyed in (False, True):
        name = "codec_keyed" if keyed else "codec"
        of_kind = [both for kind, both in codec.items() if kind.endswith("keyed") is keyed]
        encoding, decoding = zip(*of_kind, strict=True)
        found[f"{name}_encode_us"], found[f"{name}_decode_us"] = 1e6 * max(encoding), 1e6 * max(decoding)
    found |= _figures("udp", *_udp_trips(trips))
    if os.name == "posix":
        found |= _figures("serial", *_serial_trips(trips))
    return found


def _figures(wire: str, framed: np.ndarray, bare: np.ndarray) -> dict[str, float]:
    found = {}
    for name, seconds in (("round_trip", framed), ("bare_echo", bare)):
        found[f"{wire}_{name}_p50_us"] = 1e6 * float(np.median(seconds))
        found[f"{wire}_{name}_p99_us"] = 1e6 * float(np.quantile(seconds, 0.99))
        found[f"{wire}_{name}_max_us"] = 1e6 * float(seconds.max())
    found[f"{wire}_round_trip_ratio"] = float(np.median(framed) / np.median(bare))
    return found


def _time_alternately(
    framed: Callable[[int], object], bare: Callable[[], object], trips: int
) -> tuple[np.ndarray, np.ndarray]:
    """Measure alternating round trips of both kinds, each of shape (trips,) or slightly longer [s]."""
    times: tuple[list[float], list[float]] = [], []
    sequence = 0
    while len(times[0]) < trips + _WARM_UP_TRIPS:
        for _ in range(_PART):
            sequence += 1
            begin = time.perf_counter()
            framed(sequence)
            times[0].append(time.perf_counter() - begin)
        for _ in range(_PART):
            begin = time.perf_counter()
            bare()
            times[1].append(time.perf_counter() - begin)
    return np.array(times[0][_WARM_UP_TRIPS:]), np.array(times[1][_WARM_UP_TRIPS:])


def _frame_round_trip(transport: Transport) -> Callable[[int], object]:
    """Return a function that sends a command and waits for its telemetry, from record to record."""

    def ask(sequence: int) -> None:
        transport.send(encode(command(sequence)))
        while transport.wait(_TIMEOUT):
            for packet in transport.receive():
                found = decode(packet)
                if not isinstance(found, DropReason) and found.sequence == sequence:
                    return
        raise EchoLost("bench: a frame was not answered")

    return ask


@contextlib.contextmanager
def _echo_process(*arguments: Any, files: tuple[int, ...] = ()) -> Iterator[str]:
    """Context with the process at the far end; yields the line that it prints when ready."""
    program = [sys.executable, "-m", "omnimj.bench.link_echo", *map(str, arguments)]
    with subprocess.Popen(program, stdout=subprocess.PIPE, pass_fds=files, text=True) as process:
        try:
            assert process.stdout is not None
            yield _first_line(process.stdout)
        finally:
            process.kill()


def _first_line(output: IO[str]) -> str:
    line = output.readline()
    if not line:
        raise EchoLost("bench: the far end did not start")
    return line


def _udp_trips(trips: int) -> tuple[np.ndarray, np.ndarray]:
    with (
        _echo_process("udp") as line,
        socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as plain,
    ):
        port, bare_port = map(int, line.split())
        transport = UdpTransport(UdpAddress(LOOPBACK, port))
        plain.connect((LOOPBACK, bare_port))
        plain.settimeout(_TIMEOUT)
        request = bytes(COMMAND_SIZE)

        def bare() -> None:
            plain.send(request)
            plain.recv(2048)

        try:
            return _time_alternately(_frame_round_trip(transport), bare, trips)
        finally:
            transport.close()


def _serial_trips(trips: int) -> tuple[np.ndarray, np.ndarray]:
    import tty

    ends = [*os.openpty(), *os.openpty()]
    far, near, bare_far, bare_near = ends
    try:
        tty.setraw(bare_near)
        transport = SerialTransport(SerialAddress(os.ttyname(near)))
        request, back = bytes(COMMAND_SIZE + 2), TELEMETRY_SIZE + 2

        def bare() -> None:
            os.write(bare_near, request)
            received = 0
            while received < back:
                received += len(os.read(bare_near, 4096))

        try:
            with _echo_process("serial", far, bare_far, files=(far, bare_far)):
                return _time_alternately(_frame_round_trip(transport), bare, trips)
        finally:
            transport.close()
    finally:
        for end in ends:
            os.close(end)
