"""The sources of the site in one folder: pages, executed tutorials, and pages made from the code."""

from __future__ import annotations

import argparse
import re
import shutil
from collections.abc import Callable
from pathlib import Path

import omnimj
from omnimj.documentation.navigation import TUTORIALS
from omnimj.documentation.options import HOWTO, commands_of, with_options
from omnimj.documentation.reference import reference_pages
from omnimj.resources import models_folder

DOCS = Path(omnimj.__file__).resolve().parent / "docs"
"""Folder of the documentation's pages."""
Report = Callable[[str, float], None]
"""Called with a phrase and the share of the work that is done, 0 … 1."""

_LINK = re.compile(r"(\]\()([^)#\s]+)(#[^)]*)?\)")


def pages_elsewhere() -> dict[str, Path]:
    """Pages of the site whose source lies beside what they describe: name in the site → file."""
    return {
        "model_files.md": models_folder() / "README.md",
        "protocol.md": DOCS.parent / "link" / "PROTOCOL.md",
    }


def stage(sources: Path, parser: argparse.ArgumentParser, execute: bool, report: Report) -> tuple[str, ...]:
    """Collect the sources of the site in a new folder, with options and tutorials as in `site.build_site`.

    Returns:
      The pages, relative to `sources`, sorted.

    Raises:
      SimulationError: A tutorial ended with an error.
    """
    shutil.copytree(DOCS, sources, ignore=shutil.ignore_patterns("__pycache__"))
    for name, file in pages_elsewhere().items():
        (sources / name).write_text(_from_elsewhere(file), encoding="utf-8")
    for name, text in reference_pages().items():
        (sources / name).parent.mkdir(exist_ok=True)
        (sources / name).write_text(text, encoding="utf-8")
    for page in (sources / HOWTO).glob("*.md"):
        text = with_options(page.read_text(encoding="utf-8"), commands_of(parser))
        page.write_text(text, encoding="utf-8")
    for page in sources.rglob("*.md"):
        up = "../" * (len(page.relative_to(sources).parts) - 1)
        page.write_text(_with_links_in_site(page.read_text(encoding="utf-8"), up), encoding="utf-8")
    _tutorials(sources / TUTORIALS, execute, report)
    return tuple(sorted(str(page.relative_to(sources).as_posix()) for page in sources.rglob("*.md")))


def _from_elsewhere(file: Path) -> str:
    """Text of a page from outside the folder of the documentation, with links as from within."""
    return file.read_text(encoding="utf-8").replace("](../omnimj/docs/", "](")


def _with_links_in_site(text: str, up: str) -> str:
    """The page with links to pages elsewhere replaced by links to their copies in the site."""
    copies = {file.name: name for name, file in pages_elsewhere().items()}

    def replaced(match: re.Match[str]) -> str:
        target = match[2]
        if target.startswith("../") and (name := Path(target).name) in copies:
            return f"{match[1]}{up}{copies[name]}{match[3] or ''})"
        return match[0]

    return _LINK.sub(replaced, text)


def _tutorials(folder: Path, execute: bool, report: Report) -> None:
    """Replace each tutorial by its page, with results if it is executed, and put the notebook beside it."""
    from omnimj.documentation.notebooks import notebook_page

    tutorials = sorted(folder.glob("*.md"))
    for k, file in enumerate(tutorials):
        report(f"tutorial {file.stem}" if execute else "tutorials", 0.9 * k / len(tutorials))
        file.write_text(notebook_page(file, execute), encoding="utf-8")
