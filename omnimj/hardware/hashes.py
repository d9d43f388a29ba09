"""Short names of what both sides must agree on before anything moves."""

from __future__ import annotations

import hashlib

from omnimj.hardware.messages import Limits
from omnimj.hardware.payloads import limit_bytes


def short_hash(text: bytes) -> int:
    """First 8 bytes of BLAKE2s-256 (without a key), little endian."""
    return int.from_bytes(hashlib.blake2s(text).digest()[:8], "little")


def limits_hash(limits: Limits) -> int:
    """Of the seven limits as float32, in the order of the wire, 28 bytes."""
    return short_hash(limit_bytes(limits))
