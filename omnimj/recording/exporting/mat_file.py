"""Runs as MATLAB files: a variable for each column, and a structure with their units."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

from omnimj.recording.exporting.source import ExportedRun
from omnimj.recording.exporting.units import matlab_names
from omnimj.recording.folder import atomic_file
from omnimj.recording.json_files import to_jsonable

RESERVED = ("units", "names", "about")
"""Variables beside the columns."""


def write_mat(path: Path, run: ExportedRun) -> None:
    """Write a run as a MATLAB file of version 5, in full or not at all.

    `units.NAME` is the unit of the variable NAME, `names.NAME` the column's own name where MATLAB does not
    accept it, `about` the description of the run as JSON.
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
