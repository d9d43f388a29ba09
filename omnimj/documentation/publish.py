"""A built site in its final folder, complete or not at all."""

from __future__ import annotations

import argparse
import shutil
import tempfile
from pathlib import Path

from omnimj.documentation.site import SiteBuild, build_site
from omnimj.documentation.staging import Report
from omnimj.errors import OmnimjError, write_failure
from omnimj.recording.folder import check_folder

_MARK = "index.html"


def publish(
    folder: Path, force: bool, parser: argparse.ArgumentParser, execute: bool, report: Report
) -> SiteBuild:
    """Build the site beside its folder and move it there when it is complete.

    Args:
      folder: Folder of the site, new or empty.
      force: Write into a folder that is not empty; the files of a site there are replaced, others are kept.
      parser: Parser of `omnimj`, whose options the how-to pages list.
      execute: Whether to execute the tutorials, so that their results are shown.
      report: Called with what is being done and the share that is done.

    Raises:
      InputError: The folder is not empty and `force` is false.
      OutputError: The folder cannot be written.
      SimulationError: A tutorial ended with an error.
      OmnimjError: The generator warned, for example of a link that leads nowhere.
    """
    place = f"--out {folder}"
    check_folder(folder, force)
    try:
        folder.parent.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryDirectory(prefix=f".{folder.name}.", dir=folder.parent) as work:
            site = build_site(Path(work) / "site", parser, execute, report)
            if site.warnings:
                raise OmnimjError(f"omnimj docs: {'; '.join(site.warnings)}")
            _move(Path(work) / "site", folder)
    except OSError as error:
        raise write_failure(place, error) from None
    return SiteBuild(folder, site.pages, site.warnings)


def _move(built: Path, folder: Path) -> None:
    """Move the entries of a built site into a folder, the first page last."""
    folder.mkdir(exist_ok=True)
    for entry in sorted(built.iterdir(), key=lambda path: path.name == _MARK):
        target = folder / entry.name
        if target.is_dir() and not target.is_symlink():
            shutil.rmtree(target)
        else:
            target.unlink(missing_ok=True)
        shutil.move(entry, target)
