"""Entries of a scenario's file, one kind each."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from omnimj.errors import InputError
from omnimj.parameters.reading import Rule, number


def text_entry(tree: Mapping, key: str, place: str) -> str:
    """One line of text."""
    value = tree.get(key)
    if not isinstance(value, str) or not value or "\n" in value:
        found = "is missing" if value is None else f"found {value!r}"
        raise InputError(f"{place}: {key}", found, "one line of text is needed")
    return value


def entry(tree: Mapping, key: str, place: str, rule: Rule, default: float | None = None) -> float:
    """A number within its bounds; `default` where it is not there."""
    if key not in tree and default is None:
        raise InputError(f"{place}: {key}", "is missing", f"a number is needed that {rule}")
    return float(number(f"{place}: {key}", tree.get(key, default), rule))


def listed(tree: Mapping, key: str, place: str) -> list[Any]:
    """Tables under [[key]]."""
    tables = tree.get(key, [])
    if not isinstance(tables, list):
        rule = f"write [[{key}]], with two brackets on each side"
        raise InputError(f"{place}: {key}", f"found {tables!r}", rule)
    return tables
