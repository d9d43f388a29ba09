"""A calibration as `thresholds.toml`, as JSON, and in words."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import omnimj
from omnimj.control.robust.thresholds_file import UNITS
from omnimj.diagnosis.calibrate import ENOUGH, Calibration
from omnimj.recording.dataset import Dataset
from omnimj.recording.folder import whole_file


def as_json(found: Calibration, dataset: Dataset, command: str) -> dict[str, Any]:
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
                "unit": UNITS[one.name],
                "largest": one.tail.largest,
                "tail": one.tail.slope,
                "floor": one.floor,
            }
            for one in found.set
        },
        "still_diagnosed": dict(found.told),
        "warnings": warnings(found),
        "version": omnimj.__version__,
        "command": command,
    }


def as_toml(found: Calibration, dataset: Dataset, command: str) -> str:
    """The content of `thresholds.toml`; every number comes back bit for bit."""
    lines = ["# Thresholds of the robust method from fault-free recordings; what is not here is as shipped."]
    lines += [f"# {words}" for words in in_words(found)]
    lines += ["", "[thresholds]"]
    for one in found.set:
        unit = UNITS[one.name]
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


def in_words(found: Calibration) -> list[str]:
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
    return [f"{asked} from {found.hours:.3g} h of motion: {reach}", where, *warnings(found)]


def warnings(found: Calibration) -> list[str]:
    """What a reader must know, one sentence each."""
    said = []
    if found.hours < ENOUGH:
        said.append(
            f"warning: {found.hours:.3g} h of motion are less than {ENOUGH:g} h; "
            "record longer before these thresholds are relied on"
        )
    for name, many in found.told:
        diagnoses = "diagnosis" if many == 1 else "diagnoses"
        said.append(f"warning: in run {name} there would still be {many} {diagnoses}: is it free of faults?")
    return said


def write_thresholds(path: Path, text: str) -> None:
    """Writes the file, in full or not at all."""
    path.parent.mkdir(parents=True, exist_ok=True)
    with whole_file(path) as temporary:
        temporary.write_text(text, encoding="utf-8", newline="\n")
