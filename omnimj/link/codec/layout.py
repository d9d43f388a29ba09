"""Why bytes are not a frame, and how often that happened."""

from __future__ import annotations

import enum
import functools
import re
import struct
import zlib
from dataclasses import dataclass

from omnimj.link.codec.messages import FaultCode, MessageType, Quantity, Raw, Status


class DropReason(enum.IntEnum):
    """Why bytes were dropped; in this order it is looked for."""

    TOO_SHORT = 1
    TOO_LONG = 2
    STUFFING = 3
    """No stuffed packet; only where bytes come as a stream."""
    CHECKSUM = 4
    PROTOCOL = 5
    TYPE = 6
    FLAGS = 7
    """A reserved bit is set."""
    LENGTH = 8
    """No such message has so many bytes."""
    NO_KEY = 9
    """It has a tag, and we have no key."""
    NO_TAG = 10
    """We have a key, and it has no tag."""
    TAG = 11
    """Made with another key, or changed on its way."""
    SCHEMA = 12
    """Its payload is laid out in another way than ours."""
    VALUE = 13
    """It says something that no message may say."""


class DropCounts:
    """How many were dropped, by reason."""

    __slots__ = ("_counts",)

    def __init__(self) -> None:
        self._counts = [0] * (max(DropReason) + 1)

    def add(self, drop: DropReason) -> None:
        """Counts one."""
        self._counts[drop] += 1

    def __getitem__(self, drop: DropReason) -> int:
        return self._counts[drop]

    @property
    def total(self) -> int:
        """For whatever reason."""
        return sum(self._counts)

    def __str__(self) -> str:
        found = [f"{drop.name.lower()} {self[drop]}" for drop in DropReason if self[drop]]
        return ", ".join(found) or "none"


# How every message lies in bytes: the one table that Python, the schema and `PROTOCOL.md` are held to.

PROTOCOL = 1
MAX_FRAME_SIZE = 512
"""Bytes, with header and checksum, without stuffing."""
MAX_WHEELS = 8
MAX_CHANNELS = 32
TAGGED = 1
"""Bit of the header's flags: a tag of 16 bytes comes before the checksum."""
TAG_SIZE = 16
CHECKSUM_SIZE = 4
_CODES = {"u8": "B", "u16": "H", "u32": "I", "u64": "Q", "f32": "f"}


def _struct(fields: str) -> struct.Struct:
    return struct.Struct("<" + "".join(_CODES[kind] for kind in re.findall(r":(\w+)", fields)))


HEADER_FIELDS = "protocol:u8 type:u8 flags:u16 session:u32 sequence:u32 time_us:u64 schema:u32"
HEADER = _struct(HEADER_FIELDS)


@dataclass(frozen=True)
class Layout:
    """A payload: fixed fields, then some fields as often as one of them says."""

    fields: str
    repeated: str = ""
    times: str = ""
    """Name of the field that says how often."""

    @property
    def text(self) -> str:
        """As the schema has it."""
        return f"{self.fields} {self.times}*({self.repeated})" if self.repeated else self.fields

    @functools.cached_property
    def fixed(self) -> struct.Struct:
        """The fixed fields."""
        return _struct(self.fields)


PAYLOADS: dict[MessageType, Layout] = {
    MessageType.HELLO: Layout("nonce:u64"),
    MessageType.CAPABILITIES: Layout(
        "nonce:u64 limits_hash:u64 calibration_hash:u64 period_us:u32"
        " current:f32 current_rate:f32 continuous_current:f32 heating:f32 wheel_speed:f32 message_rate:f32"
        " valid_for:f32 lock_step:u8 wheels:u8 channels:u8 zero:u8",
        "quantity:u8 wheel:u8 raw:u8 zero:u8",
        "channels",
    ),
    MessageType.ARM: Layout("limits_hash:u64 calibration_hash:u64 telemetry:u32"),
    MessageType.COMMAND: Layout("valid_for:f32 wheels:u8 brake:u8 zero:u16", "current:f32", "wheels"),
    MessageType.TELEMETRY: Layout(
        "acknowledged:u32 command_age_us:u32 status:u16 fault:u8 channels:u8 refused:u32 dropped:u32"
        " counts:u32",
        "raw:f32_or_i32",
        "channels",
    ),
    MessageType.STOP: Layout(""),
    MessageType.FAULT: Layout("code:u8 wheel:u8 latched:u8 zero:u8 value:f32 limit:f32 sequence:u32"),
    MessageType.RESET_FAULT: Layout(""),
    MessageType.PING: Layout("nonce:u64"),
    MessageType.PONG: Layout("nonce:u64"),
}


def _format_enum(kind: type[enum.IntEnum] | type[enum.IntFlag]) -> str:
    return f"{kind.__name__}: " + " ".join(f"{int(one)}={one.name}" for one in kind)


def _schema_text() -> str:
    lines = [f"omnimj link {PROTOCOL}", f"header: {HEADER_FIELDS}"]
    lines += [f"{kind.name} {int(kind)}: {layout.text}".rstrip() for kind, layout in PAYLOADS.items()]
    lines += [_format_enum(kind) for kind in (Quantity, Raw, Status, FaultCode)]
    return "".join(line + "\n" for line in lines)


SCHEMA_TEXT = _schema_text()
"""What both sides must mean alike: ASCII, each line ended by one line feed."""
SCHEMA = zlib.crc32(SCHEMA_TEXT.encode("ascii"))
"""Travels in every header."""
SCHEMA_INDEPENDENT = frozenset(MessageType) - {MessageType.COMMAND, MessageType.TELEMETRY}
"""Laid out the same as long as the protocol is 1, so that strangers can find out that they are."""
