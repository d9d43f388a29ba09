"""Numbers in JSON messages, and the units that their schema states."""

from __future__ import annotations

import json
import math
import re
from collections.abc import Iterator, Mapping
from typing import Any

from omnimj.recording.importing.topics.cdr import MOST_ENTRIES, NAME_FIELDS
from omnimj.recording.run_table import printable

_DEEPEST, _MOST_NUMBERS = 8, 1024
_NANOSECONDS = ("nsec", "nanosec", "nsecs", "nanoseconds")
_STAMP_FIELDS = ("stamp", "timestamp", "time")
_BRACKETED = re.compile(r"\[\s*([^\[\]]+?)\s*\]")


def read_json_message(payload: memoryview) -> tuple[int | None, tuple[Any, ...], list[float]]:
    """Read the numbers of one message.

    Returns:
      Stamp [ns], from `header.stamp`, `timestamp` or `stamp` with seconds and nanoseconds, None without one;
      the paths of the numbers; the numbers.

    Raises:
      ValueError: It is not a JSON object, or is nested too deeply.
    """
    try:
        content = json.loads(bytes(payload))
    except RecursionError:
        raise ValueError("the message is nested too deeply") from None
    if not isinstance(content, dict):
        raise ValueError("the message is no JSON object")
    stamp = _stamp(content)
    found: dict[str, float] = {}
    for path, value in _numbers(content, "", 0):
        found[path] = value
        if len(found) > _MOST_NUMBERS:
            raise ValueError(f"the message has more than {_MOST_NUMBERS} numbers")
    return stamp, tuple(found), list(found.values())


def _stamp(content: Mapping[str, Any]) -> int | None:
    """Stamp of a message [ns]; its parts are not columns."""
    header = content.get("header")
    for place in (header, content):
        if not isinstance(place, Mapping):
            continue
        for name in _STAMP_FIELDS:
            found = place.get(name)
            if isinstance(found, Mapping) and "sec" in found:
                nanoseconds = next((found[key] for key in _NANOSECONDS if key in found), 0)
                return _whole(found["sec"], nanoseconds)
    return None


def _whole(seconds: Any, nanoseconds: Any) -> int | None:
    try:
        return int(seconds) * 1_000_000_000 + int(nanoseconds)
    except (TypeError, ValueError, OverflowError):  # not a number, NaN, infinite
        return None


def _numbers(content: Any, path: str, depth: int) -> Iterator[tuple[str, float]]:
    if depth > _DEEPEST:
        return
    if isinstance(content, bool | int | float):
        yield path, to_float(content)
    elif isinstance(content, Mapping):
        names = next((content[n] for n in NAME_FIELDS if _is_names(content.get(n))), [])
        for key, value in content.items():
            if "covariance" in key or (key in (*_STAMP_FIELDS, "header") and isinstance(value, Mapping)):
                continue
            below = printable(f"{path}.{key}" if path else str(key))
            labels = names if isinstance(value, list) and len(value) == len(names) else []
            yield from (
                _entries(value, below, labels, depth)
                if isinstance(value, list)
                else _numbers(value, below, depth + 1)
            )


def _is_names(value: Any) -> bool:
    return (
        isinstance(value, list)
        and 0 < len(value) <= MOST_ENTRIES
        and all(isinstance(v, str) for v in value)
        and len(set(value)) == len(value)
    )


def _entries(entries: list[Any], path: str, labels: list[str], depth: int) -> Iterator[tuple[str, float]]:
    if len(entries) > MOST_ENTRIES:
        return
    for k, value in enumerate(entries):
        name = value.get("name") if isinstance(value, Mapping) else None
        label = printable(labels[k]) if labels else printable(name) if isinstance(name, str) else f"{k}"
        if not isinstance(value, list):
            yield from _numbers(value, f"{path}[{label}]", depth + 1)


def to_float(value: Any) -> float:
    """Convert a number; a whole number beyond the range of floating point is infinite."""
    try:
        return float(value)
    except OverflowError:
        return math.inf


def schema_units(text: str) -> dict[str, str]:
    """Units by path: the key `unit` of a property of a JSON schema, or brackets in its description.

    A schema that is not JSON has none.
    """
    try:
        schema = json.loads(text)
    except (ValueError, RecursionError):
        return {}
    found: dict[str, str] = {}
    _collect_units(schema, "", found, 0)
    return found


def _collect_units(schema: Any, path: str, found: dict[str, str], depth: int) -> None:
    properties = schema.get("properties") if isinstance(schema, Mapping) else None
    if not isinstance(properties, Mapping) or depth > _DEEPEST:
        return
    for name, one in properties.items():
        below = f"{path}.{name}" if path else str(name)
        if not isinstance(one, Mapping):
            continue
        bracketed = _BRACKETED.search(str(one.get("description", "")))
        unit = one.get("unit", bracketed[1] if bracketed else None)
        if isinstance(unit, str):
            found[below] = unit
        _collect_units(one, below, found, depth + 1)
