"""What stands around the robot: another MJCF scene with ramps, thresholds, height fields."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

from omnimj.errors import InputError, UnknownNameError
from omnimj.resources import models_folder


def read_scene(tree: Mapping, scenario: Path) -> Path | None:
    """The `scene` of a scenario: `"obstacles"` is a file of `models/uto_robot`, `"own.xml"` lies beside it.

    Args:
      tree: The scenario's top level.
      scenario: Its file.

    Returns:
      The MJCF file; None for the flat floor.

    Raises:
      InputError: Not a text, no such file, or a scenario without ground.
      UnknownNameError: No shipped scene of that name; the message lists them.
    """
    if "scene" not in tree:
        return None
    place = f"{scenario.name}: scene"
    name = tree["scene"]
    if not isinstance(name, str):
        raise InputError(place, f"found {name!r}", "a text is needed")
    if tree.get("level") == "kinematic":
        raise InputError(place, f"found {name!r}", "the kinematic level has no ground")
    if name.endswith(".xml"):
        path = scenario.parent / name
        if not path.is_file():
            raise InputError(place, f"found {name!r}", f"there is no file {path}")
        return path
    shipped = {p.stem: p for p in (models_folder() / "uto_robot").glob("*.xml") if p.stem != "uto_robot"}
    if name not in shipped:
        raise UnknownNameError(place, "scene", name, shipped)
    return shipped[name]
