"""The firmware example, compiled and driven, keeps the rules of the device."""

from __future__ import annotations

import shutil
import subprocess
import zlib
from dataclasses import replace
from pathlib import Path

import pytest
from frame_stream import FrameStream
from sample_frames import CALIBRATION

import omnimj.link
from omnimj.link.codec.frames import encode
from omnimj.link.codec.layout import SCHEMA
from omnimj.link.codec.messages import (
    Arm,
    Capabilities,
    Challenge,
    Command,
    Fault,
    FaultCode,
    Frame,
    Hello,
    Message,
    Ping,
    Pong,
    Reset,
    Status,
    Stop,
    Telemetry,
)
from omnimj.link.codec.stream import stuff
from omnimj.link.device.config import limits_hash

HERE = Path(__file__).parent
FIRMWARE = Path(omnimj.link.__file__).parent / "firmware"
COMPILER = shutil.which("cc") or shutil.which("gcc") or shutil.which("clang") or ""
STRICT = ("-std=c99", "-Wall", "-Wextra", "-Werror", "-pedantic", "-O1")
ZERO = (0.0, 0.0, 0.0, 0.0)


class Board:
    """The firmware example on a made board, with a host's sequence numbers."""

    def __init__(self, program: Path):
        self._running = subprocess.Popen(
            [program], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True, bufsize=1
        )
        self._stream, self.sequence, self.session, self.limits_hash = FrameStream(), 0, 0, 0
        self.enabled, self.current = False, 0.0
        self.sent: list[Frame] = []
        self.newest = 0

    def line(self, text: str) -> None:
        assert self._running.stdin
        self._running.stdin.write(text + "\n")

    def turn(self, us: int = 2000) -> list[Message]:
        """One turn of the firmware; the messages that it sends."""
        self.line(f"turn {us}")
        assert self._running.stdout
        sent, enabled, current = self._running.stdout.readline().split()
        self.enabled, self.current = enabled == "1", float(current)
        self.sent = self._stream.feed(bytes.fromhex(sent)) if sent != "-" else []
        assert self._stream.drops.total == 0
        told = [frame.sequence for frame in self.sent if isinstance(frame.message, Telemetry)]
        self.newest = told[-1] if told else self.newest
        return [frame.message for frame in self.sent]

    def says(self, *messages: Message, us: int = 2000, **header) -> list[Message]:
        """The host sends; then one turn."""
        stuffed = b""
        for message in messages:
            self.sequence += 1
            if isinstance(message, Command | Reset) and message.telemetry == 0:
                message = replace(message, telemetry=self.newest)
            frame = Frame(message, self.session, self.sequence, 0)
            stuffed += stuff(encode(replace(frame, **header)))
        self.line(f"bytes {stuffed.hex()}")
        return self.turn(us)

    def begin(self, nonce: int = 5) -> Capabilities:
        """A new session."""
        found = self.enter(self.ask(nonce))
        self.says(Ping(0))
        return found

    def ask(self, nonce: int = 5) -> Hello:
        """The hello that returns the cookie of the challenge."""
        (challenge,) = (m for m in self.says(Hello(nonce), session=0) if isinstance(m, Challenge))
        return Hello(challenge.nonce, challenge.cookie, challenge.device)

    def enter(self, hello: Hello) -> Capabilities:
        (found,) = (m for m in self.says(hello, session=0) if isinstance(m, Capabilities))
        self.session, self.sequence, self.limits_hash = self.sent[0].session, 0, found.limits_hash
        assert found.nonce == hello.nonce
        self.newest = 0
        return found

    def arm(self, **but) -> list[Message]:
        """Zero command, telemetry, arm."""
        self.says(Command(ZERO, 0.0625))
        newest = [frame.sequence for frame in self.sent if isinstance(frame.message, Telemetry)][-1]
        right = Arm(self.limits_hash, CALIBRATION, newest)
        return self.says(replace(right, **but))

    def close(self) -> None:
        self._running.communicate()
        assert self._running.returncode == 0


@pytest.fixture(scope="module")
def program(tmp_path_factory):
    built = tmp_path_factory.mktemp("firmware") / "board"
    done = subprocess.run(
        [
            COMPILER,
            *STRICT,
            "-I",
            FIRMWARE,
            HERE / "firmware_board.c",
            "-o",
            built,
        ],
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    return built


@pytest.fixture
def board(program):
    board = Board(program)
    assert board.turn() == [], "without a session nothing is told"
    board.begin()
    yield board
    board.close()


def status(messages: list[Message]) -> Status:
    return next(m.status for m in messages if isinstance(m, Telemetry))


def faults(messages: list[Message]) -> list[tuple[FaultCode, bool]]:
    return [(m.code, m.latched) for m in messages if isinstance(m, Fault)]


needs_compiler = pytest.mark.skipif(not COMPILER, reason="no C compiler (cc, gcc, clang) on this machine")


@needs_compiler
def test_the_example_reports_its_identity_and_its_readings(board):
    own = board.begin(6)
    assert own.limits_hash == limits_hash(own.limits) and own.calibration_hash == CALIBRATION
    assert own.period == 0.002 and own.wheels == 4 and len(own.channels) == 12
    (telemetry,) = board.turn()
    assert isinstance(telemetry, Telemetry)
    assert telemetry.raw == (*(0.5 * i for i in range(11)), -4096)
    assert telemetry.status == 0 and telemetry.acknowledged == 0
    assert Pong(9) in board.says(Ping(9))


@needs_compiler
def test_the_example_arms_drives_and_stops(board):
    assert status(board.arm()) == Status.ARMED
    messages = board.says(Command((0.5, 0.0, 0.0, 0.0), 0.05))
    assert status(messages) == Status.ARMED | Status.CURRENT_FLOWS
    assert board.enabled and board.current == 0.5
    board.says(Stop(), session=0, sequence=0, us=100)
    assert not board.enabled and board.current == 0.0
    messages = board.says(Command((0.5, 0.0, 0.0, 0.0), 0.05))
    assert faults(messages) == [(FaultCode.NOT_ARMED, False)] and not board.enabled


@needs_compiler
def test_the_example_cuts_current_when_commands_cease_and_stays_so_until_reset_and_arm(board):
    board.arm()
    board.says(Command((0.5, 0.0, 0.0, 0.0), 0.05))
    for _ in range(24):  # the command answers a telemetry of the period before
        messages = board.turn()
        assert board.current == 0.5
    messages = board.turn()
    assert faults(messages) == [(FaultCode.COMMAND_TOO_OLD, True)] and not board.enabled
    assert board.current == 0.0
    assert faults(board.arm()) == [(FaultCode.ARM_FAULTY, False)]
    assert not status(board.says(Reset(0))) & Status.FAULT
    assert not board.enabled
    board.arm()
    assert board.enabled and board.current == 0.0


@needs_compiler
@pytest.mark.parametrize(
    ("command", "code"),
    [
        (Command((1.6, 0.0, 0.0, 0.0), 0.05), FaultCode.CURRENT),
        (Command((float("nan"), 0.0, 0.0, 0.0), 0.05), FaultCode.NOT_FINITE),
        (Command((0.0, float("-inf"), 0.0, 0.0), 0.05), FaultCode.NOT_FINITE),
        (Command(ZERO, 0.25), FaultCode.VALID_FOR),
        (Command(ZERO, 0.0), FaultCode.VALID_FOR),
        (Command(ZERO, float("nan")), FaultCode.NOT_FINITE),
        (Command((0.0, 0.0, 0.0), 0.05), FaultCode.MALFORMED),
    ],
)
def test_the_example_refuses_and_latches_and_never_clamps(board, command, code):
    board.arm()
    board.says(Command((0.5, 0.0, 0.0, 0.0), 0.05))
    assert faults(board.says(command)) == [(code, True)]
    assert not board.enabled and board.current == 0.0


@needs_compiler
def test_the_example_limits_rate_and_heat_and_speed_and_frames(board):
    board.arm()
    messages = board.says(Command((1.5, 0.0, 0.0, 0.0), 0.05))
    assert faults(messages) == [] and board.current == 1.5, "1.5 A within 2 ms are 750 A/s"
    messages = board.says(Command((-1.5, 0.0, 0.0, 0.0), 0.05))
    assert faults(messages) == [(FaultCode.CURRENT_RATE, True)]
    board.says(Reset(0))
    board.arm()
    steps = 0
    while not faults(messages := board.says(Command((1.5, 0.0, 0.0, 0.0), 0.05))):
        steps += 1
    assert faults(messages) == [(FaultCode.HEATING, True)]
    assert abs(steps * 0.002 - 0.5 / (1.5**2 - 0.75**2)) < 0.01
    board.says(Reset(0))
    board.arm()
    board.line("speed 40.5")
    assert faults(board.says(Command(ZERO, 0.05))) == [(FaultCode.WHEEL_SPEED, True)]
    board.line("speed nan")
    board.says(Reset(0))
    board.arm()
    board.turn()
    assert not board.enabled and status(board.turn()) & Status.FAULT
    board.line("speed 0")
    board.says(Reset(0))
    board.turn(100_000)
    messages = [message for _ in range(40) for message in board.says(*[Ping(k) for k in range(3)], us=10)]
    assert faults(messages) == [(FaultCode.MESSAGE_RATE, True)]


@needs_compiler
def test_the_example_arms_only_where_all_agrees(board):
    assert faults(board.arm(limits_hash=1)) == [(FaultCode.ARM_LIMITS, False)]
    assert faults(board.arm(calibration_hash=1)) == [(FaultCode.ARM_CALIBRATION, False)]
    assert faults(board.arm(telemetry=0)) == [(FaultCode.ARM_STALE_TELEMETRY, False)]
    board.turn(1000)
    stale = board.says(Command(ZERO, 0.0625))
    number = board.sent[-1].sequence
    assert status(stale) == 0
    for _ in range(11):
        board.turn()
    assert faults(board.says(Arm(board.limits_hash, CALIBRATION, number))) == [
        (FaultCode.ARM_STALE_TELEMETRY, False)
    ]
    for _ in range(32):
        board.turn()
    assert faults(board.says(Arm(board.limits_hash, CALIBRATION, number))) == [
        (FaultCode.ARM_NOT_ZERO, False)
    ]
    assert status(board.arm()) == Status.ARMED


@needs_compiler
def test_the_example_drops_what_is_old_foreign_or_of_a_second_host(board):
    board.arm()
    again = board.sequence
    for header in ({"sequence": again}, {"session": board.session ^ 1}, {"sequence": 1}):
        messages = board.says(Command((0.5, 0.0, 0.0, 0.0), 0.05), **header)
        assert faults(messages) == [] and board.current == 0.0 and board.enabled
    messages = board.says(board.ask(99), session=0)
    assert faults(messages) == [(FaultCode.BUSY, False)] and board.enabled
    before = board.session
    board.says(Stop())
    board.begin(100)
    assert board.session != before
    messages = board.says(Command(ZERO, 0.05), session=before)
    (telemetry,) = messages
    assert isinstance(telemetry, Telemetry) and telemetry.acknowledged == 0 and telemetry.dropped == 4


@needs_compiler
def test_the_example_refuses_arming_to_a_host_with_another_message_layout(board):
    board.says(Command(ZERO, 0.0625))
    newest = board.sent[-1].sequence
    right = Frame(Arm(board.limits_hash, CALIBRATION, newest), board.session, board.sequence + 1, 0)
    packet = bytearray(encode(right)[:-4])
    packet[20:24] = (SCHEMA ^ 1).to_bytes(4, "little")
    packet += zlib.crc32(packet).to_bytes(4, "little")
    board.line(f"bytes {stuff(bytes(packet)).hex()}")
    assert faults(board.turn()) == [(FaultCode.ARM_SCHEMA, False)]
    board.sequence += 1
    assert status(board.arm()) == Status.ARMED


@needs_compiler
def test_the_example_holds_each_rule_against_all_wheels_before_the_next(board):
    board.arm()
    board.says(Command((1.5, 0.0, 0.0, 0.0), 0.05))
    # wheel 1 turns round too quickly, but wheel 4 is beyond the limit, which comes first
    messages = board.says(Command((-1.5, 0.0, 0.0, 1.6), 0.05))
    assert [(f.code, f.wheel) for f in messages if isinstance(f, Fault)] == [(FaultCode.CURRENT, 4)]


@needs_compiler
def test_the_example_latches_a_stop_until_a_reset_that_has_seen_it(board):
    board.arm()
    seen = board.newest
    board.says(Stop(), session=0, sequence=0, us=100)
    assert faults(board.arm()) == [(FaultCode.ARM_STOPPED, False)] and not board.enabled
    assert faults(board.says(Reset(seen))) == [(FaultCode.STALE, False)]
    assert not status(board.says(Reset(0))) & Status.STOPPED
    assert status(board.arm()) == Status.ARMED


@needs_compiler
def test_the_example_refuses_a_command_that_answers_an_old_or_unknown_telemetry(board):
    board.arm()
    seen, stale = board.newest, [(FaultCode.STALE, False)]
    for telemetry in (seen + 1, 2**32 - 1):
        assert faults(board.says(Command((0.5, 0.0, 0.0, 0.0), 0.05, 0, telemetry))) == stale
    for _ in range(10):
        board.says(Command(ZERO, 0.05))
    assert faults(board.says(Command((0.5, 0.0, 0.0, 0.0), 0.02, 0, seen))) == stale
    assert board.enabled and board.current == 0.0


@needs_compiler
def test_the_example_trips_on_brake_with_current_and_on_a_current_that_does_not_follow(board):
    board.arm()
    messages = board.says(Command((0.5, 0.0, 0.0, 0.0), 0.05, 1))
    assert faults(messages) == [(FaultCode.BRAKE_AND_CURRENT, True)]
    board.says(Reset(0))
    board.arm()
    board.line("excess 0.6")  # more than a third of 1.5 A
    found = [faults(board.says(Command(ZERO, 0.05))) for _ in range(260)]
    assert found.count([]) >= 250 and [(FaultCode.CURRENT_DEVIATION, True)] in found and not board.enabled


@needs_compiler
def test_the_example_begins_no_session_for_a_replayed_hello_and_ends_a_silent_one(board):
    hello = board.ask(8)
    board.enter(hello)
    assert board.turn() == [], "no telemetry before the first frame of the session"
    board.says(Ping(0))
    before = board.session
    (challenge, *_) = board.says(hello, session=0)
    assert isinstance(challenge, Challenge) and challenge.cookie != hello.cookie
    assert board.session == before
    for _ in range(510):
        messages = board.turn()
    assert messages == [], "silent for more than a second"


@needs_compiler
def test_the_example_repeats_challenge_and_capabilities_every_second_for_passive_listeners(board):
    times, hello = [], board.ask(9)
    board.enter(hello)
    for k in range(1200):
        messages = board.says(Ping(k)) if k % 100 == 0 else board.turn()
        if any(isinstance(message, Capabilities) for message in messages):
            assert Challenge(9, hello.cookie, hello.device) in messages
            times.append(k)
    assert len(times) == 2 and times[1] - times[0] == 500
