"""Stuffing: no zero inside, and back again to the same bytes."""

from __future__ import annotations

import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from omnimj.link.codec.stream import stuff, unstuff

_RUN = bytes(range(1, 255))
PUBLISHED = [  # the examples that descriptions of the method share
    (b"", "01"),
    (b"\0", "0101"),
    (b"\0\0", "010101"),
    (b"\0\x11\0", "01021101"),
    (b"\x11\x22\0\x33", "0311220233"),
    (b"\x11\x22\x33\x44", "0511223344"),
    (b"\x11\0\0\0", "0211010101"),
    (_RUN, "ff" + _RUN.hex()),
    (b"\0" + _RUN, "01ff" + _RUN.hex()),
    (_RUN + b"\xff", "ff" + _RUN.hex() + "02ff"),
    (_RUN[1:] + b"\xff\0", "ff" + _RUN[1:].hex() + "ff0101"),
    (_RUN[2:] + b"\xff\0\x01", "fe" + _RUN[2:].hex() + "ff0201"),
]


def plainly_unstuffed(stuffed: bytes) -> bytes | None:
    """By slices, for comparison."""
    found, at = [], 0
    while at < len(stuffed):
        block = stuffed[at + 1 : at + stuffed[at]]
        if stuffed[at] == 0 or 0 in block or len(block) + 1 != stuffed[at]:
            return None
        at += stuffed[at]
        found.append(block + (b"" if stuffed[at - len(block) - 1] == 255 else b"\0"))
    if not found:
        return None
    whole = b"".join(found)
    return whole[:-1] if len(found[-1]) != 254 or found[-1].endswith(b"\0") else whole


@pytest.mark.parametrize(("packet", "stuffed"), PUBLISHED)
def test_published_examples_of_cobs_are_reproduced(packet, stuffed):
    assert stuff(packet).hex() == stuffed + "00"
    assert unstuff(bytes.fromhex(stuffed)) == packet


_WITH_ZEROS = st.lists(st.sampled_from([0, 0, 1, 2, 255]), max_size=600).map(bytes)
_LONG_RUNS = st.lists(st.integers(0, 520).map(lambda n: b"\x07" * n), max_size=4).map(b"\0".join)


@given(st.one_of(st.binary(max_size=600), _WITH_ZEROS, _LONG_RUNS))
def test_what_was_stuffed_has_no_zero_and_comes_back(packet):
    stuffed = stuff(packet)[:-1]
    assert 0 not in stuffed and len(stuffed) <= len(packet) + len(packet) // 254 + 1
    assert unstuff(stuffed) == packet == plainly_unstuffed(stuffed)


@given(st.binary(max_size=700))
@example(b"")
@example(b"\xff" * 255)
def test_any_bytes_are_a_packet_or_not_and_both_ways_of_reading_agree(stuffed):
    assert unstuff(stuffed) == plainly_unstuffed(stuffed)
