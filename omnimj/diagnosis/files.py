"""`diagnoses.json`: what a method says of each run of a dataset."""

from __future__ import annotations

import dataclasses
import json
import math
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import omnimj
from omnimj.control.detection.robust.thresholds import THRESHOLD_UNITS
from omnimj.diagnosis.calibration import ADVISED_HOURS, Calibration
from omnimj.diagnosis.replay import DiagnosisConfig, RunDiagnosis
from omnimj.recording.dataset import Dataset
from omnimj.recording.folder import atomic_file
from omnimj.signals import Diagnosis


def diagnoses_json(
    order: DiagnosisConfig, found: Sequence[RunDiagnosis], command: str, interrupted: bool
) -> dict[str, Any]:
    """The content of `diagnoses.json`.

    Args:
      order: What was asked for.
      found: Runs that were finished.
      command: The command line that makes it again.
      interrupted: Whether runs are missing.
    """
    return {
        "dataset": str(order.dataset.path),
        "plant": order.dataset.plant,
        "model": str(order.machine.constants.file),
        "method": order.method,
        "thresholds": None if order.thresholds is None else dataclasses.asdict(order.thresholds),
        "observer": None if order.observer is None else dataclasses.asdict(order.observer),
        "version": omnimj.__version__,
        "command": command,
        "interrupted": interrupted,
        "notes": list(order.dataset.notes),
        "runs": {
            one.name: {
                "diagnoses": [diagnosis_record(diagnosis) for diagnosis in one.diagnoses],
                "cannot_judge": one.cannot_judge,
                "judged": one.judged,
                "notes": list(one.notes),
            }
            for one in found
        },
    }


def diagnosis_record(diagnosis: Diagnosis) -> dict[str, Any]:
    """One diagnosis with lists where JSON has no tuples, and null where it has no NaN."""
    plain = dataclasses.asdict(diagnosis)
    return {key: _plain(value) for key, value in plain.items()}


def _plain(value: Any) -> Any:
    if isinstance(value, tuple):
        return [_plain(one) for one in value]
    if isinstance(value, str) or value is None:
        return value
    if isinstance(value, int) and not isinstance(value, bool):
        return int(value)
    return float(value) if math.isfinite(value) else None


def write_diagnoses(path: Path, told: dict[str, Any]) -> None:
    """Writes `diagnoses.json`, in full or not at all."""
    with atomic_file(path) as temporary:
        temporary.write_text(
            json.dumps(told, indent=2, ensure_ascii=False, allow_nan=False) + "\n", encoding="utf-8"
        )


# A calibration as `thresholds.toml`, as JSON, and in words.


def calibration_json(found: Calibration, dataset: Dataset, command: str) -> dict[str, Any]:
    """What `--json` prints."""
    return {
        "dataset": str(dataset.path),
        "false_alarms_per_hour": found.rate,
        "hours": found.hours,
        "extrapolated": found.extrapolated,
        "runs": found.runs,
        "floors": list(found.floors),
        "thresholds": {
            one.name: {
                "value": one.value,
                "unit": THRESHOLD_UNITS[one.name],
                "largest": one.tail.largest,
                "tail": one.tail.slope,
                "floor": one.floor,
            }
            for one in found.set
        },
        "still_diagnosed": dict(found.told),
        "warnings": calibration_warnings(found),
        "version": omnimj.__version__,
        "command": command,
    }


def thresholds_toml(found: Calibration, dataset: Dataset, command: str) -> str:
    """The content of `thresholds.toml`; every number comes back bit for bit."""
    lines = ["# Thresholds of the robust method from fault-free recordings; what is not here is as shipped."]
    lines += [f"# {words}" for words in format_calibration(found)]
    lines += ["", "[thresholds]"]
    for one in found.set:
        unit = THRESHOLD_UNITS[one.name]
        lines.append(f'{one.name} = {{ value = {one.value!r}, unit = "{unit}", source = "measured" }}')
    lines += [
        "",
        "[calibration]",
        f"false_alarms_per_hour = {found.rate!r}",
        f"hours = {found.hours!r}",
        f"runs = {found.runs}",
        f"dataset = {_quoted(str(dataset.path))}",
        f"version = {_quoted(omnimj.__version__)}",
        f"command = {_quoted(command)}",
    ]
    for key, value in (("largest", "largest"), ("tail", "slope"), ("floor", None)):
        lines += ["", f"[calibration.{key}]"]
        for one in found.set:
            number = one.floor if value is None else getattr(one.tail, value)
            lines.append(f"{one.name} = {float(number)!r}")
    return "\n".join(lines) + "\n"


def _quoted(text: str) -> str:
    """A basic string of TOML; JSON's escapes are among TOML's."""
    return json.dumps(text).replace("\x7f", "\\u007f")


def format_calibration(found: Calibration) -> list[str]:
    """How far these thresholds may be trusted."""
    once = f"one in {1.0 / found.rate:.3g} h"
    if found.extrapolated <= 1.0:
        reach = "the recordings are longer than that"
    else:
        reach = f"extrapolated {found.extrapolated:.3g}-fold along exponential tails"
    where = (
        f"they hold for what was recorded, here on {', '.join(found.floors)}, and promise nothing elsewhere"
    )
    asked = f"{found.rate:g} false alarms per hour of motion ({once})"
    return [f"{asked} from {found.hours:.3g} h of motion: {reach}", where, *calibration_warnings(found)]


def calibration_warnings(found: Calibration) -> list[str]:
    """What a reader must know, one sentence each."""
    said = []
    if found.hours < ADVISED_HOURS:
        said.append(
            f"warning: {found.hours:.3g} h of motion are less than {ADVISED_HOURS:g} h; "
            "record longer before these thresholds are relied on"
        )
    for name, many in found.told:
        diagnoses = "diagnosis" if many == 1 else "diagnoses"
        said.append(f"warning: in run {name} there would still be {many} {diagnoses}: is it free of faults?")
    return said


def write_thresholds(path: Path, text: str) -> None:
    """Writes the file, in full or not at all."""
    path.parent.mkdir(parents=True, exist_ok=True)
    with atomic_file(path) as temporary:
        temporary.write_text(text, encoding="utf-8", newline="\n")
