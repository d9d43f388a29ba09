"""The tables `[effects.NAME]` of a model file: what lies on top of the model's constants.

Here only the form is checked; which effects there are, their units and bounds is known to `omnimj.effects`,
which checks them when a machine is built (`check_effects`).
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from omnimj.errors import InputError
from omnimj.parameters.reading import Provenance, Rule, number, read_origin

EffectValues = Mapping[str, Mapping[str, float | str | int]]
"""Effect → parameter or selector → value."""

_FINITE = Rule(-math.inf, math.inf, False)


def read_effects(
    tree: Mapping[str, Any], path: Path, provenance: dict[str, Provenance]
) -> dict[str, dict[str, float | str | int]]:
    """Values of all `[effects.NAME]` tables of a parsed model file.

    A parameter is `{ value, unit, source }` with optional `low`, `high` (its interval) and `uncertainty`; a
    selector is a plain text or whole number.

    Args:
      tree: The whole file as parsed.
      path: The file, for messages.
      provenance: Gets `effects.NAME.PARAMETER` → unit and source.

    Raises:
      InputError: A table or entry has another form, or an interval that does not hold its value.
      UnknownNameError: An entry's key or source is unknown.
    """
    effects = tree.get("effects", {})
    if not isinstance(effects, Mapping):
        raise InputError(f"{path}: effects", f"found {effects!r}", "write tables [effects.NAME]")
    found: dict[str, dict[str, float | str | int]] = {}
    for name, table in effects.items():
        place = f"{path}: effects.{name}"
        if not isinstance(table, Mapping):
            raise InputError(place, f"found {table!r}", f"write a table [effects.{name}]")
        found[name] = {}
        for key, entry in table.items():
            if isinstance(entry, str) or (isinstance(entry, int) and not isinstance(entry, bool)):
                found[name][key] = entry
            else:
                found[name][key] = _parameter(f"{place}.{key}", entry, f"effects.{name}.{key}", provenance)
    return found


def _parameter(place: str, entry: Any, key: str, provenance: dict[str, Provenance]) -> float:
    provenance[key] = read_origin(place, entry, None, ("low", "high"))
    value = float(number(place, entry["value"], _FINITE))
    low = number(f"{place}.low", entry.get("low", value), _FINITE)
    high = number(f"{place}.high", entry.get("high", value), _FINITE)
    if not low <= value <= high:
        raise InputError(place, f"found {value:g}", f"must lie between its low {low:g} and high {high:g}")
    return value
