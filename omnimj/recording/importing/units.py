"""Units that loggers write, and how they become SI units."""

from __future__ import annotations

import math
import re
from dataclasses import dataclass

_TURN = 2.0 * math.pi
_G = 9.80665

_FACTORS: dict[str, dict[str, float]] = {
    "s": {"s": 1.0, "sec": 1.0, "ms": 1e-3, "us": 1e-6, "ns": 1e-9, "min": 60.0, "h": 3600.0},
    "A": {"a": 1.0, "ma": 1e-3},
    "V": {"v": 1.0, "mv": 1e-3},
    "m": {"m": 1.0, "cm": 1e-2, "mm": 1e-3, "um": 1e-6, "in": 0.0254},
    "rad": {"rad": 1.0, "mrad": 1e-3, "deg": _TURN / 360.0, "°": _TURN / 360.0, "rev": _TURN, "turn": _TURN},
    "m/s": {"m/s": 1.0, "cm/s": 1e-2, "mm/s": 1e-3, "km/h": 1.0 / 3.6},
    "rad/s": {
        "rad/s": 1.0,
        "mrad/s": 1e-3,
        "deg/s": _TURN / 360.0,
        "°/s": _TURN / 360.0,
        "dps": _TURN / 360.0,
        "rpm": _TURN / 60.0,
        "1/min": _TURN / 60.0,
        "rps": _TURN,
        "rev/s": _TURN,
    },
    "m/s2": {"m/s2": 1.0, "cm/s2": 1e-2, "mm/s2": 1e-3, "g": _G, "mg": _G * 1e-3},
    "N": {"n": 1.0, "kn": 1e3, "mn": 1e-3},
    "Nm": {"nm": 1.0, "mnm": 1e-3},
    "kg": {"kg": 1.0},
    "1": {"1": 1.0, "%": 1e-2},
}
RAW_UNITS = ("ticks", "tick", "counts", "count", "cnt", "inc", "lsb", "pix", "pixel", "pixels", "px", "raw")
"""Units of raw readings, which only a scale of the user makes SI."""
_SPELLINGS = {"µ": "u", "μ": "u", "²": "2", "^2": "2", "**2": "2", "·": "", "*": "", "degree": "deg"}


@dataclass(frozen=True)
class Unit:
    """Unit of a column: value in `si` = factor × logged value."""

    name: str
    """As written by the logger or the user."""
    si: str
    """SI unit, such as `rad/s`; empty for raw readings."""
    factor: float = 1.0


def find_unit(text: str) -> Unit | None:
    """Find a unit by the way it is written; None if it is not one."""
    written = text.strip()
    plain = written.lower().replace(" ", "")
    for old, new in _SPELLINGS.items():
        plain = plain.replace(old, new)
    if plain == "degs":
        plain = "deg"
    if plain in RAW_UNITS:
        return Unit(written, "")
    for si, known in _FACTORS.items():
        # capitals tell milli- from mega-, but no logger writes megaamperes
        if plain in known:
            return Unit(written, si, known[plain])
    return None


def known_units() -> list[str]:
    """Units that are converted, for messages."""
    return sorted({*(name for known in _FACTORS.values() for name in known), "ticks", "pix"})


_BRACKETS = re.compile(r"^(.*?)\s*[\[(]\s*([^\[\]()]*?)\s*[\])]\s*$")
_SLASHED = re.compile(r"^(.*\S)\s+(?:/|in)\s+(\S+)$")
_SUFFIXED = re.compile(r"^(.*[^_])_(ms|us|ns|sec|deg|rad|ma|mm|rpm|dps|ticks|px)$", re.IGNORECASE)


def split_unit(name: str) -> tuple[str, str]:
    """Split a column name into its name and the unit in it; an empty text where there is none.

    A unit stands in brackets, after ` / ` or ` in `, or, where it is unmistakable, after an underscore:
    `v_car [mm/s]`, `t / ms`, `speed (rpm)`, `time_ms`.
    """
    found = _BRACKETS.match(name)
    if found and found[1].strip():
        return found[1].strip(), found[2].strip()
    for pattern in (_SLASHED, _SUFFIXED):
        found = pattern.match(name.strip())
        if found and find_unit(found[2]) is not None:
            return found[1].strip(), found[2]
    return name.strip(), ""


TARGET_UNITS = (
    (r"time", "s"),
    (r"current(_target)?(_\d+)?", "A"),
    (r"wheel_speed(_\d+)?|yaw_rate", "rad/s"),
    (r"wheel_angle(_\d+)?|yaw|heading", "rad"),
    (r"acceleration_[xy]|carriage_acceleration", "m/s2"),
    (r"(carriage|lateral)_speed|velocity", "m/s"),
    (r"x|y|position|carriage_position", "m"),
    (r"force", "N"),
)
"""SI units of the columns of omnimj, by the pattern of their names."""


def target_unit(name: str) -> str:
    """SI unit of a column of omnimj; empty where it depends on the machine, as for `position:JOINT`."""
    return next((unit for pattern, unit in TARGET_UNITS if re.fullmatch(pattern, name)), "")
