"""A serial line gives its bytes in any pieces, with anything in between."""

from __future__ import annotations

import random

from frame_stream import FrameStream
from hypothesis import given
from hypothesis import strategies as st
from sample_frames import GOLDEN, KEY, describe, frames

from omnimj.link.codec.frames import encode
from omnimj.link.codec.layout import DropReason
from omnimj.link.codec.stream import DELIMITER, PacketStream, stuff


def stuffed(frame) -> bytes:
    return stuff(encode(frame))


@given(st.lists(frames(), max_size=5), st.data())
def test_frames_come_out_as_they_went_in_whatever_the_pieces(sent, data):
    line = b"".join(map(stuffed, sent))
    cuts = sorted(data.draw(st.lists(st.integers(0, len(line)), max_size=12)))
    stream, found = FrameStream(), []
    for begin, end in zip([0, *cuts], [*cuts, len(line)], strict=True):
        found += stream.feed(line[begin:end])
    assert list(map(describe, found)) == list(map(describe, sent))
    assert stream.drops.total == 0 and str(stream.drops) == "none"


@given(st.binary(max_size=3000), st.data())
def test_pieces_change_neither_packets_nor_counts(line, data):
    line = line.replace(b"\x01", b"\0") + bytes(1)
    whole, apart = PacketStream(), PacketStream()
    cuts = sorted(data.draw(st.lists(st.integers(0, len(line)), max_size=12)))
    found = []
    for begin, end in zip([0, *cuts], [*cuts, len(line)], strict=True):
        found += apart.feed(line[begin:end])
    assert found == whole.feed(line)
    assert str(apart.drops) == str(whole.drops)


@given(st.binary(max_size=2000), st.sampled_from(sorted(GOLDEN)))
def test_after_any_noise_the_next_zero_makes_all_well(noise, name):
    stream = FrameStream()
    assert stream.feed(noise) == []
    (found,) = stream.feed(DELIMITER + stuffed(GOLDEN[name]))
    assert describe(found) == describe(GOLDEN[name])


def test_a_line_without_zeros_is_one_drop_and_takes_no_memory():
    stream = PacketStream()
    for _ in range(1000):
        assert stream.feed(b"\x55" * 1000) == []
        assert len(stream._rest) <= 515
    assert stream.drops.total == stream.drops[DropReason.TOO_LONG] == 1
    packet = encode(GOLDEN["command"])
    assert stream.feed(DELIMITER + stuff(packet)) == [packet]


def test_every_reason_is_counted():
    stream = FrameStream(KEY)
    ping = stuff(encode(GOLDEN["ping"]))[:-1]
    stream.feed(b"\0\0\0")
    stream.feed(b"\x07short\0" + b"\xff" * 100 + b"\0" + b"\x01" * 517 + b"\0" + ping + b"\0")
    stream.feed(ping[:-1] + bytes([ping[-1] ^ 0x10]) + b"\0")
    assert str(stream.drops) == "too_short 1, too_long 1, stuffing 1, checksum 1, no_tag 1"


def test_a_lost_byte_costs_one_frame():
    rng = random.Random(3)
    line = [stuffed(GOLDEN["telemetry of the robot"]) for _ in range(200)]
    for k in range(0, 200, 4):  # the zero is the last, and costs this frame and the next
        at = rng.randrange(len(line[k]) - 1)
        line[k] = line[k][:at] + line[k][at + 1 :]
    stream = FrameStream()
    assert len(stream.feed(b"".join(line))) == 150
    assert stream.drops.total == 50
