"""Panels over the time of a run: common time axis, and intervals of faults shaded and named."""

from __future__ import annotations

from collections.abc import Sequence

from omnimj.signals import Array
from omnimj.view import palette
from omnimj.view.plots.models import in_frame
from omnimj.view.plots.panels import Drawing, Panel
from omnimj.view.wording import Span

_ROW = 15  # [pixels] of a label in a panel


def finish(drawing: Drawing, time: Array, spans: Sequence[Span], labelled: bool = True) -> Drawing:
    """Fit the panels to the times of a run, shape (k,) [s], and shade faults, labelled in the first panel."""
    for i, panel in enumerate(drawing.panels):
        is_last = i == len(drawing.panels) - 1
        panel.x_limits(float(time[0]), float(time[-1]) if len(time) > 1 else float(time[0]) + 1.0)
        if is_last:
            panel.x_label = "time [s]"
        else:
            panel.continue_below()
        if spans:
            shade_faults(panel, spans, time, labelled and i == 0)
        panel.finish()
    return drawing


def shade_faults(panel: Panel, spans: Sequence[Span], time: Array, labelled: bool = True) -> None:
    """Shade intervals of active faults, labelled at the top; faults of one interval share a band.

    The first and the last time of the run, shape (k,) [s], keep the labels inside the plot.
    """
    for row, ((start, end), labels) in enumerate(_together(spans).items()):
        edge = {"line_color": palette.FAULT, "line_dash": [3, 3], "line_width": 0.9}
        panel.shade("fault", start, end, 0.16, **edge)
        if labelled:
            _name_band(panel, (start, end), time, "; ".join(labels), row % 4)


def _together(spans: Sequence[Span]) -> dict[tuple[float, float], list[str]]:
    """Group labels by interval; `slip, wheel 1` and `slip, wheel 3` become `slip, wheels 1, 3`."""
    found: dict[tuple[float, float], dict[str, list[str]]] = {}
    for span in spans:
        name, _, wheel = span.label.partition(", wheel ")
        found.setdefault((span.start, span.end), {}).setdefault(name, []).append(wheel)
    return {
        interval: [_named(name, [w for w in wheels if w]) for name, wheels in kinds.items()]
        for interval, kinds in found.items()
    }


def _named(name: str, wheels: list[str]) -> str:
    if not wheels:
        return name
    return f"{name}, wheel{'s' if len(wheels) > 1 else ''} {', '.join(wheels)}"


def _name_band(panel: Panel, band: tuple[float, float], time: Array, label: str, row: int) -> None:
    """Write the label of a band below the upper edge, inside the plot even for a band at its side."""
    left, right = float(time[0]), float(time[-1])
    start, end = band
    middle = 0.5 * (start + end)
    if middle > left + 0.75 * (right - left):
        place, side, aside = end, "right", -4
    elif middle < left + 0.25 * (right - left):
        place, side, aside = start, "left", 4
    else:
        place, side, aside = middle, "center", 0
    panel.text(
        place,
        in_frame("top", 2 + _ROW * row),
        label,
        palette.FAULT_INK,
        x_offset=aside,
        text_align=side,
        text_baseline="top",
        background_fill_color="white",
        background_fill_alpha=0.65,
    )
