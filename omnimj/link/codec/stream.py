"""Packets out of a serial line's bytes, which come in any pieces, with anything in between."""

from __future__ import annotations

from omnimj.link.codec import cobs
from omnimj.link.codec.frames import decode
from omnimj.link.codec.key import Key
from omnimj.link.codec.layout import MAX_FRAME_SIZE, DropCounts, DropReason
from omnimj.link.codec.messages import Frame

_LONGEST = cobs.max_encoded_size(MAX_FRAME_SIZE)
_SHORTEST = 29  # of a frame without payload, stuffed


class PacketStream:
    """Cuts a stream at its zeros and unstuffs what lies between; starts anew at every zero.

    It never holds more than one packet's bytes, however long the line goes on without a zero.
    """

    def __init__(self) -> None:
        self.drops = DropCounts()
        self._rest = b""
        self._lost = False  # the packet that is coming is too long already: wait for the next zero

    def feed(self, chunk: bytes) -> list[bytes]:
        """The packets that end in this chunk. Checksums are not looked at. Never raises."""
        pieces = chunk.split(cobs.DELIMITER)
        pieces[0] = self._rest + pieces[0]
        last = pieces.pop()
        found = []
        for piece in pieces:
            if self._lost:  # its beginning has been counted
                self._lost = False
                continue
            packet = self._packet(piece)
            if packet is not None:
                found.append(packet)
        self._keep(last)
        return found

    def _packet(self, piece: bytes) -> bytes | None:
        size = len(piece)
        if _SHORTEST <= size <= _LONGEST:
            packet = cobs.decode(piece)
            if packet is None:
                self.drops.add(DropReason.STUFFING)
            return packet
        if size:  # zeros in a row say nothing
            self.drops.add(DropReason.TOO_LONG if size > _LONGEST else DropReason.TOO_SHORT)
        return None

    def _keep(self, last: bytes) -> None:
        if self._lost or len(last) > _LONGEST:
            if not self._lost:
                self.drops.add(DropReason.TOO_LONG)
            self._lost, self._rest = True, b""
        else:
            self._rest = last


class FrameStream:
    """Frames out of a stream of bytes, and counts of what it dropped on the way, and why."""

    def __init__(self, key: Key | None = None):
        self._packets, self._key = PacketStream(), key
        self.drops = self._packets.drops

    def feed(self, chunk: bytes) -> list[Frame]:
        """The frames that end in this chunk. Never raises."""
        found = []
        for packet in self._packets.feed(chunk):
            frame = decode(packet, self._key)
            if isinstance(frame, DropReason):
                self.drops.add(frame)
            else:
                found.append(frame)
        return found
