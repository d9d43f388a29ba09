"""`--effect NAME[:KEY=VALUE,…]`: an effect as it is written on the command line."""

from __future__ import annotations

from omnimj.effects import catalogue
from omnimj.effects.catalogue import base_name, find_effect
from omnimj.effects.effect import Effect
from omnimj.effects.machine import complete
from omnimj.errors import InputError, UnknownNameError


def parse_effect(text: str, plant: str | None = None) -> tuple[str, dict[str, float | str | int]]:
    """Name and values of `NAME[:KEY=VALUE,…]`.

    Args:
      text: `rail_viscous`, `rail_stribeck:force=2,velocity=0.1`, `sensor_delay_2:channel=current`, ….
      plant: With it values are checked and those left out are filled in as `machine.complete` says; without
        it the values are what was written, and `with_effects` fills them in.

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
            raise InputError(place, f"'{key}' is there twice")
        values[key] = _value(effect, key, value, place)
    return name, values if plant is None else complete(effect, values, f"--effect {name}")


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
