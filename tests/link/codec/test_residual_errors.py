"""What the checksum is certain to detect, computed from its polynomial."""

from __future__ import annotations

import random
from zlib import crc32

import numpy as np
import pytest
from sample_frames import GOLDEN

from omnimj.link.codec.frames import encode
from omnimj.link.codec.key import KEY_SIZE, Key

LONGEST = 240
"""Length of frames for which the page of threats states a distance of five [bytes]."""


def syndromes(bits: int) -> np.ndarray:
    """Change of the checksum by an error in each bit, from the end of the frame."""
    found, register = np.empty(bits, np.uint32), 0x80000000  # the last bit of the checksum itself
    for k in range(bits):
        found[k] = register
        register = register >> 1 ^ (0xEDB88320 if register & 1 else 0)
    return found


def test_the_syndromes_are_those_of_the_checksum():
    rng = random.Random(4)
    sent = rng.randbytes(60)
    expected = set(syndromes(8 * 60 + 32).tolist())
    for bit in range(8 * 60):
        damaged = bytearray(sent)
        damaged[bit // 8] ^= 1 << bit % 8
        assert crc32(damaged) ^ crc32(sent) in expected


@pytest.mark.slow
def test_every_error_of_up_to_four_bits_is_detected_in_frames_of_up_to_240_bytes():
    single = syndromes(8 * LONGEST)
    assert np.all(single != 0) and len(np.unique(single)) == len(single), "one and two bits"
    first, second = np.triu_indices(len(single), 1)
    pairs = single[first] ^ single[second]
    del first, second
    pairs.sort()
    assert not np.isin(single, pairs).any(), "three bits"
    assert not np.any(pairs[1:] == pairs[:-1]), "four bits"


def test_every_message_of_a_robot_is_far_shorter_than_that():
    key = Key(random.Random(1).randbytes(KEY_SIZE))
    assert max(len(encode(frame, key)) for frame in GOLDEN.values()) <= LONGEST
    assert len(encode(GOLDEN["telemetry of the robot"], key)) < 160
