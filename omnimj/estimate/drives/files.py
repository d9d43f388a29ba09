"""Content of `validation.json` for the drives of a robot."""

from __future__ import annotations

from typing import Any

import omnimj
from omnimj.estimate.drives.records import DriveValidation, Group, RunNumbers
from omnimj.recording.json_files import rounded, rounded_list


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
            plant: {floor: None if angle is None else rounded(angle) for floor, angle in angles.items()}
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
        "wheel_rolling": rounded(group.wheel_rolling),
        "measured_speed": rounded(group.measured_speed),
        "simulated_speed": rounded(group.simulated_speed),
        "velocity_error": rounded(group.velocity_error),
        "measured_current": rounded_list(group.measured_current),
        "current_error": rounded_list(group.current_error),
        "measured_yaw_rate": rounded(group.measured_yaw_rate),
        "yaw_rate_error": rounded(group.yaw_rate_error),
        "end_by_measured_heading": rounded(group.end_by_measured_heading),
        "end_by_own_heading": rounded(group.end_by_own_heading),
    }


def _run(run: RunNumbers) -> dict[str, Any]:
    names = ("measured", "simulated", "measured_currents", "simulated_currents")
    lengths = ("wheel_rolling", "path", "end_by_measured_heading", "end_by_own_heading")
    return (
        {"run": run.run, "plant": run.plant, "floor": run.floor}
        | {name: rounded_list(getattr(run, name)) for name in names}
        | {name: rounded(getattr(run, name)) for name in lengths}
    )
