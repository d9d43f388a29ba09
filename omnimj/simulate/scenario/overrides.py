"""Overrides `--set KEY=VALUE`, applied to a scenario before it is validated, and the keys that exist."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from typing import Any

from omnimj.errors import InputError, UnknownNameError
from omnimj.parameters.reading import parse_toml
from omnimj.plant.faults import FAULT_KINDS
from omnimj.plant.ground import PATCH_KEYS
from omnimj.simulate.metrics import metric_units
from omnimj.simulate.scenario.checks import BOUNDS, METHODS
from omnimj.simulate.scenario.drive import DRIVE_KEYS
from omnimj.simulate.scenario.tables import DIAGNOSIS_KEYS, KINEMATIC_KEYS

KnownKeys = Mapping[str, tuple[str, ...]]
"""Keys that may be set although the file lacks them, by table (`""` top level, `drive`, `faults.*`, …)."""

_COMMON = (
    *("description", "plant", "model", "floors", "floor", "duration", "faults", "checks", "equations"),
    "diagnosis",
)
ROBOT_KEYS = (*_COMMON, "level", "drive", "patches", "kinematics", "scene")
RIG_KEYS = (*_COMMON, "current", "mass", "lateral_speed")


@contextmanager
def attribute_to_overrides(file: str, overrides: Sequence[str]) -> Iterator[None]:
    """Context in which an error in an overridden value names `--set` instead of the file.

    Args:
      file: Name of the file, with which its error messages begin.
      overrides: `KEY=VALUE` texts.
    """
    try:
        yield
    except InputError as error:
        message = str(error).removeprefix(f"{file}: ")
        keys = [text.partition("=")[0].strip() for text in overrides]
        if any(re.match(rf"{re.escape(key)}\b", message) for key in keys if key):
            error.args = (f"--set {message}",)
        raise


def split_override(text: str) -> tuple[str, Any]:
    """Split `KEY=VALUE` into dotted key and value.

    The value is a TOML value, otherwise a bare string: `faults.0.loss=0.57`, `floor=pvc`.

    Raises:
      InputError: No `=`, or an empty part in the key.
    """
    key, equals, value = text.partition("=")
    key = key.strip()
    if not equals or not all(key.split(".")):
        raise InputError(f"--set {text!r}", "is not KEY=VALUE", "e.g. --set faults.0.wheel=3")
    return key, _parse(value.strip())


def _parse(text: str) -> Any:
    try:
        parsed = parse_toml(f"value = {text}")
    except (ValueError, RecursionError):  # not TOML, a number too long, nested too deep
        return text
    # a value with a line break could add more keys
    return parsed["value"] if set(parsed) == {"value"} else text


def apply_override(tree: dict[str, Any], key: str, value: Any, known: KnownKeys) -> None:
    """Set one dotted key in the tree, in place.

    A key can be set if the file has it or if it is a known key of its table; any other key is refused, as it
    would be a typing error.

    Raises:
      InputError: An index out of range, or a key below something that is not a table.
      UnknownNameError: No such key; the message lists the known ones.
    """
    node: Any = tree
    parts = key.split(".")
    table = ""
    for depth, part in enumerate(parts):
        last = depth == len(parts) - 1
        place = f"--set {key}"
        if isinstance(node, list):
            slot: Any = _index(place, ".".join(parts[:depth]), part, node)
            table += ".*"
        elif isinstance(node, dict):
            _require_key(place, part, node, known.get(table, ()))
            slot = part
            table = f"{table}.{part}" if table else part
            if not last and part not in node:
                node[part] = [] if f"{table}.*" in known else {}
        else:
            raise InputError(
                place, f"'{'.'.join(parts[:depth])}' is a single value", "it has no keys below it"
            )
        if last:
            node[slot] = value
        else:
            node = node[slot]


def _require_key(place: str, part: str, node: dict[str, Any], known: tuple[str, ...]) -> None:
    if part not in node and part not in known:
        raise UnknownNameError(place, "key", part, dict.fromkeys((*node, *known)))


def _index(place: str, name: str, part: str, entries: list[Any]) -> int:
    count = len(entries)
    if not part.isascii() or not part.isdigit():
        raise InputError(place, f"{part!r} is not an index", f"'{name}' is a list of {count}, counted from 0")
    # thousands of digits are out of range, and slow to convert
    index = int(part) if len(part) < 10 else count
    if index >= count:
        rule = f"the last is {name}.{count - 1}" if count else "there is none to change"
        raise InputError(place, f"there is no {name}.{part}", f"'{name}' has {count}, counted from 0, {rule}")
    return index


def known_keys(plant: str, wheels: int) -> KnownKeys:
    """Keys that a scenario of this plant may have, grouped by table.

    Whether a key suits the kind of fault, drive or plant is checked when the table is read.
    """
    if plant == "quarter_rig":
        metrics = tuple(metric_units(plant, wheels, False, False))
        tables: dict[str, tuple[str, ...]] = {"": RIG_KEYS}
    else:
        metrics = tuple(metric_units(plant, wheels, True, False))
        tables = {"": ROBOT_KEYS, "drive": DRIVE_KEYS, "patches.*": PATCH_KEYS, "kinematics": KINEMATIC_KEYS}
    own = (key for kind in FAULT_KINDS.values() for key in kind.own_keys)
    tables["faults.*"] = tuple(dict.fromkeys(("kind", "wheel", "onset", "end", *own)))
    tables["diagnosis"] = DIAGNOSIS_KEYS
    tables["checks"] = (*metrics, *METHODS)
    for place in ("checks", *(f"checks.{method}" for method in METHODS)):
        tables |= {f"{place}.{name}": BOUNDS for name in metrics}
    return {**tables, **{f"checks.{method}": metrics for method in METHODS}}
