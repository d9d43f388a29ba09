"""Frames of a byte stream, as both ends of a serial line decode them."""

from __future__ import annotations

from omnimj.link.codec.frames import decode
from omnimj.link.codec.key import Key
from omnimj.link.codec.layout import DropReason
from omnimj.link.codec.messages import Frame
from omnimj.link.codec.stream import PacketStream


class FrameStream:
    """Frames in a stream of bytes; `drops` counts rejected pieces by reason."""

    def __init__(self, key: Key | None = None):
        self._packets, self._key = PacketStream(), key
        self.drops = self._packets.drops

    def feed(self, chunk: bytes) -> list[Frame]:
        """Frames completed by this chunk. Never raises."""
        found = []
        for packet in self._packets.feed(chunk):
            frame = decode(packet, self._key)
            if isinstance(frame, DropReason):
                self.drops.add(frame)
            else:
                found.append(frame)
        return found
