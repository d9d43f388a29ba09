"""What a device was set up as, and what it gives to its amplifiers."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

from omnimj.hardware.messages import ChannelKind, Limits

Speeds = Callable[[float, Sequence[float]], tuple[float, ...]]
"""Wheel speeds after the gear, shape (n,) [rad/s], out of time [s] and raw readings; called once per tick."""


@dataclass(frozen=True, slots=True)
class Commissioned:
    """What the device was set up as."""

    wheels: int
    period: float
    """Between two ticks [s]."""
    channels: tuple[ChannelKind, ...]
    limits: Limits
    calibration_hash: int
    lock_step: bool = False
    keyed: bool = False
    """Frames without the key's tag are dropped, but for stop."""


@dataclass(frozen=True, slots=True)
class Output:
    """What the amplifiers get."""

    currents: tuple[float, ...]
    """Shape (n,) [A], at the amplifiers' own signs."""
    brake: int
    """Bit i−1: a relay shorts the motor of wheel i."""
