"""How every message lies in bytes: the one table that Python, the schema and `PROTOCOL.md` are held to.

A layout is words `name:type`, in order, without padding, little endian. `zero` fields are reserved.
"""

from __future__ import annotations

import enum
import functools
import re
import struct
import zlib
from dataclasses import dataclass

from omnimj.hardware.messages import FaultCode, Quantity, Raw, Status, Type

PROTOCOL = 1
LONGEST_FRAME = 512
"""Bytes, with header and checksum, without stuffing."""
MOST_WHEELS = 8
MOST_CHANNELS = 32
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


PAYLOADS: dict[Type, Layout] = {
    Type.HELLO: Layout("nonce:u64"),
    Type.CAPABILITIES: Layout(
        "nonce:u64 limits_hash:u64 calibration_hash:u64 period_us:u32"
        " current:f32 current_rate:f32 continuous_current:f32 heating:f32 wheel_speed:f32 message_rate:f32"
        " valid_for:f32 lock_step:u8 wheels:u8 channels:u8 zero:u8",
        "quantity:u8 wheel:u8 raw:u8 zero:u8",
        "channels",
    ),
    Type.ARM: Layout("limits_hash:u64 calibration_hash:u64 telemetry:u32"),
    Type.COMMAND: Layout("valid_for:f32 wheels:u8 brake:u8 zero:u16", "current:f32", "wheels"),
    Type.TELEMETRY: Layout(
        "acknowledged:u32 command_age_us:u32 status:u16 fault:u8 channels:u8 refused:u32 dropped:u32"
        " counts:u32",
        "raw:f32_or_i32",
        "channels",
    ),
    Type.STOP: Layout(""),
    Type.FAULT: Layout("code:u8 wheel:u8 latched:u8 zero:u8 value:f32 limit:f32 sequence:u32"),
    Type.RESET_FAULT: Layout(""),
    Type.PING: Layout("nonce:u64"),
    Type.PONG: Layout("nonce:u64"),
}


def _choices(kind: type[enum.IntEnum] | type[enum.IntFlag]) -> str:
    return f"{kind.__name__}: " + " ".join(f"{int(one)}={one.name}" for one in kind)


def _schema_text() -> str:
    lines = [f"omnimj link {PROTOCOL}", f"header: {HEADER_FIELDS}"]
    lines += [f"{kind.name} {int(kind)}: {layout.text}".rstrip() for kind, layout in PAYLOADS.items()]
    lines += [_choices(kind) for kind in (Quantity, Raw, Status, FaultCode)]
    return "".join(line + "\n" for line in lines)


SCHEMA_TEXT = _schema_text()
"""What both sides must mean alike: ASCII, each line ended by one line feed."""
SCHEMA = zlib.crc32(SCHEMA_TEXT.encode("ascii"))
"""Travels in every header."""
FOR_EVERY_SCHEMA = frozenset(Type) - {Type.COMMAND, Type.TELEMETRY}
"""Laid out the same as long as the protocol is 1, so that strangers can find out that they are."""
