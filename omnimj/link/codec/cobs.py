"""Consistent overhead byte stuffing: a packet without a zero byte, so that zero can end it.

Each zero of the packet is replaced by the distance to the next one, and the first byte says where the first
zero is; a distance of 255 says that 254 bytes follow and no zero. Source: Cheshire and Baker, Consistent
overhead byte stuffing, IEEE/ACM Transactions on Networking 7 (1999).
"""

from __future__ import annotations

import numpy as np

from omnimj.physics.native import kernel

DELIMITER = b"\0"
"""Ends a stuffed packet."""
_FULL = 255  # distance that stands for 254 bytes without a zero after them


@kernel
def _stuff(packet: np.ndarray, stuffed: np.ndarray) -> int:
    code, to, size = 0, 1, len(packet)
    for i in range(size):
        byte = packet[i]
        if byte != 0:
            stuffed[to] = byte
            to += 1
        full = to - code == _FULL
        if byte == 0 or (full and i + 1 < size):
            stuffed[code] = to - code
            code = to
            to += 1
    stuffed[code] = to - code
    return to


@kernel
def _unstuff(stuffed: np.ndarray, packet: np.ndarray) -> int:
    i, to, size = 0, 0, len(stuffed)
    while i < size:
        code = np.int64(stuffed[i])
        if code == 0 or i + code > size:
            return -1
        for k in range(i + 1, i + code):
            if stuffed[k] == 0:
                return -1
            packet[to] = stuffed[k]
            to += 1
        i += code
        if code < _FULL and i < size:
            packet[to] = 0
            to += 1
    return to


def max_encoded_size(size: int) -> int:
    """Of the stuffed packets of `size` bytes or fewer."""
    return size + size // 254 + 1


def encode(packet: bytes) -> bytes:
    """The packet stuffed, without the delimiter."""
    stuffed = np.empty(max_encoded_size(len(packet)), np.uint8)
    return stuffed[: _stuff(np.frombuffer(packet, np.uint8), stuffed)].tobytes()


def decode(stuffed: bytes) -> bytes | None:
    """The packet, or None where these bytes are no stuffed packet. Never raises."""
    if not stuffed:
        return None
    packet = np.empty(len(stuffed), np.uint8)
    size = _unstuff(np.frombuffer(stuffed, np.uint8), packet)
    return None if size < 0 else packet[:size].tobytes()
