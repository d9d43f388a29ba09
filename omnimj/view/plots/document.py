"""Drawings of a page as one Bokeh document: shared time axis and cursor, each signal embedded once."""

from __future__ import annotations

import base64
import json
import zlib
from collections.abc import Mapping, Sequence
from typing import Any

from bokeh import __version__
from bokeh.resources import Resources
from markupsafe import Markup

from omnimj.view import palette
from omnimj.view.plots.models import Model, encode, python_models
from omnimj.view.plots.panels import Drawing, Panel

_WHEN_READY = """
// a finger scrolls the page; a mouse zooms
if (window.matchMedia("(pointer: coarse)").matches) for (const bar of bars) bar.active_drag = null;
// on a phone, legends have as many columns as fit beside the value axis
const room = window.innerWidth - 120, fits = legend =>
  Math.floor(room / (36 + 6.5 * Math.max(...legend.items.map(item => item.label.value.length))));
for (const legend of legends) legend.ncols = Math.max(1, Math.min(legend.ncols, fits(legend)));
"""


def library() -> Markup:
    """Return the script of Bokeh from its Python package, which the drawings of a page need."""
    return Markup("\n").join(map(Markup, Resources(mode="inline", components=["bokeh"]).js_raw))


def embed(drawings: Mapping[str, Drawing]) -> tuple[Markup, dict[str, Markup]]:
    """Put drawings into one document.

    Returns:
      Script that draws them, and the element of each drawing by name.
    """
    roots = {name: _laid_out(drawing.panels) for name, drawing in drawings.items()}
    panels = [panel for drawing in drawings.values() for panel in drawing.panels]
    _connect(panels)
    legends = [legend for panel in panels for legend in panel.plot.above]
    adapted = {"bars": [panel.plot.toolbar for panel in panels], "legends": legends}
    adapt = Model("CustomJS", args=adapted, code=_WHEN_READY)
    described, callbacks = encode(list(roots.values()), {"document_ready": [adapt]})
    document = {"version": __version__, "roots": described, "callbacks": callbacks}
    ids = [root.id for root in roots.values()]
    item = {"docid": "page", "root_ids": ids, "roots": {name: name for name in ids}}
    element = Markup("<div id='{0}' data-root-id='{0}' style='display: contents;'></div>")
    return (
        Markup(f"Bokeh.embed.embed_items({_literal({'page': document})}, {_literal([item])});"),
        {name: element.format(root.id) for name, root in roots.items()},
    )


def _literal(value: Any) -> str:
    """Write a value in JavaScript; "<" is escaped, so that no text ends the script of the page."""
    return json.dumps(value, allow_nan=False, separators=(",", ":")).replace("<", "\\u003c")


def stacked(drawings: Sequence[Drawing]) -> Any:
    """Lay drawings out below each other as one Bokeh model, with a common time axis and cursor."""
    panels = [panel for drawing in drawings for panel in drawing.panels]
    _connect(panels)
    return python_models(_laid_out(panels))


def _laid_out(panels: Sequence[Panel]) -> Model:
    return Model("Column", children=[panel.plot for panel in panels], sizing_mode="stretch_width")


def _connect(panels: Sequence[Panel]) -> None:
    """Let panels share data, time axis and cursor."""
    _link(panels)
    _share_data(panels)


def packed(script: str) -> str:
    """Compress a script that is not needed at once; `groups.js` unpacks it."""
    return base64.b64encode(zlib.compress(script.encode("utf-8"), 9)).decode("ascii")


def _link(panels: Sequence[Panel]) -> None:
    """Let panels over the same times zoom together, with one cursor through all of them."""
    ranges: dict[tuple[float, float], Any] = {}
    cursor = Model("Span", dimension="height", line_color=palette.MUTED, line_width=1, line_dash=[2, 2])
    for panel in panels:
        if panel.over_time:
            own = panel.plot.x_range
            panel.plot.x_range = ranges.setdefault((own.start, own.end), own)
            panel.follow(cursor)


def _share_data(panels: Sequence[Panel]) -> None:
    """Move the columns of equal abscissae into one source: equal columns have equal names."""
    merged: dict[tuple[float, ...], Any] = {}
    for panel in panels:
        for key, source in panel.sources.items():
            shared = merged.setdefault(key, source)
            shared.data.update(source.data)
            for renderer in panel.plot.renderers:
                if renderer.data_source is source:
                    renderer.data_source = shared
