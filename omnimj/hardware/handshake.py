"""Whether a device is the one that was expected, told in words."""

from __future__ import annotations

import dataclasses
import struct

from omnimj.hardware.commissioned import Commissioned
from omnimj.hardware.device_limits import as_sent
from omnimj.hardware.hashes import limits_hash
from omnimj.hardware.messages import Capabilities, ChannelKind, Limits, Quantity


def difference(expected: Commissioned, found: Capabilities) -> str:
    """The first thing that the device has otherwise; empty where there is none.

    Channels that the host does not use may be anything, and there may be more of them.
    """
    if found.wheels != expected.wheels:
        return f"it has {found.wheels} wheels, the model {expected.wheels}"
    if found.lock_step != expected.lock_step:
        return f"it runs in {_mode(found.lock_step)}, asked for is {_mode(expected.lock_step)}"
    if _as_float32(found.period) != _as_float32(expected.period):
        return f"its period is {found.period:g} s, the model's {expected.period:g} s"
    for channel, kind in enumerate(expected.channels):
        if kind.quantity is Quantity.OTHER:
            continue
        if channel >= len(found.channels):
            return f"it has no channel {channel}, the model has {_told(kind)} there"
        if found.channels[channel] != kind:
            return f"channel {channel} is {_told(found.channels[channel])}, the model has {_told(kind)} there"
    limits = as_sent(expected.limits)
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


def _mode(lock_step: bool) -> str:
    return "lock-step" if lock_step else "real time"


def _told(kind: ChannelKind) -> str:
    wheel = f" of wheel {kind.wheel}" if kind.wheel else ""
    return f"{kind.quantity.name.lower()}{wheel} in {kind.raw.name.lower()}"
