"""Reads TOML tables of quantities into frozen dataclasses and keeps where each number comes from.

A quantity is `name = { value = …, unit = "…", source = "text | datasheet | chosen" }`.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any, NamedTuple

from omnimj.errors import InputError, UnknownNameError

SOURCES = ("text", "datasheet", "chosen", "measured", "identified")


class Provenance(NamedTuple):
    """Where a number comes from."""

    unit: str
    source: str


class Rule(NamedTuple):
    """The bounds of a quantity; `open_low` excludes the lower one."""

    low: float
    high: float
    open_low: bool

    def broken_by(self, value: float) -> bool:
        """Whether a single number breaks the rule."""
        below = value <= self.low if self.open_low else value < self.low
        return not math.isfinite(value) or below or value > self.high

    def __str__(self) -> str:
        if self.low == -math.inf and self.high == math.inf:
            return "must be finite"
        low = f"{'above' if self.open_low else 'at least'} {self.low:g}" if self.low > -math.inf else ""
        high = f"at most {self.high:g}" if self.high < math.inf else ""
        return "must be " + " and ".join(part for part in (low, high) if part)


def quantity(unit: str, low: float = -math.inf, high: float = math.inf, *, open_low: bool = False) -> Any:
    """Declares a dataclass field with its unit and bounds."""
    return dataclasses.field(metadata={"unit": unit, "rule": Rule(low, high, open_low)})


def positive(unit: str, high: float = math.inf) -> Any:
    """A quantity above zero."""
    return quantity(unit, 0.0, high, open_low=True)


def number(place: str, value: Any, rule: Rule, whole: bool = False) -> float | int:
    """Checks one number against its rule.

    Raises:
      InputError: Not a number, not whole where whole is needed, or outside the bounds.
    """
    if isinstance(value, bool) or not isinstance(value, int | float):
        raise InputError(place, f"found {value!r}", f"a number is needed that {rule}")
    try:
        broken = rule.broken_by(float(value))
    except OverflowError:  # a whole number beyond the range of floating point
        broken = True
    if broken:
        finite = isinstance(value, int) or math.isfinite(value) or rule.high < math.inf
        raise InputError(place, f"found {value!r}", str(rule) if finite else f"{rule} and finite")
    if whole and float(value) != int(value):
        raise InputError(place, f"found {value!r}", "must be a whole number")
    return int(value) if whole else float(value)


def read_quantity(place: str, entry: Any, spec: dataclasses.Field) -> tuple[Any, Provenance]:
    """One `{ value, unit, source }` entry, checked against the field it is for."""
    unit, rule = spec.metadata["unit"], spec.metadata["rule"]
    if not isinstance(entry, Mapping):
        raise InputError(place, f"found {entry!r}", f'write {{ value = …, unit = "{unit}", source = "…" }}')
    for key in entry:
        if key not in ("value", "unit", "source"):
            raise UnknownNameError(place, "key", key, ("value", "unit", "source"))
    for key in ("value", "unit", "source"):
        if key not in entry:
            raise InputError(
                place, f"'{key}' is missing", f'write {{ value = …, unit = "{unit}", source = "…" }}'
            )
    if entry["unit"] != unit:
        raise InputError(f"{place}.unit", f"found {entry['unit']!r}", f"the unit is {unit!r}")
    if entry["source"] not in SOURCES:
        raise UnknownNameError(f"{place}.source", "source", entry["source"], SOURCES)
    value = entry["value"]
    kind = str(spec.type)
    if kind.startswith("tuple"):
        if not isinstance(value, list) or not value:
            raise InputError(place, f"found {value!r}", "a list of numbers is needed")
        value = tuple(number(f"{place}[{i}]", v, rule) for i, v in enumerate(value))
    else:
        value = number(place, value, rule, whole=kind == "int")
    return value, Provenance(entry["unit"], entry["source"])


def read_table(
    kind: type,
    table: Any,
    home: Callable[[str], Path],
    provenance: dict[str, Provenance],
    prefix: str,
) -> Any:
    """A table of quantities as an instance of the dataclass `kind`.

    Args:
      kind: Dataclass whose fields come from `quantity` and `positive`.
      table: The parsed TOML table.
      home: The file that a key stands in, for messages.
      provenance: Gets `prefix.key` → unit and source.
      prefix: The table's name in the file.

    Raises:
      InputError: A key is missing or its value breaks the rule.
      UnknownNameError: A key that `kind` does not have.
    """
    fields = {f.name: f for f in dataclasses.fields(kind)}
    if not isinstance(table, Mapping):
        raise InputError(home(""), f"[{prefix}] is not a table")
    for key in table:
        if key not in fields:
            raise UnknownNameError(f"{home(key)}: [{prefix}]", "key", key, fields)
    values = {}
    for name, spec in fields.items():
        if name not in table:
            raise InputError(f"{home(name)}: [{prefix}]", f"'{name}' is missing")
        values[name], provenance[f"{prefix}.{name}"] = read_quantity(
            f"{home(name)}: {prefix}.{name}", table[name], spec
        )
    return kind(**values)
