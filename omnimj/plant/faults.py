"""Faults with onset and end: their tables in scenarios, their records in metrics, their action on a plant.

Simultaneous faults combine: losses, grips and radius scales multiply, braking torques and misalignment angles
add. Where only one can act (floor under a wheel, free or hard-over, payload, slope) the one with the latest
onset does; at equal onsets, the later one in the list.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Collection, Iterable, Mapping
from dataclasses import dataclass, field
from types import MappingProxyType
from typing import Any

import numpy as np

from omnimj.effects import AppliedEffects
from omnimj.errors import InputError, UnknownNameError
from omnimj.parameters.parts import Motor
from omnimj.parameters.reading import Rule, check_number
from omnimj.physics.motor import (
    FREE,
    HARD_OVER,
    MotorParameters,
    driven_by_measured_current,
    motor_parameters,
)
from omnimj.plant.interface import plant_channels
from omnimj.signals import Array

LOCKING_TORQUE = 100.0
"""Brake torque of a locked wheel [N.m], far above that of the motor (1 N.m) and the floor (7 N.m)."""

_TIME_TOLERANCE = 1e-9  # [s] by which a time accumulated over steps may fall short of the onset
_ANY = Rule(-1e6, 1e6, False)  # beyond the range of any channel, yet its square does not overflow
_GRIP = Rule(0.0, 1.0, False)
_ANGLE = Rule(-0.5, 0.5, False)
_OFFSET = Rule(-1.0, 1.0, False)
# meaning of `size`: offset, none, offset per second, added RMS noise, factor (1: healthy)
_MODES: Mapping[str, Rule | None] = MappingProxyType(
    {"bias": _ANY, "freeze": None, "drift": _ANY, "noise": Rule(0.0, math.inf, False), "scale": _ANY}
)


@dataclass(frozen=True)
class Fault:
    """Fault of a scenario, part of the truth of a simulated plant and hidden from controllers."""

    kind: str
    """`motor`, `free`, `locked`, `hard_over`, `slip`, `all_wheel_slip`, `misalignment`, `wheel_radius`,
    `payload`, `slope` or `sensor`."""
    onset: float
    """Time from which the fault acts [s]."""
    end: float | None = None
    """Time from which the fault no longer acts [s]; None: it is permanent."""
    wheel: int | None = None
    """Faulty wheel 1…n; None for faults of the whole plant or of a sensor."""
    numbers: Mapping[str, float | str] = field(default_factory=dict)
    """Values specific to the kind of fault: `loss`, `grip`, `angle`, …"""

    def holds_at(self, time: float) -> bool:
        """True if onset ≤ time < end, to within a nanosecond."""
        return time + _TIME_TOLERANCE >= self.onset and (
            self.end is None or time + _TIME_TOLERANCE < self.end
        )


@dataclass(frozen=True)
class Conditions:
    """Health and environment of a plant with n wheels at one instant."""

    motors: tuple[MotorParameters, ...]
    """Motor of each wheel, shape (n,)."""
    grip: Array
    """Factor 0…1 on the traction of each wheel, shape (n,)."""
    floors: tuple[str | None, ...]
    """Name of the floor that replaces the one under each wheel, shape (n,); None: no replacement."""
    misalignment: Array
    """Angle of each axle about the vertical, counter-clockwise, shape (n,) [rad]."""
    radius_scale: Array
    """True rolling radius over the nominal one, shape (n,)."""
    payload: tuple[float, float, float]
    """Payload mass [kg] and its position x, y in the body frame [m]."""
    slope: tuple[float, float]
    """Inclination of the floor and downhill direction in the world frame [rad]."""

    @property
    def motor_rows(self) -> Array:
        """Packed motor parameters, shape (n, MOTOR_SIZE)."""
        return np.array(self.motors)


def event_times(faults: Iterable[Fault]) -> tuple[float, ...]:
    """Sorted times at which conditions change [s]; sensor faults do not change conditions."""
    acting = [fault for fault in faults if fault.kind != "sensor"]
    onsets = {fault.onset for fault in acting}
    return tuple(sorted(onsets | {fault.end for fault in acting if fault.end is not None}))


def conditions_at(faults: Iterable[Fault], time: float, motor: Motor, wheels: int) -> Conditions:
    """Conditions of an otherwise healthy plant with faults at one instant.

    Args:
      faults: Faults in the order of the scenario; sensor faults are ignored here, since the sensors add them.
      time: Time [s].
      motor: Constants of the healthy motor.
      wheels: Number of wheels n.

    Returns:
      Conditions in new arrays; those of a healthy plant if no fault acts.
    """
    motors = [motor_parameters(motor)] * wheels
    grip, scale, angle = np.ones(wheels), np.ones(wheels), np.zeros(wheels)
    floors: list[str | None] = [None] * wheels
    payload, slope = (0.0, 0.0, 0.0), (0.0, 0.0)
    for fault in sorted((f for f in faults if f.holds_at(time)), key=lambda f: f.onset):
        numbers = fault.numbers
        at = slice(None) if fault.wheel is None else slice(fault.wheel - 1, fault.wheel)
        if fault.kind in ("motor", "free", "locked", "hard_over"):
            motors[at] = [_degraded(motor, fault) for motor in motors[at]]
        elif fault.kind in ("slip", "all_wheel_slip"):
            grip[at] *= float(numbers.get("grip", 1.0))
            if "floor" in numbers:
                floors[at] = [str(numbers["floor"])] * len(floors[at])
        elif fault.kind == "misalignment":
            angle[at] += float(numbers["angle"])
        elif fault.kind == "wheel_radius":
            scale[at] *= float(numbers["scale"])
        elif fault.kind == "payload":
            payload = (float(numbers["mass"]), float(numbers.get("x", 0.0)), float(numbers.get("y", 0.0)))
        elif fault.kind == "slope":
            slope = (float(numbers["angle"]), float(numbers.get("direction", 0.0)))
    return Conditions(tuple(motors), grip, tuple(floors), angle, scale, payload, slope)


def _degraded(motor: MotorParameters, fault: Fault) -> MotorParameters:
    """Add a fault to a motor that may already have others."""
    numbers = fault.numbers
    if "loss" in numbers:
        motor = motor._replace(torque_scale=motor.torque_scale * (1.0 - float(numbers["loss"])))
    if "braking_torque" in numbers:
        # the second motor's shaft also has to overcome its own friction, once
        before = max(motor.parallel_torque, motor.no_load_torque)
        motor = motor._replace(parallel_torque=before + float(numbers["braking_torque"]))
    if fault.kind == "locked":
        return motor._replace(brake=LOCKING_TORQUE)
    if fault.kind == "free":
        return motor._replace(override=FREE)
    if fault.kind == "hard_over":
        # without a given current it runs forward at the limit of the amplifier
        current = float(numbers.get("current", motor.current_limit))
        return motor._replace(override=HARD_OVER, override_current=current)
    return motor


def conditions_with_effects(
    now: Conditions, effects: AppliedEffects, measured_current: bool = False
) -> Conditions:
    """Combine the conditions due to faults with the effects of the machine.

    Payloads combine to a point mass at their common centre; a slope by a fault replaces one by an effect.

    Args:
      now: Conditions due to the faults.
      effects: Effects of the machine.
      measured_current: Whether commands are measured currents, to which no limit applies again.
    """
    motors = effects.motors(now.motors)
    return dataclasses.replace(
        now,
        motors=tuple(map(driven_by_measured_current, motors)) if measured_current else motors,
        misalignment=now.misalignment + effects.misalignment,
        radius_scale=now.radius_scale * effects.radius_scale,
        payload=_combined_payload(now.payload, effects.payload),
        slope=now.slope if now.slope[0] else effects.slope,
    )


def _combined_payload(
    first: tuple[float, float, float], second: tuple[float, float, float]
) -> tuple[float, float, float]:
    mass = first[0] + second[0]
    if not (first[0] and second[0]) or mass == 0.0:
        return first if first[0] and mass else second if mass else (0.0, 0.0, 0.0)
    x, y = ((first[0] * first[k] + second[0] * second[k]) / mass for k in (1, 2))
    return mass, x, y


@dataclass(frozen=True)
class FaultKind:
    """Keys of one kind of fault in a `[[faults]]` table."""

    on_wheel: bool
    """True for a fault of a single wheel."""
    numbers: Mapping[str, Rule] = field(default_factory=dict)
    """Numeric keys and their bounds."""
    names: tuple[str, ...] = ()
    """Keys whose value is a name."""
    one_of: tuple[str, ...] = ()
    """Keys of which a table must have exactly one."""
    defaults: Mapping[str, float] = field(default_factory=dict)
    """Default values of optional numbers."""
    optional: tuple[str, ...] = ()
    """Optional keys without a default."""

    @property
    def own_keys(self) -> tuple[str, ...]:
        """All keys specific to this kind, besides kind, wheel, onset and end."""
        return (*self.names, *self.numbers)


FAULT_KINDS: Mapping[str, FaultKind] = MappingProxyType(
    {
        "motor": FaultKind(
            on_wheel=True,
            numbers={"loss": Rule(0.0, 1.0, True), "braking_torque": Rule(0.0, 10.0, True)},
            one_of=("loss", "braking_torque"),
        ),
        "free": FaultKind(on_wheel=True),
        "locked": FaultKind(on_wheel=True),
        "hard_over": FaultKind(on_wheel=True, numbers={"current": _ANY}, optional=("current",)),
        "slip": FaultKind(on_wheel=True, numbers={"grip": _GRIP}, names=("floor",), one_of=("grip", "floor")),
        "all_wheel_slip": FaultKind(
            on_wheel=False, numbers={"grip": _GRIP}, names=("floor",), one_of=("grip", "floor")
        ),
        "misalignment": FaultKind(on_wheel=True, numbers={"angle": _ANGLE}),
        "wheel_radius": FaultKind(on_wheel=True, numbers={"scale": Rule(0.5, 2.0, False)}),
        "payload": FaultKind(
            on_wheel=False,
            numbers={"mass": Rule(-10.0, 100.0, True), "x": _OFFSET, "y": _OFFSET},
            defaults={"x": 0.0, "y": 0.0},
        ),
        "slope": FaultKind(
            on_wheel=False, numbers={"angle": _ANGLE, "direction": _ANY}, defaults={"direction": 0.0}
        ),
        "sensor": FaultKind(
            on_wheel=False, numbers={"size": _ANY}, names=("channel", "mode"), optional=("size",)
        ),
    }
)
"""Kinds of fault and the keys of each."""


def fault_record(fault: Fault) -> dict[str, Any]:
    """Record of a fault in `metrics.json`: kind, wheel, onset, end and the keys specific to the kind."""
    return {
        "kind": fault.kind,
        "wheel": fault.wheel,
        "onset": fault.onset,
        "end": fault.end,
        **fault.numbers,
    }


def read_fault(table: Any, place: str, wheels: int, floors: Collection[str], duration: float) -> Fault:
    """Read a `[[faults]]` table of a scenario.

    Args:
      table: `{kind, wheel, onset, end, …}`; `end` is optional, `wheel` is for faults of a single wheel.
      place: File and key of the table, for messages.
      wheels: Number of wheels n of the plant; 1 means the test rig, whose channels differ.
      floors: Names of the known floors.
      duration: Duration of the run [s], within which the fault must begin.

    Raises:
      UnknownNameError: Unknown kind, key, floor, channel or mode; the message lists the choices.
      InputError: A value is missing, is of the wrong type or breaks its rule.
    """
    if not isinstance(table, Mapping):
        raise InputError(place, f"found {table!r}", "a table is needed", ("kind", "wheel", "onset", "end"))
    name = _name(place, "kind", table, FAULT_KINDS)
    kind = FAULT_KINDS[name]
    known = ("kind", *(("wheel",) if kind.on_wheel else ()), "onset", "end", *kind.own_keys)
    for key in table:
        if key not in known:
            raise UnknownNameError(place, f"key of a '{name}' fault", key, known)
    onset = _number(place, "onset", table, Rule(0.0, duration, False))
    end = _number(place, "end", table, Rule(onset, math.inf, True)) if "end" in table else None
    wheel = int(_number(place, "wheel", table, Rule(1, wheels, False), whole=True)) if kind.on_wheel else None
    if name == "sensor":
        return Fault(name, onset, end, wheel, _read_sensor(table, place, plant_channels(wheels)))
    return Fault(name, onset, end, wheel, _read_own(table, place, kind, floors))


def _read_own(table: Mapping, place: str, kind: FaultKind, floors: Collection[str]) -> dict[str, float | str]:
    """Read and check the keys specific to a kind of fault."""
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
    """Read channel, mode and, except for freeze, the size, whose bounds depend on the mode."""
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
    return check_number(f"{place}.{key}", table[key], rule, whole)
