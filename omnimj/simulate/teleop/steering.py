"""What the bytes of a terminal mean to whoever drives."""

from __future__ import annotations

import enum
import math
from dataclasses import dataclass

import numpy as np

from omnimj.control.cascade.heading import wrapped
from omnimj.errors import InputError
from omnimj.signals import Target


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
KEYS_HELP = "w s ahead and back, a d sideways, ← → turn (or j l), space or any other key stops, q ends"

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
_ESCAPE_TIMEOUT = 0.05  # [s] for the rest of an arrow key, which comes in one piece or nearly so
_LONGEST_SEQUENCE = 8  # bytes of one key


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
        if self._begun and not content and now - self._since > _ESCAPE_TIMEOUT:
            found.append(Key.STOP)  # the escape key alone, or half of something
            self._begun = b""
        if content and not self._begun:
            self._since = now
        rest = self._begun + content
        while rest:
            key, size = _first_key(rest)
            if size == 0:
                break
            found.append(key)
            rest = rest[size:]
        self._begun = rest
        return found


def _first_key(content: bytes) -> tuple[Key, int]:
    """The first key and its length; length 0: its end is still to come."""
    if content[0] != _ESCAPE:
        return _LETTERS.get(chr(content[0]).lower(), Key.STOP), 1
    if len(content) == 1:
        return Key.STOP, 0
    if content[1:2] not in (b"[", b"O"):
        return Key.STOP, 1
    for end in range(2, min(len(content), _LONGEST_SEQUENCE)):
        if 0x40 <= content[end] <= 0x7E:  # the last byte of a sequence
            return (_ARROWS.get(chr(content[end]), Key.STOP) if end == 2 else Key.STOP), end + 1
    return (Key.STOP, 0) if len(content) < _LONGEST_SEQUENCE else (Key.STOP, len(content))


# From keys and sticks to the target of one control step: held keys, dead man's rule, ramps, limits.

KEY_HOLD_TIME = 0.3
"""How long a key counts as held after its last event [s]."""
LOCKOUT_AFTER_STOP = 0.5
"""After a stop no direction is listened to for this long: what was typed with it is not meant [s]."""
BRAKING_DECELERATION = 1.0
"""The least acceleration with which a demand goes to zero by itself [m/s²]."""
TURN_ARM = 0.25
"""Length that makes an acceleration of turning of one of driving: where the wheels sit [m]."""
MAX_HEADING_LEAD = 0.2
"""By how much the planned heading may part from the robot's [rad]."""
STICK_TIMEOUT = 2.0
"""A stick that has sent nothing for so long is taken for one out of reach [s]."""
MAX_SPEED, MAX_YAW_RATE, MAX_ACCELERATION, MAX_HOLD_TIME = 1.0, 2.0, 1.0, 1.0
"""Largest limits that may be asked for: m/s, rad/s, m/s², s."""

# x ahead, y left, turn counter-clockwise
_KEY_AXES = {
    Key.FORWARD: (0, 1.0),
    Key.BACK: (0, -1.0),
    Key.LEFT: (1, 1.0),
    Key.RIGHT: (1, -1.0),
    Key.TURN_LEFT: (2, 1.0),
    Key.TURN_RIGHT: (2, -1.0),
}


@dataclass(frozen=True, slots=True)
class SteeringLimits:
    """How fast and how hard a robot may be driven by hand."""

    speed: float = 0.3
    """[m/s]"""
    turn: float = 0.6
    """[rad/s]"""
    acceleration: float = 0.5
    """[m/s²]; of turning it is this over `TURN_ARM`."""
    hold: float = KEY_HOLD_TIME
    """How long a key counts as held after its last event [s]."""

    def __post_init__(self) -> None:
        for option, value, most in (
            ("--speed", self.speed, MAX_SPEED),
            ("--turn", self.turn, MAX_YAW_RATE),
            ("--acceleration", self.acceleration, MAX_ACCELERATION),
            ("--hold", self.hold, MAX_HOLD_TIME),
        ):
            if not 0.0 < value <= most:
                raise InputError(option, f"found {value:g}", f"must be above 0 and at most {most:g}")


@dataclass(frozen=True, slots=True)
class StickState:
    """How a gamepad's sticks stand, each −1…1."""

    forward: float = 0.0
    left: float = 0.0
    turn: float = 0.0
    """Counter-clockwise."""
    held: bool = False
    """The dead man's button."""


_NEUTRAL_STICK = StickState()


class Steering:
    """`on_key`, `on_stick` and `stop` when something happens; `target` once in every control step."""

    def __init__(self, limits: SteeringLimits):
        self._limits = limits
        self._events: list[tuple[float, float]] = [(-math.inf, 0.0)] * 3  # time and sign, by axis
        self._stick, self._stick_time = _NEUTRAL_STICK, -math.inf
        self._deaf_until = -math.inf
        self._must_let_go = False  # of the dead man's button, after a stop
        self._twist = (0.0, 0.0, 0.0)
        self._planned = math.nan

    @property
    def twist(self) -> tuple[float, float, float]:
        """What is asked for now, body frame: m/s ahead, m/s to the left, rad/s counter-clockwise."""
        return self._twist

    def on_key(self, now: float, key: Key) -> None:
        """One event of a key; of a direction the newest counts, so back takes forward's place.

        Args:
          now: On a clock that only goes forward [s].
          key: What it asks for; `END` stops, too.
        """
        if key not in DIRECTIONS:
            self.stop(now)
        elif now >= self._deaf_until:
            axis, sign = _KEY_AXES[key]
            self._events[axis] = now, sign

    def on_stick(self, now: float, stick: StickState) -> None:
        """A gamepad has said something. Keys that are held go before it.

        After a stop its dead man's button counts when it has been let go and pressed anew.
        """
        self._must_let_go &= stick.held
        if not self._must_let_go:
            self._stick, self._stick_time = stick, now

    def stop(self, now: float) -> None:
        """Asks for nothing at once, without a ramp, and is deaf to directions for a moment."""
        self._events = [(-math.inf, 0.0)] * 3
        self._stick, self._stick_time = _NEUTRAL_STICK, -math.inf
        self._deaf_until, self._must_let_go = now + LOCKOUT_AFTER_STOP, True
        self._twist = (0.0, 0.0, 0.0)

    def target(self, now: float, period: float, heading: float, pace: float = 1.0) -> Target:
        """The target of one control step.

        While nothing is asked for, the planned heading is the robot's own, so that nothing turns a robot
        back that was turned by hand.

        Args:
          now: On the same clock as the events [s].
          period: That the target is held for [s].
          heading: Of the robot, as the controller believes [rad].
          pace: Share of the demand that recovery allows, 0…1.
        """
        self._ramp(self._wanted(now), period)
        forward, left, turn = (pace * part for part in self._twist)
        if forward == left == turn == 0.0 or not math.isfinite(self._planned):
            self._planned = heading
        # within reach of the robot: a plan that has run away would swing it about
        off = wrapped(self._planned + turn * period - heading)
        self._planned = heading + min(max(off, -MAX_HEADING_LEAD), MAX_HEADING_LEAD)
        c, s = math.cos(heading), math.sin(heading)
        return Target(np.array((c * forward - s * left, s * forward + c * left)), turn, self._planned)

    def _wanted(self, now: float) -> tuple[float, float, float]:
        """Twist that is asked for at this instant, within the limits."""
        limits = self._limits
        x, y, turn = (sign if now - at <= limits.hold else 0.0 for at, sign in self._events)
        if x == y == turn == 0.0 and self._stick.held and now - self._stick_time <= STICK_TIMEOUT:
            x, y, turn = (
                min(max(part, -1.0), 1.0)
                for part in (self._stick.forward, self._stick.left, self._stick.turn)
            )
        much = limits.speed / max(1.0, math.hypot(x, y))
        return x * much, y * much, turn * limits.turn

    def _ramp(self, wanted: tuple[float, float, float], period: float) -> None:
        """Moves the twist towards what is wanted; to zero at least as fast as `BRAKING_DECELERATION`."""
        hard = self._limits.acceleration
        (x, y, turn), (to_x, to_y, to_turn) = self._twist, wanted
        rise = hard if to_x or to_y else max(hard, BRAKING_DECELERATION)
        spin = (hard if to_turn else max(hard, BRAKING_DECELERATION)) / TURN_ARM
        way = math.hypot(to_x - x, to_y - y)
        share = min(1.0, rise * period / way) if way > 0.0 else 1.0
        step = min(max(to_turn - turn, -spin * period), spin * period)
        x, y = (to_x, to_y) if share == 1.0 else (x + share * (to_x - x), y + share * (to_y - y))
        self._twist = x, y, (to_turn if abs(to_turn - turn) <= spin * period else turn + step)
