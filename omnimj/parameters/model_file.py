"""Model files: the TOML file of a plant, which overrides that of the shared parts, and its effects.

Only the form of the tables `[effects.NAME]` is checked here; `omnimj.effects` checks names, units and bounds
when a machine is built (`check_effects`).
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from omnimj.errors import InputError, UnknownNameError
from omnimj.parameters.mjcf_model import read_model_tree
from omnimj.parameters.parts import Bearing, Contact, Motor, Sensors, Wheel
from omnimj.parameters.reading import (
    Provenance,
    Rule,
    check_number,
    read_provenance,
    read_table,
    read_toml,
    require_keys,
)
from omnimj.resources import models_folder

EffectValues = Mapping[str, Mapping[str, float | str | int]]
"""Effect → parameter or selector → value."""

_FINITE = Rule(-math.inf, math.inf, False)

SHARED_TABLES = {"wheel": Wheel, "bearing": Bearing, "motor": Motor, "contact": Contact, "sensors": Sensors}
"""Tables of the parts file, common to robot and rig, and their records; a model file may override entries."""


@dataclass(frozen=True)
class ModelFile:
    """Parsed model file and parts file; an entry of the model file overrides that of the parts."""

    path: Path
    """Path of the model file."""
    parts_path: Path
    own: Mapping[str, Any]
    parts: Mapping[str, Any]

    def table(self, kind: type, name: str, provenance: dict[str, Provenance]) -> Any:
        """Read a table of quantities into the dataclass `kind`.

        Args:
          kind: Dataclass whose fields come from `quantity` and `positive`.
          name: Name of the table in the file.
          provenance: Mapping to which `name.key` → unit and source is added.

        Raises:
          InputError: A key is missing or its value breaks the rule; the message names its file.
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

    def shared_parts(self, provenance: dict[str, Provenance]) -> dict[str, Any]:
        """Read all tables of `SHARED_TABLES`: name → record; arguments and errors as for `table`."""
        return {name: self.table(kind, name, provenance) for name, kind in SHARED_TABLES.items()}


def model_path(given: Path | str | None, default: str) -> Path:
    """Path of a model file, given a path or the name of a shipped model, such as `three_wheel`.

    Args:
      given: Path or name; None for the default.
      default: Path of the plant's default model file inside the shipped models.

    Raises:
      UnknownNameError: A bare name that is neither a file nor a shipped model of this plant.
    """
    folder, file = models_folder(), Path(default).name
    if given is None:
        return folder / default
    given = Path(given)
    if len(given.parts) != 1 or given.suffix or given.is_file():
        return given
    if not (folder / given / file).is_file():
        if given.exists():
            return given
        shipped = sorted(p.parent.name for p in folder.glob(f"*/{file}"))
        raise UnknownNameError("--model", f"shipped {file}", str(given), (*shipped, "the path of a file"))
    return folder / given / file


def read_model_file(path: Path, plant: str, own_tables: tuple[str, ...]) -> ModelFile:
    """Read the model file of a plant and the parts file that it names, beside it or else shipped.

    Args:
      path: The model file, or an MJCF file that holds one.
      plant: Kind of plant that the file must describe.
      own_tables: Tables specific to this plant.

    Raises:
      InputError: Wrong plant, or a parts file that does not exist.
      UnknownNameError: A table that this plant, or the parts, do not have.
    """
    own = read_model_tree(path)
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
    require_keys(path, own, ("plant", "parts", *own_tables, *SHARED_TABLES), "table")
    require_keys(parts_path, parts, tuple(SHARED_TABLES), "table")
    return ModelFile(path, parts_path, own, parts)


def read_effects(
    tree: Mapping[str, Any], path: Path, provenance: dict[str, Provenance]
) -> dict[str, dict[str, float | str | int]]:
    """Read the values of all tables `[effects.NAME]` of a parsed model file.

    A parameter is `{ value, unit, source }` with optional `low`, `high` (its interval) and `uncertainty`; a
    selector is a plain text or whole number.

    Args:
      tree: Whole parsed file.
      path: Path of the file, for messages.
      provenance: Mapping to which `effects.NAME.PARAMETER` → unit and source is added.

    Raises:
      InputError: A table or entry has a wrong form, or an interval does not contain its value.
      UnknownNameError: The key or source of an entry is unknown.
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
    origin = read_provenance(place, entry, None, ("low", "high"))
    value = float(check_number(place, entry["value"], _FINITE))
    low = check_number(f"{place}.low", entry.get("low", value), _FINITE)
    high = check_number(f"{place}.high", entry.get("high", value), _FINITE)
    if not low <= value <= high:
        raise InputError(place, f"found {value:g}", f"must lie between its low {low:g} and high {high:g}")
    half = 0.5 * (high - low) if "low" in entry and "high" in entry else 0.0
    provenance[key] = origin._replace(uncertainty=origin.uncertainty or half)
    return value
