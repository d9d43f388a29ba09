"""`omnimj teleop` on a pseudo-terminal, end to end, and what it refuses."""

from __future__ import annotations

import contextlib
import io
import json
import os
import re
import select
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest
from wired_devices import ROBOT, planar, served

from omnimj.cli.main import main
from omnimj.link.codec.messages import Status
from omnimj.link.host.link import LinkMode, open_link
from omnimj.recording.traces import read_trace

termios = pytest.importorskip("termios")


_PROGRAM = """
import fcntl, signal, sys, termios
fcntl.ioctl(0, termios.TIOCSCTTY, 0)  # Ctrl-C and hang-ups come from this terminal
signal.signal(signal.SIGINT, signal.default_int_handler)  # ignored where the tests run in the background
from omnimj.cli.main import main
sys.exit(main(sys.argv[1:]))
"""
_BLANK = b"\0"


class Person:
    """Sits at a terminal on which the command runs."""

    def __init__(self, *argv: str):
        self.screen, self.near = os.openpty()
        self.before, self.seen = termios.tcgetattr(self.near), b""
        command = [sys.executable, "-c", _PROGRAM, "teleop", *argv]
        self.process = subprocess.Popen(
            command, stdin=self.near, stdout=subprocess.PIPE, stderr=self.near, start_new_session=True
        )

    def watch(self, duration: float, until: bytes = _BLANK) -> None:
        """Reads the screen."""
        end = time.monotonic() + duration
        while (left := end - time.monotonic()) > 0.0 and until not in self.seen:
            if select.select([self.screen], [], [], left)[0]:
                self.seen += os.read(self.screen, 4096)

    def hold(self, key: bytes, duration: float) -> None:
        """Holds a key down: the terminal repeats it."""
        end = time.monotonic() + duration
        while (left := end - time.monotonic()) > 0.0:
            os.write(self.screen, key)
            self.watch(min(left, 0.03))

    def leave(self) -> None:
        """Ends what is left."""
        self.process.kill()
        self.process.communicate()
        for end in (self.screen, self.near):
            with contextlib.suppress(OSError):
                os.close(end)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("last", "code"),
    [(b"q", 0), (b"\x03", 130), (None, 130)],
    ids=["key", "Ctrl-C", "hang-up"],
)
def test_keys_drive_the_robot_and_the_terminal_is_left_as_it_was(tmp_path, last, code):
    as_json = last != b"q"
    person = Person("--plant", "planar", "--out", str(tmp_path / "run"), *(["--json"] if as_json else []))
    try:
        person.watch(240.0, until=b"real time")  # the first run compiles
        assert termios.tcgetattr(person.near) != person.before
        person.hold(b"w", 0.8)
        person.hold(b"\x1a", 0.3)  # Ctrl-Z is a key, too
        if last is None:
            os.close(person.near)
            os.close(person.screen)
        else:
            os.write(person.screen, last)
            person.watch(0.3)
        output = person.process.communicate(timeout=30.0)[0].decode()
        assert person.process.returncode == code
        if last is not None:
            assert termios.tcgetattr(person.near) == person.before
            assert "s driven by hand" in output or json.loads(output)["seconds"] > 0.5
            assert as_json != ("s driven by hand" in output) and b"any other key stops" in person.seen
            assert b"Traceback" not in person.seen
    finally:
        person.leave()
    trace = read_trace(tmp_path / "run" / "trace.parquet")
    assert 0.1 < trace["target_velocity_x"].max() <= 0.3 and trace["x"][-1] > 0.02
    assert not trace["target_velocity_x"][-100:].any() and abs(trace["twist_x"][-1]) < 0.02
    assert trace.about["plant"] == "planar" and trace.about["interrupted"] is (code == 130)


# a busy machine may keep this device or its host from running for longer than any rule allows
BUSY = re.compile(rb"ms old|frames were lost|not been acknowledged|command too old|not say that it is armed")


def drive_ahead(address: str, out: Path) -> tuple[int, str, bytes]:
    """Code, last words and screen of a short drive by key."""
    person = Person("--plant", address, "--method", "off", "--out", str(out), "--force", "--reset-fault")
    try:
        person.watch(240.0, until=b"rad/s")
        person.hold(b"w", 0.6)
        os.write(person.screen, b"q")
        output = person.process.communicate(timeout=30.0)[0].decode()
        person.watch(0.2)
        assert termios.tcgetattr(person.near) == person.before
        return person.process.returncode, output, person.seen
    finally:
        person.leave()


@pytest.mark.slow
def test_keys_drive_the_robot_behind_a_wire_and_leave_it_stopped(tmp_path):
    robot, out = planar(), tmp_path / "run"
    with served(robot, "udp", lock_step=False) as address:
        for _ in range(3):
            code, output, screen = drive_ahead(address, out)
            if not (code == 1 and BUSY.search(screen)):
                break
        driven = dict(zip(robot.truth_names, robot.truth(), strict=True))
        link = open_link(address, ROBOT, mode=LinkMode.DRY_RUN)
        link.connect()
        telemetry = link.reading.telemetry
        link.close()
    robot.close()
    assert code == 0, screen[-300:]
    assert driven["x"] > 0.02 and abs(driven["y"]) < 0.1 * driven["x"]
    assert not telemetry.status & (Status.ARMED | Status.CURRENT_FLOWS | Status.FAULT)
    assert f"s driven by hand, plant {address}" in output and "real time" not in output
    trace = read_trace(out / "trace.parquet")
    assert 0.1 < trace["target_velocity_x"].max() <= 0.3 and trace.about["plant"] == address
    assert trace.about["interrupted"] is False and trace.about["failure"] is None


def refused(capsys, *argv: str) -> str:
    code = main(["teleop", *argv])
    out, err = capsys.readouterr()
    lines = [line for line in err.splitlines() if not line.startswith("compiling native code")]
    assert (code, out, len(lines)) == (2, "", 1) and lines[0].startswith("omnimj"), err
    return lines[0]


def test_without_a_terminal_nothing_is_driven(capsys, monkeypatch):
    for stdin in (io.StringIO("wwww"), None):
        monkeypatch.setattr(sys, "stdin", stdin)
        assert "standard input is not a terminal" in refused(capsys, "--plant", "planar")


@pytest.mark.parametrize(
    ("argv", "expected"),
    [
        (("--speed", "3"), "at most 1"),
        (("--turn", "nan"), "at most 2"),
        (("--speed", "fast"), "a number is needed"),
        (("--floor", "cheese"), "unknown floor"),
        (("--method", "luck"), "unknown method"),
        (("--force",), "--out"),
        (("--keep", "0"), "at least 1"),
    ],
)
def test_impossible_arguments_are_refused_in_one_line(capsys, argv, expected):
    assert expected in refused(capsys, *argv)


@pytest.mark.parametrize(
    ("argv", "expected"),
    [
        (("--plant", "moon"), "unknown plant"),
        (("--plant", "udp:nowhere"), "must be a whole number"),
        (("--plant", "udp:9750", "--floor", "pvc"), "brings its own"),
        (("--plant", "planar", "--gamepad", "/no/such/pad"), "cannot be read"),
    ],
)
def test_an_unknown_plant_is_refused_in_one_line(capsys, monkeypatch, argv, expected):
    far, near = os.openpty()
    with os.fdopen(near) as stdin:
        monkeypatch.setattr(sys, "stdin", stdin)
        assert expected in refused(capsys, *argv)
        monkeypatch.undo()
    os.close(far)


def test_the_newest_part_of_a_watched_drive_is_written_to_its_folder(tmp_path):
    """A spectator writes down what it gets of a plant without a true pose."""
    from rerun.chunk import RrdReader

    from omnimj.parameters import Robot
    from omnimj.signals import Trace
    from omnimj.simulate.teleop.driving import free_drive
    from omnimj.view.rerun.live import DeadReckoning, LiveDrive

    class File:
        is_open = True

        def connect(self, stream, blueprint):
            stream.save(tmp_path / "live.rrd")
            stream.send_blueprint(blueprint)

        def settle(self):
            pass

    scenario = free_drive()
    known = {"scenario": "teleop", "plant": "udp", "method": "off", "seed": 0, "floor": "natural_stone"}
    live = LiveDrive(scenario, known, File())
    live.start()
    robot = scenario.constants
    assert isinstance(robot, Robot)
    own = [f"wheel_speed_{i}" for i in range(1, 5)]
    others = ("current_1", "current_2", "current_3", "current_4", "acceleration_x", "acceleration_y")
    names = ("time", *own, "heading_estimate", "yaw_rate", "yaw", *others)
    names = (
        *names,
        *(f"{kind}_{i}" for kind in ("current_target", "target_wheel_speed") for i in range(1, 5)),
    )
    time_ = np.arange(300) * 0.001
    table = np.zeros((300, len(names)))
    table[:, 0] = time_
    speeds = np.array((0.0, -0.3, 0.0, 0.3)) / robot.wheel.radius  # 0.3 m/s along +x
    table[:, 1:5], table[:, 5] = speeds, np.pi / 2
    reckoning = DeadReckoning(robot)
    for k in range(0, 300, 100):
        live.rows(names, table[k : k + 100])
        placed = reckoning.placed(Trace(dict(zip(names, table[k : k + 100].T, strict=True))))
    live.finish()
    assert placed["y"][-1] == pytest.approx(0.299 * 0.3, rel=1e-6) and abs(placed["x"][-1]) < 1e-9
    entities = {chunk.entity_path for chunk in RrdReader(tmp_path / "live.rrd").stream().to_chunks()}
    assert "/world/machine/chassis" in entities and live.missed == 0
