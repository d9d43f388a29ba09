"""The robot's parameters declared uncertain: constants, floors, and the small lags of its channels."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from types import MappingProxyType

from omnimj.gap.replay import BaseParameter
from omnimj.parameters import Floor, Robot
from omnimj.signals import Array

LAGS = ("wheel_speed", "acceleration", "yaw_rate", "yaw")
"""Kinds of channels whose clock may be off that of the currents."""

_LAG = 0.004  # [s] by which a channel may be late or early before it is called a delay
_FLOOR_LETTERS = {"mu_c": ("mu_c", "mu_s", "D"), "sigma_0": ("sigma_0", "B"), "sigma_2": ("sigma_2",)}
"""What is scaled together."""


@dataclass(frozen=True)
class Based:
    """A robot with the values of its uncertain parameters."""

    robot: Robot
    floors: dict[str, Floor]
    lags: dict[str, float]
    """Kind of channel → lateness [s]."""


def base_parameters(
    robot: Robot, floors: Mapping[str, Floor], used: Sequence[str]
) -> tuple[BaseParameter, ...]:
    """Every quantity with an uncertainty, the floors in use, the channels' lags.

    Args:
      robot: The model.
      floors: Floors by name.
      used: Names of the floors that the runs were driven on.
    """
    found = []
    for name, origin in robot.provenance.items():
        table, _, key = name.partition(".")
        value = getattr(getattr(robot, table, None), key, None)
        if origin.uncertainty > 0.0 and isinstance(value, float):
            low = max(value - origin.uncertainty, 0.0) if value >= 0.0 else value - origin.uncertainty
            found.append(BaseParameter(name, origin.unit, value, low, value + origin.uncertainty))
    for floor in dict.fromkeys(used):
        half = floors[floor].uncertainty
        for letter, together in _FLOOR_LETTERS.items():
            if half > 0.0 and any(key in floors[floor].numbers for key in together):
                words = f"{letter} over that of {floor}"
                found.append(BaseParameter(f"{floor}.{letter}", "1", 1.0, 1.0 - half, 1.0 + half, words))
    found += [BaseParameter(f"{n}.lag", "s", 0.0, -_LAG, _LAG, f"lateness of {n}") for n in LAGS]
    return tuple(found)


def with_base(
    robot: Robot, floors: Mapping[str, Floor], base: Sequence[BaseParameter], values: Array
) -> Based:
    """The robot with other values of its uncertain parameters."""
    tables: dict[str, dict[str, float]] = {}
    scales: dict[str, dict[str, float]] = {}
    lags: dict[str, float] = {}
    for parameter, number in zip(base, values, strict=True):
        table, _, key = parameter.name.rpartition(".")
        if key == "lag":
            lags[table] = float(number)
        elif table in floors:
            scales.setdefault(table, {})[key] = float(number)
        else:
            tables.setdefault(table, {})[key] = float(number)
    changed = {name: dataclasses.replace(getattr(robot, name), **entries) for name, entries in tables.items()}
    return Based(
        dataclasses.replace(robot, **changed) if changed else robot,
        {name: _scaled(floor, scales.get(name, {})) for name, floor in floors.items()},
        lags,
    )


def _scaled(floor: Floor, scales: Mapping[str, float]) -> Floor:
    if not scales:
        return floor
    numbers = dict(floor.numbers)
    for letter, scale in scales.items():
        for key in _FLOOR_LETTERS[letter]:
            if key in numbers:
                numbers[key] *= scale
    return dataclasses.replace(floor, numbers=MappingProxyType(numbers))
