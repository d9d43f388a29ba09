"""Messages between host and device, one frozen record each; their layout on the wire is in `PROTOCOL.md`.

The host is the computer that runs the controller, the device the one at the amplifiers. Times refer to the
sender's monotonic clock. Currents are in amperes with the amplifier's own sign; the host's calibration
relates this sign to the direction in which the wheel turns.
"""

from __future__ import annotations

import enum
from dataclasses import dataclass


class MessageType(enum.IntEnum):
    """Type of a message."""

    HELLO = 1
    CAPABILITIES = 2
    ARM = 3
    COMMAND = 4
    TELEMETRY = 5
    STOP = 6
    FAULT = 7
    RESET = 8
    PING = 9
    PONG = 10
    CHALLENGE = 11


class Quantity(enum.IntEnum):
    """Quantity that a channel measures."""

    CURRENT = 0
    WHEEL_SPEED = 1
    WHEEL_ANGLE = 2
    ACCELERATION_X = 3
    ACCELERATION_Y = 4
    YAW_RATE = 5
    YAW = 6
    SUPPLY = 7
    OTHER = 8
    """Not used by the controller."""


class Raw(enum.IntEnum):
    """Format of a channel's reading, four bytes each."""

    VOLTS = 0
    """Volts as float32."""
    COUNTS = 1
    """Counts as int32, which may wrap."""


class Status(enum.IntFlag):
    """State of the device, as bits in every telemetry."""

    ARMED = 1
    FAULT = 2
    """A fault is latched: no current flows until reset and arm."""
    LOCK_STEP = 4
    """The device's time advances by one period per command."""
    CURRENT_FLOWS = 8
    BRAKED = 16
    AUTHENTIC = 32
    """The link is keyed."""
    STOPPED = 64
    """A stop is latched: no current flows until reset and arm."""


class FaultCode(enum.IntEnum):
    """Reason for which the device refuses a frame or stops."""

    NONE = 0
    COMMAND_TOO_OLD = 1
    """The newest command is older than its valid_for."""
    NOT_FINITE = 2
    CURRENT = 3
    CURRENT_RATE = 4
    HEATING = 5
    """The I²t limit of a motor is exceeded."""
    WHEEL_SPEED = 6
    MESSAGE_RATE = 7
    VALID_FOR = 8
    """A command's valid_for is not positive or above its limit."""
    NOT_ARMED = 9
    ARM_NOT_ZERO = 10
    """The newest command before arming is not zero, or not valid any more."""
    ARM_STALE_TELEMETRY = 11
    ARM_SCHEMA = 12
    ARM_LIMITS = 13
    ARM_CALIBRATION = 14
    ARM_FAULTY = 15
    """A latched fault must be reset before arming."""
    MALFORMED = 16
    """A valid frame does not fit this device."""
    SENSOR = 17
    """A wheel speed that a limit needs is not finite."""
    BUSY = 18
    """The device is armed by another host."""
    STALE = 19
    """A command or reset answers a telemetry that is too old or unknown; never latched."""
    ARM_STOPPED = 20
    """A latched stop must be reset before arming."""
    BRAKE_AND_CURRENT = 21
    """A command brakes a wheel and drives it, too."""
    CURRENT_DEVIATION = 22
    """A measured current does not follow its set value."""


@dataclass(frozen=True, slots=True)
class Hello:
    """Request of the host for a session, first for a cookie and then with it."""

    nonce: int
    """64 fresh random bits of the host, the same in both requests."""
    cookie: int = 0
    """Cookie of the challenge; 0 in the first request."""
    device: int = 0
    """Identity of the device in the challenge; 0 in the first request."""


@dataclass(frozen=True, slots=True)
class Challenge:
    """Answer of the device to a hello without a valid cookie; the device keeps no state for it."""

    nonce: int
    """Nonce of the hello."""
    cookie: int
    """Nonce of the device, bound to the sender and nonce of the hello; not 0."""
    device: int
    """Identity of the device, not 0."""


@dataclass(frozen=True, slots=True)
class ChannelKind:
    """Kind of a telemetry channel."""

    quantity: Quantity
    wheel: int
    """Wheel 1…n; 0 if no wheel is concerned."""
    raw: Raw


def counts_mask(channels: tuple[ChannelKind, ...]) -> int:
    """Bit mask of the channels that travel as counts."""
    return sum(1 << i for i, channel in enumerate(channels) if channel.raw is Raw.COUNTS)


@dataclass(frozen=True, slots=True)
class Limits:
    """Limits that the device enforces; all above zero."""

    current: float
    """Largest current of a wheel [A]."""
    current_rate: float
    """Largest rate of change between two commands, by their times of arrival [A/s]."""
    continuous_current: float
    """Current that a motor may carry indefinitely [A]."""
    heating: float
    """Limit of the motor's I²t, ∫(i² − continuous²)dt, never below 0 [A²s]."""
    wheel_speed: float
    """Speed after the gear above which current is cut [rad/s]."""
    message_rate: float
    """Rate of frames that are answered [1/s]."""
    valid_for: float
    """Longest valid_for of a command [s]."""


@dataclass(frozen=True, slots=True)
class Capabilities:
    """Answer of the device to a hello with a valid cookie: its configuration, under the new session."""

    nonce: int
    """Nonce of the hello."""
    period: float
    """Time between two telemetries [s]."""
    lock_step: bool
    wheels: int
    channels: tuple[ChannelKind, ...]
    limits: Limits
    limits_hash: int
    calibration_hash: int
    """Hash of the calibration with which the device was commissioned."""


@dataclass(frozen=True, slots=True)
class Arm:
    """Request of the host to enable currents."""

    limits_hash: int
    calibration_hash: int
    telemetry: int
    """Sequence of the newest telemetry that the host has received."""


@dataclass(frozen=True, slots=True)
class Command:
    """Currents from the host, with a lifetime that begins when the telemetry they answer was sent."""

    currents: tuple[float, ...]
    """Set values, shape (n,) [A]."""
    valid_for: float
    """Lifetime from the sending of that telemetry on; from arrival on in lock-step [s]."""
    brake: int = 0
    """Bit i−1: a relay shorts the motor of wheel i."""
    telemetry: int = 0
    """Sequence of the newest telemetry that the host has received; 0: none."""


@dataclass(frozen=True, slots=True)
class Telemetry:
    """Raw readings of all channels and the state of the device."""

    acknowledged: int
    """Sequence of the newest accepted command; 0: none in this session."""
    command_age: float
    """Age of the newest accepted command, as its lifetime counts [s]; infinite without one."""
    status: Status
    fault: FaultCode
    """Latched fault."""
    refused: int
    """Valid frames that were refused, modulo 2³²."""
    dropped: int
    """Packets that were corrupt, of another session, repeated or not authentic, modulo 2³²."""
    raw: tuple[float, ...]
    """Volts or counts, in the order of `Capabilities.channels`."""
    counts: int = 0
    """Bit i: `raw[i]` is counts; must agree with the capabilities (`counts_mask`)."""


@dataclass(frozen=True, slots=True)
class Stop:
    """Request for zero current and disarming at once; obeyed from any sender at any time, and latched."""


@dataclass(frozen=True, slots=True)
class Fault:
    """Report of the device: a frame was refused, or a limit was violated."""

    code: FaultCode
    wheel: int
    """Wheel 1…n; 0 if no wheel is concerned."""
    value: float
    """Offending value."""
    limit: float
    """Limit that it violates."""
    sequence: int
    """Sequence of the refused frame, 0: none; in busy the lower half of the nonce of the hello."""
    latched: bool


@dataclass(frozen=True, slots=True)
class Reset:
    """Request of the host to reset the latched stop and fault, so that arming is possible again."""

    telemetry: int
    """Sequence of a telemetry sent since the newest stop and fault; an unseen one is not reset."""


@dataclass(frozen=True, slots=True)
class Ping:
    """Request of the host for the device's time, which the answer gives to within half the round trip."""

    nonce: int


@dataclass(frozen=True, slots=True)
class Pong:
    """Answer to a ping; the device's time is in the header."""

    nonce: int


Message = Hello | Challenge | Capabilities | Arm | Command | Telemetry | Stop | Fault | Reset | Ping | Pong


@dataclass(frozen=True, slots=True)
class Frame:
    """A message with its header."""

    message: Message
    session: int
    """Session number chosen by the device, 32 bits; 0 in hello, challenge, busy, a stop without session."""
    sequence: int
    """Frame number of the sender, 1, 2, … in each session, 32 bits."""
    time: int
    """Sender's monotonic clock [µs], 64 bits."""
    authentic: bool = False
    """True if the frame carried a valid tag."""
    same_schema: bool = True
    """True if the sender uses the same layouts of all payloads, which arming requires."""
