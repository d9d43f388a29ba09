"""Files of identification and validation: `floors.toml`, `identification.json` and `validation.json`."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import numpy as np

import omnimj
from omnimj.estimate.identification.records import (
    CONFIDENCE,
    Cell,
    Estimate,
    Identification,
    IdentifiedFloor,
    SteadyCurve,
    Validation,
)
from omnimj.parameters import Floor
from omnimj.parameters.floor import FLOOR_UNITS, format_floor, printable_line
from omnimj.recording.json_files import rounded, rounded_list, write_text

FLOORS_FILE, JSON_FILE = "floors.toml", "identification.json"
_LEAST_UNCERTAINTY = 0.01


def write_floors(path: Path, identification: Identification) -> None:
    """Write one entry per floor in the format of `models/floors.toml` (see `parameters.read_floors`)."""
    write_text(path, floors_text(identification))


def floors_text(identification: Identification) -> str:
    """Content of `floors.toml`.

    `uncertainty` is the relative half-width of the curve's band, since the runs determine the curve.
    """
    head = (
        f"# Floors identified from {printable_line(str(identification.dataset))} by omnimj "
        f"{omnimj.__version__}."
    )
    entries = [format_floor(_as_floor(floor), floor.undetermined) for floor in identification.floors]
    return "\n".join([f"{head}\n{FLOOR_UNITS} Intervals in {JSON_FILE}.\n", *entries])


def _as_floor(floor: IdentifiedFloor) -> Floor:
    low, high = floor.curve.covered
    settled = f"slip {low:.3g} to {high:.3g} m/s" if math.isfinite(low) else "no settled slip"
    source = f"identified: {len(floor.runs)} runs, {settled}"
    words = floor.floor.replace("_", " ")
    return Floor(floor.floor, words, "lugre", source, floor.numbers, _uncertainty(floor.curve))


def identification_content(identification: Identification, command: str = "") -> dict[str, Any]:
    """Content of `identification.json`; open ends of intervals and non-finite numbers are null."""
    return {
        "dataset": str(identification.dataset),
        "model": str(identification.model),
        "omnimj": omnimj.__version__,
        "command": command,
        "confidence": CONFIDENCE,
        "interrupted": identification.interrupted,
        "notes": list(identification.notes),
        "floors": {floor.floor: _floor(floor) for floor in identification.floors},
    }


def _floor(floor: IdentifiedFloor) -> dict[str, Any]:
    curve = floor.curve
    return {
        "law": "lugre",
        "parameters": {e.name: _estimate(e) for e in floor.estimates},
        "undetermined": list(floor.undetermined),
        "slip_range": [rounded(end) for end in curve.covered],
        "curve": _curve(curve),
        "rms": {name: rounded(value) for name, value in floor.rms.items()},
        "runs": list(floor.runs),
        "left_out": list(floor.left_out),
        "masses": list(floor.masses),
        "radius_scale": rounded(floor.radius_scale),
        "samples": floor.samples,
        "effective_samples": rounded(floor.effective_samples),
        "clusters": floor.clusters,
    }


def _curve(curve: SteadyCurve) -> dict[str, Any]:
    """Curve over the covered slip; the whole curve where nothing is covered."""
    low = curve.covered[0]
    within = curve.slip >= low if math.isfinite(low) else curve.slip > 0.0
    names = {"traction_ratio": "ratio"} | {n: n for n in ("low", "high", "level", "level_low", "level_high")}
    columns = {"slip": "slip", **names}
    return {name: rounded_list(getattr(curve, own)[within]) for name, own in columns.items()}


def _estimate(estimate: Estimate) -> dict[str, Any]:
    low, high = (None if end is None else rounded(end) for end in (estimate.low, estimate.high))
    return {"value": rounded(estimate.value), "low": low, "high": high, "unit": estimate.unit}


def _uncertainty(curve: SteadyCurve) -> float:
    low = curve.covered[0]
    within = curve.slip >= low if math.isfinite(low) else np.ones(len(curve.slip), dtype=bool)
    half = np.max(((curve.high - curve.low) / (2.0 * curve.ratio))[within])
    return min(max(math.ceil(1000.0 * half) / 1000.0, _LEAST_UNCERTAINTY), 1.0)


def validation_content(validation: Validation, command: str = "") -> dict[str, Any]:
    """Content of `validation.json`; all errors in m/s and rad/s, null where nothing was measured."""
    return {
        "dataset": str(validation.dataset),
        "model": str(validation.model),
        "effects": list(validation.effects),
        "omnimj": omnimj.__version__,
        "command": command,
        "interrupted": validation.interrupted,
        "notes": list(validation.notes),
        "plants": list(validation.plants),
        "mean": {plant: rounded(validation.mean(plant)) for plant in validation.plants},
        "table": [_cell(cell) for cell in validation.cells],
        "runs": [
            {
                "run": run.run,
                "plant": run.plant,
                "floor": run.floor,
                "mass": run.mass,
                "lateral_speed": rounded(run.lateral_speed),
                "current": rounded(run.current),
                "carriage_speed_rms": rounded(run.carriage_rms),
                "wheel_speed_rms": rounded(run.wheel_rms),
            }
            for run in validation.runs
        ],
    }


def _cell(cell: Cell) -> dict[str, Any]:
    content: dict[str, Any] = {
        "floor": cell.floor,
        "mass": cell.mass,
        "lateral_speed": cell.lateral_speed,
        "current": cell.current,
        "runs": list(cell.runs),
        "carriage_speed_rms": {plant: rounded(value) for plant, value in cell.rms.items()},
        "wheel_speed_rms": {plant: rounded(value) for plant, value in cell.wheel_rms.items()},
        "published": None,
    }
    if len(cell.published) == 1:
        content["published"] = {"table_4_2": cell.published[0]}
    elif cell.published:
        content["published"] = {"table_4_3": cell.published[0], "table_4_4": cell.published[1]}
    return content
