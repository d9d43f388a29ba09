"""Entries of a scenario's file, one kind each."""

from __future__ import annotations

import math
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from omnimj.control.cascade.allocation import SCALES
from omnimj.control.detection.detector import OPTION_FLAGS, DetectorOptions, checked_options
from omnimj.errors import InputError, UnknownNameError
from omnimj.parameters.reading import Rule, check_number
from omnimj.resources import models_folder
from omnimj.simulate.kinematic import KinematicCase


def text_entry(tree: Mapping, key: str, place: str) -> str:
    """One line of text."""
    value = tree.get(key)
    if not isinstance(value, str) or not value or "\n" in value:
        found = "is missing" if value is None else f"found {value!r}"
        raise InputError(f"{place}: {key}", found, "one line of text is needed")
    return value


def number_entry(tree: Mapping, key: str, place: str, rule: Rule, default: float | None = None) -> float:
    """A number within its bounds; `default` where it is not there."""
    if key not in tree and default is None:
        raise InputError(f"{place}: {key}", "is missing", f"a number is needed that {rule}")
    return float(check_number(f"{place}: {key}", tree.get(key, default), rule))


def table_entries(tree: Mapping, key: str, place: str) -> list[Any]:
    """Tables under [[key]]."""
    tables = tree.get(key, [])
    if not isinstance(tables, list):
        rule = f"write [[{key}]], with two brackets on each side"
        raise InputError(f"{place}: {key}", f"found {tables!r}", rule)
    return tables


# Which robot or rig a scenario is about, where it is not the usual one.


def read_model_key(tree: Mapping, scenario: Path) -> Path | None:
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


# What stands around the robot: another MJCF scene with ramps, thresholds, height fields.


def read_scene_key(tree: Mapping, scenario: Path) -> Path | None:
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


# The `[diagnosis]` table of a scenario: which form of a method to use.

DIAGNOSIS_KEYS = ("variant", "thresholds", *OPTION_FLAGS)


def read_diagnosis(table: Any, place: str) -> DetectorOptions:
    """The form of a method; each key may be left out.

    `variant` and `thresholds` are those of `--method published`, `self_test` and `dither` of `--method
    robust`; `recovery` is for both.

    Raises:
      InputError: Not a table, or a flag is neither true nor false.
      UnknownNameError: A key, variant or set of thresholds that does not exist.
    """
    if not isinstance(table, Mapping):
        raise InputError(place, f"found {table!r}", "a table is needed", DIAGNOSIS_KEYS)
    for key in table:
        if key not in DIAGNOSIS_KEYS:
            raise UnknownNameError(place, "key", key, DIAGNOSIS_KEYS)
    usual = DetectorOptions()
    return checked_options(
        table.get("variant", usual.variant),
        table.get("thresholds", usual.thresholds),
        {name: table[name] for name in OPTION_FLAGS if name in table},
        place,
    )


# The `[kinematics]` table: what a run at the kinematic level has instead of forces, faults and floors.

KINEMATIC_KEYS = (
    "plant",
    "weights",
    "weights_from",
    "lost_wheel",
    "lost_from",
    "lost_wheel_turns_freely",
    "misalignment",
)

_WEIGHT = Rule(1e-9, 1e9, False)  # beyond, the weighted pseudo-inverse loses its digits
_TIME = Rule(0.0, math.inf, False)
_ANGLE = Rule(-0.5, 0.5, False)


def read_kinematics(table: Any, place: str, wheels: int) -> KinematicCase:
    """The `[kinematics]` table; every key may be left out.

    Args:
      table: `plant` (corrected or published), `weights` and `misalignment` with one number per wheel,
        `weights_from`, `lost_wheel`, `lost_from`, `lost_wheel_turns_freely`.
      place: What to call the table in messages.
      wheels: n.

    Raises:
      InputError: A value breaks its rule.
      UnknownNameError: A key or plant that does not exist.
    """
    if not isinstance(table, Mapping):
        raise InputError(place, f"found {table!r}", "a table is needed")
    for key in table:
        if key not in KINEMATIC_KEYS:
            raise UnknownNameError(place, "key", key, KINEMATIC_KEYS)
    plant = table.get("plant", "corrected")
    if plant not in tuple(SCALES):
        raise UnknownNameError(f"{place}.plant", "kinematic plant", plant, SCALES)
    freely = table.get("lost_wheel_turns_freely", False)
    if not isinstance(freely, bool):
        raise InputError(f"{place}.lost_wheel_turns_freely", f"found {freely!r}", "must be true or false")
    lost = table.get("lost_wheel")
    if lost is not None:
        lost = int(check_number(f"{place}.lost_wheel", lost, Rule(1, wheels, False), whole=True))
    for key in ("lost_from", "lost_wheel_turns_freely"):
        if key in table and lost is None:
            raise InputError(f"{place}.{key}", "there is no lost_wheel", "give both or neither")
    return KinematicCase(
        plant=plant,
        weights=_per_wheel(table, "weights", place, wheels, _WEIGHT, 1.0),
        weights_from=float(check_number(f"{place}.weights_from", table.get("weights_from", 0.0), _TIME)),
        lost_wheel=lost,
        lost_from=float(check_number(f"{place}.lost_from", table.get("lost_from", 0.0), _TIME)),
        lost_wheel_turns_freely=freely,
        misalignment=_per_wheel(table, "misalignment", place, wheels, _ANGLE, 0.0),
    )


def kinematic_faults(case: KinematicCase) -> list[dict[str, Any]]:
    """Misaligned axles and lost demand as `metrics.json` holds faults."""
    records: list[dict[str, Any]] = [
        {"kind": "misalignment", "wheel": wheel, "onset": 0.0, "end": None, "angle": angle}
        for wheel, angle in enumerate(case.misalignment, start=1)
        if angle != 0.0
    ]
    if case.lost_wheel is not None:
        lost = {"kind": "demand_lost", "wheel": case.lost_wheel, "onset": case.lost_from, "end": None}
        records.append(lost)
    return records


def _per_wheel(
    table: Mapping, key: str, place: str, wheels: int, rule: Rule, default: float
) -> tuple[float, ...]:
    values = table.get(key, [default] * wheels)
    if not isinstance(values, list) or len(values) != wheels:
        raise InputError(f"{place}.{key}", f"found {values!r}", f"{wheels} numbers are needed, one per wheel")
    return tuple(float(check_number(f"{place}.{key}[{i}]", value, rule)) for i, value in enumerate(values))
