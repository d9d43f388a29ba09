"""Dataset folders written run by run, so that finished runs survive a failure."""

from __future__ import annotations

import csv
import re
import unicodedata
from collections.abc import Iterable, Mapping
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.csv

from omnimj.errors import InputError, UnknownNameError, write_failure
from omnimj.parameters.reading import read_toml
from omnimj.recording.dataset import ROBOT_WHEELS, Run
from omnimj.recording.dataset_file import DATASET_FILE, PLANNED_RUNS
from omnimj.recording.folder import atomic_file, check_folder
from omnimj.recording.json_files import write_text
from omnimj.recording.run_table import TABLE_SUFFIXES, write_parquet

FORMATS = ("parquet", "csv")
"""Formats of the tables."""
_SIGNATURE = "# written by omnimj"
_PLAIN_KEY = re.compile(r"[A-Za-z0-9_-]+")


class DatasetWriter:
    """Writer of a dataset, run by run; after each run the folder is a complete dataset.

    With `force`, it replaces a dataset written by omnimj, but never measured data of another origin.
    """

    def __init__(
        self,
        folder: Path,
        plant: str,
        defaults: Mapping[str, float | str],
        force: bool = False,
        table_format: str = "parquet",
        planned: int = 0,
    ):
        """Check that the dataset can be written, without writing anything yet.

        Args:
          folder: Target folder; created if necessary.
          plant: `quarter_rig`, `uto_robot` or `linear_axis`.
          defaults: Conditions of every run unless the run states its own.
          force: Replace an earlier dataset that omnimj wrote.
          table_format: `parquet` or `csv`.
          planned: Number of runs that will be added, so that an unfinished dataset is known as such; 0 if
            unknown.

        Raises:
          InputError: The folder is not empty, or holds runs of another origin.
          OutputError: The folder cannot be written.
          UnknownNameError: The format does not exist.
        """
        if table_format not in FORMATS:
            raise UnknownNameError("--format", "format", table_format, FORMATS)
        check_folder(folder, force)
        self._old = _earlier_files(folder)
        self._folder, self._plant, self._defaults = folder, plant, dict(defaults)
        self._ending = f".{table_format}"
        self._planned = planned
        self._runs: dict[str, Run] = {}

    def add(self, run: Run) -> None:
        """Write one run and list it in `dataset.toml`, with its conditions that differ from the defaults.

        Raises:
          InputError: The name is taken or not valid as a file name.
          OutputError: A file cannot be written.
        """
        _require_file_name(run.name)
        if run.name in self._runs:
            raise InputError(f"run {run.name!r}", "occurs twice")
        if not self._runs:
            self._begin()
        with atomic_file(self._folder / f"{run.name}{self._ending}") as temporary:
            write_table(temporary, run)
        self._runs[run.name] = run
        text = dataset_text(self._plant, self._defaults, self._runs.values(), self._planned)
        write_text(self._folder / DATASET_FILE, text)

    def _begin(self) -> None:
        """Create the folder and remove an earlier dataset, its `dataset.toml` first."""
        try:
            self._folder.mkdir(parents=True, exist_ok=True)
            for file in self._old:
                file.unlink(missing_ok=True)
        except OSError as error:
            raise write_failure(f"--out {self._folder}", error) from None


def write_dataset(
    folder: Path,
    plant: str,
    defaults: Mapping[str, float | str],
    runs: Iterable[Run],
    force: bool = False,
    table_format: str = "parquet",
) -> None:
    """Write a dataset; numbers are read back bit for bit, from Parquet and CSV. Arguments as for
    `DatasetWriter`.

    Raises:
      InputError, OutputError: As in `DatasetWriter`.
    """
    writer = DatasetWriter(folder, plant, defaults, force, table_format)
    for run in runs:
        writer.add(run)


def dataset_text(
    plant: str, defaults: Mapping[str, float | str], runs: Iterable[Run], planned: int = 0
) -> str:
    """Return the text of `dataset.toml`, with the conditions of each run that differ from the defaults."""
    runs = list(runs)
    lines = [_SIGNATURE, f"plant = {toml_text(plant)}"]
    wheels = sum(name.startswith("wheel_speed_") for name in runs[0].columns) if runs else ROBOT_WHEELS
    if plant == "uto_robot" and wheels not in (0, ROBOT_WHEELS):
        lines.append(f"wheels = {wheels}")
    if planned:
        lines.append(f"{PLANNED_RUNS} = {planned}")
    if defaults:
        lines += ["", "[defaults]", *toml_entries(defaults)]
    for run in runs:
        own = {k: v for k, v in run.conditions.items() if defaults.get(k) != v}
        if run.repeat_of is not None and run.repeat_of != defaults.get("repeat_of"):
            own["repeat_of"] = run.repeat_of
        lines += ["", f"[runs.{toml_key(run.name)}]", *toml_entries(own)]
    return "\n".join(lines) + "\n"


def toml_entries(values: Mapping[str, float | str | bool]) -> list[str]:
    """Format keys and values as lines of TOML."""
    return [f"{toml_key(key)} = {toml_text(value)}" for key, value in values.items()]


def _earlier_files(folder: Path) -> list[Path]:
    """List the files of an earlier dataset written by omnimj, its `dataset.toml` first; empty if none."""
    if not folder.is_dir():
        return []
    about = folder / DATASET_FILE
    tables = {file.stem: file for file in folder.iterdir() if file.suffix.lower() in TABLE_SUFFIXES}
    ours: Mapping[str, object] = {}
    if about.is_file():
        if not about.read_bytes().startswith(_SIGNATURE.encode()):
            rule = "--force replaces only datasets that omnimj wrote, choose another folder"
            raise InputError(f"--out {folder}", f"has a {DATASET_FILE} of another origin", rule)
        runs = read_toml(about).get("runs", {})
        ours = runs if isinstance(runs, Mapping) else {}
    for stem, file in tables.items():
        if stem not in ours:
            rule = "it would become a run of the dataset, choose another folder"
            raise InputError(f"--out {folder}", f"has a file {file.name}", rule)
    return [about, *tables.values()] if about.is_file() else []


def _require_file_name(name: str) -> None:
    plain = name and name == Path(name).name and not name.startswith(".") and name == name.strip()
    if not plain or any(unicodedata.category(c) in ("Cc", "Cs") for c in name) or "\\" in name:
        raise InputError(f"run {name!r}", "is not a valid file name", "use letters, digits, _ and -")


def write_table(path: Path, run: Run) -> None:
    """Write the columns of a run as CSV or Parquet, depending on the suffix of the path."""
    if path.suffix == ".parquet":
        write_parquet(path, run.columns)
        return
    arrays = [pa.array(np.asarray(values, float)) for values in run.columns.values()]
    with path.open("w", encoding="utf-8", newline="") as header:
        csv.writer(header, lineterminator="\n").writerow(run.columns)
    table = pa.table(arrays, names=[f"{k}" for k in range(len(arrays))])
    with path.open("ab") as rows:
        # Arrow writes the shortest text that reads back as the same double
        pa.csv.write_csv(table, rows, pa.csv.WriteOptions(include_header=False))


def toml_text(value: float | str | bool) -> str:
    """Format a value as TOML."""
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, str):
        return _quoted(value)
    return repr(value) if isinstance(value, int) else repr(float(value))


def toml_key(name: str) -> str:
    """Format a key of TOML, in quotes where necessary."""
    return name if _PLAIN_KEY.fullmatch(name) else _quoted(name)


def _quoted(text: str) -> str:
    """Format a text as a basic string of TOML."""
    escaped = text.replace("\\", "\\\\").replace('"', '\\"')
    return '"' + "".join(c if c.isprintable() or ord(c) > 0x9F else f"\\u{ord(c):04x}" for c in escaped) + '"'
