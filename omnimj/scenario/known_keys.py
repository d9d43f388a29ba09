"""Keys of a scenario file, by table: what `--set` may add and what a file may hold."""

from __future__ import annotations

from omnimj.plant.faults import KINDS
from omnimj.plant.patches import PATCH_KEYS
from omnimj.scenario.checks import BOUNDS, METHODS
from omnimj.scenario.diagnosis_table import DIAGNOSIS_KEYS
from omnimj.scenario.drive import DRIVE_KEYS
from omnimj.scenario.kinematic_level import KINEMATIC_KEYS
from omnimj.scenario.metrics import metric_units
from omnimj.scenario.overrides import KnownKeys

_COMMON = ("description", "plant", "model", "floor", "duration", "faults", "checks", "equations", "diagnosis")
ROBOT_KEYS = (*_COMMON, "level", "drive", "patches", "kinematics", "scene")
RIG_KEYS = (*_COMMON, "current", "mass", "lateral_speed")


def known_keys(plant: str, wheels: int) -> KnownKeys:
    """Keys that a scenario of this plant may have: `""` top level, `drive`, `faults.*` each fault, …

    Wide on purpose: whether a key fits this kind of fault, drive or plant is judged when the table is read.
    """
    if plant == "quarter_rig":
        metrics = tuple(metric_units(plant, wheels, False, False))
        tables: dict[str, tuple[str, ...]] = {"": RIG_KEYS}
    else:
        metrics = tuple(metric_units(plant, wheels, True, False))
        tables = {"": ROBOT_KEYS, "drive": DRIVE_KEYS, "patches.*": PATCH_KEYS, "kinematics": KINEMATIC_KEYS}
    own = (key for kind in KINDS.values() for key in kind.own_keys)
    tables["faults.*"] = tuple(dict.fromkeys(("kind", "wheel", "onset", "end", *own)))
    tables["diagnosis"] = DIAGNOSIS_KEYS
    tables["checks"] = (*metrics, *METHODS)
    for place in ("checks", *(f"checks.{method}" for method in METHODS)):
        tables |= {f"{place}.{name}": BOUNDS for name in metrics}
    return {**tables, **{f"checks.{method}": metrics for method in METHODS}}
