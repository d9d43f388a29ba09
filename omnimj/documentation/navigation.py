"""Order of the pages in the navigation; a page that no section names is appended, so that none is lost."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass

from omnimj.documentation.options import HOWTO

HOME = "index.md"
TUTORIALS = "tutorials/"
"""Folder of the tutorials."""


@dataclass(frozen=True)
class Section:
    """Section of the navigation."""

    title: str
    entries: tuple[str | Section, ...]
    """Pages, relative to the folder of the documentation, and sections, in order; pages that do not exist are
    skipped."""
    folder: str | None = None
    """Folder whose other pages follow, by name."""

    def pages(self) -> Iterator[str]:
        """Pages named in this section and below."""
        for entry in self.entries:
            yield from (entry,) if isinstance(entry, str) else entry.pages()


def _commands(*names: str) -> tuple[str, ...]:
    """How-to pages of commands."""
    return tuple(f"{HOWTO}{name}.md" for name in names)


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
            Section("Drive", _commands("run", "scenarios", "compare")),
            Section("Logs", (*_commands("record", "import", "export"), "logs.md")),
            Section("Gap", (*_commands("gap", "validate"), "any_machine.md")),
            Section("Identify", (*_commands("identify"), "own_robot.md")),
            Section("Diagnose", (*_commands("diagnose", "calibrate", "evaluate"), "many_runs.md")),
            Section("Tune", (*_commands("tune", "sensitivity"), "tuning.md")),
            Section(
                "Robot on a wire",
                (
                    *_commands("device", "link_check", "teleop", "link_fuzz"),
                    *("hardware.md", "ros2_control.md"),
                ),
            ),
            Section("Wheels of your own", (*_commands("wheel", "robot"), "wheels.md")),
            Section("Python and learning", ("python.md", "learning.md")),
            Section(
                "This installation",
                _commands("completion", "bench", "report_bug", "docs_serve", "docs_build"),
            ),
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
    Section(
        "Results",
        ("validation.md", "evaluation.md", "gap_benchmark.md", "real_machines.md", "results.md"),
    ),
    Section("Project", ("changelog.md", "development.md", "cite.md")),
)
OTHERS = "How-to"
"""Section to which pages are appended that no section names."""


def navigation(pages: Iterable[str]) -> list[dict[str, object]]:
    """The navigation of MkDocs: the home page, then the sections that have pages."""
    known = set(pages) - {HOME}
    filled = {section.title: _filled(section, known) for section in SECTIONS}
    placed = {page for section in SECTIONS for page in (*section.pages(), *_others(section, known))}
    filled[OTHERS] += sorted(known - placed)
    sections: list[dict[str, object]] = [{title: found} for title, found in filled.items() if found]
    return [{"Home": HOME}, *sections]


def _filled(section: Section, known: set[str]) -> list[object]:
    """Entries of a section that exist, in order; sections without pages are left out."""
    found: list[object] = []
    for entry in section.entries:
        if isinstance(entry, Section):
            below = _filled(entry, known)
            found += [{entry.title: below}] if below else []
        elif entry in known:
            found.append(entry)
    return [*found, *_others(section, known)]


def _others(section: Section, known: set[str]) -> list[str]:
    """Other pages of the section's folder."""
    if section.folder is None:
        return []
    return sorted(page for page in known - set(section.pages()) if page.startswith(section.folder))
