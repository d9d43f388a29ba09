"""Runs as CSV, with a header `name [unit]` and all digits, and as MATLAB files with a variable per column."""

from __future__ import annotations

import csv
import json
import math
from pathlib import Path
from typing import Any

from omnimj.recording.exporting.source import ExportedRun, matlab_names
from omnimj.recording.folder import atomic_file
from omnimj.recording.importing.units import split_unit
from omnimj.recording.json_files import to_jsonable

RESERVED = ("units", "names", "about")
"""Variables of a MATLAB file beside the columns."""


def write_csv(path: Path, run: ExportedRun) -> None:
    """Write a run as CSV, in full or not at all; a value that is not a number is an empty cell.

    Raises:
      OutputError: The file cannot be written.
    """
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


def write_mat(path: Path, run: ExportedRun) -> None:
    """Write a run as a MATLAB file of version 5, in full or not at all.

    `units.NAME` is the unit of the variable NAME, `names.NAME` the column's own name where MATLAB does not
    accept it, `about` the description of the run as JSON.

    Raises:
      OutputError: The file cannot be written.
    """
    from scipy.io import savemat

    names = matlab_names((*RESERVED, *run.columns))
    content: dict[str, Any] = {names[name]: values for name, values in run.columns.items()}
    content["units"] = {names[name]: unit for name, unit in run.units.items()}
    changed = {names[name]: name for name in run.columns if names[name] != name}
    if changed:
        content["names"] = changed
    content["about"] = json.dumps(to_jsonable(run.about))
    with atomic_file(path) as temporary:
        savemat(temporary, content, long_field_names=True, oned_as="column", do_compression=True)
