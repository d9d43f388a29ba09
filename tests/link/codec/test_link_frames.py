"""Frames: whatever is sent is read as it was sent, and nothing else is read at all."""

from __future__ import annotations

import math
import zlib
from dataclasses import replace

import pytest
from hypothesis import given
from hypothesis import strategies as st
from sample_frames import GOLDEN, KEY, LIMITS, ROBOT, SECRET, describe, frames

from omnimj.bench.link import codec_times
from omnimj.errors import InputError
from omnimj.link.codec.frames import decode, encode
from omnimj.link.codec.key import Key
from omnimj.link.codec.layout import MAX_FRAME_SIZE, DropReason
from omnimj.link.codec.messages import (
    ChannelKind,
    Command,
    Fault,
    FaultCode,
    Frame,
    Limits,
    MessageType,
    Quantity,
    Raw,
    Status,
    Stop,
    Telemetry,
)

OTHER_KEY = Key(SECRET[::-1])
STOP = Frame(Stop(), 3, 4, 5)
COMMAND = GOLDEN["command"]


def sealed(content: bytes) -> bytes:
    """With the checksum made right."""
    return content + zlib.crc32(content).to_bytes(4, "little")


def changed(packet: bytes, at: int, value: int, size: int = 1) -> bytes:
    """Other bytes at a place, and a right checksum."""
    content = packet[:at] + value.to_bytes(size, "little") + packet[at + size : -4]
    return sealed(content)


@given(frames())
def test_every_frame_comes_back_as_it_was(frame):
    packet = encode(frame)
    back = decode(packet)
    assert isinstance(back, Frame) and describe(back) == describe(frame)
    assert encode(back) == packet and len(packet) <= MAX_FRAME_SIZE


@given(frames())
def test_with_the_key_every_frame_comes_back_authentic(frame):
    back = decode(encode(frame, KEY), KEY)
    assert isinstance(back, Frame) and describe(back) == describe(replace(frame, authentic=True))


@given(frames())
def test_only_a_stop_comes_through_without_the_right_key(frame):
    others = [
        (decode(encode(frame), KEY), DropReason.NO_TAG),
        (decode(encode(frame, OTHER_KEY), KEY), DropReason.TAG),
        (decode(encode(frame, KEY)), DropReason.NO_KEY),
    ]
    for found, drop in others:
        if isinstance(frame.message, Stop):
            assert isinstance(found, Frame) and not found.authentic
        else:
            assert found is drop


@given(frames(), st.data())
def test_bursts_of_up_to_32_bits_never_pass(frame, data):
    """Which is what a CRC-32 promises for certain."""
    packet = encode(frame)
    burst = data.draw(st.integers(1, 2**32 - 1))
    number = int.from_bytes(packet, "little")
    spoiled = number ^ burst << data.draw(st.integers(0, len(packet) * 8 - burst.bit_length()))
    assert decode(spoiled.to_bytes(len(packet), "little")) is DropReason.CHECKSUM


@given(frames(), st.data())
def test_pieces_and_lengthened_frames_never_pass(frame, data):
    packet = encode(frame)
    cut = data.draw(st.integers(0, len(packet) - 1))
    assert isinstance(decode(packet[:cut]), DropReason)
    more = data.draw(st.binary(min_size=1, max_size=40))
    assert (
        isinstance(decode(packet[:cut] + more + packet[cut:]), DropReason)
        or more == packet[:cut][-len(more) :]
    )


@given(st.binary(max_size=600), st.sampled_from([None, KEY]))
def test_no_bytes_raise(noise, key):
    assert isinstance(decode(noise, key), DropReason)


@given(st.sampled_from(MessageType), st.binary(max_size=300), st.booleans())
def test_no_payload_raises_even_with_a_right_checksum(kind, payload, keyed):
    content = encode(STOP, KEY if keyed else None)[:24]
    content = content[:1] + bytes([kind]) + content[2:] + payload
    if keyed:
        content += KEY.tag(content)
    found = decode(sealed(content), KEY if keyed else None)
    assert found in (DropReason.LENGTH, DropReason.VALUE) or isinstance(found, Frame)


COMMAND_BYTES, STOP_BYTES = encode(COMMAND), encode(STOP)
TELEMETRY_BYTES = encode(GOLDEN["telemetry of the robot"])
CAPABILITIES_BYTES, FAULT_BYTES = encode(GOLDEN["capabilities of the robot"]), encode(GOLDEN["fault"])
CHALLENGE_BYTES = encode(GOLDEN["challenge"])
NAN_BYTES = 0x7FC00000


@pytest.mark.parametrize(
    ("packet", "drop"),
    [
        (b"", DropReason.TOO_SHORT),
        (STOP_BYTES[:-1], DropReason.TOO_SHORT),
        (sealed(bytes(509)), DropReason.TOO_LONG),
        (sealed(bytes(508)), DropReason.PROTOCOL),
        (STOP_BYTES[:-1] + bytes([STOP_BYTES[-1] ^ 1]), DropReason.CHECKSUM),
        (changed(STOP_BYTES, 0, 1), DropReason.PROTOCOL),
        (changed(STOP_BYTES, 1, 0), DropReason.TYPE),
        (changed(STOP_BYTES, 1, 12), DropReason.TYPE),
        (changed(STOP_BYTES, 2, 2), DropReason.FLAGS),
        (changed(STOP_BYTES, 3, 0x80), DropReason.FLAGS),
        (changed(STOP_BYTES, 2, 1), DropReason.LENGTH),  # says that it has a tag
        (sealed(STOP_BYTES[:-4] + b"\0"), DropReason.LENGTH),
        (changed(COMMAND_BYTES, 1, MessageType.STOP), DropReason.LENGTH),
        (changed(COMMAND_BYTES, 28, 3), DropReason.LENGTH),
        (changed(COMMAND_BYTES, 28, 5), DropReason.LENGTH),
        (sealed(COMMAND_BYTES[:28] + bytes(8)), DropReason.VALUE),  # no wheel
        (sealed(COMMAND_BYTES[:28] + b"\x09\0\0\0" + bytes(40)), DropReason.VALUE),
        (changed(COMMAND_BYTES, 29, 0x10), DropReason.VALUE),  # brakes wheel 5 of 4
        (changed(COMMAND_BYTES, 30, 1), DropReason.VALUE),
        (changed(COMMAND_BYTES, 20, 0, 4), DropReason.SCHEMA),
        (changed(TELEMETRY_BYTES, 20, 0, 4), DropReason.SCHEMA),
        (changed(TELEMETRY_BYTES, 32, 128), DropReason.VALUE),  # status
        (changed(TELEMETRY_BYTES, 34, len(FaultCode)), DropReason.VALUE),
        (changed(TELEMETRY_BYTES, 35, 11), DropReason.LENGTH),
        (changed(TELEMETRY_BYTES, 44, 1 << 12, 4), DropReason.VALUE),  # counts of channel 12 of 12
        (sealed(TELEMETRY_BYTES[:35] + b"\x21" + bytes(12 + 33 * 4)), DropReason.VALUE),
        (changed(CAPABILITIES_BYTES, 48, 0, 4), DropReason.VALUE),  # period
        (changed(CAPABILITIES_BYTES, 52, NAN_BYTES, 4), DropReason.VALUE),  # a limit
        (changed(CAPABILITIES_BYTES, 76, 0, 4), DropReason.VALUE),
        (changed(CAPABILITIES_BYTES, 80, 2), DropReason.VALUE),  # lock-step
        (changed(CAPABILITIES_BYTES, 81, 0), DropReason.VALUE),
        (changed(CAPABILITIES_BYTES, 81, 9), DropReason.VALUE),
        (changed(CAPABILITIES_BYTES, 81, 3), DropReason.VALUE),  # a channel of wheel 4
        (changed(CAPABILITIES_BYTES, 82, 11), DropReason.LENGTH),
        (changed(CAPABILITIES_BYTES, 83, 1), DropReason.VALUE),
        (changed(CAPABILITIES_BYTES, 84, len(Quantity)), DropReason.VALUE),
        (changed(CAPABILITIES_BYTES, 86, 2), DropReason.VALUE),
        (changed(CAPABILITIES_BYTES, 87, 1), DropReason.VALUE),
        (changed(CHALLENGE_BYTES, 32, 0, 8), DropReason.VALUE),  # cookie
        (changed(CHALLENGE_BYTES, 40, 0, 8), DropReason.VALUE),  # identity
        (changed(FAULT_BYTES, 24, len(FaultCode)), DropReason.VALUE),
        (changed(FAULT_BYTES, 25, 9), DropReason.VALUE),
        (changed(FAULT_BYTES, 26, 2), DropReason.VALUE),
        (changed(FAULT_BYTES, 27, 1), DropReason.VALUE),
    ],
)
def test_a_payload_that_no_frame_has_is_dropped_with_its_reason(packet, drop):
    assert decode(packet) is drop


@pytest.mark.parametrize("name", GOLDEN)
def test_a_host_of_another_schema_learns_that_schemas_differ(name):
    found = decode(changed(encode(GOLDEN[name]), 20, 1, 4))
    if isinstance(GOLDEN[name].message, Command | Telemetry):
        assert found is DropReason.SCHEMA
    else:
        assert isinstance(found, Frame) and not found.same_schema


def _command(**but) -> Frame:
    return replace(COMMAND, message=replace(COMMAND.message, **but))


def _telemetry(**but) -> Frame:
    return Frame(replace(GOLDEN["telemetry at rest"].message, **but), 1, 1, 1)


def _capabilities(**but) -> Frame:
    return Frame(replace(ROBOT, **but), 1, 1, 1)


@pytest.mark.parametrize(
    "frame",
    [
        _command(currents=()),
        _command(currents=(0.0,) * 9),
        _command(brake=16),
        _command(brake=-1),
        replace(COMMAND, session=2**32),
        replace(COMMAND, sequence=-1),
        replace(COMMAND, time=2**64),
        _telemetry(raw=(0.0,) * 33),
        _telemetry(counts=1 << 12),
        _telemetry(counts=-1),
        _telemetry(counts=1, raw=(math.nan,)),
        _telemetry(acknowledged=2**32),
        _capabilities(wheels=0),
        _capabilities(wheels=9),
        _capabilities(wheels=3),
        _capabilities(channels=(ChannelKind(Quantity.YAW, 0, Raw.VOLTS),) * 33),
        _capabilities(limits=replace(LIMITS, heating=0.0)),
        _capabilities(limits=replace(LIMITS, heating=1e-60)),  # zero as float32
        _capabilities(limits=replace(LIMITS, heating=1e60)),
        _capabilities(limits=replace(LIMITS, valid_for=math.nan)),
        _capabilities(period=0.0),
        _capabilities(nonce=2**64),
        Frame(Fault(FaultCode.NONE, 9, 0.0, 0.0, 0, False), 1, 1, 1),
    ],
)
def test_what_cannot_travel_is_refused_with_one_line(frame):
    with pytest.raises(InputError) as caught:
        encode(frame)
    assert "\n" not in str(caught.value)


def test_too_large_a_current_travels_as_infinity_and_counts_wrap():
    sent = decode(encode(_command(currents=(1e39, -1e300, 3.40282356779733e38, 3.4028235677973366e38))))
    assert isinstance(sent, Frame) and isinstance(sent.message, Command)
    assert sent.message.currents == (math.inf, -math.inf, 3.4028234663852886e38, math.inf)
    telemetry = _telemetry(raw=(2.0**31, -(2**31) - 1, 4096.0, 1e39), counts=7)
    sent = decode(encode(telemetry))
    assert isinstance(sent, Frame) and isinstance(sent.message, Telemetry)
    assert sent.message.raw == (-(2**31), 2**31 - 1, 4096, math.inf)


@pytest.mark.parametrize(
    ("age", "read"),
    [(0.0006, 0.0006), (-1.0, 0.0), (math.nan, 0.0), (math.inf, math.inf), (1e9, 4294.967294), (5e-8, 0.0)],
)
def test_the_age_of_a_command_is_in_whole_microseconds_or_infinite(age, read):
    sent = decode(encode(_telemetry(command_age=age)))
    assert isinstance(sent, Frame) and isinstance(sent.message, Telemetry)
    assert sent.message.command_age == read and sent.message.status is Status(0)


def test_limits_are_seven():
    assert len(Limits.__dataclass_fields__) == 7, "their layout, hash and header hold seven"


@pytest.mark.slow
def test_a_frame_takes_5_microseconds_each_way(measured):
    times = codec_times(times=2000)
    assert len(times) == 12
    for name, (encoding, decoding) in times.items():
        measured(f"encode {name} [us]", encoding * 1e6, 5.0)
        measured(f"decode {name} [us]", decoding * 1e6, 5.0)
        # the figure is measured and shown; a machine that is busy otherwise must not fail
        assert max(encoding, decoding) < 50e-6, name
