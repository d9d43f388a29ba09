"""`diagnoses.json`: what a method says of each run of a dataset."""

from __future__ import annotations

import dataclasses
import json
import math
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import omnimj
from omnimj.diagnosis.diagnose import Order
from omnimj.diagnosis.replay import Replayed
from omnimj.recording.folder import whole_file
from omnimj.signals import Diagnosis


def as_json(order: Order, found: Sequence[Replayed], command: str, interrupted: bool) -> dict[str, Any]:
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
                "diagnoses": [record(diagnosis) for diagnosis in one.diagnoses],
                "cannot_judge": one.cannot_judge,
                "judged": one.judged,
                "notes": list(one.notes),
            }
            for one in found
        },
    }


def record(diagnosis: Diagnosis) -> dict[str, Any]:
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
    with whole_file(path) as temporary:
        temporary.write_text(
            json.dumps(told, indent=2, ensure_ascii=False, allow_nan=False) + "\n", encoding="utf-8"
        )
