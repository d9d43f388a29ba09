"""Effects: named pieces of physics with parameters, and the changes that they make to a machine."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from types import MappingProxyType
from typing import Any, NamedTuple

import numpy as np

from omnimj.errors import InputError
from omnimj.parameters import Floor, Rig, Robot
from omnimj.parameters.floor import LAWS, number_rules
from omnimj.parameters.parts import GRAVITY
from omnimj.parameters.reading import check_number
from omnimj.physics.effect_terms import TERM, mark_active, zero_terms
from omnimj.physics.motor import MotorParameters
from omnimj.signals import Array

RIG, ROBOT, AXIS = Rig.plant, Robot.plant, "linear_axis"
"""The plants, by the names of their folders under `models/`."""
MJCF = "mjcf"
"""Plant of any machine that an MJCF file describes."""

Values = Mapping[str, Any]
"""Parameters (floats) and selectors (text or whole numbers) of one effect by name."""

Hook = Callable[[Any, Values], None]
"""Function that adds an effect to `MachineChanges`, given all its parameters and selectors."""

FLOOR_SCALES = {
    "mu_c": ("mu_c", "mu_s", "D", "mu"),
    "sigma_0": ("sigma_0", "B", "creep_stiffness"),
    "sigma_2": ("sigma_2",),
}
"""Floor parameters multiplied by each scale: `mu_c` scales all of g(V_r) of LuGre and the peak of the other
laws, `sigma_0` the stiffness of any law."""


COMPLIANCE = "creep_compliance"
"""Number that an effect adds to a floor: to the creep ratio of LuGre per traction over load."""
_GRIP, _MOST_GRIP = 20.0, 3.0  # added to μ_c per compliance, and at most: creep is no sliding


def scale_floor(floor: Floor, scales: Mapping[str, float]) -> Floor:
    """The floor with scaled parameters; key of `FLOOR_SCALES` → scale."""
    if not scales:
        return floor
    numbers = dict(floor.numbers)
    for name, scale in scales.items():
        for key in FLOOR_SCALES[name]:
            if key in numbers:
                numbers[key] *= scale
    return dataclasses.replace(floor, numbers=MappingProxyType(numbers))


def _parts_of(floor: Floor, extra: Mapping[str, float]) -> dict[str, float]:
    """Amounts to add to a floor's own numbers."""
    parts = {key: amount for key, amount in extra.items() if key != COMPLIANCE}
    if COMPLIANCE in extra:  # settled bristles carry σ0 V_r/(κ V_roll)
        parts["turnover"] = extra[COMPLIANCE] * floor.numbers.get("sigma_0", 0.0)
        parts |= dict.fromkeys(("mu_c", "mu_s"), min(_GRIP * extra[COMPLIANCE], _MOST_GRIP))
    return parts


@dataclass(frozen=True)
class EffectParameter:
    """One parameter of an effect."""

    name: str
    unit: str
    low: float
    high: float
    """Generous physical bounds."""
    typical: float
    """Value of a noticeable effect."""
    null_value: float | None = 0.0
    """Value at which the effect vanishes; None for a shape (position, width, speed) without such a value."""


@dataclass(frozen=True)
class Interval:
    """Estimate with its bounds; None for an open one."""

    value: float
    low: float | None
    high: float | None
    unit: str = "1"


MOST_WHEELS = 12
"""Largest number of wheels with effects of their own."""


def wheel_number(choice: str | int) -> int:
    """Number of the wheel that a choice names: 3 of 3 and of `current_3`; 0 if it names none."""
    if isinstance(choice, int):
        return choice
    number = choice.rpartition("_")[2]
    return int(number) if number.isdigit() else 0


@dataclass(frozen=True)
class Selector:
    """Choice that an effect requires besides its parameters, such as a channel or a wheel."""

    name: str
    choices: tuple[str | int, ...]
    """Possible choices; empty: any name."""
    optional: bool = False
    """True if the effect acts everywhere without it."""

    def on(self, wheels: int) -> tuple[str | int, ...]:
        """Choices that a machine with this number of wheels has."""
        return tuple(choice for choice in self.choices if wheel_number(choice) <= wheels)


FLOOR = Selector("floor", (), True)
"""Floor on which an effect acts; every floor if none is named."""


@dataclass(frozen=True)
class Effect:
    """Physical change of a machine, a candidate explanation of a gap between model and measurement."""

    name: str
    words: str
    """Description in plain words."""
    where: str
    """`rail`, `wheel`, `motor`, `floor`, `body` or `sensors`."""
    plants: tuple[str, ...]
    """Plants on which the effect can act."""
    parameters: tuple[EffectParameter, ...]
    selectors: tuple[Selector, ...] = ()
    hooks: tuple[Hook, ...] = ()
    """Functions that add the effect to a machine."""
    turns_with_wheel: bool = False
    """True if the effect repeats with the angle of wheel or motor, whose phase a simulation loses."""
    has_threshold: bool = False
    """True if a small amplitude changes nothing: grip is missing only where more of it is needed."""
    has_impacts: bool = False
    """True if it acts by impacts, whose times move with its amplitude: there is no fine derivative by it."""
    quantity: str = ""
    """Quantity of the machine that it adds to or scales, if it does nothing else; a machine's file may state
    the same quantity as uncertain."""

    @property
    def amplitudes(self) -> tuple[EffectParameter, ...]:
        """Parameters that turn the effect off at their null values."""
        return tuple(p for p in self.parameters if p.null_value is not None)

    def null_values(self) -> dict[str, float]:
        """Parameter values at which the effect vanishes; shapes have their typical values."""
        return {p.name: p.typical if p.null_value is None else p.null_value for p in self.parameters}

    def typical(self) -> dict[str, float]:
        """Typical values of all parameters."""
        return {p.name: p.typical for p in self.parameters}


class ChannelEffect(NamedTuple):
    """Effect on one measured channel: scale · reading + offset, delayed."""

    scale: float = 1.0
    offset: float = 0.0
    delay: float = 0.0
    """Delay [s]."""


@dataclass(frozen=True)
class FloorChange:
    """Changes that effects make to a floor."""

    scale: dict[str, float] = field(default_factory=dict)
    """Scales by keys of `FLOOR_SCALES`."""
    extra: dict[str, float] = field(default_factory=dict)
    """Amounts added to parameters of the floor, or to `COMPLIANCE`."""

    def multiply(self, key: str, scale: float) -> None:
        """Scale parameters of the floor, on top of earlier scales."""
        self.scale[key] = self.scale.get(key, 1.0) * scale

    def add(self, key: str, amount: float) -> None:
        """Add to a parameter of the floor, on top of earlier amounts."""
        self.extra[key] = self.extra.get(key, 0.0) + amount

    def without_nulls(self) -> FloorChange:
        """The changes that change anything."""
        scale = {key: value for key, value in self.scale.items() if value != 1.0}
        return FloorChange(scale, {key: value for key, value in self.extra.items() if value != 0.0})

    def on(self, floor: Floor, load: float) -> Floor:
        """The changed floor.

        Args:
          floor: The floor.
          load: Normal force about which an exponent of the load turns, if the floor states none [N].

        Raises:
          InputError: The floor's law has no such parameter, or the sum breaks its rule.
        """
        floor = scale_floor(floor, self.scale)
        if not self.extra:
            return floor
        rules, numbers = number_rules(floor.law), dict(floor.numbers)
        for key, amount in _parts_of(floor, self.extra).items():
            place = f"floor {floor.name}: {key}"
            if key not in rules:
                rule = "choose a floor of another law"
                raise InputError(place, f"the law {floor.law!r} has none", rule, LAWS)
            if key == "load_exponent":
                numbers.setdefault("reference_load", load)
            null = 1.0 if key == "load_exponent" else 0.0
            numbers[key] = float(check_number(place, numbers.get(key, null) + amount, rules[key]))
        return dataclasses.replace(floor, numbers=MappingProxyType(numbers))


@dataclass(frozen=True)
class AppliedEffects:
    """Machine with its effects applied, for plants and replay; n wheels, one for the rig and the axis."""

    machine: Any
    """Machine with changed constants; it still lists its effects."""
    terms: Array
    """Packed `physics.effect_terms.EffectTerms` per wheel, shape (n, TERMS)."""
    torque_scale: Array
    """Ratio of true to nominal torque constant, shape (n,)."""
    radius_scale: Array
    """Ratio of true to nominal rolling radius, shape (n,)."""
    misalignment: Array
    """Angle of each axle about the vertical, counter-clockwise, shape (n,) [rad]."""
    payload: tuple[float, float, float]
    """Payload mass [kg] and its position x, y in the body frame [m]; rig and axis use the mass only."""
    slope: tuple[float, float]
    """Inclination of floor or rail and downhill direction in the world frame [rad]."""
    floor_changes: Mapping[str, FloorChange]
    """Changes by the floor's name; "": of every floor."""
    channels: Mapping[str, ChannelEffect]
    """Changes of the readings, by channel."""

    @property
    def added_mass(self) -> float:
        """Mass of the machine beyond that of its constants [kg]."""
        return self.payload[0]

    def floor(self, floor: Floor) -> Floor:
        """Floor with changed parameters.

        Raises:
          InputError: The floor's law has no such parameter.
        """
        load = 1.0
        if isinstance(self.machine, Robot):  # alone it has effects that add
            load = (self.machine.body.mass + self.added_mass) * GRAVITY / self.machine.wheel_count
        for name in ("", floor.name):
            if change := self.floor_changes.get(name):
                floor = change.on(floor, load)
        return floor

    def floors(self, floors: Mapping[str, Floor]) -> Mapping[str, Floor]:
        """All floors with changed parameters; those whose law lacks such a parameter stay as they are."""
        found = {}
        for name, floor in floors.items():
            try:
                found[name] = self.floor(floor)
            except InputError:
                found[name] = floor
        return found

    def motors(self, motors: Sequence[MotorParameters]) -> tuple[MotorParameters, ...]:
        """Motors of the n wheels with scaled torque constants."""
        scales = self.torque_scale.tolist()
        return tuple(
            motor._replace(torque_constant=motor.torque_constant * scale)
            for motor, scale in zip(motors, scales, strict=True)
        )


def adds_to_term(term: str, parameter: str) -> Hook:
    """Hook that adds a parameter of an effect to an effect term of the selected wheel, or of all."""

    def hook(changes: MachineChanges, values: Values) -> None:
        changes.add_to_term(term, values[parameter], changes.wheel_rows(values))

    return hook


def adds_to_constant(table: str, key: str, parameter: str) -> Hook:
    """Hook that adds a parameter of an effect to a constant of the machine."""

    def hook(changes: MachineChanges, values: Values) -> None:
        changes.add_to_constant(table, key, values[parameter])

    return hook


class ChannelChanges:
    """Collector of the changes that effects make to readings."""

    def __init__(self) -> None:
        self.channels: dict[str, ChannelEffect] = {}

    def change_channel(
        self, channel: str, scale: float = 1.0, offset: float = 0.0, delay: float = 0.0
    ) -> None:
        """Change the readings of a channel: scale · reading + offset, delayed further by `delay` [s]."""
        if (scale, offset, delay) == (1.0, 0.0, 0.0):
            return
        before = self.channels.get(channel, ChannelEffect())
        self.channels[channel] = ChannelEffect(
            scale * before.scale, scale * before.offset + offset, before.delay + delay
        )


class MachineChanges(ChannelChanges):
    """Collector of the changes that the effects of a machine make."""

    def __init__(self, machine: Robot | Rig):
        super().__init__()
        n = machine.wheel_count
        self.machine: Any = machine
        self.terms: Array = zero_terms(n)
        self.torque_scale, self.radius_scale, self.misalignment = np.ones(n), np.ones(n), np.zeros(n)
        self.payload, self.slope = (0.0, 0.0, 0.0), (0.0, 0.0)
        self.floor_changes: dict[str, FloorChange] = {}
        self._added: dict[str, dict[str, float]] = {}

    def wheel_rows(self, values: Values) -> slice:
        """Rows of `terms` on which an effect acts: that of the selected wheel, or all.

        Raises:
          InputError: The machine has no such wheel.
        """
        if "wheel" not in values:
            return slice(None)
        wheel, count = int(values["wheel"]), len(self.terms)
        if wheel > count:
            raise InputError("wheel", f"found {wheel}", f"the machine has wheels 1 to {count}")
        return slice(wheel - 1, wheel)

    def floor_change(self, values: Values) -> FloorChange:
        """Changes of the floor that an effect selects, or of every floor."""
        return self.floor_changes.setdefault(str(values.get(FLOOR.name, "")), FloorChange())

    def add_to_constant(self, table: str, key: str, value: float, least: float = 0.0) -> None:
        """Add to a constant of the machine (`wheel`, `roller_dry`), which cannot fall below `least`."""
        entries = self._added.setdefault(table, {})
        before = entries[key] if key in entries else float(getattr(getattr(self.machine, table), key))
        entries[key] = max(before + value, least)

    def scale_back_driving(self, factor: float) -> None:
        """Multiply the efficiency of the gears while the wheels drive them."""
        entries, key = self._added.setdefault("motor", {}), "back_driving_efficiency"
        before = entries[key] if key in entries else 1.0 / float(self.machine.motor.driven_gain)
        entries[key] = factor * before

    def add_to_term(self, name: str, value: float, rows: slice = slice(None)) -> None:
        """Add to an effect term of some wheels, by default of all."""
        self.terms[rows, TERM[name]] += value

    def set_term(self, name: str, value: float, **shape: float) -> None:
        """Set an effect term that can act only once, together with the terms of its shape.

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

    def finish(self) -> AppliedEffects:
        """Combine all changes."""
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
            {name: change.without_nulls() for name, change in self.floor_changes.items()},
            self.channels,
        )
