"""Log of all frames of a link in both directions, `frames.bin`, with the times of the host's clock.

Times are those of sending and, where the system measures it, of arrival at the socket.

The file begins with the 8 bytes `omnimj` 0 1 and a text (u32 length, then UTF-8 JSON with a description of
the run and the hash of the calibration). Records follow, little endian: `size u16 | kind u8 | time f64 [s] |
packet`. Kinds: 0 sent, 1 received, 2 received and dropped; 16 is added if the packet had a tag, which is
removed (its flag is cleared and its checksum recomputed), so that no key is needed to read the file. Readings
are raw, so that a recording can be read again with another calibration.
"""

from __future__ import annotations

import contextlib
import json
import queue
import stat
import struct
import threading
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any
from zlib import crc32

from omnimj.errors import InputError, write_failure
from omnimj.link.codec.frames import decode
from omnimj.link.codec.layout import CHECKSUM_SIZE, HEADER, MAX_FRAME_SIZE, TAG_SIZE, TAGGED, DropReason
from omnimj.link.codec.messages import Frame

FRAMES_FILE = "frames.bin"
_MAGIC = b"omnimj\x00\x01"
_LENGTH, _RECORD = struct.Struct("<I"), struct.Struct("<HBd")
_SENT, _RECEIVED, _DROPPED, _UNTAGGED = 0, 1, 2, 16
_WRITE_SIZE = 65_536  # bytes per write
_WRITE_INTERVAL = 0.25  # [s] between two writes
_MAX_QUEUED = 256  # pieces: 16 MB, more than a minute
_CLOSE_TIMEOUT = 30.0  # [s] to wait for the disk at the end of a run
_MAX_DROPPED = 10_000  # packets, so that noise cannot fill the disk
_MAX_TEXT = 1_000_000
_MAX_FILE_SIZE = 4_000_000_000


class FrameLog:
    """Writer of a log; a file that a crash has truncated can still be read.

    A thread writes, since a disk may take half a second, for which a robot cannot wait.
    """

    def __init__(self, path: Path, about: Mapping[str, Any]):
        """Begin a new file.

        Args:
          path: The file.
          about: Description of the run.

        Raises:
          InputError: The file exists.
          OutputError: It cannot be written.
        """
        text = json.dumps(dict(about)).encode()
        try:
            self._file = path.open("xb", buffering=0)
            self._file.write(_MAGIC + _LENGTH.pack(len(text)) + text)
        except FileExistsError:
            raise InputError(path, "exists already", "a log is a new file") from None
        except OSError as error:
            raise write_failure(path, error) from None
        self._pending, self._last_write = bytearray(), 0.0
        self._dropped, self._is_open = 0, True
        self.failed = ""
        """Reason for which writing has ended, such as a full disk; the run continues."""
        self._queue: queue.Queue[bytes | None] = queue.Queue(_MAX_QUEUED)
        self._writer = threading.Thread(target=self._write, name="frame log", daemon=True)
        self._writer.start()

    def sent(self, now: float, packet: bytes) -> None:
        """Log a sent packet at `now` [s]."""
        self._add(now, packet, _SENT)

    def received(self, now: float, packet: bytes) -> None:
        """Log a received packet that arrived at `now` [s]."""
        self._add(now, packet, _RECEIVED)

    def dropped(self, now: float, packet: bytes) -> None:
        """Log a received packet that is no frame at `now` [s]; only the first 10000."""
        self._dropped += 1
        if self._dropped <= _MAX_DROPPED and len(packet) <= MAX_FRAME_SIZE:
            self._add(now, packet, _DROPPED)

    def _add(self, now: float, packet: bytes, kind: int) -> None:
        if kind != _DROPPED and packet[2] & TAGGED:
            packet, kind = _without_tag(packet), kind + _UNTAGGED
        self._pending += _RECORD.pack(len(packet), kind, now) + packet
        if len(self._pending) >= _WRITE_SIZE or now - self._last_write > _WRITE_INTERVAL:
            self.flush()
            self._last_write = now

    def flush(self) -> None:
        """Hand the pending records to the thread without waiting."""
        if self._pending and not self.failed:
            try:
                self._queue.put_nowait(bytes(self._pending))
            except queue.Full:
                self.failed = "the disk is too slow"
        self._pending.clear()

    def close(self) -> None:
        """Write the rest and close the file; may be called twice."""
        if not self._is_open:
            return
        self._is_open = False
        self.flush()
        with contextlib.suppress(queue.Full):
            self._queue.put(None, timeout=_CLOSE_TIMEOUT)
        self._writer.join(_CLOSE_TIMEOUT)

    def _write(self) -> None:
        """Write pieces in the thread until the end or the first failure."""
        with self._file:
            while (piece := self._queue.get()) is not None:
                try:
                    if not self.failed:
                        self._file.write(piece)
                except OSError as error:
                    self.failed = error.strerror or str(error)


@dataclass(frozen=True, slots=True)
class LoggedFrame:
    """Frame of a recording."""

    time: float
    """Time of the host's clock [s]."""
    is_sent: bool
    """True if the host sent it; otherwise it was received."""
    frame: Frame


class FrameRecording:
    """Reader of a log, frame by frame, up to its end or truncation."""

    def __init__(self, path: Path):
        """Read the description.

        Raises:
          InputError: The file cannot be read or is no recording.
        """
        try:
            status = path.stat()
            if status.st_size > _MAX_FILE_SIZE:
                raise InputError(path, f"has more than {_MAX_FILE_SIZE} bytes")
            if not stat.S_ISREG(status.st_mode):
                raise InputError(path, "is no regular file", "a recording of frames is needed")
            self._content = path.read_bytes()
        except OSError as error:
            found = f"cannot be read ({error.strerror})"
            raise InputError(path, found, "a recording of frames is needed") from None
        begin = len(_MAGIC) + _LENGTH.size
        size = _LENGTH.unpack_from(self._content, len(_MAGIC))[0] if len(self._content) >= begin else 0
        if not self._content.startswith(_MAGIC) or size > _MAX_TEXT:
            raise InputError(path, "is no recording of frames")
        self.about = _about(path, self._content[begin : begin + size])
        self._begin = begin + size
        self.dropped = 0
        """Packets read so far that are no frames."""
        self.is_whole = True
        """True if the file ends with a complete record; a killed program may leave a partial one."""

    def __iter__(self) -> Iterator[LoggedFrame]:
        """Iterate over the frames in the order in which the host sent or processed them."""
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
        raise InputError(path, "has no description of the run", "it is damaged")
    return about


def _without_tag(packet: bytes) -> bytes:
    end = len(packet) - CHECKSUM_SIZE - TAG_SIZE
    if end < HEADER.size:
        return packet
    content = packet[:2] + (packet[2] & ~TAGGED).to_bytes(1, "little") + packet[3:end]
    return content + crc32(content).to_bytes(CHECKSUM_SIZE, "little")
