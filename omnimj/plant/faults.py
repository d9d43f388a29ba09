"""Faults as people write them (one `[[faults]]` table of a scenario) and as metrics record them.

What a fault does to a plant is in `conditions`; what a sensor fault does to a reading is in `sensors`.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import dataclass, field
from types import MappingProxyType
from typing import Any

from omnimj.errors import InputError, UnknownNameError
from omnimj.parameters.reading import Rule, number
from omnimj.plant.channels import plant_channels
from omnimj.plant.conditions import Conditions, Fault, conditions, event_times

__all__ = ["KINDS", "Conditions", "Fault", "as_record", "conditions", "event_times", "read_fault"]

_INF = float("inf")
_ANY = Rule(-1e6, 1e6, False)  # beyond any channel, within what squares and sums can hold
_GRIP = Rule(0.0, 1.0, False)
_ANGLE = Rule(-0.5, 0.5, False)
_OFFSET = Rule(-1.0, 1.0, False)
# what `size` is: an offset, -, an offset per second, an added rms, a factor (1: healthy)
_MODES: Mapping[str, Rule | None] = MappingProxyType(
    {"bias": _ANY, "freeze": None, "drift": _ANY, "noise": Rule(0.0, _INF, False), "scale": _ANY}
)


@dataclass(frozen=True)
class Kind:
    """Which keys one kind of fault takes."""

    on_wheel: bool
    """Whether it sits on one wheel."""
    numbers: Mapping[str, Rule] = field(default_factory=dict)
    """Its numbers and their bounds."""
    names: tuple[str, ...] = ()
    """Its keys that hold a name instead."""
    one_of: tuple[str, ...] = ()
    """Keys of which a table has exactly one."""
    defaults: Mapping[str, float] = field(default_factory=dict)
    """Values of numbers that may be left out."""
    optional: tuple[str, ...] = ()
    """Keys that may be left out and then have no value."""

    @property
    def own_keys(self) -> tuple[str, ...]:
        """Every key of its own, beside kind, wheel, onset and end."""
        return (*self.names, *self.numbers)


KINDS: Mapping[str, Kind] = MappingProxyType(
    {
        "motor": Kind(
            on_wheel=True,
            numbers={"loss": Rule(0.0, 1.0, True), "braking_torque": Rule(0.0, 10.0, True)},
            one_of=("loss", "braking_torque"),
        ),
        "free": Kind(on_wheel=True),
        "locked": Kind(on_wheel=True),
        "hard_over": Kind(on_wheel=True, numbers={"current": _ANY}, optional=("current",)),
        "slip": Kind(on_wheel=True, numbers={"grip": _GRIP}, names=("floor",), one_of=("grip", "floor")),
        "all_wheel_slip": Kind(
            on_wheel=False, numbers={"grip": _GRIP}, names=("floor",), one_of=("grip", "floor")
        ),
        "misalignment": Kind(on_wheel=True, numbers={"angle": _ANGLE}),
        "wheel_radius": Kind(on_wheel=True, numbers={"scale": Rule(0.5, 2.0, False)}),
        "payload": Kind(
            on_wheel=False,
            numbers={"mass": Rule(-10.0, 100.0, True), "x": _OFFSET, "y": _OFFSET},
            defaults={"x": 0.0, "y": 0.0},
        ),
        "slope": Kind(
            on_wheel=False, numbers={"angle": _ANGLE, "direction": _ANY}, defaults={"direction": 0.0}
        ),
        "sensor": Kind(on_wheel=False, numbers={"size": _ANY}, names=("channel", "mode"), optional=("size",)),
    }
)
"""Every kind of fault and the keys it takes."""


def as_record(fault: Fault) -> dict[str, Any]:
    """The fault as `metrics.json` holds it: kind, wheel, onset, end and the kind's own keys."""
    return {
        "kind": fault.kind,
        "wheel": fault.wheel,
        "onset": fault.onset,
        "end": fault.end,
        **fault.numbers,
    }


def read_fault(table: Any, place: str, wheels: int, floors: Collection[str], duration: float) -> Fault:
    """One `[[faults]]` table of a scenario as a fault.

    Args:
      table: `{kind, wheel, onset, end, …}`; `end` may be left out, `wheel` belongs to faults of one wheel.
      place: Where the table stands, for messages: file and key.
      wheels: Number of wheels n of the plant; 1 is the test rig, which has channels of its own.
      floors: Names of the known floors.
      duration: Length of the run [s]; a fault has to begin before it is over.

    Raises:
      UnknownNameError: Unknown kind, key, floor, channel or mode; the message lists the choices.
      InputError: A value is missing, is of the wrong type or breaks its rule.
    """
    if not isinstance(table, Mapping):
        raise InputError(place, f"found {table!r}", "a table is needed", ("kind", "wheel", "onset", "end"))
    name = _name(place, "kind", table, KINDS)
    kind = KINDS[name]
    known = ("kind", *(("wheel",) if kind.on_wheel else ()), "onset", "end", *kind.own_keys)
    for key in table:
        if key not in known:
            raise UnknownNameError(place, f"key of a '{name}' fault", key, known)
    onset = _number(place, "onset", table, Rule(0.0, duration, False))
    end = _number(place, "end", table, Rule(onset, _INF, True)) if "end" in table else None
    wheel = int(_number(place, "wheel", table, Rule(1, wheels, False), whole=True)) if kind.on_wheel else None
    if name == "sensor":
        return Fault(name, onset, end, wheel, _read_sensor(table, place, plant_channels(wheels)))
    return Fault(name, onset, end, wheel, _read_own(table, place, kind, floors))


def _read_own(table: Mapping, place: str, kind: Kind, floors: Collection[str]) -> dict[str, float | str]:
    """The kind's own keys, checked."""
    given = [key for key in kind.one_of if key in table]
    if kind.one_of and len(given) != 1:
        found = f"found {' and '.join(given) or 'none of them'}"
        raise InputError(place, found, "exactly one is needed", kind.one_of)
    values: dict[str, float | str] = {}
    for key in kind.own_keys:
        if key not in table and (key in kind.one_of or key in kind.optional):
            continue
        if key in kind.names:
            values[key] = _name(place, key, table, floors)
        elif key in table or key not in kind.defaults:
            values[key] = _number(place, key, table, kind.numbers[key])
        else:
            values[key] = kind.defaults[key]
    return values


def _read_sensor(table: Mapping, place: str, channels: Collection[str]) -> dict[str, float | str]:
    """Channel, mode and, for all but freeze, the size: its rule depends on the mode."""
    channel = _name(place, "channel", table, channels)
    mode = _name(place, "mode", table, _MODES)
    rule = _MODES[mode]
    if rule is None:
        if "size" in table:
            raise InputError(f"{place}.size", f"found {table['size']!r}", f"'{mode}' takes no size")
        return {"channel": channel, "mode": mode}
    return {"channel": channel, "mode": mode, "size": _number(place, "size", table, rule)}


def _name(place: str, key: str, table: Mapping, choices: Collection[str]) -> str:
    if key not in table:
        raise InputError(place, f"'{key}' is missing", choices=choices)
    value = table[key]
    if not isinstance(value, str) or value not in choices:
        raise UnknownNameError(f"{place}.{key}", key, value, choices)
    return value


def _number(place: str, key: str, table: Mapping, rule: Rule, whole: bool = False) -> float:
    if key not in table:
        raise InputError(place, f"'{key}' is missing", f"a number is needed that {rule}")
    return number(f"{place}.{key}", table[key], rule, whole)
