"""Order of the pages in the navigation; a page that no section names is appended, so that none is lost."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass

HOME = "index.md"
TUTORIALS = "tutorials/"
"""Folder of the tutorials."""


@dataclass(frozen=True)
class Section:
    """Section of the navigation."""

    title: str
    pages: tuple[str, ...]
    """Pages in order, relative to the folder of the documentation; those that do not exist are skipped."""
    folder: str | None = None
    """Folder whose other pages follow, by name."""


SECTIONS = (
    Section(
        "Tutorials",
        tuple(
            f"{TUTORIALS}{name}.md"
            for name in (
                "drive_and_break",
                "csv_to_gap",
                "own_robot",
                "own_wheel",
                "own_controller",
                "real_robot",
            )
        ),
        TUTORIALS,
    ),
    Section(
        "How-to",
        (
            *("own_robot.md", "wheels.md", "any_machine.md", "logs.md", "python.md", "learning.md"),
            *("hardware.md", "ros2_control.md", "tuning.md", "many_runs.md"),
        ),
    ),
    Section(
        "Extending",
        ("extend/floor.md", "extend/scenario.md", "extend/effect.md", "extend/plant.md"),
        "extend/",
    ),
    Section(
        "Reference",
        (
            *("commands.md", "api.md", "scenarios.md", "scenario_keys.md", "models.md", "model_files.md"),
            *("datasets.md", "effects.md", "schemas.md", "protocol.md"),
        ),
    ),
    Section(
        "Explanation",
        ("architecture.md", "equations.md", "diagnosis.md", "recovery.md", "gap.md", "threats.md"),
    ),
    Section("Results", ("validation.md", "evaluation.md", "results.md")),
    Section("Project", ("changelog.md", "development.md", "cite.md")),
)
OTHERS = "How-to"
"""Section to which pages are appended that no section names."""


def navigation(pages: Iterable[str]) -> list[dict[str, object]]:
    """The navigation of MkDocs: the home page, then the sections that have pages.

    Args:
      pages: All pages, relative to the folder of the documentation.
    """
    known = set(pages) - {HOME}
    filled = {section.title: list(_filled(section, known)) for section in SECTIONS}
    placed = {page for found in filled.values() for page in found}
    filled[OTHERS] += sorted(known - placed)
    sections: list[dict[str, object]] = [{title: found} for title, found in filled.items() if found]
    return [{"Home": HOME}, *sections]


def _filled(section: Section, known: set[str]) -> Iterator[str]:
    """Pages of a section that exist, in order."""
    yield from (page for page in section.pages if page in known)
    if section.folder is not None:
        rest = known - set(section.pages)
        yield from sorted(page for page in rest if page.startswith(section.folder))
