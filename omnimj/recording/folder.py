"""Output folders: never overwritten by accident, never with a half-written file."""

from __future__ import annotations

import logging
import os
from collections.abc import Iterable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from omnimj.errors import InputError, OutputError, write_failure

_LOG = logging.getLogger(__name__)
RUN_FILES = ("trace.parquet", "metrics.json", "run.rrd", "report.html")
"""Files of a run, in the order in which they are written."""


def check_folder(folder: Path, force: bool) -> None:
    """Check before the work that results can be written to a folder.

    Raises:
      InputError: The folder is not empty and `force` is false, or the path leads through a file.
      OutputError: The folder cannot be written.
    """
    place = f"--out {folder}"
    try:
        folder.stat()
    except (FileNotFoundError, NotADirectoryError):
        pass
    except PermissionError as error:
        raise write_failure(place, error) from None
    except OSError as error:  # for example a name too long
        raise InputError(place, f"is not possible ({error.strerror})") from None
    nearest = next(path for path in (folder, *folder.absolute().parents) if os.path.lexists(path))
    if not nearest.is_dir():
        kind = "a file" if nearest.exists() else "a link that leads nowhere"
        found = f"is {kind}" if nearest == folder else f"cannot be made, {nearest} is {kind}"
        raise InputError(place, found, "a folder is needed")
    if not os.access(nearest, os.W_OK | os.X_OK):
        raise OutputError(place, f"{nearest} is read-only", "choose another folder")
    if nearest != folder:
        return
    try:
        names = [path.name for path in folder.iterdir()]
    except OSError as error:
        raise InputError(place, f"cannot be read ({error.strerror})") from None
    if names and not force:
        raise InputError(place, "is not empty", "choose another folder, or --force to write into it")
    for name in RUN_FILES:
        if (folder / name).is_dir():
            raise InputError(place, f"has a folder {name}", "a file will go there")


def make_folder(folder: Path, force: bool, files: Iterable[str] = RUN_FILES) -> None:
    """Create a folder; with `force`, remove the files of an earlier run and nothing else.

    Args:
      folder: Folder to create, with its parents.
      force: Accept a folder that is not empty.
      files: Names of the files to remove.

    Raises:
      InputError: As in `check_folder`.
      OutputError: As in `check_folder`, or the folder cannot be created.
    """
    check_folder(folder, force)
    try:
        folder.mkdir(parents=True, exist_ok=True)
        for name in files:
            # an old report beside a new trace would be a mixture of two runs
            (folder / name).unlink(missing_ok=True)
    except OSError as error:
        raise write_failure(f"--out {folder}", error) from None


def make_parents(file: Path, place: object, rule: str = "") -> None:
    """Create the folder of a file, with its parents.

    Raises:
      OutputError: It cannot be created; the message names the place.
    """
    try:
        file.parent.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise write_failure(place, error, rule) from None


@contextmanager
def atomic_file(path: Path) -> Iterator[Path]:
    """Context with a temporary path in the same folder, renamed to `path` when the block succeeds.

    The suffix is kept, since it determines the format; after a failure the file is removed.

    Raises:
      OutputError: The file cannot be written, for example since the disk is full.
    """
    temporary = path.with_name(f".{path.stem}.{os.getpid()}{path.suffix}")
    try:
        yield temporary
        temporary.replace(path)
        _LOG.debug("wrote %s", path)
    except OSError as error:
        raise write_failure(path, error) from None
    finally:
        with suppress(OSError):  # the folder has become read-only: the reason is already reported
            temporary.unlink(missing_ok=True)
