"""Fuzz test of the codec: every accepted frame must be one that was sent.

Frames are corrupted as by a bad wire and arrive on a serial line and as datagrams, mixed with noise. An
accepted frame is compared byte by byte with the one sent under its sequence number, so that even a checksum
that is right by chance would be detected.
"""

from __future__ import annotations

import random
import struct
import sys
import time
import zlib
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field

from omnimj.link.codec.frames import decode, encode
from omnimj.link.codec.key import KEY_SIZE, Key
from omnimj.link.codec.layout import PROTOCOL, DropCounts, DropReason
from omnimj.link.codec.messages import (
    Arm,
    Challenge,
    Command,
    Fault,
    FaultCode,
    Frame,
    Hello,
    Message,
    MessageType,
    Ping,
    Reset,
    Status,
    Stop,
    Telemetry,
)
from omnimj.link.codec.stream import DELIMITER, PacketStream, stuff

_WINDOW = 4096  # remembered frames; a delayed one arrives after about 50
_BLOCK = 65_536
_PER_ROUND = 1000  # frames between two blocks of noise
_WARM = 20_000
_POOL = 4096


@dataclass
class FuzzReport:
    """Result of a fuzz test."""

    frames: int = 0
    """Frames sent, each on a serial line and as a datagram, corrupted or not."""
    noise: int = 0
    """Number of noise bytes on the line, and again in datagrams."""
    whole: int = 0
    """Frames that arrived unchanged, including duplicates."""
    accepted: int = 0
    """Frames accepted among those that arrived unchanged."""
    wrong: int = 0
    """Accepted frames that were never sent."""
    seconds: float = 0.0
    """Duration [s]."""
    peak_growth: float = 0.0
    """Growth of the peak memory after the first frames [kB]."""
    blocks_growth: int = 0
    """Growth of the number of allocated memory blocks after the first frames."""
    drops: DropCounts = field(default_factory=DropCounts)

    @property
    def passed(self) -> bool:
        """True if exactly the unchanged frames were accepted."""
        return self.wrong == 0 and self.accepted == self.whole


def _peak_memory() -> float:
    """Peak memory of this process [kB]; 0 where the system does not provide it."""
    try:
        import resource
    except ImportError:
        return 0.0
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    return peak / 1024.0 if sys.platform == "darwin" else float(peak)


class _FrameSource:
    """Random frames whose numbers are exact in float32."""

    def __init__(self, rng: random.Random):
        self._rng, self._sequence = rng, 0
        self._numbers = [struct.unpack("<f", struct.pack("<f", rng.gauss(0.0, 2.0)))[0] for _ in range(_POOL)]

    def next(self) -> Frame:
        rng = self._rng
        self._sequence += 1
        return Frame(self._message(), rng.getrandbits(32), self._sequence, rng.getrandbits(64))

    def _some(self, count: int) -> tuple[float, ...]:
        at = self._rng.randrange(_POOL - count)
        return tuple(self._numbers[at : at + count])

    def _message(self) -> Message:
        rng, kind = self._rng, self._rng.random()
        if kind < 0.45:
            raw = (*self._some(11), rng.getrandbits(31))
            return Telemetry(rng.getrandbits(32), 0.001, Status.ARMED, FaultCode.NONE, 0, 0, raw, 1 << 11)
        if kind < 0.9:
            return Command(self._some(4), 0.0625, rng.getrandbits(4), rng.getrandbits(32))
        return rng.choice(
            (
                Hello(rng.getrandbits(64), rng.getrandbits(64), rng.getrandbits(64)),
                Challenge(rng.getrandbits(64), 1 + rng.getrandbits(32), 1 + rng.getrandbits(32)),
                Ping(rng.getrandbits(64)),
                Arm(rng.getrandbits(64), rng.getrandbits(64), rng.getrandbits(32)),
                Fault(FaultCode.HEATING, 2, 1.5, 0.5, rng.getrandbits(32), True),
                Stop(),
                Reset(rng.getrandbits(32)),
            )
        )


def _flipped(rng: random.Random, content: bytes) -> bytes:
    corrupted = bytearray(content)
    for bit in rng.sample(range(8 * len(content)), rng.randint(1, 8)):
        corrupted[bit >> 3] ^= 1 << (bit & 7)
    return bytes(corrupted)


def _extended(rng: random.Random, content: bytes) -> bytes:
    at = rng.randint(0, len(content))
    return content[:at] + rng.choice((rng.randbytes, bytes))(rng.randint(1, 20)) + content[at:]


def _truncated(rng: random.Random, content: bytes) -> bytes:
    begin = rng.randrange(len(content))
    return content[:begin] if rng.random() < 0.5 else content[:begin] + content[begin + rng.randint(1, 9) :]


_CHANGES: tuple[Callable[[random.Random, bytes], bytes], ...] = (
    _flipped,
    _extended,
    _truncated,
    lambda rng, content: b"",
    lambda rng, content: content + content,
)


class _FaultyWire:
    """Wire that corrupts some frames and delays others."""

    def __init__(self, rng: random.Random):
        self._rng = rng
        self._held: list[bytes] = []

    def carry(self, content: bytes) -> Iterator[bytes]:
        kind = self._rng.random()
        if kind < 0.1:
            self._held.append(content)
        elif kind < 0.6:
            yield self._rng.choice(_CHANGES)(self._rng, content)
        else:
            yield content
        if len(self._held) > 4:
            yield self._held.pop(self._rng.randrange(len(self._held)))


class _AcceptanceChecker:
    """Comparison of accepted frames with those sent."""

    def __init__(self, report: FuzzReport, key: Key | None):
        self._report, self._key = report, key
        self._sent: dict[int, tuple[Frame, bytes]] = {}
        self._stuffed: dict[bytes, int] = {}
        self._line = PacketStream()
        self._line.drops = report.drops
        self._carry = b""  # bytes on the line after the last zero

    def sent(self, frame: Frame) -> tuple[bytes, bytes]:
        packet = encode(frame, self._key)
        stuffed = stuff(packet)
        self._sent[frame.sequence] = frame, packet
        self._stuffed[stuffed[:-1]] = frame.sequence
        if len(self._sent) > _WINDOW:
            self._sent.pop(next(iter(self._sent)))
            self._stuffed.pop(next(iter(self._stuffed)))
        return packet, stuffed

    def take_datagram(self, packet: bytes) -> None:
        self._report.whole += any(packet == sent for _, sent in self._named(packet))
        self._accept(packet)

    def take_bytes(self, chunk: bytes) -> None:
        pieces = (self._carry + chunk).split(DELIMITER)
        self._carry = pieces.pop()[-2 * _BLOCK :]
        self._report.whole += sum(piece in self._stuffed for piece in pieces)
        for packet in self._line.feed(chunk):
            self._accept(packet)

    def _named(self, packet: bytes) -> Iterator[tuple[Frame, bytes]]:
        """Frame sent under the sequence number in these bytes, if any."""
        found = self._sent.get(int.from_bytes(packet[8:12], "little"))
        if found is not None:
            yield found

    def _accept(self, packet: bytes) -> None:
        found = decode(packet, self._key)
        if isinstance(found, DropReason):
            self._report.drops.add(found)
            return
        for frame, sent in self._named(packet):
            if packet == sent and found.message == frame.message and found.session == frame.session:
                self._report.accepted += 1
                return
        if not isinstance(found.message, Stop) or self._key is None:
            self._report.wrong += 1


def _noise(rng: random.Random, size: int) -> bytes:
    """Noise: uniform, with about as many zeros as frames have, or of few values."""
    kind = rng.randrange(3)
    if kind == 0:
        return rng.randbytes(size)
    if kind == 1:
        return b"\0".join(
            rng.randbytes(rng.randint(0, 600)).replace(b"\0", b"\1") for _ in range(size // 300)
        )
    return rng.randbytes(size).translate(bytes((0, 1, 2, 29, 255)[i % 5] for i in range(256)))


def _send_frames(
    rng: random.Random,
    source: _FrameSource,
    judge: _AcceptanceChecker,
    wires: tuple[_FaultyWire, _FaultyWire],
    count: int,
) -> None:
    line: list[bytes] = []
    for _ in range(count):
        packet, stuffed = judge.sent(source.next())
        for datagram in wires[0].carry(packet):
            judge.take_datagram(datagram)
        line += wires[1].carry(stuffed)
        if len(line) > rng.randrange(20):
            chunk = b"".join(line)
            cut = rng.randint(0, len(chunk))
            judge.take_bytes(chunk[:cut])
            judge.take_bytes(chunk[cut:])
            line = []
    judge.take_bytes(b"".join(line))


def _send_noise(rng: random.Random, judge: _AcceptanceChecker, size: int, keyed: bool) -> int:
    """Send a block of noise on the line and as datagrams; on a keyed link some with a valid checksum."""
    block = _noise(rng, size)[:size]
    judge.take_bytes(block)
    at = 0
    while at < len(block):
        datagram = block[at : at + rng.randint(0, 600)]
        at += len(datagram) + 1
        if keyed and rng.random() < 0.5 and len(datagram) > 24:
            begin = bytes((PROTOCOL, 1 + datagram[1] % len(MessageType), 1, 0))
            datagram = begin + datagram[4:500]
            datagram += zlib.crc32(datagram).to_bytes(4, "little")
        judge.take_datagram(datagram)
    return len(block)


def fuzz(frames: int, noise: int, seed: int, progress: Callable[[int], object] | None = None) -> FuzzReport:
    """Send frames over bad wires, half of them on a keyed link."""
    rng, report = random.Random(seed), FuzzReport()
    keys = (None, Key(rng.randbytes(KEY_SIZE)))
    links = [
        (_AcceptanceChecker(report, key), (_FaultyWire(rng), _FaultyWire(rng)), key is not None)
        for key in keys
    ]
    source, begin, warm = _FrameSource(rng), time.perf_counter(), None
    while report.frames < frames or report.noise < noise:
        judge, wires, keyed = links[rng.randrange(2)]
        count = min(_PER_ROUND, frames - report.frames)
        _send_frames(rng, source, judge, wires, count)
        report.frames += count
        # noise in proportion to the frames
        due = noise if report.frames >= frames else noise * report.frames // max(1, frames)
        while report.noise < due:
            report.noise += _send_noise(rng, judge, min(_BLOCK, due - report.noise), keyed) or 1
        if warm is None and report.frames >= min(_WARM, frames // 2):
            warm = _peak_memory(), sys.getallocatedblocks()
        if progress is not None:
            progress(report.frames)
    report.seconds = time.perf_counter() - begin
    if warm is not None:
        report.peak_growth = _peak_memory() - warm[0]
        report.blocks_growth = sys.getallocatedblocks() - warm[1]
    return report
