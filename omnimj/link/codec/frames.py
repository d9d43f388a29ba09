"""Encode and decode frames: header, payload, authentication tag on a keyed link, checksum.

A packet is the bytes of one frame: a datagram, or the unstuffed bytes between two zeros of a serial line.
"""

from __future__ import annotations

import dataclasses
import functools
import math
import operator
import struct
import typing
from collections.abc import Callable
from typing import Any
from zlib import crc32

from omnimj.errors import InputError
from omnimj.link.codec.key import FrameKey
from omnimj.link.codec.layout import (
    CHECKSUM_SIZE,
    FLOAT32_OVERFLOW,
    HEADER,
    MAX_CHANNELS,
    MAX_FRAME_SIZE,
    MESSAGES,
    PROTOCOL,
    SCHEMA,
    SCHEMA_INDEPENDENT,
    TAG_SIZE,
    TAGGED,
    DropReason,
    Field,
    Layout,
    struct_of,
)
from omnimj.link.codec.messages import Frame, MessageType

_STOP = int(MessageType.STOP)
_SCHEMA_INDEPENDENT_TYPES = frozenset(int(kind) for kind in SCHEMA_INDEPENDENT)
_MIN_SIZE = HEADER.size + CHECKSUM_SIZE
_CRC_RESIDUE = 0x2144DF1C  # CRC-32 of any content followed by its own CRC-32
_FLOATS = tuple(struct.Struct(f"<{n}f") for n in range(MAX_CHANNELS + 1))


def encode(frame: Frame, key: FrameKey | None = None) -> bytes:
    """Encode a frame as a packet; numbers beyond the range of float32 become infinite.

    Args:
      frame: Frame to send; `authentic` and `same_schema` concern received frames only.
      key: Key of the link or keys of its end; the frame is tagged with it.

    Raises:
      InputError: A number does not fit its field, or there are too many wheels or channels.
    """
    message = frame.message
    kind, payload = _BY_RECORD[type(message)]
    flags = 0 if key is None else TAGGED
    try:
        header = HEADER.pack(PROTOCOL, kind, flags, frame.session, frame.sequence, frame.time, SCHEMA)
        content = header + payload.encode(message)
    except struct.error as error:
        raise InputError(f"frame {MessageType(kind).name}", str(frame), f"does not fit: {error}") from None
    if key is not None:
        content += key.tag(content)
    return content + crc32(content).to_bytes(CHECKSUM_SIZE, "little")


def decode(packet: bytes, key: FrameKey | None = None) -> Frame | DropReason:
    """Decode a packet to a frame, or to the reason to drop it; never raises, whatever the bytes.

    Without a key, tagged frames are dropped; with a key, frames with a wrong tag or none. A stop always
    passes, `authentic` or not, since any sender may stop a robot.

    Args:
      packet: Received bytes.
      key: Key of the link or keys of its end.
    """
    size = len(packet)
    if size < _MIN_SIZE:
        return DropReason.TOO_SHORT
    if size > MAX_FRAME_SIZE:
        return DropReason.TOO_LONG
    if crc32(packet) != _CRC_RESIDUE:
        return DropReason.CHECKSUM
    protocol, kind, flags, session, sequence, time, schema = HEADER.unpack_from(packet)
    if protocol != PROTOCOL:
        return DropReason.PROTOCOL
    payload = _BY_TYPE.get(kind)
    if payload is None:
        return DropReason.TYPE
    if flags > TAGGED:
        return DropReason.FLAGS
    end = size - CHECKSUM_SIZE
    rejected: DropReason | None = None if key is None else DropReason.NO_TAG
    if flags:
        end -= TAG_SIZE
        if end < HEADER.size:
            return DropReason.LENGTH
        rejected = (
            DropReason.NO_KEY if key is None else key.verify(packet[:end], packet[end : end + TAG_SIZE])
        )
    if rejected is not None and kind != _STOP:
        return rejected
    same_schema = schema == SCHEMA
    if not same_schema and kind not in _SCHEMA_INDEPENDENT_TYPES:
        return DropReason.SCHEMA
    message = payload.decode(packet, HEADER.size, end)
    if message.__class__ is DropReason:
        return message
    return Frame(message, session, sequence, time, flags != 0 and rejected is None, same_schema)


class _RecordCodec:
    """Codec of the fixed fields of one kind of record."""

    def __init__(self, record: type, fields: tuple[Field, ...], count: str = "", items: str = ""):
        """Prepare the conversions."""
        self.struct = struct_of(fields)
        self._record, self._fields = record, fields
        self._writers = [_writer(field) for field in fields]
        self._allowed = [(i, field.values) for i, field in enumerate(fields) if field.values is not None]
        self._readers = [(i, field.read) for i, field in enumerate(fields) if field.read is not None]
        self._floats = [i for i, field in enumerate(fields) if field.type == "f32"]
        attributes = ["" if field.name == count else _attribute(field) for field in fields]
        attributes += [items] if count else []
        self._nested: list[tuple[type, list[int]]] = []
        self._order = [self._position(name, kind, attributes) for name, kind in _attributes_of(record)]

    def _position(self, name: str, kind: type, attributes: list[str]) -> int:
        """Index of a record's attribute among the values; nested records are appended to them."""
        if name in attributes:
            return attributes.index(name)
        nested = [attributes.index(f"{name}.{inner}") for inner, _ in _attributes_of(kind)]
        self._nested.append((kind, nested))
        return len(attributes) + len(self._nested) - 1

    def pack(self, record: object) -> bytes:
        """Encode the fixed fields of a record."""
        numbers = [write(record) for write in self._writers]
        for i, allowed in self._allowed:
            if numbers[i] not in allowed:
                place = f"{type(record).__name__.lower()}.{self._fields[i].name}"
                raise InputError(place, str(numbers[i]), f"{min(allowed)}…{max(allowed)}")
        try:
            return self.struct.pack(*numbers)
        except OverflowError:
            for i in self._floats:
                numbers[i] = _saturate(numbers[i])
            return self.struct.pack(*numbers)

    def build(self, numbers: tuple[Any, ...], *items: object) -> Any:
        """Record built from the unpacked numbers, or None if one of them is not allowed."""
        values = [*numbers, *items]
        for i, allowed in self._allowed:
            value = allowed.get(values[i])
            if value is None:
                return None
            values[i] = value
        for i, read in self._readers:
            values[i] = read(values[i])
        for record, order in self._nested:
            values.append(record(*[values[i] for i in order]))
        return self._record(*[values[i] for i in self._order])


class _PayloadCodec:
    """Codec of the payload of one message type."""

    def __init__(self, layout: Layout):
        self._fixed = _RecordCodec(layout.record, layout.fields, layout.count, layout.attribute)
        self._size, self._rule = self._fixed.struct.size, layout.rule
        self._has_items, self._item = bool(layout.items), None
        if layout.items:
            self._items = operator.attrgetter(layout.attribute)
            names = [field.name for field in layout.fields]
            self._count = names.index(layout.count)
            # bit i of this field: item i is an integer
            self._mask = names.index("counts") if layout.items[0].type == "f32_or_i32" else None
            self._item_size = struct_of(layout.items).size
            if layout.item_record is not None:
                self._item = _RecordCodec(layout.item_record, layout.items)

    def encode(self, message: Any) -> bytes:
        """Encode the payload.

        Raises:
          InputError: The message breaks a rule of its layout.
        """
        broken = None if self._rule is None else self._rule(message)
        if broken is not None:
            raise InputError(type(message).__name__.lower(), *broken)
        fixed = self._fixed.pack(message)
        if not self._has_items:
            return fixed
        items = self._items(message)
        if self._item is not None:
            return fixed + b"".join(map(self._item.pack, items))
        return fixed + _pack_numbers(items, 0 if self._mask is None else message.counts)

    def decode(self, packet: bytes, begin: int, end: int) -> Any:
        """Decode the message in `packet[begin:end]`, or return the reason to drop it."""
        first = begin + self._size
        if end < first or (end > first and not self._has_items):
            return DropReason.LENGTH
        numbers = self._fixed.struct.unpack_from(packet, begin)
        if not self._has_items:
            message = self._fixed.build(numbers)
        else:
            count = numbers[self._count]
            if end != first + self._item_size * count:
                return DropReason.LENGTH
            if count > MAX_CHANNELS:
                return DropReason.VALUE
            if self._item is not None:
                items = tuple(map(self._item.build, self._item.struct.iter_unpack(packet[first:end])))
                if None in items:
                    return DropReason.VALUE
            else:
                mask = 0 if self._mask is None else numbers[self._mask]
                items = _numbers_struct(count, mask).unpack_from(packet, first)
            message = self._fixed.build(numbers, items)
        if message is None or (self._rule is not None and self._rule(message) is not None):
            return DropReason.VALUE
        return message


def _attribute(field: Field) -> str:
    return field.name if field.attribute is None else field.attribute


def _attributes_of(record: type) -> list[tuple[str, type]]:
    """Names and types of a dataclass's fields."""
    types = typing.get_type_hints(record)
    return [(field.name, types[field.name]) for field in dataclasses.fields(record)]


def _writer(field: Field) -> Callable[[Any], Any]:
    """Function that returns the number on the wire for a record."""
    attribute, write = _attribute(field), field.write
    if not attribute:
        return lambda record: 0
    get = operator.attrgetter(attribute)
    return get if write is None else lambda record: write(get(record))


def _saturate(value: float) -> float:
    return math.copysign(math.inf, value) if abs(value) >= FLOAT32_OVERFLOW else value


@functools.lru_cache(maxsize=64)
def _mixed_struct(count: int, mask: int) -> struct.Struct:
    return struct.Struct("<" + "".join("i" if mask >> i & 1 else "f" for i in range(count)))


def _numbers_struct(count: int, mask: int) -> struct.Struct:
    """Layout of `count` numbers: i32 where the mask has a bit, f32 elsewhere."""
    return _mixed_struct(count, mask) if mask else _FLOATS[count]


def _pack_numbers(values: tuple[float, ...], mask: int) -> bytes:
    layout = _numbers_struct(len(values), mask)
    try:
        return layout.pack(*values)
    except (OverflowError, struct.error):
        fitted = (
            _wrapped_count(value, i) if mask >> i & 1 else _saturate(value) for i, value in enumerate(values)
        )
        return layout.pack(*fitted)


def _wrapped_count(value: float, channel: int) -> int:
    if not math.isfinite(value):
        raise InputError(f"telemetry.raw[{channel}]", f"{value} counts", "counts are whole numbers")
    return (int(value) + 2**31) % 2**32 - 2**31


_BY_TYPE = {int(kind): _PayloadCodec(layout) for kind, layout in MESSAGES.items()}
_BY_RECORD = {layout.record: (int(kind), _BY_TYPE[int(kind)]) for kind, layout in MESSAGES.items()}
