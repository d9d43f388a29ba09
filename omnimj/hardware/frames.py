"""Frames from bytes and back: header, payload, tag where a key is in use, checksum.

A packet is the bytes of one frame: a datagram, or what stands between two zeros of a serial line, unstuffed.
"""

from __future__ import annotations

import struct
from zlib import crc32

from omnimj.errors import InputError
from omnimj.hardware import payloads
from omnimj.hardware.drops import Drop
from omnimj.hardware.key_file import Key
from omnimj.hardware.layouts import (
    CHECKSUM_SIZE,
    FOR_EVERY_SCHEMA,
    HEADER,
    LONGEST_FRAME,
    PROTOCOL,
    SCHEMA,
    TAG_SIZE,
    TAGGED,
)
from omnimj.hardware.messages import (
    Arm,
    Capabilities,
    Command,
    Fault,
    Frame,
    Hello,
    Message,
    Ping,
    Pong,
    ResetFault,
    Stop,
    Telemetry,
    Type,
)

_WRITERS: dict[type[Message], tuple[int, payloads.Written]] = {
    Hello: (int(Type.HELLO), payloads.write_nonce),
    Capabilities: (int(Type.CAPABILITIES), payloads.write_capabilities),
    Arm: (int(Type.ARM), payloads.write_arm),
    Command: (int(Type.COMMAND), payloads.write_command),
    Telemetry: (int(Type.TELEMETRY), payloads.write_telemetry),
    Stop: (int(Type.STOP), payloads.write_nothing),
    Fault: (int(Type.FAULT), payloads.write_fault),
    ResetFault: (int(Type.RESET_FAULT), payloads.write_nothing),
    Ping: (int(Type.PING), payloads.write_nonce),
    Pong: (int(Type.PONG), payloads.write_nonce),
}
_READERS: dict[int, payloads.Read] = {
    int(Type.HELLO): payloads.read_hello,
    int(Type.CAPABILITIES): payloads.read_capabilities,
    int(Type.ARM): payloads.read_arm,
    int(Type.COMMAND): payloads.read_command,
    int(Type.TELEMETRY): payloads.read_telemetry,
    int(Type.STOP): payloads.read_stop,
    int(Type.FAULT): payloads.read_fault,
    int(Type.RESET_FAULT): payloads.read_reset_fault,
    int(Type.PING): payloads.read_ping,
    int(Type.PONG): payloads.read_pong,
}
_STOP = int(Type.STOP)
_EVERYWHERE = frozenset(int(kind) for kind in FOR_EVERY_SCHEMA)
_SHORTEST = HEADER.size + CHECKSUM_SIZE
_RIGHT = 0x2144DF1C  # CRC-32 of anything that ends with its own CRC-32


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
        raise InputError(f"frame {Type(kind).name}", str(frame), f"does not fit: {error}") from None
    if key is not None:
        content += key.tag(content)
    return content + crc32(content).to_bytes(CHECKSUM_SIZE, "little")


def decode(packet: bytes, key: Key | None = None) -> Frame | Drop:
    """The frame of a packet, or why there is none. Never raises, whatever the bytes.

    Without a key, frames with a tag are dropped; with one, those without or with a wrong one are. A stop
    comes through either way, `authentic` or not: who stops a robot needs no papers.
    """
    size = len(packet)
    if size < _SHORTEST:
        return Drop.TOO_SHORT
    if size > LONGEST_FRAME:
        return Drop.TOO_LONG
    if crc32(packet) != _RIGHT:
        return Drop.CHECKSUM
    protocol, kind, flags, session, sequence, time, schema = HEADER.unpack_from(packet)
    if protocol != PROTOCOL:
        return Drop.PROTOCOL
    read = _READERS.get(kind)
    if read is None:
        return Drop.TYPE
    if flags > TAGGED:
        return Drop.FLAGS
    end = size - CHECKSUM_SIZE
    wrong: Drop | None = None if key is None else Drop.NO_TAG
    if flags:
        end -= TAG_SIZE
        if end < HEADER.size:
            return Drop.LENGTH
        wrong = Drop.NO_KEY if key is None else key.fault(packet[:end], packet[end : end + TAG_SIZE])
    if wrong is not None and kind != _STOP:
        return wrong
    same = schema == SCHEMA
    if not same and kind not in _EVERYWHERE:
        return Drop.SCHEMA
    message = read(packet, HEADER.size, end)
    if message.__class__ is Drop:
        return message  # type: ignore[return-value]  # by its class
    authentic = flags != 0 and wrong is None
    return Frame(message, session, sequence, time, authentic, same)  # type: ignore[arg-type]
