"""Device and host as two programs: what is left when one is killed, interrupted, or has another key.

A tap lies between the two, sees every frame, and goes on listening when the host is gone.
"""

from __future__ import annotations

import contextlib
import os
import select
import signal
import socket
import subprocess
import sys
import threading
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest
from key_files import make_key_file
from wired_devices import PERIOD, ROBOT, WIRING

from omnimj.cli.main import main
from omnimj.link.codec.frames import decode
from omnimj.link.codec.messages import (
    Command,
    Fault,
    FaultCode,
    Frame,
    Hello,
    Ping,
    Status,
    Stop,
    Telemetry,
)
from omnimj.link.device.server import DeviceServer
from omnimj.link.host.link import LinkMode, open_link
from omnimj.link.host.plant import HardwarePlant
from omnimj.link.host.state_machine import COMMAND_VALIDITY, STOP_REPEATS

pytestmark = pytest.mark.skipif(os.name != "posix", reason="signals are of POSIX")
LONGEST = 90.0  # [s]: nothing here takes so long, but native code may have to be compiled first
ATTEMPTS = 5  # a busy machine may end a driving host, which stops when telemetry is older than 20 ms
DRIVE = ("run", "circle_8m", "--method", "off", "--set", "drive.start_time=0.0")
# who starts these tests in the background would have Ctrl-C ignored by their programs, too
PROGRAM = """
import signal, sys
signal.signal(signal.SIGINT, signal.default_int_handler)
from omnimj.cli.main import main
sys.exit(main(sys.argv[1:]))
"""


def started(*argv: str) -> subprocess.Popen[str]:
    command = [sys.executable, "-c", PROGRAM, *argv]
    return subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)


def free_port() -> int:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        probe.bind(("127.0.0.1", 0))
        return probe.getsockname()[1]


@contextlib.contextmanager
def device(*argv: str) -> Iterator[int]:
    """`omnimj device` on the planar robot, ready; its port. It is ended as a service is."""
    port = free_port()
    program = started("device", "--udp", f"127.0.0.1:{port}", "--plant", "planar", *argv)
    try:
        assert program.stdout is not None
        assert select.select([program.stdout], [], [], LONGEST)[0], "the device says nothing"
        assert program.stdout.readline().startswith(f"device ready at udp:127.0.0.1:{port}")
        yield port
        program.terminate()
        printed, complaint = program.communicate(timeout=LONGEST)
        assert program.returncode == 130 and " frames, " in printed and "Traceback" not in complaint
    finally:
        program.kill()
        program.communicate()


@pytest.fixture(scope="module")
def port():
    """A device in real time."""
    with device() as listening:
        yield listening


class Tap:
    """Forwards the frames of two programs and keeps them; True: the host's."""

    def __init__(self, port: int):
        self.near, self.far = (socket.socket(socket.AF_INET, socket.SOCK_DGRAM) for _ in range(2))
        self.near.bind(("127.0.0.1", 0))
        self.far.connect(("127.0.0.1", port))
        self.address = f"udp:127.0.0.1:{self.near.getsockname()[1]}"
        self.frames: list[tuple[bool, Frame]] = []
        self._news, self._over = threading.Condition(), threading.Event()
        self._thread = threading.Thread(target=self._pass_on)
        self._thread.start()

    def _pass_on(self) -> None:
        host = None
        while not self._over.is_set():
            for one in select.select([self.near, self.far], [], [], 0.05)[0]:
                try:
                    packet, sender = one.recvfrom(2048)
                    if is_host := one is self.near:
                        host = sender
                        self.far.send(packet)
                    elif host is not None:
                        self.near.sendto(packet, host)
                except ConnectionError:  # the port of a program that has ended
                    continue
                frame = decode(packet)
                assert isinstance(frame, Frame)
                with self._news:
                    self.frames.append((is_host, frame))
                    self._news.notify_all()

    def until(self, holds: Callable[[list[Frame]], bool], since: int = 0) -> bool:
        """Waits until something holds of the device's frames."""
        with self._news:
            return self._news.wait_for(lambda: holds(self.received(since)), LONGEST)

    def clear(self) -> None:
        with self._news:
            self.frames.clear()

    def received(self, since: int = 0) -> list[Frame]:
        """By the device."""
        return [frame for is_host, frame in self.frames[since:] if not is_host]

    def heard(self) -> list[Frame]:
        """From the host."""
        return [frame for is_host, frame in self.frames if is_host]

    def close(self) -> None:
        self._over.set()
        self._thread.join()
        self.near.close()
        self.far.close()


@pytest.fixture
def tap(port):
    between = Tap(port)
    yield between
    between.close()


def telemetry_of(frames: list[Frame]) -> list[Telemetry]:
    return [frame.message for frame in frames if isinstance(frame.message, Telemetry)]


def flows(frames: list[Frame]) -> bool:
    return any(Status.CURRENT_FLOWS in telemetry.status for telemetry in telemetry_of(frames[-50:]))


def disarmed(frames: list[Frame]) -> bool:
    return any(Status.ARMED not in telemetry.status for telemetry in telemetry_of(frames[-50:]))


@contextlib.contextmanager
def driving(tap: Tap) -> Iterator[subprocess.Popen[str]]:
    """A host whose robot moves, and its frames alone in the tap."""
    complaint = ""
    for _ in range(ATTEMPTS):
        tap.clear()
        program = started(*DRIVE, "--plant", tap.address, "--real-time", "--reset-fault")
        try:
            ended = program.poll
            assert tap.until(lambda frames: flows(frames) or ended() is not None)  # noqa: B023
            if ended() is None:
                yield program
                return
        finally:
            program.kill()
            _, complaint = program.communicate()
    pytest.fail(f"the host does not drive: {complaint}")


def seen(port: int) -> Telemetry:
    """What a host that does not drive gets from the device."""
    link = open_link(f"udp:127.0.0.1:{port}", ROBOT, mode=LinkMode.DRY_RUN)
    try:
        link.connect()
        return link.reading.telemetry
    finally:
        link.close()


@pytest.mark.slow
def test_a_device_whose_host_is_killed_stops_with_its_reason(tap, port, capsys, measured):
    with driving(tap) as host:
        host.kill()
        host.wait()
        mark = len(tap.frames)
        assert tap.until(lambda frames: len(telemetry_of(frames)) > 100, since=mark)
    assert not any(isinstance(frame.message, Stop) for frame in tap.heard())
    every = [frame for frame in tap.received() if isinstance(frame.message, Telemetry)]
    first = next(k for k, frame in enumerate(every) if frame.message.fault)
    before, after = telemetry_of(every[:first]), telemetry_of(every[first:])
    assert all(one.fault is FaultCode.COMMAND_TOO_OLD for one in after)
    assert not any(one.status & (Status.ARMED | Status.CURRENT_FLOWS) for one in after)
    (fault,) = [frame.message for frame in tap.received() if isinstance(frame.message, Fault)]
    assert fault.code is FaultCode.COMMAND_TOO_OLD and fault.latched
    # by its own clock: the program may have been kept from running
    kept = max(PERIOD, 1e-6 * (every[first].time - every[first - 1].time))
    over = (before[-1].command_age - COMMAND_VALIDITY) / PERIOD
    measured("killed host: current flows beyond valid-for [periods]", over, 1.0)
    assert before[-1].command_age <= COMMAND_VALIDITY + PERIOD
    # not below: telemetry states the age in whole microseconds
    assert COMMAND_VALIDITY <= after[0].command_age <= COMMAND_VALIDITY + 2.0 * PERIOD + kept
    assert seen(port).fault is FaultCode.COMMAND_TOO_OLD  # of the device, not of a session

    address = f"udp:127.0.0.1:{port}"
    capsys.readouterr()
    assert main([*DRIVE, "--plant", address, "--real-time"]) == 1
    lines = [line for line in capsys.readouterr().err.splitlines() if not line.startswith("compiling")]
    assert len(lines) == 1 and "command too old" in lines[0] and "--reset-fault" in lines[0], lines
    assert seen(port).fault is FaultCode.COMMAND_TOO_OLD
    plant = HardwarePlant(open_link(address, ROBOT), WIRING, reset_fault=True)
    try:
        plant.reset()
        assert Status.ARMED in plant.link.arm().telemetry.status
    finally:
        plant.close()
    assert seen(port).fault is FaultCode.NONE


@pytest.mark.slow
@pytest.mark.parametrize(
    "number",
    [signal.SIGINT, signal.SIGTERM],
    ids=["Ctrl-C", "SIGTERM"],
)
def test_a_host_that_is_interrupted_ends_by_a_stop(tap, number):
    for _ in range(ATTEMPTS):
        with driving(tap) as host:
            mark = len(tap.frames)
            host.send_signal(number)
            _, complaint = host.communicate(timeout=LONGEST)
            assert tap.until(disarmed, since=mark)
        if host.returncode != 1:  # not ended by itself before the signal
            break
    assert host.returncode == 130 and "Traceback" not in complaint
    assert [type(frame.message) for frame in tap.heard()[-STOP_REPEATS:]] == [Stop] * STOP_REPEATS
    # the stop overtakes a command that waits in the device's queue, which is then refused
    assert not any(frame.message.latched for frame in tap.received() if isinstance(frame.message, Fault))
    assert all(one.fault is FaultCode.NONE for one in telemetry_of(tap.received(since=mark)))


def overheard(own: str) -> bool:
    """Whether the monitor at this address gets telemetry of a robot that moves."""
    host, _, port = own.partition(":")
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as monitor:
        monitor.bind((host, int(port)))
        monitor.settimeout(LONGEST)
        for _ in range(20_000):
            frame = decode(monitor.recv(2048))
            if isinstance(frame, Frame) and flows([frame]):
                return True
    return False


@pytest.mark.slow
def test_a_readonly_host_follows_another_hosts_run(capsys):
    own = f"127.0.0.1:{free_port()}"
    words = ("--set", "duration=0.3", "--plant", f"udp:{own}", "--readonly")
    with device("--monitor", own) as port:
        for _ in range(ATTEMPTS):
            host = started(*DRIVE, "--plant", f"udp:127.0.0.1:{port}", "--real-time", "--reset-fault")
            try:
                assert overheard(own)
                code, went_on = main([*DRIVE, *words]), host.poll() is None
            finally:
                host.kill()
                host.communicate()
            if code in (0, 1) and went_on:
                break
        assert code in (0, 1) and went_on
    assert f"udp:{own}, readonly; " in capsys.readouterr().out


@pytest.mark.slow
def test_a_rehearsing_host_moves_nothing(tap, capsys):
    words = ("--set", "duration=0.2", "--plant", tap.address, "--dry-run")
    assert main([*DRIVE, *words]) in (0, 1)
    assert "dry run; " in capsys.readouterr().out
    assert {type(frame.message) for frame in tap.heard()} == {Hello, Ping, Command}
    assert len(telemetry_of(tap.received())) > 50
    assert not any(one.status & (Status.ARMED | Status.CURRENT_FLOWS) for one in telemetry_of(tap.received()))


@pytest.fixture(scope="module")
def keys(tmp_path_factory) -> tuple[Path, Path]:
    """Two files of keys."""
    folder = tmp_path_factory.mktemp("keys")
    right, wrong = folder / "right", folder / "wrong"
    make_key_file(right)
    make_key_file(wrong)
    return right, wrong


@contextlib.contextmanager
def device_in_thread(*argv: str) -> Iterator[int]:
    """`omnimj device` on the planar robot beside the host; its port. It is ended as by Ctrl-C."""
    port, ready, over = free_port(), threading.Event(), threading.Event()
    run, codes = DeviceServer.run, []

    def until_over(server: DeviceServer, goes_on: Callable[[], bool]) -> None:
        ready.set()
        run(server, lambda: goes_on() and not over.is_set())
        raise KeyboardInterrupt

    words = ["device", "--udp", f"127.0.0.1:{port}", "--plant", "planar", *argv]
    thread = threading.Thread(target=lambda: codes.append(main(words)))
    with pytest.MonkeyPatch.context() as patched:
        patched.setattr(DeviceServer, "run", until_over)
        thread.start()
        try:
            assert ready.wait(LONGEST), "the device does not begin"
            yield port
        finally:
            over.set()
            thread.join()
    assert codes == [130]


@pytest.mark.slow
@pytest.mark.parametrize("begun", [device_in_thread, device])
def test_with_the_same_key_a_run_is_driven_and_with_another_one_refused(begun, keys, capsys):
    right, wrong = keys
    with begun("--lock-step", "--key-file", str(right)) as listening:
        address = f"udp:127.0.0.1:{listening}"
        short = (*DRIVE, "--set", "duration=0.3", "--plant", address, "--lock-step")
        assert main([*short, "--key-file", str(right)]) in (0, 1)
        assert f"{address}, lock-step, keyed; " in capsys.readouterr().out
        for given in (["--key-file", str(wrong)], []):
            assert main([*short, *given]) == 3
            out, err = capsys.readouterr()
            lines = [line for line in err.splitlines() if not line.startswith("compiling")]
            assert not out and len(lines) == 1 and "does not answer" in lines[0] and "key" in lines[0], err
