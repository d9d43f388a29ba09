"""Layout of every message on the wire, and the reasons for which a packet is dropped.

`MESSAGES` is the single description: the codec, the schema that both sides compare, and the tables of
`PROTOCOL.md` are generated from it. Numbers are little endian, without padding.
"""

from __future__ import annotations

import enum
import math
import struct
import zlib
from collections.abc import Callable, Iterable, Mapping
from dataclasses import astuple, dataclass
from typing import Any

from omnimj.link.codec.messages import (
    Arm,
    Capabilities,
    Challenge,
    ChannelKind,
    Command,
    Fault,
    FaultCode,
    Hello,
    MessageType,
    Ping,
    Pong,
    Quantity,
    Raw,
    Reset,
    Status,
    Stop,
    Telemetry,
)

PROTOCOL = 2
"""Version of the frame layout."""
MAX_FRAME_SIZE = 512
"""Longest frame with header and checksum, before byte stuffing [bytes]."""
MAX_WHEELS = 8
MAX_CHANNELS = 32
TAGGED = 1
"""Bit of the header's flags: an authentication tag precedes the checksum."""
TAG_SIZE = 16
CHECKSUM_SIZE = 4
_INFINITE_AGE = 0xFFFFFFFF
_MAX_SECONDS = (_INFINITE_AGE - 1) / 1e6
FLOAT32_OVERFLOW = 3.4028235677973366e38
"""Smallest number whose nearest float32 is infinite."""
_FLOAT32_UNDERFLOW = 2.0**-150  # largest number whose nearest float32 is zero


class DropReason(enum.IntEnum):
    """Reason for which a packet is dropped, in the order of the checks."""

    TOO_SHORT = 1
    TOO_LONG = 2
    STUFFING = 3
    """Invalid byte stuffing; serial lines only."""
    CHECKSUM = 4
    PROTOCOL = 5
    TYPE = 6
    FLAGS = 7
    """A reserved bit is set."""
    LENGTH = 8
    """No message of this type has this length."""
    NO_KEY = 9
    """The frame is tagged, but this side has no key."""
    NO_TAG = 10
    """This side has a key, but the frame is not tagged."""
    TAG = 11
    """The tag was made with another key, or the frame was altered."""
    SCHEMA = 12
    """The sender lays out this payload differently."""
    VALUE = 13
    """A field has a value that is not allowed."""


class DropCounts:
    """Number of dropped packets by reason."""

    __slots__ = ("_counts",)

    def __init__(self) -> None:
        self._counts = [0] * (max(DropReason) + 1)

    def add(self, drop: DropReason) -> None:
        """Count one packet."""
        self._counts[drop] += 1

    def __getitem__(self, drop: DropReason) -> int:
        return self._counts[drop]

    @property
    def total(self) -> int:
        """Number of dropped packets over all reasons."""
        return sum(self._counts)

    def __str__(self) -> str:
        found = [f"{drop.name.lower()} {self[drop]}" for drop in DropReason if self[drop]]
        return ", ".join(found) or "none"


@dataclass(frozen=True)
class Field:
    """Number in a header or payload."""

    name: str
    type: str
    """`u8`, `u16`, `u32`, `u64`, `f32`, or `f32_or_i32` (by channel)."""
    meaning: str = ""
    """Description in `PROTOCOL.md`."""
    attribute: str | None = None
    """Attribute of the record, such as `limits.current`; the field's name if None, no attribute if empty."""
    values: Mapping[int, Any] | None = None
    """Allowed numbers and the attribute's value for each; any number if None."""
    write: Callable[[Any], Any] | None = None
    """Number on the wire from the attribute's value."""
    read: Callable[[Any], Any] | None = None
    """Attribute's value from the number on the wire."""

    @property
    def size(self) -> int:
        """Size in bytes."""
        return struct.calcsize(_CODES[self.type])


Rule = Callable[[Any], tuple[str, str] | None]
"""Check of a record as a whole: the offending value and the rule that it breaks, or None."""


@dataclass(frozen=True)
class Layout:
    """Layout of a payload: fixed fields, one of which counts the items that follow."""

    record: type
    sender: str
    """`host` or `device`."""
    fields: tuple[Field, ...] = ()
    items: tuple[Field, ...] = ()
    item_record: type | None = None
    """Record of one item; None: an item is a single number."""
    count: str = ""
    """Name of the field that holds the number of items."""
    attribute: str = ""
    """Attribute of the record that holds the items, a tuple."""
    rule: Rule | None = None
    note: str = ""
    """Paragraph of `PROTOCOL.md` below the table."""

    @property
    def text(self) -> str:
        """Line of the payload in the schema, without the name."""
        fixed, items = _field_text(self.fields), _field_text(self.items)
        return f"{fixed} {self.count}*({items})" if items else fixed


_CODES = {"u8": "B", "u16": "H", "u32": "I", "u64": "Q", "f32": "f", "f32_or_i32": "f"}


def struct_of(fields: Iterable[Field]) -> struct.Struct:
    """Binary layout of consecutive fields."""
    return struct.Struct("<" + "".join(_CODES[field.type] for field in fields))


def _field_text(fields: Iterable[Field]) -> str:
    return " ".join(f"{field.name}:{field.type}" for field in fields)


def microseconds(seconds: float) -> int:
    """Whole microseconds as 32 bits, at most 2³² − 2; NaN and negative times become 0."""
    if 0.0 <= seconds < _MAX_SECONDS:
        return int(seconds * 1e6 + 0.5)
    return _INFINITE_AGE - 1 if seconds >= _MAX_SECONDS else 0


def _write_age(seconds: float) -> int:
    return _INFINITE_AGE if seconds == math.inf else microseconds(seconds)


def _read_age(number: int) -> float:
    return math.inf if number == _INFINITE_AGE else number / 1e6


def _identity(numbers: Iterable[int]) -> dict[int, int]:
    return {number: number for number in numbers}


def _members(kind: type[enum.IntEnum]) -> dict[int, enum.IntEnum]:
    return {int(member): member for member in kind}


_FLAG = {0: False, 1: True}
_STATUSES = {bits: Status(bits) for bits in range(2 * max(int(bit) for bit in Status))}
_RESERVED_8 = Field("zero", "u8", attribute="", values={0: 0})
_RESERVED_16 = Field("zero", "u16", attribute="", values={0: 0})


def _capabilities_rule(record: Capabilities) -> tuple[str, str] | None:
    if record.period < 1e-6:
        return f"period {record.period}", "at least 1e-6 s"
    limits = astuple(record.limits)
    if not all(_FLOAT32_UNDERFLOW < limit < FLOAT32_OVERFLOW for limit in limits):
        return f"limits {limits}", "finite and above zero as float32"
    if not all(0 <= channel.wheel <= record.wheels for channel in record.channels):
        return "channel of a wheel that does not exist", f"0…{record.wheels}"
    return None


def _command_rule(record: Command) -> tuple[str, str] | None:
    if 0 <= record.brake < 1 << len(record.currents):
        return None
    return f"{len(record.currents)} currents, brake {record.brake}", "one bit per wheel"


def _telemetry_rule(record: Telemetry) -> tuple[str, str] | None:
    if 0 <= record.counts < 1 << len(record.raw):
        return None
    return f"{len(record.raw)} channels, counts {record.counts:#x}", "one bit per channel"


def _challenge_rule(record: Challenge) -> tuple[str, str] | None:
    if record.cookie != 0 and record.device != 0:
        return None
    return f"cookie {record.cookie:#x}, device {record.device:#x}", "neither may be 0"


_ECHO = Field("telemetry", "u32", "sequence of the newest telemetry that the host has received")

HEADER_FIELDS = (
    Field("protocol", "u8", str(PROTOCOL)),
    Field("type", "u8", "section 2"),
    Field("flags", "u16", "bit 0: the frame has a tag; all other bits 0"),
    Field(
        "session",
        "u32",
        "chosen by the device; 0 in HELLO, CHALLENGE, FAULT BUSY, and in a STOP outside any session",
    ),
    Field("sequence", "u32", "frame number of the sender, increasing within a session, from 1"),
    Field("time_us", "u64", "sender's monotonic clock [µs]; the device's is simulated time in lock-step"),
    Field("schema", "u32", "section 1.5"),
)
HEADER = struct_of(HEADER_FIELDS)

MESSAGES: dict[MessageType, Layout] = {
    MessageType.HELLO: Layout(
        Hello,
        "host",
        (
            Field("nonce", "u64", "random; repeated in the answer"),
            Field("cookie", "u64", "of the CHALLENGE; 0: none yet"),
            Field("device", "u64", "identity in the CHALLENGE; 0: unknown"),
        ),
    ),
    MessageType.CAPABILITIES: Layout(
        Capabilities,
        "device",
        (
            Field("nonce", "u64", "nonce of the HELLO"),
            Field("limits_hash", "u64", "section 3"),
            Field("calibration_hash", "u64", "section 3; calibration that the device was commissioned with"),
            Field(
                "period_us",
                "u32",
                "time between two telemetries [µs], not 0",
                "period",
                write=microseconds,
                read=lambda number: number / 1e6,
            ),
            Field("current", "f32", "largest current of a wheel [A]", "limits.current"),
            Field("current_rate", "f32", "largest rate of change of a current [A/s]", "limits.current_rate"),
            Field(
                "continuous_current",
                "f32",
                "current that a motor may carry indefinitely [A]",
                "limits.continuous_current",
            ),
            Field(
                "heating",
                "f32",
                "limit of ∫(i² − continuous²)dt, never below 0 [A²s]",
                "limits.heating",
            ),
            Field(
                "wheel_speed", "f32", "current is cut above it; after the gear [rad/s]", "limits.wheel_speed"
            ),
            Field("message_rate", "f32", "frames that are answered [1/s]", "limits.message_rate"),
            Field("valid_for", "f32", "longest valid_for of a command [s]; at most 0.2", "limits.valid_for"),
            Field("lock_step", "u8", "0 or 1", values=_FLAG),
            Field("wheels", "u8", "1…8", values=_identity(range(1, MAX_WHEELS + 1))),
            Field(
                "channels",
                "u8",
                "0…32; number of the entries that follow",
                values=_identity(range(MAX_CHANNELS + 1)),
                write=len,
            ),
            _RESERVED_8,
        ),
        items=(
            Field("quantity", "u8", "`Quantity` of the schema", values=_members(Quantity)),
            Field("wheel", "u8", "1…wheels; 0 if the channel belongs to no wheel"),
            Field("raw", "u8", "0 volts (f32), 1 counts (i32)", values=_members(Raw)),
            _RESERVED_8,
        ),
        item_record=ChannelKind,
        count="channels",
        attribute="channels",
        rule=_capabilities_rule,
        note="The seven limits are finite and above zero. The device must apply exactly these float32 "
        "numbers: it rounds its own\nlimits to float32 first, and a value *equal* to its limit passes.",
    ),
    MessageType.ARM: Layout(
        Arm,
        "host",
        (
            Field("limits_hash", "u64", "as in the capabilities"),
            Field("calibration_hash", "u64", "calibration that the **host** uses"),
            _ECHO,
        ),
    ),
    MessageType.COMMAND: Layout(
        Command,
        "host",
        (
            Field("valid_for", "f32", "lifetime of the command, section 4.4 [s]; usually 0.05"),
            Field(
                "wheels",
                "u8",
                "1…8; number of currents that follow",
                "currents",
                values=_identity(range(1, MAX_WHEELS + 1)),
                write=len,
            ),
            Field("brake", "u8", "bit i−1: a relay shorts the motor of wheel i"),
            _RESERVED_16,
            _ECHO,
        ),
        items=(Field("current", "f32", "current of wheel 1, 2, … [A], at the amplifier's own sign"),),
        count="wheels",
        attribute="currents",
        rule=_command_rule,
    ),
    MessageType.TELEMETRY: Layout(
        Telemetry,
        "device",
        (
            Field("acknowledged", "u32", "sequence of the newest accepted command; 0: none in this session"),
            Field(
                "command_age_us",
                "u32",
                "age of that command, section 4.4 [µs]; 0xFFFFFFFF: none",
                "command_age",
                write=_write_age,
                read=_read_age,
            ),
            Field("status", "u16", "bits, `Status` of the schema", values=_STATUSES),
            Field("fault", "u8", "latched fault, `FaultCode`; 0: none", values=_members(FaultCode)),
            Field(
                "channels",
                "u8",
                "as in the capabilities; number of readings that follow",
                "raw",
                values=_identity(range(MAX_CHANNELS + 1)),
                write=len,
            ),
            Field("refused", "u32", "refused frames since power-up, modulo 2³²"),
            Field("dropped", "u32", "dropped frames since power-up, modulo 2³²"),
            Field("counts", "u32", "bit i: reading i is in counts; as in the capabilities"),
        ),
        items=(
            Field(
                "raw",
                "f32_or_i32",
                "reading of channel 0, 1, …: volts as f32, counts as i32 (may wrap)",
            ),
        ),
        count="channels",
        attribute="raw",
        rule=_telemetry_rule,
    ),
    MessageType.STOP: Layout(Stop, "host"),
    MessageType.FAULT: Layout(
        Fault,
        "device",
        (
            Field("code", "u8", "`FaultCode` of the schema", values=_members(FaultCode)),
            Field("wheel", "u8", "1…8; 0 if no wheel is concerned", values=_identity(range(MAX_WHEELS + 1))),
            Field("latched", "u8", "0 or 1", values=_FLAG),
            _RESERVED_8,
            Field("value", "f32", "offending value; may be NaN or infinite"),
            Field("limit", "f32", "limit that it violates"),
            Field(
                "sequence",
                "u32",
                "sequence of the refused frame, 0: none; in BUSY the lower half of the nonce",
            ),
        ),
    ),
    MessageType.RESET: Layout(
        Reset,
        "host",
        (Field("telemetry", "u32", "sequence of a telemetry sent since the newest stop and fault"),),
    ),
    MessageType.PING: Layout(Ping, "host", (Field("nonce", "u64"),)),
    MessageType.PONG: Layout(
        Pong, "device", (Field("nonce", "u64", "nonce of the PING; the device's time is in the header"),)
    ),
    MessageType.CHALLENGE: Layout(
        Challenge,
        "device",
        (
            Field("nonce", "u64", "nonce of the HELLO"),
            Field("cookie", "u64", "section 4.2; not 0"),
            Field("device", "u64", "identity of the device, not 0"),
        ),
        rule=_challenge_rule,
    ),
}


def _format_enum(kind: type[enum.IntEnum] | type[enum.IntFlag]) -> str:
    return f"{kind.__name__}: " + " ".join(f"{int(one)}={one.name}" for one in kind)


def _schema_text() -> str:
    lines = [f"omnimj link {PROTOCOL}", f"header: {_field_text(HEADER_FIELDS)}"]
    lines += [f"{kind.name} {int(kind)}: {layout.text}".rstrip() for kind, layout in MESSAGES.items()]
    lines += [_format_enum(kind) for kind in (Quantity, Raw, Status, FaultCode)]
    return "".join(line + "\n" for line in lines)


SCHEMA_TEXT = _schema_text()
"""Layout and enumerations on which both sides must agree; ASCII, each line ends with a line feed."""
SCHEMA = zlib.crc32(SCHEMA_TEXT.encode("ascii"))
"""CRC-32 of `SCHEMA_TEXT`, part of every header."""
SCHEMA_INDEPENDENT = frozenset(MessageType) - {MessageType.COMMAND, MessageType.TELEMETRY}
"""Messages that keep their layout as long as `PROTOCOL` does, so that incompatible sides can detect it."""
