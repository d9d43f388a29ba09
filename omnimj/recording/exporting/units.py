"""Units of the columns of traces and datasets, and names for tools that accept fewer signs."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable

from omnimj.recording.importing.units import target_unit

_N = r"(_\d+)?"
_UNITS = (
    # beyond the measured columns, which `target_unit` knows
    (rf"(target|true)_wheel_speed{_N}|target_yaw_rate|twist_yaw|gyro_bias", "rad/s"),
    (r"heading_estimate|target_heading|tilt", "rad"),
    (rf"(target_)?twist_[xy]|target_velocity_[xy]|slip_velocity{_N}|true_(carriage_speed|velocity)", "m/s"),
    (r"target_[xy]|place_error_[xy]|lateral_position|true_position", "m"),
    (rf"(normal|traction|lateral)_force{_N}|(residual|threshold)_force(_[xy])?", "N"),
    (r"residual_moment", "Nm"),
    (rf"(residual|threshold)_wheel_speed{_N}", "rad/s"),
    (rf"(residual|threshold)_slip{_N}", "m"),
    (rf"(residual|threshold)_motor{_N}", "1"),  # log likelihood ratio
    (rf"(effectiveness|limit_reason|weight){_N}|misfit|mode|recovery|pace", "1"),
)
_LONGEST_MATLAB = 63
_MATLAB_WORDS = (
    *("break", "case", "catch", "classdef", "continue", "else", "elseif", "end", "for", "function", "global"),
    *("if", "otherwise", "parfor", "persistent", "return", "spmd", "switch", "try", "while"),
)


def column_unit(name: str) -> str:
    """SI unit of a column; `1` for pure numbers, empty where it depends on the machine or is unknown."""
    return target_unit(name) or next((unit for pattern, unit in _UNITS if re.fullmatch(pattern, name)), "")


def ros_names(names: Iterable[str]) -> dict[str, str]:
    """Field names of a ROS message by column: small letters, digits and single underscores."""

    def valid(name: str) -> str:
        plain = re.sub(r"_+", "_", re.sub(r"[^a-z0-9]", "_", name.lower())).strip("_")
        return plain if plain[:1].isalpha() else f"column_{plain}".rstrip("_")

    return _distinct(names, valid)


def matlab_names(names: Iterable[str]) -> dict[str, str]:
    """Variable names for MATLAB by column: letters, digits and underscores, at most 63."""

    def valid(name: str) -> str:
        plain = re.sub(r"[^A-Za-z0-9_]", "_", name)
        plain = plain if plain[:1].isalpha() else f"column_{plain.lstrip('_')}"
        return (f"{plain}_" if plain in _MATLAB_WORDS else plain)[:_LONGEST_MATLAB]

    return _distinct(names, valid)


def _distinct(names: Iterable[str], valid: Callable[[str], str]) -> dict[str, str]:
    """Names made valid; a number is added to those that another column has."""
    found: dict[str, str] = {}
    taken: set[str] = set()
    for name in names:
        first = one = valid(name)
        count = 2
        while one in taken:
            ending = f"_{count}"
            one, count = f"{first[: _LONGEST_MATLAB - len(ending)]}{ending}", count + 1
        taken.add(one)
        found[name] = one
    return found
