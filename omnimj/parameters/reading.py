"""TOML files and their tables of quantities, read into frozen dataclasses with the source of each number.

A quantity is `name = { value = …, unit = "…", source = "text | datasheet | chosen | …" }`, from `SOURCES`.
"""

from __future__ import annotations

import contextlib
import dataclasses
import functools
import math
import pickle
import stat
import tomllib
from collections.abc import Callable, Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

from omnimj.errors import InputError, UnknownNameError

MAX_TOML_SIZE = 16 * 2**20
"""Largest TOML file that is read [bytes]."""
_MOST_KEPT, _LONGEST_KEPT = 64, 2**18  # texts that are kept parsed, and their letters
SOURCES = ("text", "datasheet", "chosen", "measured", "identified", "tuned")


class Provenance(NamedTuple):
    """Unit, source and uncertainty of a number."""

    unit: str
    source: str
    uncertainty: float = 0.0
    """Half-width of the interval, in the same unit; 0: taken as exact."""


class Rule(NamedTuple):
    """Bounds of a quantity; `open_low` excludes the lower bound."""

    low: float
    high: float
    open_low: bool

    def broken_by(self, value: float) -> bool:
        """True if a number breaks the rule."""
        below = value <= self.low if self.open_low else value < self.low
        return not math.isfinite(value) or below or value > self.high

    def __str__(self) -> str:
        if self.low == -math.inf and self.high == math.inf:
            return "must be finite"
        low = f"{'above' if self.open_low else 'at least'} {self.low:g}" if self.low > -math.inf else ""
        high = f"at most {self.high:g}" if self.high < math.inf else ""
        return "must be " + " and ".join(part for part in (low, high) if part)


_NOT_NEGATIVE = Rule(0.0, math.inf, False)
_INTEGERS = range(-(2**63), 2**63)
_NEEDED = ("value", "unit", "source")


def quantity(
    unit: str,
    low: float = -math.inf,
    high: float = math.inf,
    *,
    open_low: bool = False,
    default: Any = dataclasses.MISSING,
) -> Any:
    """Declare a dataclass field with its unit, its bounds and an optional default.

    Args:
      unit: Unit in which model files give the value.
      low: Smallest value.
      high: Largest value.
      open_low: True if `low` itself is not allowed.
      default: Value where a model file does not give one; without it the value is required.
    """
    return dataclasses.field(default=default, metadata={"unit": unit, "rule": Rule(low, high, open_low)})


def positive(unit: str, high: float = math.inf, *, default: Any = dataclasses.MISSING) -> Any:
    """Declare a quantity above zero."""
    return quantity(unit, 0.0, high, open_low=True, default=default)


def check_number(place: str, value: Any, rule: Rule, whole: bool = False) -> float | int:
    """Check one number against its rule.

    Args:
      place: File and key, for messages.
      value: Parsed number.
      rule: Bounds of the number.
      whole: Whether it must be a whole number.

    Raises:
      InputError: Not a number, not whole although required, or outside the bounds.
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


def check_table(place: str, value: Any) -> Mapping[str, Any]:
    """Check that a value is a table.

    Raises:
      InputError: It is not.
    """
    if not isinstance(value, Mapping):
        raise InputError(place, f"found {value!r}", "a table is needed")
    return value


def require_keys(place: object, table: Mapping[str, Any], keys: Sequence[str], kind: str = "key") -> None:
    """Check that a table has no other keys than these.

    Args:
      place: File or table, for messages.
      table: Parsed table.
      keys: Known keys.
      kind: What the keys are, such as `table`.

    Raises:
      UnknownNameError: An unknown key; the message lists the known ones.
    """
    for key in table:
        if key not in keys:
            raise UnknownNameError(place, kind, key, keys)


def check_choice(place: object, value: Any, choices: Iterable[str], kind: str) -> str:
    """Check that a value is one of the choices, which are of this kind, such as `unit`.

    Raises:
      UnknownNameError: It is not; the message lists the choices.
    """
    choices = tuple(choices)
    if value not in choices:
        raise UnknownNameError(place, kind, value, choices)
    return value


def check_flag(place: str, value: Any) -> bool:
    """Check that a value is true or false.

    Raises:
      InputError: It is not.
    """
    if not isinstance(value, bool):
        raise InputError(place, f"found {value!r}", "must be true or false")
    return value


def check_text(place: str, value: Any) -> str:
    """Check that a value is a string that is not blank.

    Raises:
      InputError: It is not.
    """
    if not isinstance(value, str) or not value.strip():
        raise InputError(place, f"found {value!r}", "a string is needed")
    return value


def read_quantity(place: str, entry: Any, spec: dataclasses.Field) -> tuple[Any, Provenance]:
    """Read one entry `{ value, unit, source }`, optionally with `uncertainty`, by the rule of its field."""
    unit, rule = spec.metadata["unit"], spec.metadata["rule"]
    origin = read_provenance(place, entry, unit)
    value = entry["value"]
    kind = str(spec.type)
    if kind.startswith("tuple"):
        if not isinstance(value, list) or not value:
            raise InputError(place, f"found {value!r}", "a list of numbers is needed")
        value = tuple(check_number(f"{place}[{i}]", v, rule) for i, v in enumerate(value))
    else:
        value = check_number(place, value, rule, whole=kind == "int")
    return value, origin


def read_provenance(place: str, entry: Any, unit: str | None, more: tuple[str, ...] = ()) -> Provenance:
    """Read unit, source and uncertainty of one entry; the caller reads its value.

    Args:
      place: File and key, for messages.
      entry: Parsed entry.
      unit: Required unit; None: any text.
      more: Further allowed keys.

    Raises:
      InputError: No table, or a key is missing or wrong.
      UnknownNameError: An unknown key or source.
    """
    shape = f'write {{ value = …, unit = "{"…" if unit is None else unit}", source = "…" }}'
    known = (*_NEEDED, "uncertainty", *more)
    if not isinstance(entry, Mapping):
        raise InputError(place, f"found {entry!r}", shape)
    require_keys(place, entry, known)
    for key in _NEEDED:
        if key not in entry:
            raise InputError(place, f"'{key}' is missing", shape)
    found = entry["unit"]
    if found != unit if unit is not None else not isinstance(found, str):
        rule = "a string is needed" if unit is None else f"the unit is {unit!r}"
        raise InputError(f"{place}.unit", f"found {found!r}", rule)
    if entry["source"] not in SOURCES:
        raise UnknownNameError(f"{place}.source", "source", entry["source"], SOURCES)
    uncertainty = float(check_number(f"{place}.uncertainty", entry.get("uncertainty", 0.0), _NOT_NEGATIVE))
    return Provenance(entry["unit"], entry["source"], uncertainty)


def read_table(
    kind: type,
    table: Any,
    file_of: Callable[[str], Path],
    provenance: dict[str, Provenance],
    prefix: str,
) -> Any:
    """Read a table of quantities into the dataclass `kind`.

    Args:
      kind: Dataclass whose fields come from `quantity` and `positive`.
      table: The parsed TOML table.
      file_of: Function that returns the file in which a key is written, for messages.
      provenance: Mapping to which `prefix.key` → unit and source is added.
      prefix: Name of the table in the file.

    Raises:
      InputError: A key is missing or its value breaks the rule.
      UnknownNameError: A key that `kind` does not have.
    """
    fields = {f.name: f for f in dataclasses.fields(kind)}
    if not isinstance(table, Mapping):
        raise InputError(file_of(""), f"[{prefix}] is not a table")
    for key in table:
        if key not in fields:
            raise UnknownNameError(f"{file_of(key)}: [{prefix}]", "key", key, fields)
    values = {}
    for name, spec in fields.items():
        if name not in table and spec.default is not dataclasses.MISSING:
            continue
        if name not in table:
            raise InputError(f"{file_of(name)}: [{prefix}]", f"'{name}' is missing")
        values[name], provenance[f"{prefix}.{name}"] = read_quantity(
            f"{file_of(name)}: {prefix}.{name}", table[name], spec
        )
    return kind(**values)


def read_toml(path: Path) -> dict[str, Any]:
    """Parse a TOML file.

    Args:
      path: Path of the file; a byte order mark, as some editors write it, is skipped.

    Raises:
      InputError: The file is missing, cannot be read, is too large, no regular file or not TOML; the message
        names file and line.
    """
    content = read_regular_file(path, "a TOML file")
    try:
        # a TOML file has no byte order mark, but some editors write one
        return parse_toml(content.decode("utf-8-sig"))
    except UnicodeDecodeError as error:
        rule = f"it is not UTF-8 text, at byte {error.start}"
        raise InputError(path, "is not valid TOML", rule) from None
    except RecursionError:
        raise InputError(path, "is not valid TOML", "it is nested too deeply") from None
    except ValueError as error:
        raise InputError(path, "is not valid TOML", str(error)) from None


def read_regular_file(path: Path, needed: str) -> bytes:
    """Read a file of limited size; a pipe or a device might never end, or never begin.

    Args:
      path: Path of the file.
      needed: What is needed in the place of a folder, such as `a TOML file`.

    Raises:
      InputError: The file is missing, cannot be read, is too large or no regular file.
    """
    try:
        return _read_regular_file(path)
    except InputError:
        raise
    except FileNotFoundError:
        raise InputError(path, "no such file") from None
    except IsADirectoryError:
        raise InputError(path, "is a folder", f"{needed} is needed") from None
    except OSError as error:
        raise InputError(path, f"cannot be read ({error.strerror})") from None
    except ValueError:  # a null byte
        raise InputError(path, "is not a valid file name") from None


def _read_regular_file(path: Path) -> bytes:
    status = path.stat()
    if stat.S_ISDIR(status.st_mode):
        raise IsADirectoryError
    if not stat.S_ISREG(status.st_mode):
        raise InputError(path, "is a pipe or a device", "a regular file is needed")
    if status.st_size > MAX_TOML_SIZE:
        raise InputError(path, f"has {status.st_size} bytes", f"at most {MAX_TOML_SIZE} are read")
    return path.read_bytes()


def parse_toml(text: str) -> dict[str, Any]:
    """Parse TOML text; unlike Python's parser, reject integers beyond the 64 bits of TOML 1.0.

    Raises:
      ValueError: The text is not TOML.
      RecursionError: The text is nested too deeply.
    """
    if len(text) <= _LONGEST_KEPT:
        with contextlib.suppress(RecursionError):  # deeper than pickle goes
            return pickle.loads(_pickled_tree(text))
    return _tree(text)


@functools.lru_cache(_MOST_KEPT)
def _pickled_tree(text: str) -> bytes:
    """Parsed text; studies read the same files for each trial, and parsing takes fifty times as long."""
    return pickle.dumps(_tree(text))


def _tree(text: str) -> dict[str, Any]:
    tree = tomllib.loads(text)
    waiting: list[Any] = [tree]
    while waiting:  # no recursion: dotted keys nest to any depth
        node = waiting.pop()
        if isinstance(node, Mapping):
            waiting.extend(node.values())
        elif isinstance(node, list):
            waiting.extend(node)
        elif isinstance(node, int) and node not in _INTEGERS:
            # it may be too large for a float, and even to be printed
            raise ValueError("a whole number has more than 64 bits")
    return tree
