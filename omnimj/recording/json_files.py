"""Results of single trials as JSON files, each in full or not at all."""

from __future__ import annotations

import json
import math
import traceback
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import numpy as np

from omnimj.recording.folder import atomic_file


def to_jsonable(value: Any) -> Any:
    """The same in JSON's own kinds; what is not finite becomes null."""
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


def write_json(path: Path, content: Any) -> None:
    """Writes JSON; the file is there in full or not at all."""
    with atomic_file(path) as temporary:
        text = json.dumps(content, indent=1, allow_nan=False, ensure_ascii=False)
        temporary.write_text(text + "\n", encoding="utf-8")


def write_text(path: Path, text: str) -> None:
    """Writes a text; the file is there in full or not at all."""
    with atomic_file(path) as temporary:
        temporary.write_text(text, encoding="utf-8")


def read_result(folder: Path, name: str) -> dict[str, Any] | None:
    """The result of a trial; None where there is none yet, or none that can be read."""
    try:
        return json.loads((folder / f"{name}.json").read_text(encoding="utf-8"))
    except (FileNotFoundError, ValueError):
        return None


def has_result(folder: Path, name: str) -> bool:
    """Whether a result is there; one that says what broke is tried again."""
    found = read_result(folder, name)
    return found is not None and "error" not in found


def result_writer(folder: Path) -> Callable[[str, Any], None]:
    """What writes results into a folder by name; None is no result."""

    def keep(name: str, result: dict[str, Any] | None) -> None:
        if result is not None:
            write_json(folder / f"{name}.json", result)

    return keep


def run_guarded(work: Callable[[], dict[str, Any]]) -> dict[str, Any]:
    """One trial that breaks down must not take the others' hours with it: it is counted and shown."""
    try:
        return work()
    except Exception as error:
        last = traceback.extract_tb(error.__traceback__)[-1]
        place = f"{Path(last.filename).name}:{last.lineno}"
        return {"error": f"{type(error).__name__}: {error} ({place})"}
