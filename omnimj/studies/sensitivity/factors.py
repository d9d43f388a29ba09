"""Factors of a sensitivity study: parameters of a scenario's machine and floors, with their ranges."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from omnimj.parameters import Floor
from omnimj.parameters.floor import OPTIONAL, number_rules
from omnimj.parameters.reading import Provenance, Rule
from omnimj.simulate.scenario.scenario import Scenario

CHOSEN = "chosen"
DEFAULT_SHARE = 0.20
"""Half-width of a range, relative to the value, where the file states no uncertainty."""
FLOOR = "floor"
"""First part of the names of floor parameters: `floor.nylon.mu_c`."""

_ANY = Rule(-math.inf, math.inf, False)
_KEPT = 0.01  # smallest distance of a range to an excluded bound, relative to the value
_NOT_OF_THE_PLANT = {"control": "a controller setting, not measured"}
_KEYS_LEFT = {
    "sensors.sample_rate": "the controller's sample rate, not measured",
    "wheel.rows": "a number of parts, not measured",
    "wheel.rollers_per_row": "a number of parts, not measured",
    "rig.masses": "set by the scenario",
}
_DIRECTION = "drives_along"
_ZERO = "it is 0 and the file states no uncertainty, so it has no range"


@dataclass(frozen=True)
class Factor:
    """Parameter with its range."""

    name: str
    """`motor.torque_constant`, `floor.nylon.mu_c`; a list is scaled by its largest entry."""
    unit: str
    nominal: float
    """Value of the model file, which the controller uses."""
    low: float
    high: float
    whole: bool = False
    """True if the parameter is an integer."""
    stated: bool = False
    """True if the range is the uncertainty stated in the model file."""

    def at(self, place: float) -> float:
        """Return the value at a place of the range, 0 … 1; integers are rounded."""
        value = self.low + place * (self.high - self.low)
        return float(round(value)) if self.whole else value

    def place(self, value: float) -> float:
        """Return the place of a value in the range, 0 … 1."""
        return (value - self.low) / (self.high - self.low)


@dataclass(frozen=True)
class ExcludedFactor:
    """Parameter of a selected provenance that is nevertheless not varied."""

    name: str
    reason: str


def find_factors(
    scenario: Scenario, sources: Sequence[str] = (CHOSEN,), share: float = DEFAULT_SHARE
) -> tuple[tuple[Factor, ...], tuple[ExcludedFactor, ...]]:
    """Find the parameters of machine and floors with one of the given provenances.

    The range is value ± the uncertainty stated by the file, else value ± share · |value|, and at least ±1 for
    an integer; it is clipped to the admissible values.

    Args:
      scenario: Scenario with its machine and all its floors, also those of patches and faults.
      sources: Provenances.
      share: Half-width relative to the value.

    Returns:
      Varied parameters in the order of the files, and those that are not varied.
    """
    found: list[Factor] = []
    left: list[ExcludedFactor] = []
    for one in (*_machine(scenario, sources, share), *_floors(scenario, sources, share)):
        if isinstance(one, Factor):
            found.append(one)
        else:
            left.append(one)
    return tuple(found), tuple(left)


def _machine(scenario: Scenario, sources: Sequence[str], share: float) -> Iterator[Factor | ExcludedFactor]:
    machine = scenario.constants
    for name, origin in machine.provenance.items():
        if origin.source not in sources:
            continue
        table, _, key = name.partition(".")
        reason = _NOT_OF_THE_PLANT.get(table) or _KEYS_LEFT.get(name)
        if key.endswith(_DIRECTION):
            reason = "a direction"
        if reason:
            yield ExcludedFactor(name, reason)
            continue
        value, rule, whole = _entry(machine, table, key)
        nominal = max(map(abs, value)) if isinstance(value, tuple) else float(value)
        yield _ranged(name, origin, nominal, rule, whole, share)


def _entry(machine: Any, table: str, key: str) -> tuple[Any, Rule, bool]:
    """Return value and rule of a parameter of the machine, and whether it is an integer."""
    if table == "effects":
        effect, _, parameter = key.partition(".")
        return machine.effects[effect][parameter], _ANY, False
    if table == "wheels":
        number, _, key = key.partition(".")
        holder = machine.wheels[int(number) - 1]
    else:
        holder = getattr(machine, table)
    field = next(f for f in dataclasses.fields(holder) if f.name == key)
    value = getattr(holder, key)
    rule = _ANY if isinstance(value, tuple) else field.metadata["rule"]
    return value, rule, str(field.type) == "int"


def _ranged(
    name: str, origin: Provenance, nominal: float, rule: Rule, whole: bool, share: float
) -> Factor | ExcludedFactor:
    stated = origin.uncertainty > 0.0
    half = origin.uncertainty if stated else share * abs(nominal)
    if half == 0.0:
        return ExcludedFactor(name, _ZERO)
    if whole:
        half = max(1.0, float(round(half)))
    low, high = nominal - half, min(nominal + half, rule.high)
    if low < rule.low or (rule.open_low and low <= rule.low):
        low = rule.low + _KEPT * (nominal - rule.low) if rule.open_low else rule.low
    return Factor(name, origin.unit, nominal, low, high, whole, stated)


def _floors(scenario: Scenario, sources: Sequence[str], share: float) -> Iterator[Factor | ExcludedFactor]:
    for name in floors_in(scenario):
        floor = scenario.floors[name]
        for letter, value in floor.numbers.items():
            source = _source_of(floor, letter)
            if source in sources:
                origin = Provenance(_UNITS.get(letter, "1"), source, floor.uncertainty * abs(value))
                rule = number_rules(floor.law)[letter]
                yield _ranged(f"{FLOOR}.{name}.{letter}", origin, value, rule, False, share)


_UNITS: Mapping[str, str] = {
    "V_s": "m/s",
    "sigma_0": "1/m",
    "sigma_1": "s/m",
    "sigma_2": "s/m",
    "relaxation_length": "m",
    "damping_time": "s",
    "reference_load": "N",
}
_ALWAYS_CHOSEN = (*OPTIONAL, "relaxation_length", "damping_time")  # not published, see floors.toml


def _source_of(floor: Floor, letter: str) -> str:
    """Return the provenance of a floor parameter: the first word of the floor's source, or `chosen`."""
    if letter in _ALWAYS_CHOSEN and floor.source.startswith("text"):
        return CHOSEN
    words = floor.source.replace(",", " ").replace(":", " ").split()
    return words[0] if words else ""


def floors_in(scenario: Scenario) -> tuple[str, ...]:
    """Return the floors of a scenario, that of the hall first."""
    names = [scenario.floor, *(patch.floor for patch in scenario.patches)]
    names += [str(fault.numbers["floor"]) for fault in scenario.faults if "floor" in fault.numbers]
    return tuple(dict.fromkeys(names))
