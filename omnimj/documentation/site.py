"""The site of the documentation: MkDocs with the theme Material, without anything from the network."""

from __future__ import annotations

import argparse
import copy
import logging
import os
import shutil
import sys
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from logging.handlers import BufferingHandler
from pathlib import Path
from typing import Any

import omnimj
from omnimj.documentation.equations import format_equation, format_state_diagram
from omnimj.documentation.navigation import NAVIGATION
from omnimj.documentation.staging import Report, stage
from omnimj.errors import MissingLibrary, OmnimjError, write_failure
from omnimj.recording.folder import check_folder

_PACKAGE = Path(omnimj.__file__).resolve().parent
_PACKAGES = (
    *("mkdocs", "material", "mkdocstrings", "mkdocstrings_handlers", "latex2mathml"),
    *("jupytext", "nbclient", "ipykernel", "matplotlib"),
)
_EXTENSIONS: tuple[str | dict[str, Any], ...] = (
    *("admonition", "attr_list", "def_list", "md_in_html", "sane_lists", "tables"),
    {"toc": {"permalink": True}},
    {"pymdownx.highlight": {"anchor_linenums": True}},
    {
        "pymdownx.superfences": {
            "custom_fences": [
                {"name": "math", "class": "math", "format": format_equation},
                {"name": "mermaid", "class": "states", "format": format_state_diagram},
            ],
        }
    },
    *("pymdownx.details", "pymdownx.inlinehilite"),
)
_FEATURES = (
    *("content.code.copy", "navigation.tabs", "navigation.top", "navigation.footer", "navigation.indexes"),
    *("search.suggest", "search.highlight", "toc.follow"),
)


@dataclass(frozen=True)
class SiteBuild:
    """A built site."""

    folder: Path
    pages: tuple[str, ...]
    """Sources of the pages, relative to the folder of the documentation."""
    warnings: tuple[str, ...] = field(default=())
    """Warnings of MkDocs: links that lead nowhere, pages outside the navigation, and the like."""


def require_generator() -> None:
    """Refuse to go on without the programs that build the site.

    Raises:
      MissingLibrary: One of them is not installed.
    """
    from importlib.util import find_spec

    for package in _PACKAGES:
        if find_spec(package) is None:
            raise MissingLibrary("omnimj docs", package, "docs")


def build_site(folder: Path, parser: argparse.ArgumentParser, execute: bool, report: Report) -> SiteBuild:
    """Build the site into an existing folder, whose files are replaced.

    The how-to pages list the options of `parser`, that of `omnimj`; `execute` shows the tutorials' results.

    Raises:
      SimulationError: A tutorial ended with an error.
      OmnimjError: MkDocs refused a page or a setting.
    """
    with tempfile.TemporaryDirectory(prefix="omnimj-docs-") as work:
        sources = Path(work) / "pages"
        pages = stage(sources, parser, execute, report)
        report("building pages", 0.9)
        with _collected_warnings() as warnings:
            _build(Path(work) / "mkdocs.yml", site_settings(sources, folder))
    return SiteBuild(folder, pages, tuple(record.getMessage() for record in warnings))


def site_settings(sources: Path, folder: Path) -> dict[str, Any]:
    """Settings of MkDocs for one build of the pages in `sources` into a folder."""
    return {
        "site_name": "omnimj",
        "site_description": "MuJoCo twin of an omni-wheel robot, fault diagnosis, and the gap to measurement",
        "docs_dir": str(sources),
        "site_dir": str(folder),
        "nav": NAVIGATION,
        "theme": _theme(),
        "plugins": ["search", "offline", {"autorefs": {}}, {"mkdocstrings": _api_options()}],
        "markdown_extensions": list(_EXTENSIONS),
        "extra_css": ["assets/site.css"],
        "extra": {"polyfills": ["assets/iframe-worker.js"]},
        "validation": {
            "nav": {"omitted_files": "warn", "not_found": "warn"},
            "links": {"not_found": "warn", "anchors": "warn", "absolute_links": "warn"},
        },
    }


def _theme() -> dict[str, Any]:
    """The theme: fonts of the system, light and dark colours that follow the system until one is chosen."""

    def palette(media: str, scheme: str, icon: str, words: str) -> dict[str, Any]:
        return {
            "media": media,
            **({"scheme": scheme, "primary": "indigo", "accent": "indigo"} if scheme else {}),
            "toggle": {"icon": f"material/{icon}", "name": words},
        }

    return {
        "name": "material",
        "font": False,
        "language": "en",
        "features": list(_FEATURES),
        "icon": {"logo": "material/robot-outline"},
        "palette": [
            palette("(prefers-color-scheme)", "", "brightness-auto", "Light colours"),
            palette("(prefers-color-scheme: light)", "default", "brightness-7", "Dark colours"),
            palette("(prefers-color-scheme: dark)", "slate", "brightness-4", "Colours of the system"),
        ],
    }


def _api_options() -> dict[str, Any]:
    """Settings of the reference of the Python interface."""
    options = {
        "docstring_style": "google",
        "show_root_heading": True,
        "show_root_full_path": False,
        "show_source": False,
        "show_bases": False,
        "show_signature_annotations": True,
        "separate_signature": True,
        "signature_crossrefs": False,
        "heading_level": 3,
        "members_order": "source",
        "docstring_section_style": "list",
        "filters": ["!^_"],
        "inherited_members": True,
    }
    return {"handlers": {"python": {"paths": [str(_PACKAGE.parent)], "options": options}}}


def _build(file: Path, settings: dict[str, Any]) -> None:
    """Run MkDocs, whose settings must begin with a file, in the folder that relative paths start from."""
    os.environ.setdefault("NO_MKDOCS_2_WARNING", "1")  # a notice of the theme to its maintainers
    from mkdocs.commands.build import build
    from mkdocs.config.base import load_config
    from mkdocs.exceptions import MkDocsException

    file.write_text(f"site_name: {settings['site_name']}\n", encoding="utf-8")
    try:
        build(load_config(str(file), **copy.deepcopy(settings)))  # MkDocs empties what it is given
    except MkDocsException as error:
        raise OmnimjError(f"omnimj docs: {error}") from error


@contextmanager
def _collected_warnings() -> Iterator[list[logging.LogRecord]]:
    """Context that collects the warnings of MkDocs in place of printing them."""
    logger, collector = logging.getLogger("mkdocs"), BufferingHandler(sys.maxsize)
    collector.setLevel(logging.WARNING)
    before = logger.propagate, logger.level
    logger.addHandler(collector)
    logger.propagate = False
    logger.setLevel(logging.WARNING)
    try:
        yield collector.buffer
    finally:
        logger.removeHandler(collector)
        logger.propagate, logger.level = before[0], before[1]


_MARK = "index.html"


def publish(
    folder: Path, force: bool, parser: argparse.ArgumentParser, execute: bool, report: Report
) -> SiteBuild:
    """Build the site beside its folder, as `build_site`, and move it there when it is complete.

    With `force` the folder may hold files: those of a site are replaced, others are kept.

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
