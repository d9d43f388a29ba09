"""`validation.json`: the table and the runs behind it."""

from __future__ import annotations

import json
import math
from pathlib import Path
from typing import Any

import omnimj
from omnimj.identification.records import Cell, Validation
from omnimj.recording.folder import whole_file


def write_validation(path: Path, told: dict[str, Any]) -> None:
    """Writes `validation.json`."""
    with whole_file(path) as temporary:
        temporary.write_text(json.dumps(told, indent=2, ensure_ascii=False) + "\n", encoding="utf-8")


def as_json(validation: Validation, command: str = "") -> dict[str, Any]:
    """The content of `validation.json`; all errors in m/s and rad/s, null where nothing was measured."""
    return {
        "dataset": str(validation.dataset),
        "model": str(validation.model),
        "effects": list(validation.effects),
        "omnimj": omnimj.__version__,
        "command": command,
        "interrupted": validation.interrupted,
        "notes": list(validation.notes),
        "plants": list(validation.plants),
        "mean": {plant: _number(validation.mean(plant)) for plant in validation.plants},
        "table": [_cell(cell) for cell in validation.cells],
        "runs": [
            {
                "run": run.run,
                "plant": run.plant,
                "floor": run.floor,
                "mass": run.mass,
                "lateral_speed": _number(run.lateral_speed),
                "current": _number(run.current),
                "carriage_speed_rms": _number(run.carriage_rms),
                "wheel_speed_rms": _number(run.wheel_rms),
            }
            for run in validation.runs
        ],
    }


def _cell(cell: Cell) -> dict[str, Any]:
    told: dict[str, Any] = {
        "floor": cell.floor,
        "mass": cell.mass,
        "lateral_speed": cell.lateral_speed,
        "current": cell.current,
        "runs": list(cell.runs),
        "carriage_speed_rms": {plant: _number(value) for plant, value in cell.rms.items()},
        "wheel_speed_rms": {plant: _number(value) for plant, value in cell.wheel_rms.items()},
        "published": None,
    }
    if len(cell.published) == 1:
        told["published"] = {"table_4_2": cell.published[0]}
    elif cell.published:
        told["published"] = {"table_4_3": cell.published[0], "table_4_4": cell.published[1]}
    return told


def _number(value: float) -> float | None:
    return float(f"{value:.6g}") if math.isfinite(value) else None
