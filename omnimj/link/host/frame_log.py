"""`frames.bin`: every frame of a link, both ways, as it was on the wire, with the times of the host's clock.

The file begins with the 8 bytes `omnimj` 0 1 and one text (u32 length, then UTF-8 JSON: what was driven, and
the hash of the calibration). Then record after record, little endian: `size u16 | kind u8 | time f64 [s] |
packet`. Kinds: 0 sent, 1 received, 2 received and dropped; 16 more where the packet had a tag, which is left
out (its flag is cleared and its checksum made anew), so that no key is needed to read it. Raw numbers are
kept, so that a recording can be read anew with another calibration.
"""

from __future__ import annotations

import contextlib
import json
import queue
import struct
import threading
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any
from zlib import crc32

from omnimj.errors import InputError
from omnimj.link.codec.frames import decode
from omnimj.link.codec.layout import CHECKSUM_SIZE, HEADER, MAX_FRAME_SIZE, TAG_SIZE, TAGGED, DropReason
from omnimj.link.codec.messages import Frame

FRAMES_FILE = "frames.bin"
_MAGIC = b"omnimj\x00\x01"
_LENGTH, _RECORD = struct.Struct("<I"), struct.Struct("<HBd")
_SENT, _RECEIVED, _DROPPED, _UNTAGGED = 0, 1, 2, 16
_AT_ONCE = 65_536  # bytes that are written together, at most
_OFTEN = 0.25  # [s] between two writes, at most
_QUEUED = 256  # such pieces: 16 MB, a minute and more
_LONGEST_WRITE = 30.0  # [s] that the end of a run waits for a disk
_MOST_DROPPED = 10_000  # packets: noise must not fill the disk
_MOST_TEXT = 1_000_000
_LARGEST_FILE = 4_000_000_000


class FrameLog:
    """Writes as the link goes; what was written until a crash can be read.

    A disk may take half a second for a write, which is more than a robot waits for: a thread does it.
    """

    def __init__(self, path: Path, about: Mapping[str, Any]):
        """Begins a new file.

        Raises:
          InputError: It is there already, or cannot be written.
        """
        text = json.dumps(dict(about)).encode()
        try:
            self._file = path.open("xb", buffering=0)
            self._file.write(_MAGIC + _LENGTH.pack(len(text)) + text)
        except OSError as error:
            raise InputError(path, f"cannot be written ({error.strerror})") from None
        self._waiting, self._written = bytearray(), 0.0
        self._dropped, self._is_open = 0, True
        self.failed = ""
        """Why nothing is written any more, such as a full disk; a run goes on without."""
        self._queue: queue.Queue[bytes | None] = queue.Queue(_QUEUED)
        self._writer = threading.Thread(target=self._write, name="frame log", daemon=True)
        self._writer.start()

    def sent(self, now: float, packet: bytes) -> None:
        """One of ours [s]."""
        self._add(now, packet, _SENT)

    def received(self, now: float, packet: bytes) -> None:
        """One of the device's [s]."""
        self._add(now, packet, _RECEIVED)

    def dropped(self, now: float, packet: bytes) -> None:
        """What came and was no frame [s]; the first 10000."""
        self._dropped += 1
        if self._dropped <= _MOST_DROPPED and len(packet) <= MAX_FRAME_SIZE:
            self._add(now, packet, _DROPPED)

    def _add(self, now: float, packet: bytes, kind: int) -> None:
        if kind != _DROPPED and packet[2] & TAGGED:
            packet, kind = _without_tag(packet), kind + _UNTAGGED
        self._waiting += _RECORD.pack(len(packet), kind, now) + packet
        if len(self._waiting) >= _AT_ONCE or now - self._written > _OFTEN:
            self.flush()
            self._written = now

    def flush(self) -> None:
        """Hands what waits to the thread; never waits."""
        if self._waiting and not self.failed:
            try:
                self._queue.put_nowait(bytes(self._waiting))
            except queue.Full:
                self.failed = "the disk is too slow"
        self._waiting.clear()

    def close(self) -> None:
        """Writes the rest; may be called twice."""
        if not self._is_open:
            return
        self._is_open = False
        self.flush()
        with contextlib.suppress(queue.Full):
            self._queue.put(None, timeout=_LONGEST_WRITE)
        self._writer.join(_LONGEST_WRITE)

    def _write(self) -> None:
        """The thread's: piece after piece, up to the end or the first one that cannot be written."""
        with self._file:
            while (piece := self._queue.get()) is not None:
                try:
                    if not self.failed:
                        self._file.write(piece)
                except OSError as error:
                    self.failed = error.strerror or str(error)


@dataclass(frozen=True, slots=True)
class LoggedFrame:
    """One frame of a recording."""

    time: float
    """Of the host's clock [s]."""
    is_sent: bool
    """By the host; else received."""
    frame: Frame


class FrameRecording:
    """A file that is read frame by frame, up to its end or to where it breaks off."""

    def __init__(self, path: Path):
        """Reads what was driven.

        Raises:
          InputError: There is no such file, or it is no recording.
        """
        try:
            if path.stat().st_size > _LARGEST_FILE:
                raise InputError(path, f"has more than {_LARGEST_FILE} bytes")
            self._content = path.read_bytes()
        except OSError as error:
            found = f"cannot be read ({error.strerror})"
            raise InputError(path, found, "a recording of frames is needed") from None
        begin = len(_MAGIC) + _LENGTH.size
        size = _LENGTH.unpack_from(self._content, len(_MAGIC))[0] if len(self._content) >= begin else 0
        if not self._content.startswith(_MAGIC) or size > _MOST_TEXT:
            raise InputError(path, "is no recording of frames")
        self.about = _about(path, self._content[begin : begin + size])
        self._begin = begin + size
        self.dropped = 0
        """Packets that came and were no frames, among those read so far."""
        self.is_whole = True
        """Whether it ends where a record ends; a program that was killed may leave half of one."""

    def __iter__(self) -> Iterator[LoggedFrame]:
        """The frames in the order of time."""
        at, content = self._begin, self._content
        self.dropped, self.is_whole = 0, True
        while at < len(content):
            first = at + _RECORD.size
            if first > len(content) or first + _RECORD.unpack_from(content, at)[0] > len(content):
                self.is_whole = False
                return
            size, kind, time = _RECORD.unpack_from(content, at)
            at = first + size
            way = kind & ~_UNTAGGED
            frame = decode(content[first:at]) if way in (_SENT, _RECEIVED) else DropReason.TYPE
            if isinstance(frame, DropReason):
                self.dropped += 1
            else:
                yield LoggedFrame(time, way == _SENT, frame)


def _about(path: Path, text: bytes) -> Mapping[str, Any]:
    try:
        about = json.loads(text)
    except ValueError:
        about = None
    if not isinstance(about, dict):
        raise InputError(path, "does not say what was driven", "it is damaged")
    return about


def _without_tag(packet: bytes) -> bytes:
    end = len(packet) - CHECKSUM_SIZE - TAG_SIZE
    if end < HEADER.size:
        return packet
    content = packet[:2] + (packet[2] & ~TAGGED).to_bytes(1, "little") + packet[3:end]
    return content + crc32(content).to_bytes(CHECKSUM_SIZE, "little")
