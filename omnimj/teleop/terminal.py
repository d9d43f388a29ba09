"""The terminal that keys come from: every key at once and unseen, and left as it was found."""

from __future__ import annotations

import contextlib
import os
import select
import sys
from types import TracebackType
from typing import Any

from omnimj.errors import InputError

try:
    import termios
except ImportError:  # not a POSIX system
    termios = None

_AT_ONCE = 256  # bytes
_CLEAR = "\r\x1b[K"


class Terminal:
    """`with Terminal() as terminal: … terminal.read()`.

    Ctrl-C still interrupts. Ctrl-Z, Ctrl-\\ and Ctrl-S would hold or end the program with a robot in motion:
    they become keys like any other.
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
        self.show("")
        with contextlib.suppress(termios.error, OSError):  # it may be gone
            # what was typed last is for the robot, not for the shell
            termios.tcsetattr(self._source, termios.TCSAFLUSH, self._found)

    def read(self) -> bytes | None:
        """What was typed since, without waiting; None when the terminal is gone."""
        try:
            if not select.select([self._source], [], [], 0.0)[0]:
                return b""
            return os.read(self._source, _AT_ONCE) or None
        except OSError:
            return None

    def drain(self) -> None:
        """Forgets what was typed and not read."""
        assert termios is not None
        with contextlib.suppress(termios.error, OSError):
            termios.tcflush(self._source, termios.TCIFLUSH)

    def show(self, line: str) -> None:
        """Writes one line over the one before; leaves it out where that would have to wait."""
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
