"""Effects: named pieces of physics with parameters, and the changes that they make to a machine."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from types import MappingProxyType
from typing import Any, NamedTuple

import numpy as np

from omnimj.errors import InputError
from omnimj.parameters import Axis, Floor, Rig, Robot
from omnimj.physics.effect_terms import CURVES, TERM, mark_active, write_curve, zero_terms
from omnimj.physics.motor import MotorParameters
from omnimj.signals import Array

RIG, ROBOT, AXIS = Rig.plant, Robot.plant, Axis.plant
"""The plants, by the names of their folders under `models/`."""

Values = Mapping[str, Any]
"""Parameters (floats) and selectors (text or whole numbers) of one effect by name."""

Hook = Callable[[Any, Values], None]
"""Function that writes an effect into `MachineChanges`, given every parameter and selector."""


@dataclass(frozen=True)
class EffectParameter:
    """One parameter of an effect."""

    name: str
    unit: str
    low: float
    high: float
    """Physical bounds, generous."""
    typical: float
    """A size worth noticing."""
    null_value: float | None = 0.0
    """Value at which the effect is gone; None: a shape (place, width, speed), which takes nothing away."""


@dataclass(frozen=True)
class Selector:
    """A choice that an effect needs besides its parameters, such as a channel or a wheel."""

    name: str
    choices: tuple[str | int, ...]


@dataclass(frozen=True)
class Effect:
    """A physical change of a machine that may explain a gap between model and measurement."""

    name: str
    words: str
    """Description in plain words."""
    where: str
    """`rail`, `wheel`, `motor`, `floor`, `body` or `sensors`."""
    plants: tuple[str, ...]
    """Machines that it can act on."""
    parameters: tuple[EffectParameter, ...]
    selectors: tuple[Selector, ...] = ()
    hooks: tuple[Hook, ...] = ()
    """Functions that write it into a machine."""

    @property
    def amplitudes(self) -> tuple[EffectParameter, ...]:
        """Parameters that switch the effect off at their null values."""
        return tuple(p for p in self.parameters if p.null_value is not None)

    def null_values(self) -> dict[str, float]:
        """Values of all parameters without the effect; shapes at their typical values."""
        return {p.name: p.typical if p.null_value is None else p.null_value for p in self.parameters}

    def typical(self) -> dict[str, float]:
        """Typical values of all parameters."""
        return {p.name: p.typical for p in self.parameters}


class ChannelEffect(NamedTuple):
    """A sensor effect on one channel: scale · reading + offset, late by delay."""

    scale: float = 1.0
    offset: float = 0.0
    delay: float = 0.0
    """[s]"""


@dataclass(frozen=True)
class AppliedEffects:
    """A machine with its effects, ready for plants and for replay; n wheels, the rig and an axis have one."""

    machine: Any
    """The same machine with changed constants (its own effects still named in it)."""
    terms: Array
    """Packed `physics.effect_terms.EffectTerms` per wheel, shape (n, TERMS)."""
    torque_scale: Array
    """True over nominal torque constant, shape (n,)."""
    radius_scale: Array
    """True over nominal rolling radius, shape (n,)."""
    misalignment: Array
    """Angle of each axle about the vertical, counter-clockwise, shape (n,) [rad]."""
    payload: tuple[float, float, float]
    """Mass [kg] and its place x, y in the body frame [m]; on rig and axis the mass alone matters."""
    slope: tuple[float, float]
    """Inclination of floor or rail and the world direction that points downhill [rad]."""
    floor_scale: Mapping[str, float]
    """Factors on a floor's numbers, by letter; empty: none."""
    channels: Mapping[str, ChannelEffect]
    """Channels whose readings change."""

    @property
    def added_mass(self) -> float:
        """Mass on the machine beyond its constants [kg]."""
        return self.payload[0]

    def floor(self, floor: Floor) -> Floor:
        """The floor with its numbers scaled (μ_s with μ_c; D of the Magic Formula with μ_c)."""
        if not self.floor_scale:
            return floor
        numbers = {key: value * self.floor_scale.get(key, 1.0) for key, value in floor.numbers.items()}
        return dataclasses.replace(floor, numbers=MappingProxyType(numbers))

    def floors(self, floors: Mapping[str, Floor]) -> Mapping[str, Floor]:
        """All floors with their numbers scaled."""
        if not self.floor_scale:
            return floors
        return {name: self.floor(floor) for name, floor in floors.items()}

    def motors(self, motors: Sequence[MotorParameters]) -> tuple[MotorParameters, ...]:
        """The motors of the n wheels with their torque constants scaled."""
        scales = self.torque_scale.tolist()
        return tuple(
            motor._replace(torque_constant=motor.torque_constant * scale)
            for motor, scale in zip(motors, scales, strict=True)
        )


class MachineChanges:
    """Collector of the changes that the effects of one machine make."""

    def __init__(self, machine: Robot | Rig | Axis):
        n = machine.wheel_count
        self.machine: Any = machine
        self.terms: Array = zero_terms(n)
        self.torque_scale, self.radius_scale, self.misalignment = np.ones(n), np.ones(n), np.zeros(n)
        self.payload, self.slope = (0.0, 0.0, 0.0), (0.0, 0.0)
        self.floor_scale: dict[str, float] = {}
        self.channels: dict[str, ChannelEffect] = {}
        self._added: dict[str, dict[str, float]] = {}
        self._curves = 0

    def wheel_rows(self, values: Values) -> slice:
        """Rows that an effect acts on: that of the chosen wheel, or all.

        Raises:
          InputError: The machine has no such wheel.
        """
        if "wheel" not in values:
            return slice(None)
        wheel, count = int(values["wheel"]), len(self.terms)
        if wheel > count:
            raise InputError("wheel", f"found {wheel}", f"the machine has wheels 1 to {count}")
        return slice(wheel - 1, wheel)

    def add_to_constant(self, table: str, key: str, value: float) -> None:
        """Add to a constant of the machine that cannot fall below zero (`wheel`, `roller_dry`)."""
        entries = self._added.setdefault(table, {})
        before = entries[key] if key in entries else float(getattr(getattr(self.machine, table), key))
        entries[key] = max(before + value, 0.0)

    def add_to_term(self, name: str, value: float) -> None:
        """Add to an effect term of all wheels."""
        self.terms[:, TERM[name]] += value

    def set_term(self, name: str, value: float, **shape: float) -> None:
        """Set an effect term that can act once only, together with the terms of its shape.

        Raises:
          InputError: A second instance of the effect.
        """
        if value == 0.0:
            return
        if self.terms[:, TERM[name]].any():
            raise InputError("effects", "found this effect twice", "it can act once on a machine")
        self.terms[:, TERM[name]] = value
        for key, number in shape.items():
            self.terms[:, TERM[key]] = number

    def add_curve(self, over: str, values: Sequence[float], low: float, high: float) -> None:
        """Add a tabulated force, as `effect_terms.write_curve`.

        Raises:
          InputError: More of them than fit beside each other.
        """
        if not any(values):
            return
        if self._curves == CURVES:
            raise InputError("effects", "found too many tabulated forces", f"{CURVES} are possible")
        write_curve(self.terms, self._curves, over, values, low, high)
        self._curves += 1

    def change_channel(
        self, channel: str, scale: float = 1.0, offset: float = 0.0, delay: float = 0.0
    ) -> None:
        """Change the readings of a channel: scale · before + offset, later by delay [s]."""
        if (scale, offset, delay) == (1.0, 0.0, 0.0):
            return
        before = self.channels.get(channel, ChannelEffect())
        self.channels[channel] = ChannelEffect(
            scale * before.scale, scale * before.offset + offset, before.delay + delay
        )

    def finish(self) -> AppliedEffects:
        """All changes together."""
        mark_active(self.terms)
        tables = {
            name: dataclasses.replace(getattr(self.machine, name), **entries)
            for name, entries in self._added.items()
        }
        return AppliedEffects(
            dataclasses.replace(self.machine, **tables) if tables else self.machine,
            self.terms,
            self.torque_scale,
            self.radius_scale,
            self.misalignment,
            self.payload,
            self.slope,
            {key: scale for key, scale in self.floor_scale.items() if scale != 1.0},
            self.channels,
        )
