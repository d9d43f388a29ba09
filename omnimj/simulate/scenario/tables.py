"""Readers of single entries and small tables of a scenario file, each with its rules."""

from __future__ import annotations

import math
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from omnimj.control.cascade.allocation import SCALES
from omnimj.control.detection.detector import OPTION_FLAGS, THRESHOLD_SETS, VARIANTS, DetectorOptions
from omnimj.errors import InputError, UnknownNameError
from omnimj.parameters.mjcf_model import MJCF_SUFFIX
from omnimj.parameters.reading import Rule, check_choice, check_flag, check_number, require_keys
from omnimj.resources import models_folder
from omnimj.simulate.kinematic import KinematicCase

DIAGNOSIS_KEYS = ("variant", "thresholds", "floor", *OPTION_FLAGS)
KINEMATIC_KEYS = (
    "plant",
    "weights",
    "weights_from",
    "lost_wheel",
    "lost_from",
    "lost_wheel_turns_freely",
    "misalignment",
)
_WEIGHT = Rule(1e-9, 1e9, False)  # beyond it the weighted pseudo-inverse loses its precision
_TIME = Rule(0.0, math.inf, False)
_ANGLE = Rule(-0.5, 0.5, False)


def text_entry(tree: Mapping, key: str, place: str) -> str:
    """Text of a key, which must be a single line."""
    value = tree.get(key)
    if not isinstance(value, str) or not value or "\n" in value:
        found = "is missing" if value is None else f"found {value!r}"
        raise InputError(f"{place}: {key}", found, "must be one line of text")
    return value


def number_entry(tree: Mapping, key: str, place: str, rule: Rule, default: float | None = None) -> float:
    """Number of a key, checked against its rule, or the default."""
    if key not in tree and default is None:
        raise InputError(f"{place}: {key}", "is missing", f"a number is needed that {rule}")
    return float(check_number(f"{place}: {key}", tree.get(key, default), rule))


def table_entries(tree: Mapping, key: str, place: str) -> list[Any]:
    """List of tables `[[key]]`; empty if there are none."""
    tables = tree.get(key, [])
    if not isinstance(tables, list):
        rule = f"write [[{key}]], with two brackets on each side"
        raise InputError(f"{place}: {key}", f"found {tables!r}", rule)
    return tables


def _text_key(tree: Mapping, key: str, scenario: Path) -> str | None:
    """Text of a key at the top level of a scenario; None without the key."""
    name = tree.get(key)
    if name is not None and (not isinstance(name, str) or not name):
        raise InputError(f"{scenario.name}: {key}", f"found {name!r}", "a string is needed")
    return name


def read_model_key(tree: Mapping, scenario: Path) -> Path | None:
    """Read the key `model`: `"three_wheel"` is a shipped model, `"own.toml"` or `"own.xml"` a file.

    A file lies beside the scenario or, as `robotino/identified.toml`, in the folder of the shipped models.

    Returns:
      Path of a file, or the bare name of a shipped model; None for the plant's default one.
    """
    name = _text_key(tree, "model", scenario)
    if name is None:
        return None
    return _existing_file(name, "model", scenario) if name.endswith((".toml", MJCF_SUFFIX)) else Path(name)


def read_floors_key(tree: Mapping, scenario: Path) -> Path | None:
    """Read the key `floors`: a file beside the scenario or among the shipped models; None without the key."""
    name = _text_key(tree, "floors", scenario)
    return None if name is None else _existing_file(name, "floors", scenario)


def _existing_file(name: str, key: str, scenario: Path) -> Path:
    """File that a scenario names, beside it or else among the shipped models."""
    path = scenario.parent / name
    for file in (path, models_folder() / name):
        if file.is_file():
            return file
    raise InputError(f"{scenario.name}: {key}", f"found {name!r}", f"there is no file {path}")


def read_scene_key(tree: Mapping, scenario: Path) -> Path | None:
    """Read the key `scene`: `"obstacles"` is a shipped scene, `"own.xml"` a file beside the scenario.

    Returns:
      The MJCF file; None without the key, for the flat floor.
    """
    name, place = _text_key(tree, "scene", scenario), f"{scenario.name}: scene"
    if name is None:
        return None
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


def read_diagnosis(table: Any, place: str) -> DetectorOptions:
    """Read the `[diagnosis]` table: options of the diagnosis methods, all optional.

    `variant` and `thresholds` belong to `--method published`, `floor`, `self_test` and `dither` to
    `--method robust`, `recovery` to both.

    Raises:
      InputError: Not a table, a flag that is neither true nor false, or a floor that is no text.
      UnknownNameError: A key, variant or set of thresholds that does not exist.
    """
    if not isinstance(table, Mapping):
        raise InputError(place, f"found {table!r}", "a table is needed", DIAGNOSIS_KEYS)
    require_keys(place, table, DIAGNOSIS_KEYS)
    floor = table.get("floor")
    if floor is not None and not isinstance(floor, str):
        raise InputError(f"{place}.floor", f"found {floor!r}", "a string is needed")
    choices = {"variant": ("variant", VARIANTS), "thresholds": ("set of thresholds", THRESHOLD_SETS)}
    for key, (kind, known) in choices.items():
        if key in table:
            check_choice(f"{place}.{key}", table[key], known, kind)
    for name in OPTION_FLAGS:
        check_flag(f"{place}.{name}", table.get(name, False))
    return DetectorOptions(**table)


def read_kinematics(table: Any, place: str, wheels: int) -> KinematicCase:
    """Read the `[kinematics]` table; every key is optional.

    Args:
      table: `plant` (corrected or published), `weights` and `misalignment` with one number per wheel,
        `weights_from`, `lost_wheel`, `lost_from`, `lost_wheel_turns_freely`.
      place: Name of the table in messages.
      wheels: Number of wheels n.

    Raises:
      InputError: A value breaks its rule.
      UnknownNameError: A key or plant that does not exist.
    """
    if not isinstance(table, Mapping):
        raise InputError(place, f"found {table!r}", "a table is needed")
    require_keys(place, table, KINEMATIC_KEYS)
    plant = check_choice(f"{place}.plant", table.get("plant", "corrected"), SCALES, "kinematic plant")
    freely = check_flag(f"{place}.lost_wheel_turns_freely", table.get("lost_wheel_turns_freely", False))
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
    """Misaligned axles and a lost demand as fault records of `metrics.json`."""
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
