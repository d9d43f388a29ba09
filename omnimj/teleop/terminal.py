"""The terminal that keys come from: every key at once and unseen, and left as it was found."""

from __future__ import annotations

import contextlib
import os
import select
import sys
import threading
from types import TracebackType
from typing import Any

from omnimj.errors import InputError

try:
    import termios
except ImportError:  # not a POSIX system
    termios = None

_AT_ONCE = 256  # bytes
_KEPT = 4096  # bytes, typed and not yet asked for: the newest
_LONGEST_END = 0.5  # [s] that the end waits for the thread
_CLEAR = "\r\x1b[K"


class Terminal:
    """`with Terminal() as terminal: … terminal.read()`.

    Ctrl-C still interrupts. Ctrl-Z, Ctrl-\\ and Ctrl-S would hold or end the program with a robot in motion:
    they become keys like any other.

    On a busy machine the system may take 0.1 s to say whether a terminal has a key, twice as long as a robot
    waits for a command. From the first `read` on a thread of its own asks it, and writes.
    """

    def __init__(self, source: int | None = None, sink: int | None = None):
        """A terminal to read from and one to write to; standard input and error when None.

        Raises:
          InputError: Keys would not come from a terminal.
        """
        self._source = _descriptor(sys.stdin) if source is None else source
        self._sink = _descriptor(sys.stderr) if sink is None else sink
        if termios is None:
            raise InputError("omnimj teleop", "this system has no POSIX terminals", "keys are read from one")
        if self._source < 0 or not os.isatty(self._source):
            rule = "keys are read from one, run it there"
            raise InputError("omnimj teleop", "standard input is not a terminal", rule)
        self._shows = self._sink >= 0 and os.isatty(self._sink)
        self._found: Any = None
        self._lock, self._typed, self._line = threading.Lock(), bytearray(), ""
        self._is_gone, self._is_over = False, False
        self._thread: threading.Thread | None = None
        self._bell = -1, -1

    def __enter__(self) -> Terminal:
        assert termios is not None
        self._found = termios.tcgetattr(self._source)
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
            # what was typed last is for the robot, not for the shell
            termios.tcsetattr(self._source, termios.TCSAFLUSH, self._found)

    def read(self) -> bytes | None:
        """What was typed since, without waiting; None when the terminal is gone."""
        if self._thread is None:
            self._begin()
        with self._lock:
            content = bytes(self._typed)
            self._typed.clear()
            return content or (None if self._is_gone else b"")

    def drain(self) -> None:
        """Forgets what was typed and not read."""
        assert termios is not None
        with contextlib.suppress(termios.error, OSError):
            termios.tcflush(self._source, termios.TCIFLUSH)
        with self._lock:
            self._typed.clear()

    def show(self, line: str) -> None:
        """Writes one line over the one before; leaves it out where that would have to wait."""
        if self._thread is None:
            self._write(line)
            return
        self._line = line
        self._ring()

    # --- the thread

    def _begin(self) -> None:
        self._is_over, self._bell = False, os.pipe()
        for end in self._bell:
            os.set_blocking(end, False)
        self._thread = threading.Thread(target=self._attend, name="terminal", daemon=True)
        self._thread.start()

    def _end(self) -> None:
        if self._thread is None:
            return
        self._is_over = True
        self._ring()
        self._thread.join(_LONGEST_END)
        if not self._thread.is_alive():  # or else the system keeps it, and it needs its bell
            for end in self._bell:
                os.close(end)
        self._thread = None

    def _ring(self) -> None:
        with contextlib.suppress(BlockingIOError):  # it rings already
            os.write(self._bell[1], b"!")

    def _attend(self) -> None:
        """Keys as they come, the newest line when the bell rings."""
        bell = self._bell[0]
        while not self._is_over:
            asked = [bell] if self._is_gone else [bell, self._source]
            try:
                ready = select.select(asked, [], [])[0]
            except (OSError, ValueError):  # the terminal's descriptor has been closed
                self._is_gone = True
                continue
            if self._source in ready:
                self._listen()
            if bell in ready:
                os.read(bell, _AT_ONCE)
                if not self._is_over:
                    self._write(self._line)

    def _listen(self) -> None:
        try:
            content = os.read(self._source, _AT_ONCE)
        except OSError:
            content = b""
        with self._lock:
            self._typed += content
            del self._typed[:-_KEPT]
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
