"""Steering by hand: held keys and stick positions become the target of each control step.

Nothing here has a clock or reads a device: the caller passes the time. A demand lasts only a short time after
its last event, since a terminal signals a held key only by repeating it; a robot therefore stops soon after
its operator, terminal or network is gone.
"""

from __future__ import annotations

import enum
import math
from dataclasses import dataclass

import numpy as np

from omnimj.control.cascade.heading import wrapped
from omnimj.errors import InputError
from omnimj.signals import Target

KEY_HOLD_TIME = 0.3
"""Time for which a key counts as held after its last event [s]."""
LOCKOUT_AFTER_STOP = 0.5
"""Time after a stop during which directions are ignored [s]."""
BRAKING_DECELERATION = 1.0
"""Smallest deceleration with which a demand without events returns to zero [m/s²]."""
TURN_ARM = 0.25
"""Lever arm that converts an acceleration limit to one of the yaw rate: distance of the wheels [m]."""
MAX_HEADING_LEAD = 0.2
"""Largest difference between planned heading and heading of the robot [rad]."""
STICK_TIMEOUT = 2.0
"""Time without events after which a gamepad counts as out of range [s]."""
MAX_SPEED, MAX_YAW_RATE, MAX_ACCELERATION, MAX_HOLD_TIME = 1.0, 2.0, 1.0, 1.0
"""Largest admissible limits: m/s, rad/s, m/s², s."""


class Key(enum.Enum):
    """Meaning of a key."""

    FORWARD = "forward"
    BACK = "back"
    LEFT = "left"
    RIGHT = "right"
    TURN_LEFT = "turn left"
    TURN_RIGHT = "turn right"
    STOP = "stop"
    """Space bar, and every key without another meaning, so that a wrong key stops the robot."""
    END = "end"


DIRECTIONS = frozenset(
    (Key.FORWARD, Key.BACK, Key.LEFT, Key.RIGHT, Key.TURN_LEFT, Key.TURN_RIGHT)
)  # fmt: skip
"""Keys that demand motion."""
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
_ESCAPE_TIMEOUT = 0.05  # [s] for the rest of an arrow key, which arrives in one piece or nearly so
_LONGEST_SEQUENCE = 8  # bytes of one key

# axis (0: x ahead, 1: y left, 2: yaw, counter-clockwise) and sign
_KEY_AXES = {
    Key.FORWARD: (0, 1.0),
    Key.BACK: (0, -1.0),
    Key.LEFT: (1, 1.0),
    Key.RIGHT: (1, -1.0),
    Key.TURN_LEFT: (2, 1.0),
    Key.TURN_RIGHT: (2, -1.0),
}


class KeyReader:
    """Decoder of a terminal's bytes into keys; arrow keys are three bytes and may arrive in pieces.

    It buffers at most one unfinished key, and only for a short time.
    """

    def __init__(self) -> None:
        self._begun = b""
        self._since = 0.0

    def feed(self, now: float, content: bytes) -> list[Key]:
        """Keys completed by these bytes.

        Args:
          now: Time on a monotonic clock [s].
          content: Bytes of the terminal; may be empty, to let time pass.
        """
        found = []
        if self._begun and not content and now - self._since > _ESCAPE_TIMEOUT:
            found.append(Key.STOP)  # the escape key alone, or an incomplete sequence
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
    """First key and its length in bytes; length 0 when its end has not arrived yet."""
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


@dataclass(frozen=True, slots=True)
class SteeringLimits:
    """Limits of a drive by hand."""

    speed: float = 0.3
    """Largest speed [m/s]."""
    turn: float = 0.6
    """Largest yaw rate [rad/s]."""
    acceleration: float = 0.5
    """Largest acceleration [m/s²]; divided by `TURN_ARM`, that of the yaw rate [rad/s²]."""
    hold: float = KEY_HOLD_TIME
    """Time for which a key counts as held after its last event [s]."""

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
    """Positions of a gamepad's sticks, each −1…1."""

    forward: float = 0.0
    left: float = 0.0
    turn: float = 0.0
    """Yaw demand, counter-clockwise positive."""
    held: bool = False
    """True if the dead man's button is held."""


_NEUTRAL_STICK = StickState()


class Steering:
    """Conversion of events (`on_key`, `on_stick`, `stop`) into a `target`, made once per control step."""

    def __init__(self, limits: SteeringLimits):
        self._limits = limits
        self._events: list[tuple[float, float]] = [(-math.inf, 0.0)] * 3  # time and sign, by axis
        self._stick, self._stick_time = _NEUTRAL_STICK, -math.inf
        self._ignore_until = -math.inf
        self._needs_release = False  # release of the dead man's button, required after a stop
        self._twist = (0.0, 0.0, 0.0)
        self._planned = math.nan

    @property
    def twist(self) -> tuple[float, float, float]:
        """Current demand in the body frame: m/s ahead, m/s to the left, rad/s counter-clockwise."""
        return self._twist

    def on_key(self, now: float, key: Key) -> None:
        """Process a key event; the newest direction of an axis counts, so that back replaces forward.

        Args:
          now: Time on a monotonic clock [s].
          key: Meaning of the key; `END` also stops.
        """
        if key not in DIRECTIONS:
            self.stop(now)
        elif now >= self._ignore_until:
            axis, sign = _KEY_AXES[key]
            self._events[axis] = now, sign

    def on_stick(self, now: float, stick: StickState) -> None:
        """Process the state of a gamepad; held keys take precedence.

        After a stop the dead man's button must be released and pressed again.

        Args:
          now: Time on the same clock [s].
          stick: Positions of the sticks.
        """
        self._needs_release &= stick.held
        if not self._needs_release:
            self._stick, self._stick_time = stick, now

    def stop(self, now: float) -> None:
        """Set the demand to zero without a ramp, and ignore directions for `LOCKOUT_AFTER_STOP`."""
        self._events = [(-math.inf, 0.0)] * 3
        self._stick, self._stick_time = _NEUTRAL_STICK, -math.inf
        self._ignore_until, self._needs_release = now + LOCKOUT_AFTER_STOP, True
        self._twist = (0.0, 0.0, 0.0)

    def target(self, now: float, period: float, heading: float, time_scaling: float = 1.0) -> Target:
        """Target of one control step.

        At zero demand the planned heading is that of the robot, so that a robot turned by a person does not
        turn back.

        Args:
          now: Time on the same clock as the events [s].
          period: Time for which the target is held [s].
          heading: The controller's estimate of the robot's heading [rad].
          time_scaling: Share of the demanded speed that recovery allows, 0…1.
        """
        self._ramp(self._demand(now), period)
        forward, left, turn = (time_scaling * part for part in self._twist)
        if forward == left == turn == 0.0 or not math.isfinite(self._planned):
            self._planned = heading
        # bounded lead: a planned heading far ahead would spin the robot
        off = wrapped(self._planned + turn * period - heading)
        self._planned = heading + min(max(off, -MAX_HEADING_LEAD), MAX_HEADING_LEAD)
        c, s = math.cos(heading), math.sin(heading)
        return Target(np.array((c * forward - s * left, s * forward + c * left)), turn, self._planned)

    def _demand(self, now: float) -> tuple[float, float, float]:
        """Demanded twist at this instant, within the limits."""
        limits = self._limits
        x, y, turn = (sign if now - at <= limits.hold else 0.0 for at, sign in self._events)
        if x == y == turn == 0.0 and self._stick.held and now - self._stick_time <= STICK_TIMEOUT:
            x, y, turn = (
                min(max(part, -1.0), 1.0)
                for part in (self._stick.forward, self._stick.left, self._stick.turn)
            )
        scale = limits.speed / max(1.0, math.hypot(x, y))
        return x * scale, y * scale, turn * limits.turn

    def _ramp(self, demand: tuple[float, float, float], period: float) -> None:
        """Move the twist towards the demand at the acceleration limit, or faster when braking."""
        usual = self._limits.acceleration
        (x, y, turn), (to_x, to_y, to_turn) = self._twist, demand
        rise = usual if to_x or to_y else max(usual, BRAKING_DECELERATION)
        spin = (usual if to_turn else max(usual, BRAKING_DECELERATION)) / TURN_ARM
        change = math.hypot(to_x - x, to_y - y)
        share = min(1.0, rise * period / change) if change > 0.0 else 1.0
        step = min(max(to_turn - turn, -spin * period), spin * period)
        x, y = (to_x, to_y) if share == 1.0 else (x + share * (to_x - x), y + share * (to_y - y))
        self._twist = x, y, (to_turn if abs(to_turn - turn) <= spin * period else turn + step)
