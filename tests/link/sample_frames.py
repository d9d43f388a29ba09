"""Frames for tests: one of every kind in extremes, strategies for any, and how a frame reads as text."""

from __future__ import annotations

import hashlib
import math
import struct
from dataclasses import astuple

from hypothesis import strategies as st

from omnimj.link.codec.key import Key
from omnimj.link.codec.layout import microseconds
from omnimj.link.codec.messages import (
    Arm,
    Capabilities,
    Challenge,
    ChannelKind,
    Command,
    Fault,
    FaultCode,
    Frame,
    Hello,
    Limits,
    MessageType,
    Ping,
    Pong,
    Quantity,
    Raw,
    Reset,
    Status,
    Stop,
    Telemetry,
    counts_mask,
)
from omnimj.link.device.config import limits_hash

SECRET = hashlib.blake2s(b"the key of the golden frames").digest()
KEY = Key(SECRET)
LIMITS = Limits(1.5, 1000.0, 0.75, 0.5, 40.0, 2000.0, 0.25)
CHANNELS = (
    *(ChannelKind(Quantity.CURRENT, i, Raw.VOLTS) for i in range(1, 5)),
    *(ChannelKind(Quantity.WHEEL_SPEED, i, Raw.VOLTS) for i in range(1, 5)),
    ChannelKind(Quantity.ACCELERATION_X, 0, Raw.VOLTS),
    ChannelKind(Quantity.ACCELERATION_Y, 0, Raw.VOLTS),
    ChannelKind(Quantity.YAW_RATE, 0, Raw.VOLTS),
    ChannelKind(Quantity.YAW, 0, Raw.COUNTS),
)
CALIBRATION = 0x0123456789ABCDEF
ROBOT = Capabilities(0x1122334455667788, 0.001, False, 4, CHANNELS, LIMITS, limits_hash(LIMITS), CALIBRATION)
_MANY = tuple(ChannelKind(Quantity(i % 8), i % 9, Raw(i % 2)) for i in range(32))
_VOLTS = (0.5, -1.25, 0.0, -0.0, 2.0, 2.5, -3.0, 0.1, 9.75, 0.0078125, 1e-20)

GOLDEN: dict[str, Frame] = {
    "hello": Frame(Hello(0x1122334455667788), 0, 1, 5),
    "hello with a cookie": Frame(Hello(0x1122334455667788, 0x99AABBCCDDEEFF00, 0x0102030405060708), 0, 2, 6),
    "challenge": Frame(Challenge(0x1122334455667788, 0x99AABBCCDDEEFF00, 0x0102030405060708), 0, 0, 7),
    "hello of ones": Frame(Hello(2**64 - 1, 2**64 - 1, 2**64 - 1), 2**32 - 1, 2**32 - 1, 2**64 - 1),
    "capabilities of the robot": Frame(ROBOT, 0xC0FFEE01, 1, 1_000_000),
    "capabilities of 8 wheels": Frame(
        Capabilities(0, 0.002, True, 8, _MANY, LIMITS, 0, 2**64 - 1), 0xC0FFEE02, 1, 0
    ),
    "arm": Frame(Arm(limits_hash(LIMITS), CALIBRATION, 41), 0xC0FFEE01, 2, 1_000_500),
    "command": Frame(Command((0.25, -0.5, 1.5, -1.5), 0.05, 0, 42), 0xC0FFEE01, 3, 1_001_000),
    "command of zero": Frame(Command((0.0, -0.0, 0.0, 0.0), 0.2), 0xC0FFEE01, 4, 1_002_000),
    "command that is not finite": Frame(
        Command((math.nan, math.inf, -math.inf, 3.4028234663852886e38), 0.0), 1, 5, 7
    ),
    "command of one wheel, braked": Frame(Command((0.0,), 0.05, 1, 2**32 - 1), 1, 6, 8),
    "command of 8 wheels, all braked": Frame(Command((0.125,) * 8, math.nan, 255), 1, 7, 9),
    "telemetry of the robot": Frame(
        Telemetry(3, 0.0006, Status.ARMED, FaultCode.NONE, 1, 2, (*_VOLTS, -4096), counts_mask(CHANNELS)),
        0xC0FFEE01,
        42,
        1_002_000,
    ),
    "telemetry at rest": Frame(
        Telemetry(0, math.inf, Status(0), FaultCode.NONE, 0, 0, (0.0,) * 12), 0xC0FFEE01, 1, 1_000_000
    ),
    "telemetry of 32 channels": Frame(
        Telemetry(
            2**32 - 1,
            4293.0,
            Status(127),
            FaultCode.CURRENT_DEVIATION,
            2**32 - 1,
            2**32 - 1,
            (math.nan, math.inf, *(i * 0.5 for i in range(14)), *(-(2**31) + i for i in range(16))),
            0xFFFF0000,
        ),
        2**32 - 1,
        2**32 - 1,
        2**64 - 1,
    ),
    "telemetry without channels": Frame(
        Telemetry(0, 0.0, Status.LOCK_STEP, FaultCode.SENSOR, 0, 0, ()), 7, 1, 0
    ),
    "stop": Frame(Stop(), 0xC0FFEE01, 5, 1_003_000),
    "stop of nobody's session": Frame(Stop(), 0, 0, 0),
    "fault": Frame(Fault(FaultCode.CURRENT, 3, 1.75, 1.5, 17, True), 0xC0FFEE01, 43, 1_003_500),
    "fault, not latched": Frame(
        Fault(FaultCode.ARM_LIMITS, 0, math.nan, 0.0, 0, False), 0xC0FFEE01, 44, 1_004_000
    ),
    "reset": Frame(Reset(46), 0xC0FFEE01, 6, 1_005_000),
    "ping": Frame(Ping(0xFEDCBA9876543210), 0xC0FFEE01, 7, 1_006_000),
    "pong": Frame(Pong(0xFEDCBA9876543210), 0xC0FFEE01, 45, 1_006_250),
}


def _bits(value: float) -> str:
    if math.isnan(value):
        return "nan"  # one is as good as another, and processors turn one into another
    return struct.pack(">f", value).hex()


def _fields(message: object) -> list[str]:
    if isinstance(message, Hello | Challenge):
        return [f"{number:016x}" for number in (message.nonce, message.cookie, message.device)]
    if isinstance(message, Reset):
        return [str(message.telemetry)]
    if isinstance(message, Ping | Pong):
        return [f"{message.nonce:016x}"]
    if isinstance(message, Capabilities):
        limits = ",".join(_bits(number) for number in astuple(message.limits))
        kinds = ",".join(f"{kind.quantity:d}/{kind.wheel}/{kind.raw:d}" for kind in message.channels)
        hashes = [
            f"{number:016x}" for number in (message.nonce, message.limits_hash, message.calibration_hash)
        ]
        about = [str(microseconds(message.period)), str(int(message.lock_step)), str(message.wheels)]
        return [*hashes, *about, limits, kinds]
    if isinstance(message, Arm):
        return [f"{message.limits_hash:016x}", f"{message.calibration_hash:016x}", str(message.telemetry)]
    if isinstance(message, Command):
        currents = ",".join(map(_bits, message.currents))
        return [_bits(message.valid_for), str(message.brake), str(message.telemetry), currents]
    if isinstance(message, Telemetry):
        age = 0xFFFFFFFF if math.isinf(message.command_age) else microseconds(message.command_age)
        raw = ",".join(
            f"{int(value) & 0xFFFFFFFF:08x}" if message.counts >> i & 1 else _bits(value)
            for i, value in enumerate(message.raw)
        )
        numbers = (message.acknowledged, age, int(message.status), int(message.fault))
        return [*map(str, (*numbers, message.refused, message.dropped)), f"{message.counts:08x}", raw]
    if isinstance(message, Fault):
        numbers = (int(message.code), message.wheel, int(message.latched))
        return [*map(str, numbers), _bits(message.value), _bits(message.limit), str(message.sequence)]
    return []


def describe(frame: Frame) -> str:
    """The frame as one line, every float by its bits, so that −0 is distinguished, too."""
    message = frame.message
    kind = next(kind for kind in MessageType if kind.name.replace("_", "") == type(message).__name__.upper())
    head = [str(int(kind)), str(frame.session), str(frame.sequence), str(frame.time)]
    return " ".join(
        [*head, str(int(frame.authentic)), str(int(frame.same_schema)), *_fields(message)]
    ).strip()


def _whole(bits: int) -> st.SearchStrategy[int]:
    return st.integers(0, 2**bits - 1)


def _above_zero() -> st.SearchStrategy[float]:
    return st.floats(min_value=2.0**-126, max_value=2.0**127, width=32)


def _limits() -> st.SearchStrategy[Limits]:
    return st.builds(Limits, *[_above_zero()] * 7)


@st.composite
def capabilities(draw: st.DrawFn) -> Capabilities:
    """Any."""
    wheels = draw(st.integers(1, 8))
    kinds = st.builds(ChannelKind, st.sampled_from(Quantity), st.integers(0, wheels), st.sampled_from(Raw))
    return Capabilities(
        draw(_whole(64)),
        draw(st.integers(1, 4_000_000_000)) / 1e6,
        draw(st.booleans()),
        wheels,
        tuple(draw(st.lists(kinds, max_size=32))),
        draw(_limits()),
        draw(_whole(64)),
        draw(_whole(64)),
    )


@st.composite
def commands(draw: st.DrawFn) -> Command:
    """Any, also such as no device takes."""
    currents = tuple(draw(st.lists(st.floats(width=32), min_size=1, max_size=8)))
    brake = draw(st.integers(0, 2 ** len(currents) - 1))
    return Command(currents, draw(st.floats(width=32)), brake, draw(_whole(32)))


@st.composite
def telemetries(draw: st.DrawFn) -> Telemetry:
    """Any."""
    channels = draw(st.integers(0, 32))
    counts = draw(st.integers(0, 2**channels - 1))
    count, volts = st.integers(-(2**31), 2**31 - 1), st.floats(width=32)
    return Telemetry(
        draw(_whole(32)),
        draw(st.one_of(st.just(math.inf), st.integers(0, 4_000_000_000).map(lambda us: us / 1e6))),
        Status(draw(st.integers(0, 127))),
        draw(st.sampled_from(FaultCode)),
        draw(_whole(32)),
        draw(_whole(32)),
        tuple(draw(count if counts >> i & 1 else volts) for i in range(channels)),
        counts,
    )


def messages() -> st.SearchStrategy:
    """Any message."""
    fault = st.builds(
        Fault,
        st.sampled_from(FaultCode),
        st.integers(0, 8),
        st.floats(width=32),
        st.floats(width=32),
        _whole(32),
        st.booleans(),
    )
    return st.one_of(
        st.builds(Hello, _whole(64), _whole(64), _whole(64)),
        st.builds(Challenge, _whole(64), st.integers(1, 2**64 - 1), st.integers(1, 2**64 - 1)),
        capabilities(),
        st.builds(Arm, _whole(64), _whole(64), _whole(32)),
        commands(),
        telemetries(),
        st.just(Stop()),
        fault,
        st.builds(Reset, _whole(32)),
        st.builds(Ping, _whole(64)),
        st.builds(Pong, _whole(64)),
    )


def frames() -> st.SearchStrategy[Frame]:
    """Any frame."""
    return st.builds(Frame, messages(), _whole(32), _whole(32), _whole(64))
