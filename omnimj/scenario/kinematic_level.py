"""The `[kinematics]` table: what a run at the kinematic level has instead of forces, faults and floors."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

from omnimj.control.allocation import SCALES
from omnimj.errors import InputError, UnknownNameError
from omnimj.kinematic import KinematicCase
from omnimj.parameters.reading import Rule, number

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
        lost = int(number(f"{place}.lost_wheel", lost, Rule(1, wheels, False), whole=True))
    for key in ("lost_from", "lost_wheel_turns_freely"):
        if key in table and lost is None:
            raise InputError(f"{place}.{key}", "there is no lost_wheel", "give both or neither")
    return KinematicCase(
        plant=plant,
        weights=_each_wheel(table, "weights", place, wheels, _WEIGHT, 1.0),
        weights_from=float(number(f"{place}.weights_from", table.get("weights_from", 0.0), _TIME)),
        lost_wheel=lost,
        lost_from=float(number(f"{place}.lost_from", table.get("lost_from", 0.0), _TIME)),
        lost_wheel_turns_freely=freely,
        misalignment=_each_wheel(table, "misalignment", place, wheels, _ANGLE, 0.0),
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


def _each_wheel(
    table: Mapping, key: str, place: str, wheels: int, rule: Rule, default: float
) -> tuple[float, ...]:
    values = table.get(key, [default] * wheels)
    if not isinstance(values, list) or len(values) != wheels:
        raise InputError(f"{place}.{key}", f"found {values!r}", f"{wheels} numbers are needed, one per wheel")
    return tuple(float(number(f"{place}.{key}[{i}]", value, rule)) for i, value in enumerate(values))
