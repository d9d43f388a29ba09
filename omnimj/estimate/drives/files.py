"""Content of `validation.json` for the drives of a robot."""

from __future__ import annotations

import math
from typing import Any

import omnimj
from omnimj.estimate.drives.records import DriveValidation, Group, RunNumbers
from omnimj.signals import Array

_DIGITS = 6


def drives_content(found: DriveValidation, command: str = "") -> dict[str, Any]:
    """Content of `validation.json`: SI units, errors of speeds and lengths as ratios, null: unknown."""
    return {
        "dataset": str(found.dataset),
        "model": str(found.model),
        "effects": list(found.effects),
        "omnimj": omnimj.__version__,
        "command": command,
        "interrupted": found.interrupted,
        "notes": [*found.marker_notes, *found.notes],
        "plants": list(found.plants),
        "marker_angle": {
            plant: {floor: None if angle is None else _number(angle) for floor, angle in angles.items()}
            for plant, angles in found.marker.items()
        },
        "table": [_group(group) for group in found.groups],
        "runs": [_run(run) for run in found.numbers],
    }


def _group(group: Group) -> dict[str, Any]:
    return {
        "floor": group.floor,
        "plant": group.plant,
        "runs": list(group.runs),
        "wheel_rolling": _number(group.wheel_rolling),
        "measured_speed": _number(group.measured_speed),
        "simulated_speed": _number(group.simulated_speed),
        "velocity_error": _number(group.velocity_error),
        "measured_current": _numbers(group.measured_current),
        "current_error": _numbers(group.current_error),
        "measured_yaw_rate": _number(group.measured_yaw_rate),
        "yaw_rate_error": _number(group.yaw_rate_error),
        "end_by_measured_heading": _number(group.end_by_measured_heading),
        "end_by_own_heading": _number(group.end_by_own_heading),
    }


def _run(run: RunNumbers) -> dict[str, Any]:
    names = ("measured", "simulated", "measured_currents", "simulated_currents")
    lengths = ("wheel_rolling", "path", "end_by_measured_heading", "end_by_own_heading")
    return (
        {"run": run.run, "plant": run.plant, "floor": run.floor}
        | {name: _numbers(getattr(run, name)) for name in names}
        | {name: _number(getattr(run, name)) for name in lengths}
    )


def _number(value: float) -> float | None:
    return float(f"{value:.{_DIGITS}g}") if math.isfinite(value) else None


def _numbers(values: Array) -> list[float | None]:
    return [_number(value) for value in values.tolist()]
