"""Copies of model files that keep the text of the original, with changed values and added effects."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

import tomlkit
from tomlkit.exceptions import TOMLKitError
from tomlkit.items import InlineTable, Table

from omnimj.effects.catalogue import effects_of, find_effect
from omnimj.effects.effect import AXIS, Effect, Interval
from omnimj.effects.machine import complete_values
from omnimj.errors import InputError, UnknownNameError
from omnimj.parameters.mjcf_model import is_mjcf, read_model_tree
from omnimj.parameters.model_file import SHARED_TABLES
from omnimj.parameters.reading import parse_toml, read_toml
from omnimj.resources import models_folder

EffectEstimates = Mapping[str, Mapping[str, "float | int | str | Interval"]]
"""Effect → parameter (a number, or an estimate with its interval) or selector → value."""


def format_model(
    file: Path,
    effects: EffectEstimates,
    changed: Mapping[str, float | Iterable[float] | Interval] | None = None,
) -> str:
    """Text of a model file with changed values and effects.

    Comments, order and all else of the original are kept; of an MJCF file, the model file inside. Changed
    values get the source "identified"; for a value of the parts file an overriding entry is added. A table
    `[effects.NAME]` of the original is replaced where `effects` has the same name, and kept otherwise.

    Args:
      file: The model file to start from.
      effects: Effects to add.
      changed: `table.key` → new value, such as `motor.torque_constant`; one with an interval gets half its
        width as `uncertainty`.

    Raises:
      InputError: A value out of bounds, or a file that cannot be edited.
      UnknownNameError: An effect, parameter or key that the model does not have.
    """
    tree = read_model_tree(file)
    plant = str(tree.get("plant"))
    known = effects_of(plant)
    parts_file = _parts_path(tree, file)
    has_parts = plant != AXIS and parts_file.is_file()
    parts = read_toml(parts_file) if has_parts else {}
    try:
        own = tomlkit.dumps(tree) if is_mjcf(file) else file.read_text(encoding="utf-8-sig")
        document = tomlkit.parse(own)
        if has_parts and parts_file.parent != models_folder():
            document["parts"] = parts_file.absolute().as_posix()  # found from any folder
        for name, value in (changed or {}).items():
            _replace_value(document, name, value, parts, file)
        for name, values in effects.items():
            effect = find_effect(name, plant, file)
            _replace_effect(document, name, _effect_table(name, known[effect.name], values, file))
        text = tomlkit.dumps(document)
    except TOMLKitError as error:
        raise InputError(file, f"its text cannot be changed ({error})") from None
    _verify_written(text, effects, changed or {}, file)
    return text


def _parts_path(tree: Mapping[str, Any], file: Path) -> Path:
    name = str(tree.get("parts", "parts.toml"))
    beside = file.parent / name
    return beside if beside.is_file() else models_folder() / name


def _replace_value(
    document: tomlkit.TOMLDocument,
    name: str,
    value: float | Iterable[float] | Interval,
    parts: Mapping[str, Any],
    file: Path,
) -> None:
    """Replace the value of a quantity, or add an entry that overrides the parts."""
    table, _, key = name.partition(".")
    own: Any = document.get(table, {})
    shared = parts.get(table, {}) if table in SHARED_TABLES else {}
    written = isinstance(own, Mapping) and (key in own or key in shared)
    if not isinstance(own, Mapping) or not (written or _unit_of_default(table, key)):
        tables = [(t, e) for where in (document, parts) for t, e in where.items() if isinstance(e, Mapping)]
        known = dict.fromkeys(f"{t}.{k}" for t, entries in tables for k in entries)
        raise UnknownNameError(f"{file}: changed value", "quantity", name, known)
    if key in own:
        own[key]["value"], own[key]["source"] = _plain(value), "identified"
        if isinstance(value, Interval):
            own[key]["uncertainty"] = _half_width(value)
        return
    old = shared[key] if key in shared else {"unit": _unit_of_default(table, key)}
    entry = tomlkit.inline_table()
    entry.update({"value": _plain(value), "unit": old["unit"], "source": "identified"})
    if isinstance(value, Interval):
        entry["uncertainty"] = _half_width(value)
    elif "uncertainty" in old:
        entry["uncertainty"] = old["uncertainty"]
    if table not in document:
        document[table] = tomlkit.table()
    table_of: Any = document[table]
    table_of[key] = entry


def _unit_of_default(table: str, key: str) -> str | None:
    """Unit of a quantity of the shared parts that a model file may leave out; None for any other key."""
    kind = SHARED_TABLES.get(table)
    for field in dataclasses.fields(kind) if kind is not None else ():
        if field.name == key and field.default is not dataclasses.MISSING:
            return str(field.metadata["unit"])
    return None


def _half_width(estimate: Interval) -> float:
    low = estimate.value if estimate.low is None else estimate.low
    high = estimate.value if estimate.high is None else estimate.high
    return 0.5 * (high - low)


def _plain(value: float | Iterable[float] | Interval) -> float | list[float]:
    if isinstance(value, Interval):
        return value.value
    return [float(v) for v in value] if isinstance(value, Iterable) else float(value)


def _replace_effect(document: tomlkit.TOMLDocument, name: str, table: Table) -> None:
    """Append a table `[effects.NAME]`, replacing one of the same name."""
    if "effects" not in document:
        document["effects"] = tomlkit.table(is_super_table=True)
    effects: Any = document["effects"]
    effects.pop(name, None)
    effects[name] = table


def _effect_table(name: str, effect: Effect, values: Mapping[str, Any], file: Path) -> Table:
    """Table `[effects.NAME]` with every parameter written out."""
    plain = {key: v.value if isinstance(v, Interval) else v for key, v in values.items()}
    full = complete_values(effect, plain, f"{file}: effects.{name}", partial=False)
    table = tomlkit.table()
    table.comment(effect.words)
    for selector in effect.selectors:
        if selector.name in full:
            table[selector.name] = full[selector.name]
    for parameter in effect.parameters:
        table[parameter.name] = effect_entry(
            float(full[parameter.name]), parameter.unit, values.get(parameter.name)
        )
    return table


def effect_entry(value: float, unit: str, given: object) -> InlineTable:
    """Entry of a parameter of an identified effect, with its interval where `given` has one."""
    entry = tomlkit.inline_table()
    entry.update({"value": value, "unit": unit, "source": "identified"})
    if isinstance(given, Interval):
        for bound in ("low", "high"):
            limit = getattr(given, bound)
            if limit is not None and math.isfinite(limit):
                entry[bound] = float(limit)
    return entry


def _verify_written(
    text: str,
    effects: EffectEstimates,
    changed: Mapping[str, float | Iterable[float] | Interval],
    file: Path,
) -> None:
    """Parse the text again and check that it contains the values to be written."""
    try:
        tree = parse_toml(text)
        for name in effects:
            tree["effects"][name]
        for name, value in changed.items():
            table, _, key = name.partition(".")
            if tree[table][key]["value"] != _plain(value):
                raise KeyError(name)
    except (KeyError, TypeError, ValueError) as error:
        raise InputError(file, f"its text cannot be changed ({error})") from None
