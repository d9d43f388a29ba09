"""Runs as CSV: a header `name [unit]`, numbers with all their digits."""

from __future__ import annotations

import csv
import math
from pathlib import Path

from omnimj.recording.exporting.source import ExportedRun
from omnimj.recording.folder import atomic_file
from omnimj.recording.importing.units import split_unit


def write_csv(path: Path, run: ExportedRun) -> None:
    """Write a run as CSV, in full or not at all; a value that is not a number is an empty cell."""
    heads = [_head(name, unit) for name, unit in run.units.items()]
    columns = [values.tolist() for values in run.columns.values()]
    with atomic_file(path) as temporary, temporary.open("w", encoding="utf-8", newline="") as file:
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow(heads)
        for row in zip(*columns, strict=True):
            writer.writerow(["" if math.isnan(value) else repr(value) for value in row])


def _head(name: str, unit: str) -> str:
    """Name with its unit in brackets; empty brackets keep a name that ends like a unit whole."""
    if unit or split_unit(name) != (name, ""):
        return f"{name} [{unit}]"
    return name
