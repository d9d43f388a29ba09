"""Wiring of a robot: the tables `[hardware]` of a model file, which assign quantities to raw readings.

Input: SI = sign · gain · (raw − offset), raw in volts or counts. Output: command to the amplifier =
sign · gain · current, in A/A over a wire, in V/A at an analog box.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from omnimj.errors import InputError
from omnimj.parameters.reading import (
    Provenance,
    Rule,
    check_choice,
    check_number,
    positive,
    read_provenance,
    read_table,
    require_keys,
)
from omnimj.signals import robot_channels

RAW_UNITS = {"volts": "V", "counts": "count"}
"""Kinds of raw readings and their units."""
UNITS = {
    "current": "A",
    "wheel_speed": "rad/s",
    "wheel_angle": "rad",
    "acceleration_x": "m/s2",
    "acceleration_y": "m/s2",
    "yaw_rate": "rad/s",
    "yaw": "rad",
}
"""Quantities that inputs measure, and their units."""
OUTPUT_UNITS = ("A/A", "V/A")
MAX_CHANNELS = 16
"""Largest number of channels in one telemetry message."""

_FINITE = Rule(-math.inf, math.inf, False)
_ABOVE_ZERO = Rule(0.0, math.inf, True)
_NOT_NEGATIVE = Rule(0.0, math.inf, False)
_CHANNEL = Rule(0.0, MAX_CHANNELS - 1, False)
_COUNTER = 2.0**32  # a count is transmitted in 32 bits


@dataclass(frozen=True)
class HardwareLimits:
    """Limits with which the device is configured; see `omnimj.link.codec.messages.Limits`."""

    current: float = positive("A")
    """Largest current of a wheel."""
    current_rate: float = positive("A/s")
    """Largest rate of change of a current; above the controller's, since commands arrive with jitter."""
    continuous_current: float = positive("A")
    """Current that a motor may carry indefinitely."""
    heating: float = positive("A2.s")
    """Largest I²t above the continuous current."""
    wheel_speed: float = positive("rad/s")
    """Wheel speed, after the gear, above which the current is cut."""
    message_rate: float = positive("1/s")
    """Largest rate of frames that are answered."""
    valid_for: float = positive("s", 0.2)
    """Longest lifetime of a command."""


@dataclass(frozen=True)
class HardwareInput:
    """One measured channel."""

    name: str
    """Channel of the robot, such as `current_1`."""
    quantity: str
    """Measured quantity: that of the name, or `wheel_angle` if the host differentiates it to a speed."""
    wheel: int
    """Wheel 1…n; 0: no wheel is concerned."""
    raw: str
    """`volts` or `counts`."""
    channel: int
    """Index on the device or analog box, from 0."""
    sign: int
    gain: float
    """Gain, positive [unit of the quantity per V or count]."""
    offset: float
    """Raw reading at zero of the quantity [V or count]."""
    filter: float
    """Time constant of the host's first-order filter; 0: none [s]."""
    wrap: float
    """Range after which the raw reading of a wheel angle wraps; 0: never [V or count]."""


@dataclass(frozen=True)
class HardwareOutput:
    """Amplifier of one wheel."""

    wheel: int
    """Wheel 1…n."""
    channel: int
    """Index among the currents of the device or the outputs of the analog box, from 0."""
    sign: int
    gain: float
    """Gain, positive, in `unit`."""
    unit: str
    """`A/A` or `V/A`."""


@dataclass(frozen=True)
class Hardware:
    """Wiring of a robot with n wheels."""

    limits: HardwareLimits
    inputs: tuple[HardwareInput, ...]
    """Inputs in the order of the robot's channels, length 2 n + 4."""
    outputs: tuple[HardwareOutput, ...]
    """Outputs in the order of the wheels, length n."""
    provenance: Mapping[str, Provenance]
    """`hardware.inputs.current_1.gain` → unit and source."""
    device: int = 0
    """Identity of the robot's device, 64 bits; 0: any device is accepted."""


def read_hardware(tree: Mapping[str, Any], path: Path, wheels: int) -> Hardware | None:
    """Read the tables `[hardware]` of a parsed model file; None if it has none.

    Args:
      tree: Whole parsed file.
      path: Path of the file, for messages.
      wheels: Number of wheels n.

    Raises:
      InputError: A table or key is missing or breaks its rule.
      UnknownNameError: A key, name, quantity or unit that is not known.
    """
    if "hardware" not in tree:
        return None
    own, place = tree["hardware"], f"{path}: hardware"
    if not isinstance(own, Mapping):
        raise InputError(place, f"found {own!r}", "write tables [hardware.limits], [[hardware.inputs]], …")
    _require_keys(place, own, ("limits", "inputs", "outputs"), ("device",))
    provenance: dict[str, Provenance] = {}
    limits = read_table(HardwareLimits, own["limits"], lambda _: path, provenance, "hardware.limits")
    inputs = [
        _input(f"{place}.inputs", entry, wheels, provenance) for entry in _entries(place, own, "inputs")
    ]
    outputs = [
        _output(f"{place}.outputs", entry, wheels, provenance) for entry in _entries(place, own, "outputs")
    ]
    names = robot_channels(wheels)
    _require_each_once(f"{place}.inputs", "name", [i.name for i in inputs], names)
    _require_each_once(f"{place}.inputs", "channel", [i.channel for i in inputs])
    _require_each_once(f"{place}.outputs", "wheel", [o.wheel for o in outputs], range(1, wheels + 1))
    on_wire = [o for o in outputs if o.unit == "A/A"]
    if on_wire and len(on_wire) != wheels:
        raise InputError(f"{place}.outputs", "gains in A/A and in V/A", "all must have the same unit")
    channels = [o.channel for o in outputs]
    _require_each_once(f"{place}.outputs", "channel", channels, range(wheels) if on_wire else None)
    ordered = tuple(sorted(inputs, key=lambda i: names.index(i.name)))
    outputs.sort(key=lambda o: o.wheel)
    return Hardware(limits, ordered, tuple(outputs), provenance, _identity(place, own))


def _identity(place: str, own: Mapping[str, Any]) -> int:
    """Identity of the device, written as 16 hexadecimal digits; 0 if there is none."""
    found = own.get("device", "0" * 16)
    if not isinstance(found, str) or len(found) != 16 or found.strip("0123456789abcdef"):
        raise InputError(f"{place}.device", f"found {found!r}", "must be 16 hexadecimal digits, in quotes")
    return int(found, 16)


def _entries(place: str, own: Mapping[str, Any], name: str) -> list[Mapping[str, Any]]:
    entries = own[name]
    if not isinstance(entries, list) or not all(isinstance(entry, Mapping) for entry in entries):
        raise InputError(f"{place}.{name}", f"found {entries!r}", f"write tables [[hardware.{name}]]")
    return entries


def _require_keys(
    place: str, entry: Mapping[str, Any], needed: tuple[str, ...], optional: tuple[str, ...]
) -> None:
    require_keys(place, entry, (*needed, *optional))
    for key in needed:
        if key not in entry:
            raise InputError(place, f"'{key}' is missing")


def _require_each_once(place: str, kind: str, found: list[Any], needed: Any = None) -> None:
    for value in found:
        if found.count(value) > 1:
            raise InputError(place, f"{kind} {value!r} occurs twice", f"each {kind} may occur only once")
    for value in needed if needed is not None else ():
        if value not in found:
            raise InputError(place, f"{kind} {value!r} is missing")
    if isinstance(needed, range) and any(value not in needed for value in found):
        raise InputError(place, f"found {kind} {max(found)}", f"must be {needed[0]} to {needed[-1]}")


def _sign(place: str, entry: Mapping[str, Any]) -> int:
    value = entry.get("sign", 1)
    if isinstance(value, bool) or value not in (1, -1):
        raise InputError(f"{place}.sign", f"found {value!r}", "must be 1 or -1")
    return int(value)


def _input(
    place: str, entry: Mapping[str, Any], wheels: int, provenance: dict[str, Provenance]
) -> HardwareInput:
    optional = ("quantity", "sign", "offset", "filter", "wrap")
    _require_keys(place, entry, ("name", "raw", "channel", "gain"), optional)
    name = check_choice(f"{place}.name", entry["name"], robot_channels(wheels), "name")
    place = f"{place}.{name}"
    stem, _, last = name.rpartition("_")
    of_name, wheel = (stem, int(last)) if last.isdigit() else (name, 0)
    allowed = ("wheel_speed", "wheel_angle") if of_name == "wheel_speed" else (of_name,)
    quantity = check_choice(f"{place}.quantity", entry.get("quantity", of_name), allowed, "quantity")
    raw = check_choice(f"{place}.raw", entry["raw"], RAW_UNITS, "raw")
    unit = RAW_UNITS[raw]
    if "wrap" in entry and quantity != "wheel_angle":
        raise InputError(f"{place}.wrap", f"found with {quantity}", "it belongs to wheel_angle")

    def value(key: str, unit: str, rule: Rule, default: float) -> float:
        if key not in entry:
            return default
        provenance[f"hardware.inputs.{name}.{key}"] = read_provenance(f"{place}.{key}", entry[key], unit)
        return float(check_number(f"{place}.{key}", entry[key]["value"], rule))

    return HardwareInput(
        name,
        quantity,
        wheel,
        raw,
        channel=int(check_number(f"{place}.channel", entry["channel"], _CHANNEL, whole=True)),
        sign=_sign(place, entry),
        gain=value("gain", f"{UNITS[quantity]}/{unit}", _ABOVE_ZERO, 0.0),
        offset=value("offset", unit, _FINITE, 0.0),
        filter=value("filter", "s", _NOT_NEGATIVE, 0.0),
        wrap=value("wrap", unit, _ABOVE_ZERO, _COUNTER if raw == "counts" else 0.0),
    )


def _output(
    place: str, entry: Mapping[str, Any], wheels: int, provenance: dict[str, Provenance]
) -> HardwareOutput:
    _require_keys(place, entry, ("wheel", "channel", "gain"), ("sign",))
    wheel = int(check_number(f"{place}.wheel", entry["wheel"], Rule(1.0, wheels, False), whole=True))
    place = f"{place}.{wheel}"
    gain = entry["gain"]
    provenance[f"hardware.outputs.{wheel}.gain"] = origin = read_provenance(f"{place}.gain", gain, None)
    check_choice(f"{place}.gain.unit", origin.unit, OUTPUT_UNITS, "unit")
    return HardwareOutput(
        wheel,
        channel=int(check_number(f"{place}.channel", entry["channel"], _CHANNEL, whole=True)),
        sign=_sign(place, entry),
        gain=float(check_number(f"{place}.gain", gain["value"], _ABOVE_ZERO)),
        unit=origin.unit,
    )
