"""Writes model files: a copy of one, its own text kept, with changed values and effects on top."""

from __future__ import annotations

import json
import math
import os
import re
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from omnimj.effects.catalogue import effects_of, find_effect
from omnimj.effects.effect import AXIS, Effect
from omnimj.effects.machine import complete_values
from omnimj.errors import InputError, UnknownNameError
from omnimj.parameters.model_file import SHARED_TABLES
from omnimj.parameters.reading import parse_toml, read_toml
from omnimj.resources import models_folder

_HEADER = re.compile(r"\s*\[")
_VALUE = re.compile(r"value\s*=\s*(\[[^\]]*\]|[^,}\s]+)")
_SOURCE = re.compile(r'source\s*=\s*("[^"]*"|\'[^\']*\')')


@dataclass(frozen=True)
class FittedValue:
    """A fitted number and its interval."""

    value: float
    low: float | None = None
    high: float | None = None


EffectEstimates = Mapping[str, Mapping[str, "float | int | str | FittedValue"]]
"""Effect → parameter (a number, or an estimate with its interval) or selector → value."""


def format_model(
    file: Path, effects: EffectEstimates, changed: Mapping[str, float | Iterable[float]] | None = None
) -> str:
    """The text of a model file with changed values and effects.

    Comments and everything else of its own text stay; changed values get the source "identified"; a value
    that stands in the parts file gets an entry here, which goes before. A table `[effects.NAME]` that the
    file has already is replaced where `effects` has the same name, and kept elsewhere.

    Args:
      file: The model file to start from.
      effects: What to put on top.
      changed: `table.key` → new value, such as `motor.torque_constant`.

    Raises:
      InputError: A value out of bounds, or a file whose text cannot be changed line by line.
      UnknownNameError: An effect, parameter or key that the model does not have.
    """
    tree = read_toml(file)
    plant = str(tree.get("plant"))
    known = effects_of(plant)
    lines = file.read_text(encoding="utf-8-sig").splitlines()
    lines = _resolve_parts_path(lines, tree, file)
    parts = _parts_of(tree, file)
    for name, value in (changed or {}).items():
        lines = _replace_value(lines, name, value, tree, parts, file)
    for name in effects:
        if name in tree.get("effects", {}):
            lines = _remove_table(lines, f"effects.{name}")
    for name, values in effects.items():
        effect = find_effect(name, plant, file)
        lines += ["", *_effect_table(name, known[effect.name], values, file)]
    text = "\n".join(lines) + "\n"
    _verify_written(text, effects, changed or {}, file)
    return text


def write_model(
    path: Path,
    file: Path,
    effects: EffectEstimates,
    changed: Mapping[str, float | Iterable[float]] | None = None,
) -> None:
    """Writes `format_model` as a file: whole, or not at all.

    Raises:
      InputError: As `format_model`, or the file cannot be written.
      UnknownNameError: As `format_model`.
    """
    text = format_model(file, effects, changed)
    temporary = path.with_name(f".{path.stem}.{os.getpid()}{path.suffix}")
    try:
        temporary.write_text(text, encoding="utf-8")
        temporary.replace(path)
    except OSError as error:
        raise InputError(path, f"cannot be written ({error.strerror})") from None
    finally:
        temporary.unlink(missing_ok=True)


def _parts_path(tree: Mapping[str, Any], file: Path) -> Path:
    name = str(tree.get("parts", "parts.toml"))
    beside = file.parent / name
    return beside if beside.is_file() else models_folder() / name


def _parts_of(tree: Mapping[str, Any], file: Path) -> Mapping[str, Any]:
    path = _parts_path(tree, file)
    return read_toml(path) if tree.get("plant") != AXIS and path.is_file() else {}


def _resolve_parts_path(lines: list[str], tree: Mapping[str, Any], file: Path) -> list[str]:
    """A copy in another folder must find the parts that lie beside the original."""
    path = _parts_path(tree, file)
    if tree.get("plant") == AXIS or not path.is_file() or path.parent == models_folder():
        return lines
    entry = f"parts = {json.dumps(path.absolute().as_posix())}"
    for k, line in enumerate(lines):
        if re.match(r"\s*parts\s*=", line):
            return [*lines[:k], entry, *lines[k + 1 :]]
        if _HEADER.match(line):
            return [*lines[:k], entry, *lines[k:]]
    return [*lines, entry]


def _table_at(lines: list[str], name: str) -> tuple[int, int] | None:
    """First line below the header of a table and the line after its last."""
    header = re.compile(rf"\s*\[\s*{re.escape(name)}\s*\]\s*(#.*)?$")
    for k, line in enumerate(lines):
        if header.match(line):
            end = next((j for j in range(k + 1, len(lines)) if _HEADER.match(lines[j])), len(lines))
            return k + 1, end
    return None


def _remove_table(lines: list[str], name: str) -> list[str]:
    found = _table_at(lines, name)
    return lines if found is None else lines[: found[0] - 1] + lines[found[1] :]


def _replace_value(
    lines: list[str],
    name: str,
    value: float | Iterable[float],
    tree: Mapping[str, Any],
    parts: Mapping[str, Any],
    file: Path,
) -> list[str]:
    """The lines with one quantity's value replaced, or with an entry that overrides the parts."""
    table, _, key = name.partition(".")
    own = tree.get(table, {})
    shared = parts.get(table, {}) if table in SHARED_TABLES else {}
    if not isinstance(own, Mapping) or not (key in own or key in shared):
        known = [
            f"{t}.{k}"
            for where in (tree, parts)
            for t, e in where.items()
            if isinstance(e, Mapping)
            for k in e
        ]
        raise UnknownNameError(f"{file}: changed value", "quantity", name, dict.fromkeys(known))
    number = _number(value)
    found = _table_at(lines, table)
    if key in own and found is not None:
        entry = re.compile(rf"\s*{re.escape(key)}\s*=")
        for k in range(*found):
            if entry.match(lines[k]):
                line = _VALUE.sub(f"value = {number}", lines[k], count=1)
                line = _SOURCE.sub('source = "identified"', line, count=1)
                return [*lines[:k], line, *lines[k + 1 :]]
    old = {**shared, **own}[key]
    more = f", uncertainty = {old['uncertainty']!r}" if "uncertainty" in old else ""
    line = f'{key} = {{ value = {number}, unit = {json.dumps(old["unit"])}, source = "identified"{more} }}'
    if found is None:
        return [*lines, "", f"[{table}]", line]
    return [*lines[: found[0]], line, *lines[found[0] :]]


def _number(value: float | Iterable[float]) -> str:
    return (
        "[" + ", ".join(repr(float(v)) for v in value) + "]"
        if isinstance(value, Iterable)
        else repr(float(value))
    )


def _effect_table(name: str, effect: Effect, values: Mapping[str, Any], file: Path) -> list[str]:
    """Lines of one `[effects.NAME]` table, every parameter written out."""
    plain = {key: v.value if isinstance(v, FittedValue) else v for key, v in values.items()}
    full = complete_values(effect, plain, f"{file}: effects.{name}", partial=False)
    lines = [f"[effects.{name}] # {effect.words}"]
    lines += [f"{selector.name} = {json.dumps(full[selector.name])}" for selector in effect.selectors]
    for parameter in effect.parameters:
        given = values.get(parameter.name)
        entry = f"value = {float(full[parameter.name])!r}, unit = {json.dumps(parameter.unit)}"
        entry += ', source = "identified"'
        if isinstance(given, FittedValue):
            for bound in ("low", "high"):
                limit = getattr(given, bound)
                if limit is not None and math.isfinite(limit):
                    entry += f", {bound} = {float(limit)!r}"
        lines.append(f"{parameter.name} = {{ {entry} }}")
    return lines


def _verify_written(
    text: str, effects: EffectEstimates, changed: Mapping[str, float | Iterable[float]], file: Path
) -> None:
    """Reads the text again: TOML can be laid out in ways that a change line by line does not reach."""
    try:
        tree = parse_toml(text)
        for name in effects:
            tree["effects"][name]
        for name, value in changed.items():
            table, _, key = name.partition(".")
            found = tree[table][key]["value"]
            if found != (list(map(float, value)) if isinstance(value, Iterable) else float(value)):
                raise ValueError(name)
    except (ValueError, KeyError, TypeError) as error:
        rule = "write its tables as [name] with one entry a line"
        raise InputError(file, f"its text cannot be changed ({error})", rule) from None
