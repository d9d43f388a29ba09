"""A gamepad as Linux shows it: events of 8 bytes, read from a file such as /dev/input/js0."""

from __future__ import annotations

import os
import struct
from pathlib import Path

from omnimj.errors import InputError
from omnimj.teleop.steering import Stick

FIRST = Path("/dev/input/js0")
"""Where the first one is."""
HELP = "hold the left shoulder button, left stick drives, right stick turns, every other button stops"

_EVENT = struct.Struct("<IhBB")  # time [ms], value, kind, number
_BUTTON, _AXIS, _BEFORE = 1, 2, 0x80  # the last: how things stood when it was opened
_DEAD_MAN = 4  # left shoulder of the usual pads
_LEFT_X, _LEFT_Y, _RIGHT_X = 0, 1, 3
_FULL = 32767.0
_NOTHING = 0.12  # of full deflection: sticks do not come back to zero
_AT_ONCE = 64 * _EVENT.size


class GamepadReader:
    """Bytes in, the state of the sticks out; holds less than one event."""

    def __init__(self) -> None:
        self._rest = b""
        self._axes = {_LEFT_X: 0.0, _LEFT_Y: 0.0, _RIGHT_X: 0.0}
        self._held = False

    def feed(self, content: bytes) -> tuple[Stick, bool]:
        """How the sticks stand after these events, and whether a button was pressed that stops.

        A dead man's button that was down before anybody looked does not count: it must be pressed anew.
        """
        content = self._rest + content
        whole = len(content) // _EVENT.size * _EVENT.size
        self._rest, stops = content[whole:], False
        for _, value, kind, number in _EVENT.iter_unpack(content[:whole]):
            if kind & ~_BEFORE == _AXIS and number in self._axes:
                self._axes[number] = value / _FULL
            elif kind == _BUTTON and number == _DEAD_MAN:
                self._held = value != 0
            elif kind == _BUTTON and value:
                stops = True
        x, y, turn = (_beyond(self._axes[number]) for number in (_LEFT_X, _LEFT_Y, _RIGHT_X))
        return Stick(-y, -x, -turn, self._held), stops  # pads count to the right and down


def _beyond(value: float) -> float:
    """What is left of a deflection beyond the dead zone, −1…1."""
    size = min(max(abs(value) - _NOTHING, 0.0) / (1.0 - _NOTHING), 1.0)
    return size if value > 0.0 else -size


class Gamepad:
    """The file of a gamepad; reading never waits."""

    def __init__(self, path: Path):
        """Opens it.

        Raises:
          InputError: It is not there, or may not be read.
        """
        try:
            self._file = os.open(path, os.O_RDONLY | os.O_NONBLOCK)
        except OSError as error:
            raise InputError(f"--gamepad {path}", f"cannot be read ({error.strerror})") from None

    def read(self) -> bytes | None:
        """What has come; None when the gamepad is gone."""
        try:
            return os.read(self._file, _AT_ONCE) or None
        except BlockingIOError:
            return b""
        except OSError:
            return None

    def close(self) -> None:
        """Lets go of the file."""
        os.close(self._file)
