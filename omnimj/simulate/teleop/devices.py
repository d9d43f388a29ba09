"""Input of a drive by hand: the terminal for keys, a gamepad as a Linux event file, and the operator.

The operator reads both once per control step, and shows a status line.
"""

from __future__ import annotations

import contextlib
import os
import select
import struct
import sys
import threading
import time
from collections.abc import Callable
from pathlib import Path
from types import TracebackType
from typing import Any

from omnimj.errors import InputError
from omnimj.signals import Target
from omnimj.simulate.teleop.steering import DIRECTIONS, Key, KeyReader, Steering, StickState

try:
    import termios
except ImportError:  # not a POSIX system
    termios = None

FIRST_GAMEPAD = Path("/dev/input/js0")
"""Event file of the first gamepad."""
GAMEPAD_HELP = "hold the left shoulder button, left stick drives, right stick turns, every other button stops"

_READ_SIZE = 256  # bytes
_BUFFER_SIZE = 4096  # bytes; the newest of those typed but not read are kept
_JOIN_TIMEOUT = 0.5  # [s] for which the end waits for the thread
_CLEAR = "\r\x1b[K"

_EVENT = struct.Struct("<IhBB")  # time [ms], value, kind, number
_BUTTON, _AXIS, _INITIAL_STATE = 1, 2, 0x80  # the last flags the state on opening
_DEAD_MAN = 4  # left shoulder of the usual pads
_LEFT_X, _LEFT_Y, _RIGHT_X = 0, 1, 3
_FULL = 32767.0
_DEAD_ZONE = 0.12  # of full deflection: sticks do not return to zero exactly
_EVENT_BYTES = 64 * _EVENT.size
STALE_AFTER = 0.1
"""Time between two reads beyond which directions typed meanwhile are outdated and ignored [s]."""
_DISPLAY_PERIOD = 0.1  # [s]


class Terminal:
    """Terminal in raw mode: `with Terminal() as terminal: … terminal.read()`.

    Keys arrive at once and without echo; the settings are restored at the end. Ctrl-C still interrupts.
    Ctrl-Z, Ctrl-\\ and Ctrl-S would suspend or end the program with a robot in motion, so they become
    ordinary keys.

    On a busy machine the system may take 0.1 s to poll a terminal, twice as long as a robot waits for a
    command. From the first `read` on, a thread of its own reads and writes.
    """

    def __init__(self, source: int | None = None, sink: int | None = None):
        """Use these file descriptors to read and to write; standard input and error when None.

        Raises:
          InputError: The source is not a terminal.
        """
        self._source = _descriptor(sys.stdin) if source is None else source
        self._sink = _descriptor(sys.stderr) if sink is None else sink
        if termios is None:
            raise InputError("omnimj teleop", "this system has no POSIX terminals", "keys are read from one")
        if self._source < 0 or not os.isatty(self._source):
            rule = "keys are read from one, run it there"
            raise InputError("omnimj teleop", "standard input is not a terminal", rule)
        self._shows = self._sink >= 0 and os.isatty(self._sink)
        self._saved: Any = None
        self._lock, self._typed, self._line = threading.Lock(), bytearray(), ""
        self._is_gone, self._is_over = False, False
        self._thread: threading.Thread | None = None
        self._pipe = -1, -1

    def __enter__(self) -> Terminal:
        assert termios is not None
        self._saved = termios.tcgetattr(self._source)
        changed = termios.tcgetattr(self._source)
        changed[0] &= ~termios.IXON
        changed[3] &= ~(termios.ICANON | termios.ECHO)
        nothing = bytes([os.fpathconf(self._source, "PC_VDISABLE") & 0xFF])
        for name in ("VSUSP", "VQUIT", "VDSUSP"):
            if hasattr(termios, name):
                changed[6][getattr(termios, name)] = nothing
        changed[6][termios.VMIN], changed[6][termios.VTIME] = 1, 0
        termios.tcsetattr(self._source, termios.TCSAFLUSH, changed)
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        assert termios is not None
        self._end()
        self._write("")
        with contextlib.suppress(termios.error, OSError):  # it may be gone
            # the last keys were meant for the robot, not for the shell
            termios.tcsetattr(self._source, termios.TCSAFLUSH, self._saved)

    def read(self) -> bytes | None:
        """Bytes typed since the last call, without waiting; None when the terminal is gone."""
        if self._thread is None:
            self._begin()
        with self._lock:
            content = bytes(self._typed)
            self._typed.clear()
            return content or (None if self._is_gone else b"")

    def drain(self) -> None:
        """Discard bytes that were typed but not read."""
        assert termios is not None
        with contextlib.suppress(termios.error, OSError):
            termios.tcflush(self._source, termios.TCIFLUSH)
        with self._lock:
            self._typed.clear()

    def show(self, line: str) -> None:
        """Write one line over the previous one, unless writing would block."""
        if self._thread is None:
            self._write(line)
            return
        self._line = line
        self._wake()

    def _begin(self) -> None:
        self._is_over, self._pipe = False, os.pipe()
        for end in self._pipe:
            os.set_blocking(end, False)
        self._thread = threading.Thread(target=self._serve, name="terminal", daemon=True)
        self._thread.start()

    def _end(self) -> None:
        if self._thread is None:
            return
        self._is_over = True
        self._wake()
        self._thread.join(_JOIN_TIMEOUT)
        if not self._thread.is_alive():  # a blocked thread still needs its pipe
            for end in self._pipe:
                os.close(end)
        self._thread = None

    def _wake(self) -> None:
        with contextlib.suppress(BlockingIOError):  # a wake-up is pending already
            os.write(self._pipe[1], b"!")

    def _serve(self) -> None:
        """Read keys as they arrive, and write the newest line after each wake-up."""
        wake = self._pipe[0]
        while not self._is_over:
            sources = [wake] if self._is_gone else [wake, self._source]
            try:
                ready = select.select(sources, [], [])[0]
            except (OSError, ValueError):  # the terminal's descriptor has been closed
                self._is_gone = True
                continue
            if self._source in ready:
                self._read_keys()
            if wake in ready:
                os.read(wake, _READ_SIZE)
                if not self._is_over:
                    self._write(self._line)

    def _read_keys(self) -> None:
        try:
            content = os.read(self._source, _READ_SIZE)
        except OSError:
            content = b""
        with self._lock:
            self._typed += content
            del self._typed[:-_BUFFER_SIZE]
            self._is_gone = not content

    def _write(self, line: str) -> None:
        if not self._shows:
            return
        with contextlib.suppress(OSError):
            if select.select([], [self._sink], [], 0.0)[1]:
                os.write(self._sink, (_CLEAR + line).encode(errors="replace"))


def _descriptor(stream: object) -> int:
    try:
        return stream.fileno()  # type: ignore[attr-defined]
    except (AttributeError, OSError, ValueError):  # closed, or a stand-in without a file
        return -1


class GamepadReader:
    """Decoder of gamepad events (8 bytes each) into the state of the sticks."""

    def __init__(self) -> None:
        self._rest = b""
        self._axes = {_LEFT_X: 0.0, _LEFT_Y: 0.0, _RIGHT_X: 0.0}
        self._held = False

    def feed(self, content: bytes) -> tuple[StickState, bool]:
        """State of the sticks after these events, and whether a stop button was pressed.

        A dead man's button held while the gamepad is opened counts only once it is pressed again.
        """
        content = self._rest + content
        whole = len(content) // _EVENT.size * _EVENT.size
        self._rest, stops = content[whole:], False
        for _, value, kind, number in _EVENT.iter_unpack(content[:whole]):
            if kind & ~_INITIAL_STATE == _AXIS and number in self._axes:
                self._axes[number] = value / _FULL
            elif kind == _BUTTON and number == _DEAD_MAN:
                self._held = value != 0
            elif kind == _BUTTON and value:
                stops = True
        x, y, turn = (_outside_dead_zone(self._axes[number]) for number in (_LEFT_X, _LEFT_Y, _RIGHT_X))
        return StickState(-y, -x, -turn, self._held), stops  # gamepads count to the right and down


def _outside_dead_zone(value: float) -> float:
    """Deflection beyond the dead zone, rescaled to −1…1."""
    size = min(max(abs(value) - _DEAD_ZONE, 0.0) / (1.0 - _DEAD_ZONE), 1.0)
    return size if value > 0.0 else -size


class Gamepad:
    """Event file of a gamepad, read without waiting."""

    def __init__(self, path: Path):
        """Open the file.

        Raises:
          InputError: The file does not exist or may not be read.
        """
        try:
            self._file = os.open(path, os.O_RDONLY | os.O_NONBLOCK)
        except OSError as error:
            raise InputError(f"--gamepad {path}", f"cannot be read ({error.strerror})") from None

    def read(self) -> bytes | None:
        """Bytes since the last call; None when the gamepad is gone."""
        try:
            return os.read(self._file, _EVENT_BYTES) or None
        except BlockingIOError:
            return b""
        except OSError:
            return None

    def close(self) -> None:
        """Close the file."""
        os.close(self._file)


class Operator:
    """Source of targets for `drive_by_hand`, which ends on a key or when the terminal is gone."""

    def __init__(
        self,
        steering: Steering,
        period: float,
        keyboard: Terminal,
        pad: Gamepad | None = None,
        clock: Callable[[], float] = time.monotonic,
        status: Callable[[], str] = str,
    ):
        """Connect an operator at a terminal, with a gamepad if there is one.

        Args:
          steering: Steering that makes the targets.
          period: Control period [s].
          keyboard: Source of keys.
          pad: Source of stick events; None without a gamepad.
          clock: Monotonic clock [s].
          status: Function that returns text to append to the status line.
        """
        self._steering, self._period, self._keyboard, self._pad = steering, period, keyboard, pad
        self._clock, self._status = clock, status
        self._keys, self._sticks = KeyReader(), GamepadReader()
        self._last_read = self._last_shown = clock()

    def target(self, heading: float, time_scaling: float) -> Target | None:
        """Target of the coming control period; None when the operator ends the drive.

        Args:
          heading: The controller's estimate of the robot's heading [rad].
          time_scaling: Share of the demanded speed that recovery allows, 0…1.
        """
        now = self._clock()
        if not self._read_keys(now):
            return None
        if self._pad is not None:
            self._read_gamepad(now)
        target = self._steering.target(now, self._period, heading, time_scaling)
        if now - self._last_shown >= _DISPLAY_PERIOD:
            self._last_shown = now
            x, y, turn = self._steering.twist
            self._keyboard.show(f"{x:+.2f} {y:+.2f} m/s {turn:+.2f} rad/s  {self._status()}")
        return target

    def _read_keys(self, now: float) -> bool:
        """Process typed keys; False ends the drive."""
        content, old = self._keyboard.read(), now - self._last_read > STALE_AFTER
        self._last_read = now
        if content is None:
            return False
        for key in self._keys.feed(now, content):
            if key is Key.END:
                return False
            if not (old and key in DIRECTIONS):
                self._steering.on_key(now, key)
        return True

    def _read_gamepad(self, now: float) -> None:
        """Process gamepad events; losing the gamepad stops the robot."""
        assert self._pad is not None
        content = self._pad.read()
        if content is None:
            self._pad = None
            self._steering.stop(now)
        elif content:
            stick, stops = self._sticks.feed(content)
            self._steering.on_stick(now, stick)
            if stops:
                self._steering.stop(now)
