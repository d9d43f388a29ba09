"""HTML reports made from templates: one file each that works offline, on a phone and on paper.

A report is data (texts, tables, figures) and a template in `templates/`; the templates escape every text.
Parts of a page about single runs are found by a search field, together with the rows of tables about them;
their plots are loaded when they are opened.
"""

from __future__ import annotations

import base64
import dataclasses
import re
from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass, fields, is_dataclass
from pathlib import Path
from typing import Any

from jinja2 import Environment, FileSystemLoader, StrictUndefined
from markupsafe import Markup, escape

import omnimj
from omnimj.recording.json_files import write_text
from omnimj.view.plots.document import embed, library, packed
from omnimj.view.plots.panels import Drawing
from omnimj.view.plots.static import WIDTH, svg

_MEDIA_TYPES = {".png": "image/png", ".jpg": "image/jpeg", ".jpeg": "image/jpeg", ".svg": "image/svg+xml"}
_MANY, _SENTENCE = 4, 40  # columns, and letters in a cell, from which rows are stacked on a phone
_BROAD = 780  # width of a still picture across the page [pixels]
_WIDE = 5  # columns from which rows are always stacked on a phone
_TEMPLATES = Environment(
    loader=FileSystemLoader(Path(__file__).parent / "templates"),
    autoescape=True,
    undefined=StrictUndefined,
    trim_blocks=True,
    lstrip_blocks=True,
)
FEW_RUNS = 3
"""Number of runs up to which a page has no search field."""
MOST_FIGURES = 40
"""Largest number of runs with plots, which keeps the page small enough for a browser."""


@dataclass(frozen=True)
class Cell:
    """Cell of a table."""

    text: object
    kind: str = ""
    """CSS classes, such as `number`."""
    title: str = ""
    """Bold text above the text."""
    note: str = ""
    """Small text below the text."""
    bar: int | None = None
    """Length of a bar below the text [%]; None for no bar."""
    link: str = ""
    """Address that the text links to, such as `#anchor`; empty for none."""
    find: str = ""
    """Words that the text puts into the page's search field; empty for none."""


def number(text: object, note: str = "") -> Cell:
    """Make a cell for a number, which is kept on one line."""
    return Cell(text, "number", note=note)


def check_state(ok: bool, judged: bool = True) -> Cell:
    """Make a cell for the result of a check: a sign and a word, readable without colour."""
    if not judged:
        return Cell("– not judged", "state")
    return Cell("✓ ok", "state good") if ok else Cell("✗ failed", "state bad")


@dataclass(frozen=True)
class Table:
    """Table of an HTML page: rows of cells below column headings."""

    rows: Sequence[Sequence[Cell]]
    head: Sequence[str] = ()
    kind: str = ""
    """CSS class; `stacked` turns each row into a list on a narrow page."""
    row_headings: bool = False
    """True if the first cell of each row is its heading."""
    keys: Sequence[str] = ()
    """Anchor of the run that each row belongs to; empty for a table of something else."""


def table(
    rows: Sequence[Sequence[Cell | object]],
    head: Sequence[str] = (),
    kind: str = "",
    row_headings: bool = False,
) -> Table:
    """Make a table; one with many columns or long texts is stacked on a narrow page.

    The first cell of each row is its heading if there are no column headings, or in addition to them if
    `row_headings`. `kind` is a CSS class other than `stacked`.
    """
    cells = [[one if isinstance(one, Cell) else Cell(one) for one in row] for row in rows]
    has_sentence = any(len(f"{c.title}{c.text}{c.note}") > _SENTENCE for row in cells for c in row)
    if not kind and (len(head) >= _WIDE or (len(head) >= _MANY and has_sentence)):
        kind = "stacked"
    return Table(cells, head, kind, row_headings or not head)


@dataclass(frozen=True)
class Figure:
    """Plot or picture with heading and caption."""

    content: Markup | Drawing
    name: str
    """Anchor of the figure, unique within the page; empty for a picture."""
    heading: str
    caption: str
    kind: str = ""
    """CSS class: `picture`, `broad` for a plot as wide as the page, or empty."""
    label: str = ""
    """Description for screen readers; the heading if empty."""


def picture(file: Path, label: str, heading: str, caption: str) -> Figure:
    """Embed an image file, described by `label` for screen readers."""
    content = base64.b64encode(file.read_bytes()).decode("ascii")
    source = f"data:{_MEDIA_TYPES[file.suffix.lower()]};base64,{content}"
    return Figure(Markup("<img src='{}' alt='{}'>").format(source, label), "", heading, caption, "picture")


def command_line(command: str) -> Markup:
    """Format a command line for copying, with line breaks between words but not inside `--option`."""
    words = re.sub(r"(?<!\S)--?[\w-]+", r"<span class='option'>\g<0></span>", str(escape(command)))
    return Markup(f"<pre><code>{words}</code></pre>")


def write_page(path: Path, template: str, title: str, **content: Any) -> None:
    """Render a report from a template, named without its ending, and write it, in full or not at all.

    Raises:
      OutputError: The file cannot be written.
    """
    page = _TEMPLATES.get_template(f"{template}.html.j2")
    grouped = [(group, figure) for group, figure in _figures(content) if figure.name]
    contents = [(figure.name, figure.heading) for _, figure in grouped]
    drawn: dict[str, dict[str, Drawing]] = {}
    still = {}
    for group, figure in grouped:
        if isinstance(drawing := figure.content, Drawing):
            drawn.setdefault(group, {})[figure.name] = drawing
            still[figure.name] = Markup(svg(drawing, width=_BROAD if figure.kind == "broad" else WIDTH))
    documents = {group: embed(drawings) for group, drawings in drawn.items()}
    groups = {group: packed(script) for group, (script, _) in documents.items() if group}
    scripts = [library(), *(script for group, (script, _) in documents.items() if not group)] if drawn else []
    elements = {name: one for _, found in documents.values() for name, one in found.items()}
    plots = {"elements": elements, "still": still, "scripts": scripts, "groups": groups, "contents": contents}
    text = page.render(title=title, version=omnimj.__version__, **plots, **content)
    write_text(path, text)


def render_part(template: str, **content: Any) -> str:
    """Render a template that is no page of its own, such as a table for a notebook."""
    return _TEMPLATES.get_template(f"{template}.html.j2").render(**content)


def _figures(content: Any, group: str = "") -> Iterator[tuple[str, Figure]]:
    """Find the figures in the content of a page, each with the anchor of its part about one run, or empty."""
    if isinstance(content, Figure):
        yield group, content
        return
    group = content.key if isinstance(content, RunSection) else group
    if isinstance(content, Mapping):
        below = list(content.values())
    elif isinstance(content, list | tuple):
        below = content
    else:
        below = [getattr(content, f.name) for f in fields(content)] if is_dataclass(content) else ()
    for part in below:
        yield from _figures(part, group)


_TEMPLATES.filters["command_line"] = command_line


@dataclass(frozen=True)
class RunSection:
    """Part of the page about one run, whose plots are loaded when it is opened."""

    name: str
    """Name of the run, unique within the page."""
    figures: Sequence[Figure]
    note: str = ""
    """Words beside the name, readable while the section is closed."""
    lines: Sequence[str] = ()
    table: Table | None = None
    is_open: bool = False
    """True if the section is open from the beginning; the first of a page always is."""

    @property
    def key(self) -> str:
        """Anchor of the section."""
        return run_key(self.name)


def run_key(name: str) -> str:
    """Return the anchor of the section of a run."""
    return "run-" + "".join(c if c.isascii() and c.isalnum() else f"-{ord(c):x}-" for c in name)


def run_table(
    rows: Sequence[tuple[str, Sequence[Cell | object]]],
    head: Sequence[str],
    sections: Collection[RunSection],
) -> Table:
    """Make a table of runs, whose rows are found by the search field.

    A row is the name of a run, which links to its section if there is one, and its other cells.
    """
    linked = {section.key for section in sections}
    keys = [run_key(name) for name, _ in rows]
    cells = [
        (Cell(name, link=f"#{key}" if key in linked else ""), *others)
        for key, (name, others) in zip(keys, rows, strict=True)
    ]
    return dataclasses.replace(table(cells, head), keys=keys)
