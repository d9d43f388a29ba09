"""Marked blocks of the pages, without scripts: equations (`math`) as MathML, state diagrams as tables."""

from __future__ import annotations

import html
import re
from typing import Any


def format_equation(source: str, _language: str, _class: str, _options: Any, _markdown: Any, **_: Any) -> str:
    """Convert a block of LaTeX, for the custom fences of pymdownx.superfences."""
    from latex2mathml.converter import convert

    return f'<div class="math">{convert(source.strip(), display="block")}</div>'


_TITLE, _START = "stateDiagram-v2", "[*]"
_TRANSITION = re.compile(r"\s*(\[\*\]|\w+) --> (\w+): (.+?)\s*")


def format_state_diagram(
    source: str, _language: str, _class: str, _options: Any, _markdown: Any, **_: Any
) -> str:
    """Convert a diagram to a table with a line for each state: what leads from it to which other state.

    Raises:
      ValueError: A line is no transition; other diagrams of Mermaid would need its script.
    """
    title, *lines = source.strip().splitlines()
    leading: dict[str, list[str]] = {}
    for line in lines:
        match = _TRANSITION.fullmatch(line)
        if title.strip() != _TITLE or match is None:
            raise ValueError(f"not a transition of a {_TITLE}: {line.strip()!r}")
        origin, target, words = (html.escape(part) for part in match.groups())
        leading.setdefault(origin, []).append(f"<strong>{target}</strong>: {words}")
    rows = (
        f"<tr><td>{'(start)' if origin == _START else origin}</td><td>{'<br>'.join(targets)}</td></tr>"
        for origin, targets in leading.items()
    )
    return f"<table><thead><tr><th>from</th><th>to</th></tr></thead><tbody>{''.join(rows)}</tbody></table>"
