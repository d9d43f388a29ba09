"""Lines, bars and labels of a plot, read from the models that the browser draws."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from omnimj.view.plots.panels import Panel


class DrawnLine(NamedTuple):
    """A visible line of a panel."""

    label: str
    color: str
    x: np.ndarray
    y: np.ndarray


def marks(panel: Panel, kind: str) -> list[Any]:
    """Annotations of a kind."""
    return [mark for mark in panel.plot.center if mark.kind == kind]


def labels_of(panel: Panel) -> dict[Any, str]:
    """Entry of the legend by renderer."""
    items = [item for legend in panel.plot.above for item in legend.items]
    return {renderer: item.label.value for item in items for renderer in item.renderers}


def lines(panel: Panel, label: str | None = None) -> list[DrawnLine]:
    """Visible lines of a panel in the order in which they are drawn."""
    labels = labels_of(panel)
    found = []
    for renderer in panel.plot.renderers:
        glyph, data = renderer.glyph, renderer.data_source.data
        if glyph.kind == "Line" and glyph.line_alpha > 0.0:
            named = labels.get(renderer, "")
            found.append(DrawnLine(named, str(glyph.line_color), data["x"], data[glyph.y.field]))
    return [line for line in found if label is None or line.label == label]


def shades(panel: Panel) -> list[Any]:
    """Shaded intervals."""
    return [box for box in marks(panel, "BoxAnnotation") if box.name == "fault"]


def texts(panel: Panel) -> list[str]:
    """Words written into the panel."""
    return [label.text for label in marks(panel, "Label")]


def row_names(panel: Panel) -> list[str]:
    """Names of the rows of the value axis, from top to bottom."""
    overrides = panel.y_axis.major_label_overrides
    return [overrides[row] for row in sorted(overrides)]


class Bar(NamedTuple):
    """A horizontal bar."""

    row: str
    left: float
    right: float
    color: str


def bars(panel: Panel) -> list[Bar]:
    """Horizontal bars in the order in which they are drawn."""
    names, found = row_names(panel), []
    for renderer in panel.plot.renderers:
        if renderer.glyph.kind == "HBar":
            data = renderer.data_source.data
            colors = data.get("color", [renderer.glyph.fill_color] * len(data["left"]))
            rows = [names[row] for row in data["middle"]]
            found += map(Bar, rows, data["left"], data["right"], colors)
    return found
