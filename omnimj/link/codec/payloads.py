"""Payloads from messages and back. Times of the wire are whole microseconds, numbers float32."""

from __future__ import annotations

import functools
import math
import struct
from collections.abc import Callable
from typing import Any

from omnimj.errors import InputError
from omnimj.link.codec.layout import MAX_CHANNELS, MAX_WHEELS, PAYLOADS, DropReason
from omnimj.link.codec.messages import (
    Arm,
    Capabilities,
    ChannelKind,
    Command,
    Fault,
    FaultCode,
    Hello,
    Limits,
    Message,
    MessageType,
    Ping,
    Pong,
    Quantity,
    Raw,
    ResetFault,
    Status,
    Stop,
    Telemetry,
)

_INFINITE_AGE = 0xFFFFFFFF  # microseconds that stand for infinity
_MAX_SECONDS = (_INFINITE_AGE - 1) / 1e6  # seconds
_FLOAT32_OVERFLOW = 3.4028235677973366e38  # from here on the nearest float32 is infinity
_FAULTS = {int(code): code for code in FaultCode}
_QUANTITIES = {int(quantity): quantity for quantity in Quantity}
_RAWS = {int(raw): raw for raw in Raw}
_STATUSES = tuple(Status(bits) for bits in range(2 * max(int(bit) for bit in Status)))
_CAPABILITIES, _ARM = PAYLOADS[MessageType.CAPABILITIES].fixed, PAYLOADS[MessageType.ARM].fixed
_COMMAND, _TELEMETRY = PAYLOADS[MessageType.COMMAND].fixed, PAYLOADS[MessageType.TELEMETRY].fixed
_FAULT, _NONCE = PAYLOADS[MessageType.FAULT].fixed, PAYLOADS[MessageType.PING].fixed
_CHANNEL = struct.Struct("<4B")
_FLOATS = tuple(struct.Struct(f"<{n}f") for n in range(MAX_CHANNELS + 1))

PayloadWriter = Callable[[Any], bytes]
PayloadReader = Callable[[bytes, int, int], "Message | DropReason"]
"""Of packet, begin and end of the payload."""


def microseconds(seconds: float) -> int:
    """Whole microseconds for 32 bits, at most 2³² − 2; not a number and what is below zero are 0."""
    if 0.0 <= seconds < _MAX_SECONDS:
        return int(seconds * 1e6 + 0.5)
    return _INFINITE_AGE - 1 if seconds >= _MAX_SECONDS else 0


def _saturate(value: float) -> float:
    return math.copysign(math.inf, value) if abs(value) >= _FLOAT32_OVERFLOW else value


def _floats(values: tuple[float, ...]) -> bytes:
    try:
        return _FLOATS[len(values)].pack(*values)
    except OverflowError:
        return _FLOATS[len(values)].pack(*map(_saturate, values))


@functools.lru_cache(maxsize=64)
def _raw_struct(channels: int, counts: int) -> struct.Struct:
    return struct.Struct("<" + "".join("i" if counts >> i & 1 else "f" for i in range(channels)))


def _count(value: float, place: str) -> int:
    if not math.isfinite(value):
        raise InputError(place, f"{value} counts", "counts are whole numbers")
    return (int(value) + 2**31) % 2**32 - 2**31


def _raw(values: tuple[float, ...], counts: int) -> bytes:
    if not counts:
        return _floats(values)
    try:
        return _raw_struct(len(values), counts).pack(*values)
    except (OverflowError, struct.error):
        fitting = (
            _count(value, f"telemetry.raw[{i}]") if counts >> i & 1 else _saturate(value)
            for i, value in enumerate(values)
        )
        return _raw_struct(len(values), counts).pack(*fitting)


def _require(right: bool, place: str, found: object, rule: str) -> None:
    if not right:
        raise InputError(place, str(found), rule)


def _are_valid_limits(limits: tuple[float, ...]) -> bool:
    return all(0.0 < value < math.inf for value in limits)


def limit_values(limits: Limits) -> tuple[float, ...]:
    """The seven limits in the order of the wire."""
    return (
        limits.current,
        limits.current_rate,
        limits.continuous_current,
        limits.heating,
        limits.wheel_speed,
        limits.message_rate,
        limits.valid_for,
    )


def write_nonce(message: Hello | Ping | Pong) -> bytes:
    """Payload of the three messages that are a nonce."""
    return _NONCE.pack(message.nonce)


def write_capabilities(message: Capabilities) -> bytes:
    """Payload."""
    wheels, channels, numbers = message.wheels, message.channels, limit_values(message.limits)
    _require(1 <= wheels <= MAX_WHEELS, "capabilities.wheels", wheels, f"1…{MAX_WHEELS}")
    _require(len(channels) <= MAX_CHANNELS, "capabilities.channels", len(channels), f"at most {MAX_CHANNELS}")
    _require(message.period >= 1e-6, "capabilities.period", message.period, "at least 1e-6 s")
    written = _CAPABILITIES.pack(
        message.nonce,
        message.limits_hash,
        message.calibration_hash,
        microseconds(message.period),
        *map(_saturate, numbers),
        message.lock_step,
        wheels,
        len(channels),
        0,
    )
    kept = _CAPABILITIES.unpack(written)[4:11]
    _require(_are_valid_limits(kept), "capabilities.limits", kept, "finite and above zero as float32")
    for channel in channels:
        _require(0 <= channel.wheel <= wheels, "capabilities.channels.wheel", channel.wheel, f"0…{wheels}")
        written += _CHANNEL.pack(channel.quantity, channel.wheel, channel.raw, 0)
    return written


def write_arm(message: Arm) -> bytes:
    """Payload."""
    return _ARM.pack(message.limits_hash, message.calibration_hash, message.telemetry)


def write_command(message: Command) -> bytes:
    """Payload."""
    currents, brake = message.currents, message.brake
    wheels = len(currents)
    if not (1 <= wheels <= MAX_WHEELS and 0 <= brake < 1 << wheels):
        raise InputError("command", f"{wheels} currents, brake {brake}", f"1…{MAX_WHEELS}, a bit for each")
    return _COMMAND.pack(_saturate(message.valid_for), wheels, brake, 0) + _floats(currents)


def write_telemetry(message: Telemetry) -> bytes:
    """Payload."""
    raw, counts, age = message.raw, message.counts, message.command_age
    channels = len(raw)
    if channels > MAX_CHANNELS or counts < 0 or counts >> channels:
        raise InputError("telemetry", f"{channels} channels, counts {counts:#x}", f"at most {MAX_CHANNELS}")
    return _TELEMETRY.pack(
        message.acknowledged,
        _INFINITE_AGE if age == math.inf else microseconds(age),
        message.status,
        message.fault,
        channels,
        message.refused & _INFINITE_AGE,
        message.dropped & _INFINITE_AGE,
        counts,
    ) + _raw(raw, counts)


def write_nothing(message: Stop | ResetFault) -> bytes:
    """Payload of the two messages that say it with their type."""
    return b""


def write_fault(message: Fault) -> bytes:
    """Payload."""
    _require(0 <= message.wheel <= MAX_WHEELS, "fault.wheel", message.wheel, f"0…{MAX_WHEELS}")
    value, limit = _saturate(message.value), _saturate(message.limit)
    return _FAULT.pack(message.code, message.wheel, message.latched, 0, value, limit, message.sequence)


def read_hello(packet: bytes, begin: int, end: int) -> Hello | DropReason:
    """Message."""
    return Hello(*_NONCE.unpack_from(packet, begin)) if end - begin == _NONCE.size else DropReason.LENGTH


def read_ping(packet: bytes, begin: int, end: int) -> Ping | DropReason:
    """Message."""
    return Ping(*_NONCE.unpack_from(packet, begin)) if end - begin == _NONCE.size else DropReason.LENGTH


def read_pong(packet: bytes, begin: int, end: int) -> Pong | DropReason:
    """Message."""
    return Pong(*_NONCE.unpack_from(packet, begin)) if end - begin == _NONCE.size else DropReason.LENGTH


def read_capabilities(packet: bytes, begin: int, end: int) -> Capabilities | DropReason:
    """Message."""
    first = begin + _CAPABILITIES.size
    if end < first:
        return DropReason.LENGTH
    nonce, limits_hash, calibration_hash, period, *numbers, lock_step, wheels, channels, zero = (
        _CAPABILITIES.unpack_from(packet, begin)
    )
    if end != first + _CHANNEL.size * channels:
        return DropReason.LENGTH
    if zero or lock_step > 1 or not 1 <= wheels <= MAX_WHEELS or channels > MAX_CHANNELS or not period:
        return DropReason.VALUE
    kinds = [_channel(packet, first + _CHANNEL.size * i, wheels) for i in range(channels)]
    if None in kinds or not _are_valid_limits(tuple(numbers)):
        return DropReason.VALUE
    right = tuple(kind for kind in kinds if kind is not None)
    limits = Limits(*numbers)
    return Capabilities(
        nonce, period / 1e6, bool(lock_step), wheels, right, limits, limits_hash, calibration_hash
    )


def _channel(packet: bytes, at: int, wheels: int) -> ChannelKind | None:
    quantity, wheel, raw, zero = _CHANNEL.unpack_from(packet, at)
    if quantity not in _QUANTITIES or raw not in _RAWS or wheel > wheels or zero:
        return None
    return ChannelKind(_QUANTITIES[quantity], wheel, _RAWS[raw])


def read_arm(packet: bytes, begin: int, end: int) -> Arm | DropReason:
    """Message."""
    return Arm(*_ARM.unpack_from(packet, begin)) if end - begin == _ARM.size else DropReason.LENGTH


def read_command(packet: bytes, begin: int, end: int) -> Command | DropReason:
    """Message."""
    first = begin + _COMMAND.size
    if end < first:
        return DropReason.LENGTH
    valid_for, wheels, brake, zero = _COMMAND.unpack_from(packet, begin)
    if end != first + 4 * wheels:
        return DropReason.LENGTH
    if zero or not 1 <= wheels <= MAX_WHEELS or brake >> wheels:
        return DropReason.VALUE
    return Command(_FLOATS[wheels].unpack_from(packet, first), valid_for, brake)


def read_telemetry(packet: bytes, begin: int, end: int) -> Telemetry | DropReason:
    """Message."""
    first = begin + _TELEMETRY.size
    if end < first:
        return DropReason.LENGTH
    acknowledged, age, status, fault, channels, refused, dropped, counts = _TELEMETRY.unpack_from(
        packet, begin
    )
    if end != first + 4 * channels:
        return DropReason.LENGTH
    code = _FAULTS.get(fault)
    if code is None or channels > MAX_CHANNELS or status >= len(_STATUSES) or counts >> channels:
        return DropReason.VALUE
    layout = _raw_struct(channels, counts) if counts else _FLOATS[channels]
    return Telemetry(
        acknowledged,
        math.inf if age == _INFINITE_AGE else age / 1e6,
        _STATUSES[status],
        code,
        refused,
        dropped,
        layout.unpack_from(packet, first),
        counts,
    )


def read_stop(packet: bytes, begin: int, end: int) -> Stop | DropReason:
    """Message."""
    return Stop() if begin == end else DropReason.LENGTH


def read_reset_fault(packet: bytes, begin: int, end: int) -> ResetFault | DropReason:
    """Message."""
    return ResetFault() if begin == end else DropReason.LENGTH


def read_fault(packet: bytes, begin: int, end: int) -> Fault | DropReason:
    """Message."""
    if end - begin != _FAULT.size:
        return DropReason.LENGTH
    code, wheel, latched, zero, value, limit, sequence = _FAULT.unpack_from(packet, begin)
    if code not in _FAULTS or wheel > MAX_WHEELS or latched > 1 or zero:
        return DropReason.VALUE
    return Fault(_FAULTS[code], wheel, value, limit, sequence, bool(latched))
