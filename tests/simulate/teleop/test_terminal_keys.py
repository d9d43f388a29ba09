"""Bytes of terminals and gamepads: in whatever pieces, and nothing unknown that moves the robot."""

from __future__ import annotations

import itertools
import os
import struct
from typing import cast

import pytest
from hypothesis import given
from hypothesis import strategies as st

from omnimj.errors import InputError
from omnimj.simulate.teleop.devices import STALE_AFTER, Gamepad, GamepadReader, Operator, Terminal
from omnimj.simulate.teleop.steering import DIRECTIONS, Key, KeyReader, Steering, SteeringLimits, StickState

TYPED = b"wsad\x1b[A\x1b[Bjl\x1b[D\x1bOCW q"
MEANT = [
    Key.FORWARD,
    Key.BACK,
    Key.LEFT,
    Key.RIGHT,
    Key.FORWARD,
    Key.BACK,
    Key.TURN_LEFT,
    Key.TURN_RIGHT,
    Key.TURN_LEFT,
    Key.TURN_RIGHT,
    Key.FORWARD,
    Key.STOP,
    Key.END,
]


@given(st.lists(st.integers(0, len(TYPED)), max_size=6))
def test_keys_are_read_in_whatever_pieces_they_come(cuts):
    reader, found, edges = KeyReader(), [], [0, *sorted(cuts), len(TYPED)]
    for begin, end in itertools.pairwise(edges):
        found += reader.feed(0.0, TYPED[begin:end])
    assert found == MEANT


@pytest.mark.parametrize(
    "typed", [b" ", b"\x1a", b"\x1b[5~", b"\x1b[1;5A", b"\x1bx", b"\xc3", b"\x1b\x1b[Z", b"\x1b[" + b"1" * 9]
)
def test_what_is_no_key_stops(typed):
    found = KeyReader().feed(0.0, typed)
    assert found and found[0] is Key.STOP and not DIRECTIONS & {*found}


def test_escape_alone_stops_as_soon_as_it_is_clear_that_it_is_alone():
    reader = KeyReader()
    assert reader.feed(0.0, b"\x1b") == [] == reader.feed(0.04, b"")
    assert reader.feed(0.06, b"") == [Key.STOP] and reader.feed(0.07, b"w") == [Key.FORWARD]


@given(st.lists(st.binary(max_size=40), max_size=8))
def test_no_bytes_break_the_readers(pieces):
    keys, pad = KeyReader(), GamepadReader()
    for k, piece in enumerate(pieces):
        assert len(keys.feed(0.01 * k, piece)) <= len(piece) + 8
        found, _ = pad.feed(piece)
        assert all(-1.0 <= part <= 1.0 for part in (found.forward, found.left, found.turn))
    assert len(keys._begun) < 8 and len(pad._rest) < 8


def event(kind, number, value):
    return struct.pack("<IhBB", 12345, value, kind, number)


AXIS, BUTTON, BEFORE = 2, 1, 0x80


def test_a_pad_reports_its_sticks_and_its_dead_man_s_button():
    reader = GamepadReader()
    events = event(AXIS, 1, -32767) + event(AXIS, 0, 32767) + event(AXIS, 3, -32767) + event(AXIS, 5, 9999)
    assert reader.feed(events[:5]) == (StickState(), False)
    assert reader.feed(events[5:]) == (StickState(1.0, -1.0, 1.0), False)
    assert reader.feed(event(BUTTON, 4, 1))[0].held and not reader.feed(event(BUTTON, 4, 0))[0].held
    assert reader.feed(event(BUTTON, 1, 1))[1] and not reader.feed(event(BUTTON, 1, 0))[1]
    assert reader.feed(event(AXIS, 1, 3000) + event(AXIS, 0, 0) + event(AXIS, 3, 0))[0] == StickState(-0.0)


def test_a_button_that_was_down_before_does_not_count():
    assert not GamepadReader().feed(event(BUTTON | BEFORE, 4, 1))[0].held


class Fingers:
    """Types the given keys at their times."""

    def __init__(self):
        self.now, self.typed, self.lines = 0.0, {}, []

    def read(self):
        return self.typed.get(round(self.now, 3), b"")

    def show(self, line):
        self.lines.append(line)


def driven_by(fingers, duration, pad=None):
    steering = Steering(SteeringLimits())
    operator = Operator(
        steering, 0.001, cast("Terminal", fingers), pad, clock=lambda: fingers.now, status=lambda: "fine"
    )
    speeds = []
    while fingers.now < duration and operator.target(0.0, 1.0) is not None:
        speeds.append(steering.twist[0])
        fingers.now += 0.001
    return speeds


def test_an_operator_ends_with_a_key_or_with_the_terminal_and_sees_the_status():
    for last in (b"q", None):
        fingers = Fingers()
        fingers.typed = {0.002: b"w", 0.25: last}
        speeds = driven_by(fingers, 1.0)
        assert len(speeds) == 250 and speeds[-1] > 0.1
        assert len(fingers.lines) == 2 and fingers.lines[0].endswith("fine")


def test_keys_that_lay_unread_for_long_move_nothing():
    fingers = Fingers()
    steering = Steering(SteeringLimits())
    operator = Operator(steering, 0.001, cast("Terminal", fingers), clock=lambda: fingers.now)
    fingers.now = STALE_AFTER + 0.05
    fingers.typed = {0.15: b"www", 0.16: b"w"}
    operator.target(0.0, 1.0)
    assert steering.twist == (0.0, 0.0, 0.0)
    fingers.now = 0.16
    operator.target(0.0, 1.0)
    assert steering.twist[0] > 0.0


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="named pipes are of POSIX")
def test_a_pad_that_is_pulled_stops_the_robot(tmp_path):
    os.mkfifo(tmp_path / "js0")
    reading = os.open(tmp_path / "js0", os.O_RDONLY | os.O_NONBLOCK)  # so that the pad can be opened first
    far = os.open(tmp_path / "js0", os.O_WRONLY)
    os.close(reading)
    pad, fingers = Gamepad(tmp_path / "js0"), Fingers()
    os.write(far, event(AXIS, 1, -32767) + event(BUTTON, 4, 1))
    speeds = driven_by(fingers, 0.5, pad)
    assert speeds[-1] > 0.2
    os.close(far)
    assert not any(driven_by(fingers, 1.0, pad))
    pad.close()


def test_a_pad_that_is_not_there_is_one_clear_line(tmp_path):
    with pytest.raises(InputError, match="cannot be read"):
        Gamepad(tmp_path / "js7")
