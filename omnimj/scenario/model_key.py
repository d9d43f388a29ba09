"""Which robot or rig a scenario is about, where it is not the usual one."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

from omnimj.errors import InputError


def own_model(tree: Mapping, scenario: Path) -> Path | None:
    """The `model` of a scenario: `"three_wheel"` is a shipped one, `"own.toml"` lies beside the scenario.

    Args:
      tree: The scenario's top level.
      scenario: Its file.

    Returns:
      A file, or the bare name of a shipped model; None for the plant's usual one.

    Raises:
      InputError: Not a text, or no such file.
    """
    name = tree.get("model")
    if name is None:
        return None
    place = f"{scenario.name}: model"
    if not isinstance(name, str) or not name:
        raise InputError(place, f"found {name!r}", "a text is needed")
    if not name.endswith(".toml"):
        return Path(name)
    path = scenario.parent / name
    if not path.is_file():
        raise InputError(place, f"found {name!r}", f"there is no file {path}")
    return path
