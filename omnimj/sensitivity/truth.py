"""The scenario as it really is: some numbers of machine and floors other than the model files say."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from types import MappingProxyType
from typing import Any

from omnimj.parameters import Floor
from omnimj.scenario.scenario import Scenario
from omnimj.sensitivity.varied import FLOOR


def truth_with(scenario: Scenario, values: Mapping[str, float]) -> Scenario:
    """The same scenario for a plant to be made of; the controller is made of the one that is given.

    Args:
      scenario: As the model files have it.
      values: New value by name, as in `varied.Varied`.
    """
    machine: Any = scenario.constants
    floors = dict(scenario.floors)
    for name, value in values.items():
        table, _, key = name.partition(".")
        if table == FLOOR:
            floor, _, letter = key.rpartition(".")
            floors[floor] = _floor(floors[floor], letter, value)
        elif table == "effects":
            machine = _with_effect(machine, key, value)
        elif table == "wheels":
            machine = _with_mount(machine, key, value)
        else:
            changed = _replaced(getattr(machine, table), key, value)
            machine = dataclasses.replace(machine, **{table: changed})
    return dataclasses.replace(scenario, constants=machine, floors=MappingProxyType(floors))


def _floor(floor: Floor, letter: str, value: float) -> Floor:
    return dataclasses.replace(floor, numbers=MappingProxyType({**floor.numbers, letter: value}))


def _with_effect(machine: Any, key: str, value: float) -> Any:
    effect, _, parameter = key.partition(".")
    changed = {**machine.effects[effect], parameter: value}
    return dataclasses.replace(machine, effects={**machine.effects, effect: changed})


def _with_mount(machine: Any, key: str, value: float) -> Any:
    number, _, entry = key.partition(".")
    mounts = list(machine.wheels)
    mounts[int(number) - 1] = _replaced(mounts[int(number) - 1], entry, value)
    return dataclasses.replace(machine, wheels=tuple(mounts))


def _replaced(table: Any, key: str, value: float) -> Any:
    """The table with one new value; all numbers of a list keep their ratios, its largest gets the value."""
    before = getattr(table, key)
    if isinstance(before, tuple):
        factor = value / max(map(abs, before))
        return dataclasses.replace(table, **{key: tuple(factor * entry for entry in before)})
    return dataclasses.replace(table, **{key: int(value) if isinstance(before, int) else value})
