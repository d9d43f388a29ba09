"""Which numbers of a scenario's machine and floors are varied, and between which bounds."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from omnimj.parameters import Floor
from omnimj.parameters.floor import LAWS
from omnimj.parameters.reading import Provenance, Rule
from omnimj.simulate.scenario.scenario import Scenario

CHOSEN = "chosen"
DEFAULT_SHARE = 0.20
"""Half-width of a range, relative to the value, where the file states no uncertainty."""
FLOOR = "floor"
"""First part of the names of a floor's numbers: `floor.nylon.mu_c`."""

_ANY = Rule(-math.inf, math.inf, False)
_KEPT = 0.01  # of the value: as near as a range comes to a bound that the number may not reach
_NOT_OF_THE_PLANT = {"control": "a setting of the controller: it is set, not measured"}
_KEYS_LEFT = {
    "sensors.sample_rate": "the controller's period: it is set, not measured",
    "wheel.rows": "the wheel's build: it is counted, not measured",
    "wheel.rollers_per_row": "the wheel's build: it is counted, not measured",
    "rig.masses": "the scenario says the mass",
}
_DIRECTION = "drives_along"
_ZERO = "it is 0 and the file states no uncertainty: a share of it is nothing"


@dataclass(frozen=True)
class Factor:
    """A number and what it may be."""

    name: str
    """`motor.torque_constant`, `floor.nylon.mu_c`; a list of numbers goes by its largest one."""
    unit: str
    nominal: float
    """What the model file says, and the controller believes."""
    low: float
    high: float
    whole: bool = False
    """Whether it is a whole number."""
    stated: bool = False
    """Whether the range is the file's own uncertainty."""

    def at(self, place: float) -> float:
        """Value at a place of the range, low at 0 and high at 1; whole numbers are rounded."""
        value = self.low + place * (self.high - self.low)
        return float(round(value)) if self.whole else value

    def place(self, value: float) -> float:
        """Where a value lies in the range, 0 … 1."""
        return (value - self.low) / (self.high - self.low)


@dataclass(frozen=True)
class ExcludedFactor:
    """A number of the same origin that is not varied."""

    name: str
    reason: str


def find_factors(
    scenario: Scenario, sources: Sequence[str] = (CHOSEN,), share: float = DEFAULT_SHARE
) -> tuple[tuple[Factor, ...], tuple[ExcludedFactor, ...]]:
    """Every number of machine and floors with one of the given origins.

    Its range is value ± the uncertainty that its file states, else value ± share · |value|; a whole number
    moves by one at least. A range that leaves what the number may be is cut off there.

    Args:
      scenario: Its machine, and every floor that is in it: the hall's, those of patches and of faults.
      sources: Origins as the files have them.
      share: Half-width relative to the value.

    Returns:
      What is varied, in the order of the files, and what is not and why.
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
    """Value of a number of the machine, what it may be, and whether it is whole."""
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
                rule = LAWS[floor.law][1][letter]
                yield _ranged(f"{FLOOR}.{name}.{letter}", origin, value, rule, False, share)


_UNITS: Mapping[str, str] = {
    "V_s": "m/s",
    "sigma_0": "1/m",
    "sigma_1": "s/m",
    "sigma_2": "s/m",
    "relaxation_length": "m",
    "damping_time": "s",
}
_ALWAYS_CHOSEN = ("mu_cap", "relaxation_length", "damping_time")  # no source has them, see floors.toml


def _source_of(floor: Floor, letter: str) -> str:
    """A floor has one line on where its numbers come from, its first word; some numbers are ours always."""
    if letter in _ALWAYS_CHOSEN and floor.source.startswith("text"):
        return CHOSEN
    words = floor.source.replace(",", " ").replace(":", " ").split()
    return words[0] if words else ""


def floors_in(scenario: Scenario) -> tuple[str, ...]:
    """Floors that are in a scenario, the hall's first."""
    names = [scenario.floor, *(patch.floor for patch in scenario.patches)]
    names += [str(fault.numbers["floor"]) for fault in scenario.faults if "floor" in fault.numbers]
    return tuple(dict.fromkeys(names))
