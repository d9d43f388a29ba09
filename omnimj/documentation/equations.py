"""Equations of the pages, blocks marked `math`, as MathML, which browsers draw without any script."""

from __future__ import annotations

from typing import Any


def format_equation(source: str, _language: str, _class: str, _options: Any, _markdown: Any, **_: Any) -> str:
    """Convert a block of LaTeX, for the custom fences of pymdownx.superfences."""
    from latex2mathml.converter import convert

    return f'<div class="math">{convert(source.strip(), display="block")}</div>'
