"""How long frames take to and from bytes."""

from __future__ import annotations

import random
import time
from collections.abc import Callable
from dataclasses import dataclass

from omnimj.hardware import cobs
from omnimj.hardware.frames import decode, encode
from omnimj.hardware.key_file import KEY_SIZE, Key
from omnimj.hardware.messages import Command, FaultCode, Frame, Status, Telemetry

_SEED = 1
_CHANNELS = 12


@dataclass(frozen=True)
class CodecTime:
    """Of one kind of frame on one kind of link."""

    name: str
    """As `telemetry serial keyed`."""
    encode: float
    """From record to bytes [s]."""
    decode: float
    """From bytes to record [s]."""


def _frames() -> dict[str, Frame]:
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


def _least(work: Callable[[], object], times: int, rounds: int) -> float:
    """Mean over `times`, the least of some rounds: what else the machine does is not the codec's [s]."""
    means = []
    for _ in range(rounds):
        begin = time.perf_counter()
        for _ in range(times):
            work()
        means.append((time.perf_counter() - begin) / times)
    return min(means)


def codec_times(times: int = 10_000, rounds: int = 5) -> tuple[CodecTime, ...]:
    """Times of telemetry of 12 channels and of a command of 4 currents, on serial and UDP, keyed and not.

    Args:
      times: Frames in a round.
      rounds: The least mean counts.
    """
    found = []
    for name, frame in _frames().items():
        for key in (None, Key(bytes(range(KEY_SIZE)))):
            papers = " keyed" if key else ""
            packet = encode(frame, key)
            stuffed = cobs.encode(packet)
            found.append(
                CodecTime(
                    f"{name} udp{papers}",
                    _least(lambda f=frame, k=key: encode(f, k), times, rounds),
                    _least(lambda p=packet, k=key: decode(p, k), times, rounds),
                )
            )
            found.append(
                CodecTime(
                    f"{name} serial{papers}",
                    _least(lambda f=frame, k=key: cobs.encode(encode(f, k)), times, rounds),
                    _least(lambda s=stuffed, k=key: decode(cobs.decode(s) or b"", k), times, rounds),
                )
            )
    return tuple(found)
