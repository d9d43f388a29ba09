"""Reads a TOML file of quantities into frozen dataclasses and keeps where each number comes from.

A quantity is `name = { value = …, unit = "…", source = "text | datasheet | chosen" }`.
"""

from __future__ import annotations

import dataclasses
import math
import tomllib
from collections.abc import Mapping
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
            return "must be a finite number"
        low = f"{'above' if self.open_low else 'at least'} {self.low:g}" if self.low > -math.inf else ""
        high = f"at most {self.high:g}" if self.high < math.inf else ""
        return "must be " + " and ".join(part for part in (low, high) if part)


def quantity(unit: str, low: float = -math.inf, high: float = math.inf, *, open_low: bool = False) -> Any:
    """Declares a dataclass field with its unit and bounds."""
    return dataclasses.field(metadata={"unit": unit, "rule": Rule(low, high, open_low)})


def positive(unit: str, high: float = math.inf) -> Any:
    """A quantity above zero."""
    return quantity(unit, 0.0, high, open_low=True)


def read_toml(path: Path) -> dict[str, Any]:
    """Parses a TOML file.

    Raises:
      InputError: The file is missing or is not TOML; the message names file and line.
    """
    try:
        with path.open("rb") as stream:
            return tomllib.load(stream)
    except FileNotFoundError:
        raise InputError(path, "no such file") from None
    except IsADirectoryError:
        raise InputError(path, "is a folder", "a TOML file is needed") from None
    except RecursionError:
        raise InputError(path, "is not valid TOML", "it is nested too deeply") from None
    except ValueError as error:  # not TOML, not UTF-8, or a number of thousands of digits
        raise InputError(path, "is not valid TOML", str(error)) from None


def number(place: str, value: Any, rule: Rule, whole: bool = False) -> float | int:
    """Checks one number against its rule.

    Raises:
      InputError: Not a number, not whole where whole is needed, or outside the bounds.
    """
    if isinstance(value, bool) or not isinstance(value, int | float):
        raise InputError(place, f"found {value!r}", f"a number is needed that {rule}")
    try:
        broken = rule.broken_by(float(value))
    except OverflowError:  # TOML has integers of any length, floats end at 1.8e308
        raise InputError(place, "found a number too large to use", str(rule)) from None
    if broken:
        raise InputError(place, f"found {value!r}", str(rule))
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


def read_table(kind: type, table: Any, place: str, provenance: dict[str, Provenance], prefix: str) -> Any:
    """A table of quantities as an instance of the dataclass `kind`.

    Raises:
      InputError: A key is missing or its value breaks the rule.
      UnknownNameError: A key that `kind` does not have.
    """
    if not isinstance(table, Mapping):
        raise InputError(place, f"[{prefix}] is {'missing' if table is None else 'not a table'}")
    fields = {f.name: f for f in dataclasses.fields(kind)}
    for key in table:
        if key not in fields:
            raise UnknownNameError(f"{place}: [{prefix}]", "key", key, fields)
    values = {}
    for name, spec in fields.items():
        if name not in table:
            raise InputError(f"{place}: [{prefix}]", f"'{name}' is missing")
        values[name], provenance[f"{prefix}.{name}"] = read_quantity(
            f"{place}: {prefix}.{name}", table[name], spec
        )
    return kind(**values)


def read_model_file(path: Path, plant: str, tables: tuple[str, ...], models: Path) -> dict[str, Any]:
    """A plant's TOML with the shared parts merged under it.

    Raises:
      InputError: Wrong plant, or a parts file that does not exist.
      UnknownNameError: A table that this plant does not have.
    """
    own = read_toml(path)
    if own.get("plant") != plant:
        raise InputError(f"{path}: plant", f"found {own.get('plant')!r}", f"this file must say {plant!r}")
    parts_name = own.get("parts", "parts.toml")
    if not isinstance(parts_name, str):
        raise InputError(f"{path}: parts", f"found {parts_name!r}", "a file name is needed")
    beside = path.parent / parts_name
    merged = dict(read_toml(beside if beside.is_file() else models / parts_name))
    for key, value in own.items():
        if key in ("plant", "parts"):
            continue
        if key not in tables:
            raise UnknownNameError(path, "table", key, tables)
        if key in merged and isinstance(value, Mapping):
            value = {**merged[key], **value}
        merged[key] = value
    return merged
