"""Reading single keys of a `[drive]` table, each with its rule."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from omnimj.errors import InputError
from omnimj.parameters.reading import Rule, number

# wide bounds: a reference must stay finite whatever is asked
SPEED = Rule(0.0, 10.0, True)  # seven times what the motors reach
ACCELERATION = Rule(0.0, 100.0, True)
LENGTH = Rule(0.0, 1e4, True)
PLACE = Rule(-1e4, 1e4, False)
TIME = Rule(0.0, 1e5, False)
ANGLE = Rule(-1e4, 1e4, False)
COUNT = Rule(1, 1000, False)
SPEEDS: Mapping[str, float] = {"low": 0.5, "high": 1.0}
"""Speeds that have a name in the source's tests [m/s]."""
DEFAULT_ACCELERATION = 1.0
"""Two wheels with 16 N of peak traction move 15.8 kg at 2 m/s²; this leaves as much again [m/s²]."""


@dataclass(frozen=True)
class DriveTable:
    """A `[drive]` table and the place to name in messages."""

    content: Mapping[str, Any]
    place: str

    def __contains__(self, key: str) -> bool:
        return key in self.content

    def at(self, key: str) -> str:
        """Place of a key, for messages."""
        return f"{self.place}.{key}"

    def number(self, key: str, rule: Rule, default: float | None = None) -> float:
        """A number; required when there is no default."""
        if key not in self.content:
            if default is None:
                raise InputError(self.place, f"'{key}' is missing", f"a number is needed that {rule}")
            return default
        return float(number(self.at(key), self.content[key], rule))

    def whole(self, key: str, rule: Rule, default: int) -> int:
        """A whole number."""
        return int(number(self.at(key), self.content.get(key, default), rule, whole=True))

    def flag(self, key: str, default: bool) -> bool:
        """True or false."""
        value = self.content.get(key, default)
        if not isinstance(value, bool):
            raise InputError(self.at(key), f"found {value!r}", "must be true or false")
        return value

    def point(self, key: str, default: tuple[float, float] | None = None) -> tuple[float, float]:
        """Two numbers x, y [m]; required when there is no default."""
        if key not in self.content:
            if default is None:
                raise InputError(self.place, f"'{key}' is missing", "two numbers [x, y] are needed")
            return default
        return as_point(self.content[key], self.at(key))

    def speed(self) -> float:
        """The cruising speed: a positive number or one of the named speeds [m/s]."""
        value = self.content.get("speed")
        if isinstance(value, str):
            if value not in SPEEDS:
                rule = f"a number is needed that {SPEED}, or a named speed"
                raise InputError(self.at("speed"), f"found {value!r}", rule, SPEEDS)
            return SPEEDS[value]
        return self.number("speed", SPEED)

    def accelerations(self) -> tuple[float, float]:
        """Acceleration and deceleration, equal unless both are given [m/s²]."""
        up = self.number("acceleration", ACCELERATION, DEFAULT_ACCELERATION)
        return up, self.number("deceleration", ACCELERATION, up)

    def at_most_one(self, first: str, second: str) -> None:
        """Refuses two keys that say the same thing twice."""
        if first in self and second in self:
            raise InputError(self.place, f"has both '{first}' and '{second}'", "give one of them")


def as_point(value: Any, place: str) -> tuple[float, float]:
    """Two finite numbers.

    Raises:
      InputError: Anything else.
    """
    if not isinstance(value, list) or len(value) != 2:
        raise InputError(place, f"found {value!r}", "two numbers [x, y] are needed")
    return float(number(f"{place}[0]", value[0], PLACE)), float(number(f"{place}[1]", value[1], PLACE))
