"""JSON and text files, each written in full or not at all."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from omnimj.recording.folder import atomic_file
from omnimj.signals import Array


def to_jsonable(value: Any) -> Any:
    """Convert a value to JSON types; numbers that are not finite become null."""
    if isinstance(value, Mapping):
        return {str(key): to_jsonable(entry) for key, entry in value.items()}
    if isinstance(value, np.ndarray):
        return to_jsonable(value.tolist())
    if isinstance(value, list | tuple):
        return [to_jsonable(entry) for entry in value]
    if isinstance(value, np.generic):
        return to_jsonable(value.item())
    if isinstance(value, float) and not math.isfinite(value):
        return None
    return value


def rounded(value: float) -> float | None:
    """Round to six significant digits; None where the value is not finite."""
    return float(f"{value:.6g}") if math.isfinite(value) else None


def rounded_values(value: Any) -> Any:
    """Convert a value to JSON types, every float rounded as `rounded` does."""
    value = to_jsonable(value)
    if isinstance(value, dict):
        return {key: rounded_values(entry) for key, entry in value.items()}
    if isinstance(value, list):
        return [rounded_values(entry) for entry in value]
    return rounded(value) if isinstance(value, float) else value


def rounded_list(values: Array) -> list[float | None]:
    """Round every value of an array, shape (n,), as `rounded` does."""
    return [rounded(value) for value in values.tolist()]


def write_json(path: Path, content: Any) -> None:
    """Write a value as JSON, in full or not at all."""
    write_text(path, json.dumps(content, indent=2, allow_nan=False, ensure_ascii=False) + "\n")


def write_text(path: Path, text: str) -> None:
    """Write a text file, in full or not at all."""
    with atomic_file(path) as temporary:
        temporary.write_text(text, encoding="utf-8", newline="\n")
