"""Frames from bytes and back: header, payload, tag where a key is in use, checksum.

A packet is the bytes of one frame: a datagram, or what stands between two zeros of a serial line, unstuffed.
"""

from __future__ import annotations

import struct
from zlib import crc32

from omnimj.errors import InputError
from omnimj.link.codec import payloads
from omnimj.link.codec.key import Key
from omnimj.link.codec.layout import (
    CHECKSUM_SIZE,
    HEADER,
    MAX_FRAME_SIZE,
    PROTOCOL,
    SCHEMA,
    SCHEMA_INDEPENDENT,
    TAG_SIZE,
    TAGGED,
    DropReason,
)
from omnimj.link.codec.messages import (
    Arm,
    Capabilities,
    Command,
    Fault,
    Frame,
    Hello,
    Message,
    MessageType,
    Ping,
    Pong,
    ResetFault,
    Stop,
    Telemetry,
)

_WRITERS: dict[type[Message], tuple[int, payloads.PayloadWriter]] = {
    Hello: (int(MessageType.HELLO), payloads.write_nonce),
    Capabilities: (int(MessageType.CAPABILITIES), payloads.write_capabilities),
    Arm: (int(MessageType.ARM), payloads.write_arm),
    Command: (int(MessageType.COMMAND), payloads.write_command),
    Telemetry: (int(MessageType.TELEMETRY), payloads.write_telemetry),
    Stop: (int(MessageType.STOP), payloads.write_nothing),
    Fault: (int(MessageType.FAULT), payloads.write_fault),
    ResetFault: (int(MessageType.RESET_FAULT), payloads.write_nothing),
    Ping: (int(MessageType.PING), payloads.write_nonce),
    Pong: (int(MessageType.PONG), payloads.write_nonce),
}
_READERS: dict[int, payloads.PayloadReader] = {
    int(MessageType.HELLO): payloads.read_hello,
    int(MessageType.CAPABILITIES): payloads.read_capabilities,
    int(MessageType.ARM): payloads.read_arm,
    int(MessageType.COMMAND): payloads.read_command,
    int(MessageType.TELEMETRY): payloads.read_telemetry,
    int(MessageType.STOP): payloads.read_stop,
    int(MessageType.FAULT): payloads.read_fault,
    int(MessageType.RESET_FAULT): payloads.read_reset_fault,
    int(MessageType.PING): payloads.read_ping,
    int(MessageType.PONG): payloads.read_pong,
}
_STOP = int(MessageType.STOP)
_SCHEMA_INDEPENDENT_TYPES = frozenset(int(kind) for kind in SCHEMA_INDEPENDENT)
_SHORTEST = HEADER.size + CHECKSUM_SIZE
_CRC_RESIDUE = 0x2144DF1C  # CRC-32 of anything that ends with its own CRC-32


def encode(frame: Frame, key: Key | None = None) -> bytes:
    """The frame as a packet, tagged where there is a key; float32 turns what is too large into infinity.

    Args:
      frame: What to send; `authentic` and `same_schema` are for what was received.
      key: Of this link.

    Raises:
      InputError: a number does not fit its field, or there are more wheels or channels than a frame holds.
    """
    message = frame.message
    kind, write = _WRITERS[type(message)]
    flags = 0 if key is None else TAGGED
    try:
        header = HEADER.pack(PROTOCOL, kind, flags, frame.session, frame.sequence, frame.time, SCHEMA)
        content = header + write(message)
    except struct.error as error:
        raise InputError(f"frame {MessageType(kind).name}", str(frame), f"does not fit: {error}") from None
    if key is not None:
        content += key.tag(content)
    return content + crc32(content).to_bytes(CHECKSUM_SIZE, "little")


def decode(packet: bytes, key: Key | None = None) -> Frame | DropReason:
    """The frame of a packet, or why there is none. Never raises, whatever the bytes.

    Without a key, frames with a tag are dropped; with one, those without or with a wrong one are. A stop
    comes through either way, `authentic` or not: who stops a robot needs no papers.
    """
    size = len(packet)
    if size < _SHORTEST:
        return DropReason.TOO_SHORT
    if size > MAX_FRAME_SIZE:
        return DropReason.TOO_LONG
    if crc32(packet) != _CRC_RESIDUE:
        return DropReason.CHECKSUM
    protocol, kind, flags, session, sequence, time, schema = HEADER.unpack_from(packet)
    if protocol != PROTOCOL:
        return DropReason.PROTOCOL
    read = _READERS.get(kind)
    if read is None:
        return DropReason.TYPE
    if flags > TAGGED:
        return DropReason.FLAGS
    end = size - CHECKSUM_SIZE
    wrong: DropReason | None = None if key is None else DropReason.NO_TAG
    if flags:
        end -= TAG_SIZE
        if end < HEADER.size:
            return DropReason.LENGTH
        wrong = DropReason.NO_KEY if key is None else key.fault(packet[:end], packet[end : end + TAG_SIZE])
    if wrong is not None and kind != _STOP:
        return wrong
    same = schema == SCHEMA
    if not same and kind not in _SCHEMA_INDEPENDENT_TYPES:
        return DropReason.SCHEMA
    message = read(packet, HEADER.size, end)
    if message.__class__ is DropReason:
        return message  # type: ignore[return-value]  # by its class
    authentic = flags != 0 and wrong is None
    return Frame(message, session, sequence, time, authentic, same)  # type: ignore[arg-type]
