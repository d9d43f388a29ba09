"""A model file: one plant's TOML over the file of the parts that plants share."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from omnimj.errors import InputError, UnknownNameError
from omnimj.parameters.reading import Provenance, read_table
from omnimj.parameters.toml_file import read_toml
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
