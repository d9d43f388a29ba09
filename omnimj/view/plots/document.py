"""Drawings of a page as one Bokeh document: shared time axis and cursor, each signal embedded once."""

from __future__ import annotations

import base64
import zlib
from collections.abc import Mapping, Sequence
from typing import Any

from bokeh.document import Document
from bokeh.embed import components
from bokeh.layouts import column
from bokeh.models import ColumnDataSource, CrosshairTool, CustomJS, Range1d
from bokeh.models import Span as Rule
from bokeh.resources import Resources
from markupsafe import Markup

from omnimj.view import palette
from omnimj.view.plots.panels import Drawing, Panel

_TOUCH = """
// a finger scrolls the page; a mouse zooms
if (window.matchMedia("(pointer: coarse)").matches) for (const bar of bars) bar.active_drag = null;
"""


def library() -> Markup:
    """Return the script of Bokeh from its Python package, which the drawings of a page need."""
    return Markup("\n").join(map(Markup, Resources(mode="inline", components=["bokeh"]).js_raw))


def embed(drawings: Mapping[str, Drawing]) -> tuple[Markup, dict[str, Markup]]:
    """Put drawings into one document.

    Returns:
      Script that draws them, and the element of each drawing by name.
    """
    panels = [panel for drawing in drawings.values() for panel in drawing.panels]
    _link(panels)
    _share_data(panels)
    models: Any = {
        name: column([panel.plot for panel in drawing.panels], sizing_mode="stretch_width")
        for name, drawing in drawings.items()
    }
    document = Document()
    with document.models.freeze():  # references are collected once, not once per drawing
        for model in models.values():
            document.add_root(model)
    bars = [panel.plot.toolbar for panel in panels]
    document.js_on_event("document_ready", CustomJS(args={"bars": bars}, code=_TOUCH))
    script, elements = components(models, wrap_script=False)
    return Markup(script), {name: Markup(element) for name, element in elements.items()}


def stacked(drawings: Sequence[Drawing]) -> Any:
    """Lay drawings out below each other as one Bokeh model, with a common time axis and cursor."""
    panels = [panel for drawing in drawings for panel in drawing.panels]
    _link(panels)
    _share_data(panels)
    return column([panel.plot for panel in panels], sizing_mode="stretch_width")


def packed(script: str) -> str:
    """Compress a script that is not needed at once; `groups.js` unpacks it."""
    return base64.b64encode(zlib.compress(script.encode("utf-8"), 9)).decode("ascii")


def _link(panels: list[Panel]) -> None:
    """Let panels over the same times zoom together, with one cursor through all of them."""
    ranges: dict[tuple[float, float], Range1d] = {}
    cursor = Rule(dimension="height", line_color=palette.MUTED, line_width=1, line_dash=[2, 2])
    for panel in panels:
        if panel.over_time:
            own = panel.plot.x_range
            panel.plot.x_range = ranges.setdefault((own.start, own.end), own)
            panel.plot.add_tools(CrosshairTool(overlay=cursor))


def _share_data(panels: list[Panel]) -> None:
    """Move the columns of equal abscissae into one source: equal columns have equal names."""
    merged: dict[tuple[float, ...], ColumnDataSource] = {}
    for panel in panels:
        for renderer in panel.plot.renderers:
            source = renderer.data_source
            if source.tags:
                shared = merged.setdefault(tuple(source.tags), source)
                shared.data.update(source.data)
                renderer.data_source = shared
