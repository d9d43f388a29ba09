"""What travels between host and device: one frozen record per message. Layout on the wire: `PROTOCOL.md`.

The host is the computer that thinks, the device the one at the amplifiers. Times are of the sender's
monotonic clock. Currents are in amperes at the amplifier's own sign: what a positive number does to the wheel
is calibration, which is the host's, like everything else that turns raw numbers into physics.
"""

from __future__ import annotations

import enum
from dataclasses import dataclass


class MessageType(enum.IntEnum):
    """Of a frame."""

    HELLO = 1
    CAPABILITIES = 2
    ARM = 3
    COMMAND = 4
    TELEMETRY = 5
    STOP = 6
    FAULT = 7
    RESET_FAULT = 8
    PING = 9
    PONG = 10


class Quantity(enum.IntEnum):
    """What a channel measures."""

    CURRENT = 0
    WHEEL_SPEED = 1
    WHEEL_ANGLE = 2
    ACCELERATION_X = 3
    ACCELERATION_Y = 4
    YAW_RATE = 5
    YAW = 6
    SUPPLY = 7
    OTHER = 8
    """Nothing that the controller uses."""


class Raw(enum.IntEnum):
    """How a channel's number travels, four bytes each."""

    VOLTS = 0
    """float32."""
    COUNTS = 1
    """int32, which may wrap."""


class Status(enum.IntFlag):
    """Bits of the device's state in every telemetry."""

    ARMED = 1
    FAULT = 2
    """Latched: nothing moves until reset-fault and arm."""
    LOCK_STEP = 4
    """The device's time goes on by one period per command."""
    CURRENT_FLOWS = 8
    BRAKED = 16
    AUTHENTIC = 32
    """This session is keyed."""


class FaultCode(enum.IntEnum):
    """Why the device does not do what it was told."""

    NONE = 0
    COMMAND_TOO_OLD = 1
    """The last command outlived its valid-for."""
    NOT_FINITE = 2
    CURRENT = 3
    CURRENT_RATE = 4
    HEATING = 5
    """I²t."""
    WHEEL_SPEED = 6
    MESSAGE_RATE = 7
    VALID_FOR = 8
    """A command wants to hold for longer than may be, or not at all."""
    NOT_ARMED = 9
    ARM_NOT_ZERO = 10
    """The last command before arming was not zero, or there was none that is still valid."""
    ARM_STALE_TELEMETRY = 11
    ARM_SCHEMA = 12
    ARM_LIMITS = 13
    ARM_CALIBRATION = 14
    ARM_FAULTY = 15
    """A latched fault must be reset first."""
    MALFORMED = 16
    """A frame that is whole says something that no message may say."""
    SENSOR = 17
    """A channel that a limit needs is not finite."""
    BUSY = 18
    """Another host has the armed device."""


@dataclass(frozen=True, slots=True)
class Hello:
    """Host: who is there? The answer carries the same nonce and begins a session."""

    nonce: int


@dataclass(frozen=True, slots=True)
class ChannelKind:
    """One channel of the telemetry."""

    quantity: Quantity
    wheel: int
    """1…n; 0 where it is of no wheel."""
    raw: Raw


def counts_mask(channels: tuple[ChannelKind, ...]) -> int:
    """Bit i: channel i travels as counts."""
    return sum(1 << i for i, channel in enumerate(channels) if channel.raw is Raw.COUNTS)


@dataclass(frozen=True, slots=True)
class Limits:
    """What the device lets through; all above zero."""

    current: float
    """Largest current of a wheel [A]."""
    current_rate: float
    """Largest change of it between two commands, per second of their times of arrival [A/s]."""
    continuous_current: float
    """Which a motor may carry for ever [A]."""
    heating: float
    """I²t: what ∫(i² − continuous²)dt may reach, never below 0 [A²s]."""
    wheel_speed: float
    """At which current is cut [rad/s], after the gear, as the device measures it."""
    message_rate: float
    """Frames per second that are answered [1/s]."""
    valid_for: float
    """Longest valid-for of a command [s]."""


@dataclass(frozen=True, slots=True)
class Capabilities:
    """Device: what I am. Begins the session that its header names."""

    nonce: int
    """Of the hello."""
    period: float
    """Between two telemetries [s]."""
    lock_step: bool
    wheels: int
    channels: tuple[ChannelKind, ...]
    limits: Limits
    limits_hash: int
    calibration_hash: int
    """Of the calibration that the device was commissioned with."""


@dataclass(frozen=True, slots=True)
class Arm:
    """Host: currents may flow from now on."""

    limits_hash: int
    calibration_hash: int
    telemetry: int
    """Sequence of the newest telemetry that the host has seen."""


@dataclass(frozen=True, slots=True)
class Command:
    """Host: these currents, for so long."""

    currents: tuple[float, ...]
    """One per wheel [A]."""
    valid_for: float
    """[s]."""
    brake: int = 0
    """Bit i−1: a relay shorts the motor of wheel i."""


@dataclass(frozen=True, slots=True)
class Telemetry:
    """Device: raw readings of every channel, and how it is."""

    acknowledged: int
    """Sequence of the newest command that was taken; 0: none in this session."""
    command_age: float
    """Since it came [s]; of a device that has none: infinity."""
    status: Status
    fault: FaultCode
    """That is latched."""
    refused: int
    """Frames that were whole, from the right sender, and refused, modulo 2³²."""
    dropped: int
    """Frames that were broken, foreign, old, or not authentic, modulo 2³²."""
    raw: tuple[float, ...]
    """Volts or counts, in the order of `Capabilities.channels`."""
    counts: int = 0
    """Bit i: `raw[i]` is counts; must be what the capabilities say (`counts_mask`)."""


@dataclass(frozen=True, slots=True)
class Stop:
    """Host: zero current now, then disabled. Obeyed from anybody, in any session, at any time."""


@dataclass(frozen=True, slots=True)
class Fault:
    """Device: a frame was refused, or something happened."""

    code: FaultCode
    wheel: int
    """1…n; 0 where it is of no wheel."""
    value: float
    """What was found."""
    limit: float
    """What is allowed."""
    sequence: int
    """Of the refused frame; 0: none."""
    latched: bool


@dataclass(frozen=True, slots=True)
class ResetFault:
    """Host: the fault has been seen; arm is possible again."""


@dataclass(frozen=True, slots=True)
class Ping:
    """Host: what is your time? The device's clock is known to half the round trip."""

    nonce: int


@dataclass(frozen=True, slots=True)
class Pong:
    """Device: the nonce back; its time is in the header."""

    nonce: int


Message = Hello | Capabilities | Arm | Command | Telemetry | Stop | Fault | ResetFault | Ping | Pong


@dataclass(frozen=True, slots=True)
class Frame:
    """A message with its header."""

    message: Message
    session: int
    """That the device has chosen, 32 bits; 0 in hello and in a stop of nobody's session."""
    sequence: int
    """Of the sender, 1, 2, … in each session, 32 bits."""
    time: int
    """Of the sender's monotonic clock [µs], 64 bits."""
    authentic: bool = False
    """Whether a key's tag came with it and is right."""
    same_schema: bool = True
    """Whether its sender lays out every payload as we do; false is never armed."""
