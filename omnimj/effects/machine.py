"""Effects of a machine: add, check, parse from the command line, apply to its constants."""

from __future__ import annotations

import dataclasses
import itertools
import math
from collections.abc import Mapping, Sequence
from typing import Any, TypeVar

from omnimj.effects import catalogue
from omnimj.effects.catalogue import base_name, find_effect
from omnimj.effects.effect import MOST_WHEELS, AppliedEffects, Effect, MachineChanges
from omnimj.errors import InputError, UnknownNameError
from omnimj.parameters import Rig, Robot

Machine = TypeVar("Machine", Robot, Rig)


def complete_values(
    effect: Effect,
    given: Mapping[str, Any],
    place: object,
    partial: bool = True,
    wheels: int = MOST_WHEELS,
) -> dict[str, float | str | int]:
    """Complete the parameters and selectors of an effect.

    Missing shapes (a width, a position) get their typical values. Missing amplitudes get their null values if
    another amplitude is given, otherwise their typical values. A selector must be given unless it has only
    one choice.

    Args:
      effect: Effect as declared for the plant, from `effects_of`.
      given: Values by name.
      place: Origin of the values, for messages.
      partial: Whether all amplitudes may be missing.
      wheels: Number of the machine's wheels.

    Raises:
      InputError: A value that is not a number, is out of bounds or is missing.
      UnknownNameError: An unknown parameter or choice.
    """
    known = [p.name for p in effect.parameters] + [s.name for s in effect.selectors]
    for key in given:
        if key not in known:
            raise UnknownNameError(place, f"parameter of {effect.name}", key, known)
    named = any(p.name in given for p in effect.amplitudes)
    if not (named or partial):
        needed = [p.name for p in effect.amplitudes]
        raise InputError(place, "has no size", "give at least one of its amplitudes", needed)
    values: dict[str, float | str | int] = {}
    for parameter in effect.parameters:
        fallback = parameter.null_value if named and parameter.null_value is not None else parameter.typical
        value = given.get(parameter.name, fallback)
        if isinstance(value, bool) or not isinstance(value, float | int):
            raise InputError(f"{place}.{parameter.name}", f"found {value!r}", "a number is needed")
        if not (math.isfinite(value) and parameter.low <= value <= parameter.high):
            rule = f"must be at least {parameter.low:g} and at most {parameter.high:g} {parameter.unit}"
            raise InputError(f"{place}.{parameter.name}", f"found {value!r}", rule)
        values[parameter.name] = float(value)
    for selector in effect.selectors:
        if selector.optional and selector.name not in given:
            continue
        if not selector.choices:
            values[selector.name] = _any_name(given.get(selector.name), f"{place}.{selector.name}")
            continue
        choices = selector.on(wheels)
        if selector.name not in given and len(choices) > 1:
            raise InputError(
                place, f"'{selector.name}' is missing", "name one of the choices", map(str, choices)
            )
        chosen = given.get(selector.name, next(iter(choices)))
        if chosen not in choices or isinstance(chosen, bool | float):
            raise UnknownNameError(place, selector.name, chosen, map(str, choices))
        values[selector.name] = chosen
    return values


def _any_name(given: object, place: str) -> str:
    if isinstance(given, str) and given:
        return given
    raise InputError(place, f"found {given!r}", "a name is needed")


def with_effects(machine: Machine, effects: Mapping[str, Mapping[str, Any]]) -> Machine:
    """Copy of a machine with further effects; an effect of the same name is replaced.

    Args:
      machine: `Rig` or `Robot`.
      effects: Name → parameter or selector → value; further instances of an effect are NAME_2, NAME_3, ….
        Missing values are filled in as in `complete_values`.

    Raises:
      InputError: A value out of bounds or missing.
      UnknownNameError: An unknown effect, parameter or choice.
    """
    full = dict(machine.effects)
    for name, values in effects.items():
        place = f"effects.{name}"
        effect = find_effect(name, machine.plant, "effects")
        full[name] = complete_values(effect, values, place, wheels=machine.wheel_count)
    changed = dataclasses.replace(machine, effects=full)
    collect_changes(changed)  # refuses effects that exclude each other
    return changed


def with_further_effects(machine: Machine, effects: Sequence[tuple[str, Mapping[str, Any]]]) -> Machine:
    """Copy of a machine with further instances of effects, beside those that it has.

    Args:
      machine: `Rig` or `Robot`.
      effects: Names of effects and their values, as in `with_effects`; a name may come several times.

    Raises:
      InputError: A value out of bounds or missing, or an effect that can act only once.
      UnknownNameError: An unknown effect, parameter or choice.
    """
    added: dict[str, Mapping[str, Any]] = {}
    for name, values in effects:
        names = (name if k == 1 else f"{name}_{k}" for k in itertools.count(1))
        added[next(n for n in names if n not in machine.effects and n not in added)] = values
    return with_effects(machine, added)


def apply_effects(machine: Robot | Rig) -> AppliedEffects:
    """Apply a machine's effects to its constants, for plants and for replay.

    Raises:
      InputError: An effect's value is out of bounds or missing, or two effects exclude each other; the
        message names the machine's file.
      UnknownNameError: An unknown effect, parameter or choice.
    """
    return collect_changes(machine).finish()


def collect_changes(machine: Robot | Rig) -> MachineChanges:
    """Collect the changes of a machine's effects.

    Raises:
      InputError: As `apply_effects`.
      UnknownNameError: As `apply_effects`.
    """
    changes = MachineChanges(machine)
    for name, given in machine.effects.items():
        place = f"{machine.file}: effects.{name}"
        effect = find_effect(name, machine.plant, f"{machine.file}: effects")
        values = complete_values(effect, given, place, partial=False, wheels=machine.wheel_count)
        for hook in effect.hooks:
            try:
                hook(changes, values)
            except InputError as error:
                raise InputError(place, str(error)) from None
    return changes


def check_effects(machine: Robot | Rig) -> None:
    """Check the effects of a machine that was read from a file.

    Raises:
      InputError: An effect is incomplete, a value out of bounds or a unit wrong; the message names file,
        effect and parameter.
      UnknownNameError: An unknown effect, parameter or choice.
    """
    collect_changes(machine)
    for name, given in machine.effects.items():
        for parameter in find_effect(name, machine.plant, machine.file).parameters:
            origin = machine.provenance.get(f"effects.{name}.{parameter.name}")
            if parameter.name in given and origin is None:
                shape = f'write {{ value = …, unit = "{parameter.unit}", source = "…" }}'
                raise InputError(
                    f"{machine.file}: effects.{name}.{parameter.name}",
                    f"found {given[parameter.name]!r}",
                    shape,
                )
            if origin is not None and origin.unit != parameter.unit:
                place = f"{machine.file}: effects.{name}.{parameter.name}.unit"
                raise InputError(place, f"found {origin.unit!r}", f"the unit is {parameter.unit!r}")


def parse_effect(text: str, plant: str | None = None) -> tuple[str, dict[str, float | str | int]]:
    """Parse an effect of the command line, `NAME[:KEY=VALUE,…]`, into its name and values.

    Args:
      text: `rail_viscous`, `rail_stribeck:force=2,velocity=0.1`, `sensor_delay_2:channel=current`, ….
      plant: Plant for which values are checked and missing ones filled in as in `complete_values`; None:
        values are returned as written, for `with_effects`.

    Raises:
      InputError: Not of this form, or a value out of bounds.
      UnknownNameError: An unknown effect, parameter or choice.
    """
    name, colon, rest = text.partition(":")
    place = f"--effect {text}"
    if plant is not None:
        effect = find_effect(name, plant, place)
    elif base_name(name) in catalogue.EFFECTS:
        effect = catalogue.EFFECTS[base_name(name)]
    else:
        raise UnknownNameError(place, "effect", name, catalogue.EFFECTS)
    values: dict[str, float | str | int] = {}
    for pair in rest.split(",") if colon else ():
        key, equals, value = (part.strip() for part in pair.partition("="))
        if not (equals and key and value):
            raise InputError(place, f"{pair!r} is not KEY=VALUE", f"e.g. --effect {_example(effect)}")
        if key in values:
            raise InputError(place, f"'{key}' occurs twice")
        values[key] = _value(effect, key, value, place)
    return name, values if plant is None else complete_values(effect, values, f"--effect {name}")


def _value(effect: Effect, key: str, text: str, place: str) -> float | str | int:
    for selector in effect.selectors:
        if key == selector.name:
            return int(text) if text.isascii() and text.isdigit() and len(text) < 10 else text
    known = [p.name for p in effect.parameters] + [s.name for s in effect.selectors]
    if key not in known:
        raise UnknownNameError(place, f"parameter of {effect.name}", key, known)
    try:
        return float(text)
    except ValueError:
        raise InputError(f"{place}: {key}", f"found {text!r}", "a number is needed") from None


def _example(effect: Effect) -> str:
    first = effect.parameters[0]
    return f"{effect.name}:{first.name}={first.typical:g}"
