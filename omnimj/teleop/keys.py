"""What the bytes of a terminal mean to whoever drives."""

from __future__ import annotations

import enum


class Key(enum.Enum):
    """What a key asks for."""

    FORWARD = "forward"
    BACK = "back"
    LEFT = "left"
    RIGHT = "right"
    TURN_LEFT = "turn left"
    TURN_RIGHT = "turn right"
    STOP = "stop"
    """Space, and every key that means nothing else: whoever hits a wrong key wants the robot to stand."""
    END = "end"


DIRECTIONS = frozenset(
    (Key.FORWARD, Key.BACK, Key.LEFT, Key.RIGHT, Key.TURN_LEFT, Key.TURN_RIGHT)
)  # fmt: skip
"""Keys that ask for motion."""
HELP = "w s ahead and back, a d sideways, ← → turn (or j l), space or any other key stops, q ends"

_LETTERS = {
    "w": Key.FORWARD,
    "s": Key.BACK,
    "a": Key.LEFT,
    "d": Key.RIGHT,
    "j": Key.TURN_LEFT,
    "l": Key.TURN_RIGHT,
    "q": Key.END,
}
_ARROWS = {"A": Key.FORWARD, "B": Key.BACK, "D": Key.TURN_LEFT, "C": Key.TURN_RIGHT}
_ESCAPE = 0x1B
_WAITS = 0.05  # [s] for the rest of an arrow key, which comes in one piece or nearly so
_LONGEST = 8  # bytes of one key


class KeyReader:
    """Cuts a terminal's bytes into keys; arrow keys are three bytes and may come in pieces.

    Holds one unfinished key at most, and that only for a short time.
    """

    def __init__(self) -> None:
        self._begun = b""
        self._since = 0.0

    def feed(self, now: float, content: bytes) -> list[Key]:
        """The keys that end in these bytes.

        Args:
          now: On any clock that only goes forward [s].
          content: What the terminal gave; nothing is a way to say that time has passed.
        """
        found = []
        if self._begun and not content and now - self._since > _WAITS:
            found.append(Key.STOP)  # the escape key alone, or half of something
            self._begun = b""
        if content and not self._begun:
            self._since = now
        rest = self._begun + content
        while rest:
            key, size = _first(rest)
            if size == 0:
                break
            found.append(key)
            rest = rest[size:]
        self._begun = rest
        return found


def _first(content: bytes) -> tuple[Key, int]:
    """The first key and its length; length 0: its end is still to come."""
    if content[0] != _ESCAPE:
        return _LETTERS.get(chr(content[0]).lower(), Key.STOP), 1
    if len(content) == 1:
        return Key.STOP, 0
    if content[1:2] not in (b"[", b"O"):
        return Key.STOP, 1
    for end in range(2, min(len(content), _LONGEST)):
        if 0x40 <= content[end] <= 0x7E:  # the last byte of a sequence
            return (_ARROWS.get(chr(content[end]), Key.STOP) if end == 2 else Key.STOP), end + 1
    return (Key.STOP, 0) if len(content) < _LONGEST else (Key.STOP, len(content))
