"""A run's folder: never overwrites by accident, and never holds a half-written file."""

from __future__ import annotations

import os
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from pathlib import Path

from omnimj.errors import InputError

RUN_FILES = ("trace.parquet", "metrics.json", "run.rrd", "report.html")
"""What a run writes, in this order."""


def check_folder(folder: Path, force: bool) -> None:
    """Whether a run may write here; asked before the run, so that no work is lost.

    Raises:
      InputError: The folder is not empty and `force` is not given, or the path is a file.
    """
    try:
        if folder.exists() and not folder.is_dir():
            raise InputError(f"--out {folder}", "is a file", "a folder is needed")
        if not force and folder.is_dir() and any(folder.iterdir()):
            raise InputError(
                f"--out {folder}", "is not empty", "choose another folder, or --force to write into it"
            )
    except OSError as error:
        raise InputError(f"--out {folder}", f"cannot be read ({error.strerror})") from None


def make_folder(folder: Path, force: bool, files: Iterable[str] = RUN_FILES) -> None:
    """Creates the folder; with `force` takes away the files of an earlier run, and nothing else.

    Raises:
      InputError: As `check_folder`, or the folder cannot be made.
    """
    check_folder(folder, force)
    try:
        folder.mkdir(parents=True, exist_ok=True)
        for name in files:
            # an old report beside a new trace would be a mixture of two runs
            (folder / name).unlink(missing_ok=True)
    except OSError as error:
        raise InputError(f"--out {folder}", f"cannot be written ({error.strerror})") from None


@contextmanager
def whole_file(path: Path) -> Iterator[Path]:
    """A temporary path in the same folder; becomes `path` when the block ends well, vanishes otherwise.

    The ending is kept, since writers choose the format by it.
    """
    temporary = path.with_name(f".{path.stem}.{os.getpid()}{path.suffix}")
    try:
        yield temporary
        temporary.replace(path)
    finally:
        temporary.unlink(missing_ok=True)
