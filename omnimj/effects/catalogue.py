"""Catalogue of all effects: every module of this package that has a tuple `EFFECTS` adds to it.

An effect may be declared once for several plants, or under one name with different parameters for each plant.
"""

from __future__ import annotations

import functools
import importlib
import pkgutil
import re
from collections.abc import Iterator, Mapping
from pathlib import Path
from types import MappingProxyType

from omnimj.effects.effect import AXIS, MJCF, RIG, ROBOT, Effect
from omnimj.errors import UnknownNameError

PLANTS = (RIG, ROBOT, AXIS, MJCF)
"""Plants for which effects exist."""

_INSTANCE = re.compile(r"(.+)_([2-9]|[1-9][0-9])")


def _declared() -> Iterator[Effect]:
    """Effects of all modules of the package, in the order of the modules' names."""
    for module in sorted(entry.name for entry in pkgutil.iter_modules([str(Path(__file__).parent)])):
        if module != "catalogue":
            found = getattr(importlib.import_module(f"omnimj.effects.{module}"), "EFFECTS", ())
            yield from found if isinstance(found, tuple) else ()


def _merged(first: Effect, second: Effect) -> Effect:
    """Join two declarations of one effect for different plants."""
    if set(first.plants) & set(second.plants):
        raise ValueError(f"effect {first.name!r} is declared twice for one plant")
    known = {p.name for p in first.parameters}, {s.name for s in first.selectors}
    return Effect(
        first.name,
        first.words,
        first.where,
        first.plants + second.plants,
        first.parameters + tuple(p for p in second.parameters if p.name not in known[0]),
        first.selectors + tuple(s for s in second.selectors if s.name not in known[1]),
    )


@functools.cache
def _catalogue() -> tuple[Mapping[str, Effect], Mapping[str, Mapping[str, Effect]]]:
    united: dict[str, Effect] = {}
    by_plant: dict[str, dict[str, Effect]] = {plant: {} for plant in PLANTS}
    for effect in _declared():
        united[effect.name] = _merged(united[effect.name], effect) if effect.name in united else effect
        for plant in effect.plants:
            by_plant[plant][effect.name] = effect
    return (
        MappingProxyType(united),
        MappingProxyType({plant: MappingProxyType(found) for plant, found in by_plant.items()}),
    )


def effects_of(plant: str) -> Mapping[str, Effect]:
    """Effects of one plant by name, with their parameters and choices on it.

    Raises:
      UnknownNameError: No such plant.
    """
    found = _catalogue()[1]
    if plant not in found:
        raise UnknownNameError("effects", "plant", plant, found)
    return found[plant]


def base_name(name: str) -> str:
    """Name of an effect without the number of a further instance: `sensor_delay_2` → `sensor_delay`."""
    known = _catalogue()[0]
    if name in known:
        return name
    numbered = _INSTANCE.fullmatch(name)
    return numbered[1] if numbered and numbered[1] in known else name


def find_effect(name: object, plant: str, place: object) -> Effect:
    """Look up an effect of a plant by name, also by that of a further instance (`sensor_delay_2`).

    Raises:
      UnknownNameError: The plant has no such effect; the message lists those it has.
    """
    known = effects_of(plant)
    base = base_name(name) if isinstance(name, str) else name
    if not isinstance(base, str) or base not in known:
        raise UnknownNameError(place, f"effect of {plant}", name, known)
    return known[base]


# last: modules of the package may import the functions above while the catalogue is collected
EFFECTS: Mapping[str, Effect] = _catalogue()[0]
"""All effects by name, each with the parameters of all its plants; `effects_of` selects one plant."""
