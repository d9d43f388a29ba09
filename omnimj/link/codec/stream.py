"""Packets in the byte stream of a serial line, which arrives in arbitrary pieces with noise between them.

Each packet is encoded by consistent overhead byte stuffing (COBS) and ended by a zero. Source: Cheshire and
Baker, Consistent overhead byte stuffing, IEEE/ACM Transactions on Networking 7 (1999).
"""

from __future__ import annotations

from cobs import cobs

from omnimj.link.codec.layout import CHECKSUM_SIZE, HEADER, MAX_FRAME_SIZE, DropCounts, DropReason

DELIMITER = b"\0"
"""End of a stuffed packet."""
_MAX_STUFFED = cobs.max_encoded_length(MAX_FRAME_SIZE)
_MIN_STUFFED = HEADER.size + CHECKSUM_SIZE + 1


def stuff(packet: bytes) -> bytes:
    """Packet without zeros, followed by the delimiter."""
    return cobs.encode(packet) + DELIMITER


def unstuff(piece: bytes) -> bytes | None:
    """Packet from its stuffed bytes without the delimiter, or None if the stuffing is invalid."""
    try:
        return cobs.decode(piece) if piece else None
    except cobs.DecodeError:
        return None


class PacketStream:
    """Splitter of a stream at its zeros, which unstuffs the pieces; every zero resynchronises it.

    At most the bytes of one packet are kept, however long the line continues without a zero.
    """

    def __init__(self) -> None:
        self.drops = DropCounts()
        self._rest = b""
        self._overlong = False  # the current piece is too long: skip to the next zero

    def feed(self, chunk: bytes) -> list[bytes]:
        """Packets completed by this chunk; checksums are not verified. Never raises."""
        pieces = chunk.split(DELIMITER)
        pieces[0] = self._rest + pieces[0]
        last = pieces.pop()
        found = []
        for piece in pieces:
            if self._overlong:  # already counted
                self._overlong = False
                continue
            packet = self._packet(piece)
            if packet is not None:
                found.append(packet)
        self._keep(last)
        return found

    def skip(self) -> None:
        """Forget the beginning of a packet that will not be completed; it counts as dropped."""
        if self._rest:
            self.drops.add(DropReason.TOO_SHORT)
        self._rest, self._overlong = b"", False

    def _packet(self, piece: bytes) -> bytes | None:
        size = len(piece)
        if _MIN_STUFFED <= size <= _MAX_STUFFED:
            packet = unstuff(piece)
            if packet is None:
                self.drops.add(DropReason.STUFFING)
            return packet
        if size:  # consecutive zeros are allowed
            self.drops.add(DropReason.TOO_LONG if size > _MAX_STUFFED else DropReason.TOO_SHORT)
        return None

    def _keep(self, last: bytes) -> None:
        if self._overlong or len(last) > _MAX_STUFFED:
            if not self._overlong:
                self.drops.add(DropReason.TOO_LONG)
            self._overlong, self._rest = True, b""
        else:
            self._rest = last
