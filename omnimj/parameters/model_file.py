"""A model file: one plant's TOML over the file of the parts that plants share."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from omnimj.errors import InputError, UnknownNameError
from omnimj.parameters.reading import Provenance, Rule, check_number, read_provenance, read_table, read_toml
from omnimj.resources import models_folder

SHARED_TABLES = ("wheel", "bearing", "motor", "contact", "sensors")
"""What robot and rig have in common; the parts file holds these tables, a model file may override them."""


@dataclass(frozen=True)
class ModelFile:
    """Both files as parsed; an entry of the plant's own file goes before the same entry of the parts."""

    path: Path
    """The plant's own file."""
    parts_path: Path
    own: Mapping[str, Any]
    parts: Mapping[str, Any]

    def table(self, kind: type, name: str, provenance: dict[str, Provenance]) -> Any:
        """A table of quantities as an instance of the dataclass `kind`.

        Raises:
          InputError: A key is missing or its value breaks the rule; the message names the file it stands in.
          UnknownNameError: A key that `kind` does not have.
        """
        own, parts = self.own.get(name), self.parts.get(name)
        if own is not None and not isinstance(own, Mapping):
            raise InputError(self.path, f"[{name}] is not a table")
        if parts is not None and not isinstance(parts, Mapping):
            raise InputError(self.parts_path, f"[{name}] is not a table")
        if own is None and parts is None:
            raise InputError(self.path, f"[{name}] is missing")
        entries = {**(parts or {}), **(own or {})}

        def home(key: str) -> Path:
            return (
                self.parts_path if own is None or (parts and key in parts and key not in own) else self.path
            )

        return read_table(kind, entries, home, provenance, name)


def model_path(asked: Path | None, usual: str) -> Path:
    """Where a model file is: a path as it is, or the name of a shipped model, such as `three_wheel`.

    Args:
      asked: What was asked for; the usual one when None.
      usual: Path of the plant's usual model file inside the shipped models.

    Raises:
      UnknownNameError: A bare name that is neither a file nor a shipped model of this plant.
    """
    folder, file = models_folder(), Path(usual).name
    if asked is None:
        return folder / usual
    if len(asked.parts) != 1 or asked.suffix or asked.exists():
        return asked
    if not (folder / asked / file).is_file():
        shipped = sorted(p.parent.name for p in folder.glob(f"*/{file}"))
        raise UnknownNameError("--model", f"shipped {file}", str(asked), (*shipped, "the path of a file"))
    return folder / asked / file


def read_model_file(path: Path, plant: str, own_tables: tuple[str, ...]) -> ModelFile:
    """Reads a plant's TOML and the parts it names: a file beside it, or else one of the shipped models.

    Args:
      path: The model file.
      plant: What it must be a model of.
      own_tables: Tables of this plant alone.

    Raises:
      InputError: Wrong plant, or a parts file that does not exist.
      UnknownNameError: A table that this plant, or the parts, do not have.
    """
    own = read_toml(path)
    if own.get("plant") != plant:
        raise InputError(f"{path}: plant", f"found {own.get('plant')!r}", f"this file must say {plant!r}")
    name = own.get("parts", "parts.toml")
    if not isinstance(name, str):
        raise InputError(f"{path}: parts", f"found {name!r}", "a file name is needed")
    parts_path = path.parent / name
    if not parts_path.is_file():
        parts_path = models_folder() / name
    if not parts_path.is_file():
        rule = f"no such file beside it or in {models_folder()}"
        raise InputError(f"{path}: parts", f"found {name!r}", rule)
    parts = read_toml(parts_path)
    _require_known(path, own, ("plant", "parts", *own_tables, *SHARED_TABLES))
    _require_known(parts_path, parts, SHARED_TABLES)
    return ModelFile(path, parts_path, own, parts)


def _require_known(path: Path, tree: Mapping[str, Any], known: tuple[str, ...]) -> None:
    for key in tree:
        if key not in known:
            raise UnknownNameError(path, "table", key, known)


# The tables `[effects.NAME]` of a model file: what lies on top of the model's constants.

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
    provenance[key] = read_provenance(place, entry, None, ("low", "high"))
    value = float(check_number(place, entry["value"], _FINITE))
    low = check_number(f"{place}.low", entry.get("low", value), _FINITE)
    high = check_number(f"{place}.high", entry.get("high", value), _FINITE)
    if not low <= value <= high:
        raise InputError(place, f"found {value:g}", f"must lie between its low {low:g} and high {high:g}")
    return value
