"""What host and device hold against each other before anything moves: short hashes."""

from __future__ import annotations

import dataclasses
import hashlib
import struct

from omnimj.hardware.messages import Limits


def short_hash(content: bytes) -> int:
    """The first 8 bytes of BLAKE2s-256 (RFC 7693, no key), as a little-endian number of 64 bits."""
    return int.from_bytes(hashlib.blake2s(content).digest()[:8], "little")


def limits_hash(limits: Limits) -> int:
    """Of the seven limits in the order of the record, each as a little-endian float32: 28 bytes."""
    return short_hash(struct.pack("<7f", *dataclasses.astuple(limits)))
