"""Configuration of a device, the hashes that identify it, and its comparison with what a host expects."""

from __future__ import annotations

import dataclasses
import hashlib
import struct
from collections.abc import Callable, Sequence
from dataclasses import dataclass

from omnimj.link.codec.messages import Capabilities, ChannelKind, Limits, Quantity
from omnimj.link.device.limits import round_to_float32

WheelSpeedDecoder = Callable[[float, Sequence[float]], tuple[float, ...]]
"""Wheel speeds after the gear, shape (n,) [rad/s], from time [s] and raw readings; called once per tick."""

CurrentDecoder = Callable[[Sequence[float]], tuple[float, ...]]
"""Measured currents at the amplifiers' own signs, shape (n,) [A], from raw readings."""


@dataclass(frozen=True, slots=True)
class DeviceConfig:
    """Configuration with which a device was commissioned."""

    wheels: int
    period: float
    """Time between two ticks [s]."""
    channels: tuple[ChannelKind, ...]
    limits: Limits
    calibration_hash: int
    lock_step: bool = False
    keyed: bool = False
    """True if frames without a valid tag are dropped, except stop."""
    identity: int = 0
    """Identity of the device, 64 bits; 0: drawn at power-up by a device, any for a host."""


@dataclass(frozen=True, slots=True)
class AmplifierOutput:
    """Set values of the amplifiers."""

    currents: tuple[float, ...]
    """Currents with the amplifiers' own signs, shape (n,) [A]."""
    brake: int
    """Bit i−1: a relay shorts the motor of wheel i."""


def short_hash(content: bytes) -> int:
    """First 8 bytes of BLAKE2s-256 (RFC 7693, no key) as a little-endian number."""
    return int.from_bytes(hashlib.blake2s(content).digest()[:8], "little")


def limits_hash(limits: Limits) -> int:
    """Hash of the seven limits in the order of the record, each as a little-endian float32."""
    return short_hash(struct.pack("<7f", *dataclasses.astuple(limits)))


def describe_mismatch(expected: DeviceConfig, found: Capabilities) -> str:
    """Describe the first difference between a device and the expected one; empty text if there is none.

    Channels that the host does not use may be of any kind, and there may be more of them.
    """
    if found.wheels != expected.wheels:
        return f"it has {found.wheels} wheels, the model {expected.wheels}"
    if found.lock_step != expected.lock_step:
        return f"it runs in {_clock_mode(found.lock_step)}, expected is {_clock_mode(expected.lock_step)}"
    if _as_float32(found.period) != _as_float32(expected.period):
        return f"its period is {found.period:g} s, the model's {expected.period:g} s"
    for channel, kind in enumerate(expected.channels):
        if kind.quantity is Quantity.OTHER:
            continue
        if channel >= len(found.channels):
            return f"it has no channel {channel}, the model has {_format_channel(kind)} there"
        if found.channels[channel] != kind:
            return (
                f"channel {channel} is {_format_channel(found.channels[channel])}, the model has "
                f"{_format_channel(kind)} there"
            )
    limits = round_to_float32(expected.limits)
    for field in dataclasses.fields(Limits):
        own, its = getattr(limits, field.name), getattr(found.limits, field.name)
        if own != its:
            return f"its limit {field.name} is {its:g}, the model's {own:g}"
    if found.limits_hash != limits_hash(limits):
        return "its limits have another hash"
    if found.calibration_hash != expected.calibration_hash:
        return "it was commissioned with another calibration"
    return ""


def _as_float32(period: float) -> float:
    return struct.unpack("<f", struct.pack("<f", period))[0]


def _clock_mode(lock_step: bool) -> str:
    return "lock-step" if lock_step else "real time"


def _format_channel(kind: ChannelKind) -> str:
    wheel = f" of wheel {kind.wheel}" if kind.wheel else ""
    return f"{kind.quantity.name.lower()}{wheel} in {kind.raw.name.lower()}"
