"""Shipped scenarios; a module without slow imports, so that they are listed at once."""

from __future__ import annotations

import os
from pathlib import Path

from omnimj.errors import InputError, UnknownNameError
from omnimj.parameters.reading import read_toml
from omnimj.resources import scenarios_folder


def scenario_names() -> list[str]:
    """Sorted names of the shipped scenarios."""
    return sorted(path.stem for path in scenarios_folder().glob("*.toml"))


def list_scenarios() -> dict[str, str]:
    """One-line descriptions of the shipped scenarios by name, sorted.

    Raises:
      InputError: A scenario file is not TOML.
    """
    described = {}
    for name in scenario_names():
        content = read_toml(scenarios_folder() / f"{name}.toml")
        described[name] = " ".join(str(content.get("description", "")).split())
    return described


def find_scenario(name_or_path: str | Path) -> Path:
    """Find the file of a shipped scenario by name, or any TOML file by path.

    A text that contains a folder or ends in `.toml` is a path.

    Raises:
      InputError: No file has this path.
      UnknownNameError: No shipped scenario has this name.
    """
    text = os.fspath(name_or_path)
    path = Path(text)
    if isinstance(name_or_path, Path) or path.suffix == ".toml" or len(path.parts) > 1:
        if not path.exists():
            rule = "give the path of a file, or a name without a folder and without .toml"
            raise InputError(text, "no such scenario file", rule, scenario_names())
        return path
    names = scenario_names()
    if text not in names:
        raise UnknownNameError("SCENARIO", "scenario", text, names)
    return scenarios_folder() / f"{text}.toml"
