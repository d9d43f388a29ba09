"""Folders of runs: `metrics.json` and `trace.parquet` of one run, or many of them below a folder."""

from __future__ import annotations

import json
import os
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from omnimj.errors import InputError
from omnimj.recording.traces import read_trace
from omnimj.signals import Trace

METRICS_FILE, TRACE_FILE = "metrics.json", "trace.parquet"
_MAX_SIZE = 16_000_000  # bytes of a metrics.json
_MAX_DEPTH = 4  # levels of folders below the one that is searched
_MAX_RUNS = 5000


@dataclass(frozen=True)
class RunFolder:
    """Folder of a run."""

    path: Path
    metrics: Mapping[str, Any]
    """Content of `metrics.json`; `checks` is a list of objects with `name` and `ok`."""

    def trace(self) -> Trace:
        """Read the trace of the run.

        Raises:
          InputError: The trace is missing or damaged.
        """
        return read_trace(self.path / TRACE_FILE)


def is_run_folder(path: Path) -> bool:
    """Return True if a folder holds the metrics of a run."""
    return (path / METRICS_FILE).is_file()


def read_run_folder(path: Path) -> RunFolder:
    """Read the metrics of a run.

    Raises:
      InputError: The folder or its metrics are missing, or they are not those of a run.
    """
    file = path / METRICS_FILE
    if not path.is_dir():
        raise InputError(
            path, "is not a folder", "the folder of a run is needed, as omnimj run --out writes it"
        )
    if file.exists() and not (file.is_file() and file.stat().st_size <= _MAX_SIZE):
        raise InputError(file, f"is not a regular file of at most {_MAX_SIZE} bytes")
    try:
        content = json.loads(file.read_text(encoding="utf-8"))
    except FileNotFoundError:
        raise InputError(path, f"has no {METRICS_FILE}", "omnimj run --out writes such folders") from None
    except OSError as error:
        raise InputError(file, f"cannot be read ({error.strerror})") from None
    except (ValueError, RecursionError):
        raise InputError(file, "is not JSON", "it is damaged") from None
    _require_metrics(file, content)
    return RunFolder(path, content)


def _require_metrics(file: Path, content: Any) -> None:
    """Check what readers of the metrics rely on: names are text, and checks have a name and a result."""
    if not isinstance(content, dict) or not isinstance(content.get("scenario"), str):
        raise InputError(file, "has no 'scenario'", "the metrics of a run are needed")
    for name in ("checks", "faults", "diagnoses"):
        entries = content.get(name) or []
        if not isinstance(entries, list) or not all(isinstance(one, dict) for one in entries):
            raise InputError(file, f"{name!r} is not a list of objects", "it is damaged")
    for check in content.get("checks") or []:
        number = check.get("value")
        is_number = number is None or isinstance(number, int | float)
        if not isinstance(check.get("name"), str) or not isinstance(check.get("ok"), bool) or not is_number:
            raise InputError(file, "has a check without name, number or result", "it is damaged")


def find_run_folders(folder: Path) -> list[RunFolder]:
    """Read all runs below a folder, in the order of their paths.

    Raises:
      InputError: There is no run, there are more than 5000, or one is damaged.
    """
    found = []
    for path in _run_paths(folder, 0):
        if len(found) == _MAX_RUNS:
            raise InputError(folder, f"holds more than {_MAX_RUNS} runs", "choose a folder within it")
        found.append(read_run_folder(path))
    if not found:
        rule = f"a run is a folder with {METRICS_FILE}, as omnimj run --out writes it"
        raise InputError(folder, "holds no run", rule)
    return found


def _run_paths(folder: Path, depth: int) -> Iterator[Path]:
    try:
        inside = sorted(entry.path for entry in os.scandir(folder) if entry.is_dir(follow_symlinks=False))
    except OSError as error:
        raise InputError(folder, f"cannot be read ({error.strerror})") from None
    for path in map(Path, inside):
        if is_run_folder(path):
            yield path
        elif depth + 1 < _MAX_DEPTH:
            yield from _run_paths(path, depth + 1)


def short_names(paths: list[Path]) -> list[str]:
    """Name folders by the shortest ends of their paths that differ: `a/seed_1` and `b/seed_1`."""
    parts = [path.absolute().parts for path in paths]
    longest = max(map(len, parts), default=0)
    for length in range(1, longest + 1):
        names = ["/".join(own[-length:]) for own in parts]
        if len(set(names)) == len(set(parts)):
            return names
    return [str(path) for path in paths]
