"""Plots of several runs, overlaid: one scenario with several methods, or any runs."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from typing import Any

import numpy as np

from omnimj.signals import Array, Trace
from omnimj.view import palette
from omnimj.view.motion import planned_heading, planned_position
from omnimj.view.plots.over_time import finish
from omnimj.view.plots.panels import TALL, Drawing, Style, new_drawing
from omnimj.view.plots.runs import draw_patch, draw_path, equal_with_room, map_from_above
from omnimj.view.wording import Span

_DEGREES = 180.0 / np.pi
_PER_COLUMN = 150  # height of one of several panels [pixels]


LineStyle = tuple[str, Style, float]
"""Colour, dash pattern and width [pixels] of a run's lines."""
_METHOD: LineStyle = (palette.INK, "-", 1.3)


def run_styles(names: Iterable[str]) -> dict[str, LineStyle]:
    """Choose a colour and a dash pattern for each run, which differ up to eight runs."""
    return {name: (palette.wheel_color(i), palette.wheel_line(i), 1.4) for i, name in enumerate(names)}


def _wide_first(
    traces: Mapping[str, Trace], styles: Mapping[str, LineStyle]
) -> list[tuple[str, Trace, dict[str, Any]]]:
    """Runs and keywords of their lines, with the widest line first, so that narrow lines lie on top."""
    drawn = [(name, trace, styles.get(name, _METHOD)) for name, trace in traces.items()]
    drawn.sort(key=lambda one: -one[2][2])
    return [
        (name, trace, {"color": color, "dash": dash, "width": width, "label": name})
        for name, trace, (color, dash, width) in drawn
    ]


def courses(
    traces: Mapping[str, Trace],
    spans: Sequence[Span],
    styles: Mapping[str, LineStyle] = palette.METHODS,
) -> Drawing:
    """Plot heading error, position error and speed of each run."""
    place = all("x" in trace and "target_x" in trace for trace in traces.values())
    speed = all("twist_x" in trace for trace in traces.values())
    drawing = new_drawing(TALL, rows=1 + int(place) + int(speed))
    panels = drawing.panels
    panels[0].values("heading error [°]")
    panels[0].rule(0.0)
    if place:
        panels[1].values("off the plan [m]")
    if speed:
        panels[-1].values("speed [m/s]")
    for _, trace, style in _wide_first(traces, styles):
        time = trace["time"]
        heading, planned = trace["heading" if "heading" in trace else "yaw"], planned_heading(trace)
        away = np.unwrap(heading if planned is None else heading - planned)
        away -= 2.0 * np.pi * np.round(away[0] / (2.0 * np.pi))
        panels[0].line(time, _DEGREES * away, **style)
        if place:
            x, y = trace["x"] - trace["target_x"], trace["y"] - trace["target_y"]
            panels[1].line(time, np.hypot(x, y), **style)
        if speed:
            panels[-1].line(time, np.hypot(trace["twist_x"], trace["twist_y"]), **style)
    panels[0].legend()
    return finish(drawing, _longest(traces), spans)


def _longest(traces: Mapping[str, Trace]) -> Array:
    """Times of the longest run, shape (k,) [s]."""
    return max((trace["time"] for trace in traces.values()), key=lambda time: time[-1])


def signals(
    traces: Mapping[str, Trace],
    columns: Sequence[tuple[str, str]],
    styles: Mapping[str, LineStyle],
) -> Drawing:
    """Plot columns over time, each with its label in a panel, of the runs that have them."""
    drawing = new_drawing(_PER_COLUMN * len(columns) + 50, rows=len(columns))
    for panel, (column, label) in zip(drawing.panels, columns, strict=True):
        panel.values(label)
        for _, trace, style in _wide_first(traces, styles):
            if column in trace:
                panel.line(trace["time"], trace[column], **style)
    drawing.panels[0].legend()
    return finish(drawing, _longest(traces), ())


def paths(
    traces: Mapping[str, Trace],
    patches: Sequence[Any],
    styles: Mapping[str, LineStyle] = palette.METHODS,
) -> Drawing:
    """Plot the driven paths from above with equal axes."""
    drawing = map_from_above()
    (panel,) = drawing.panels
    planned = planned_position(next(iter(traces.values())))
    driven = [np.column_stack([trace["x"], trace["y"]]) for trace in traces.values()]
    equal_with_room(panel, np.vstack(driven if planned is None else [planned, *driven]))
    for patch in patches:
        draw_patch(panel, patch)
    if planned is not None:
        style = {"label": "planned", "dash": (0, (5, 3)), "width": 1.2}
        draw_path(panel, planned[:, 0], planned[:, 1], color=palette.PLANNED, **style)
    for name, trace, style in _wide_first(traces, styles):
        draw_path(panel, trace["x"], trace["y"], **style)
        panel.points(trace["x"][-1], trace["y"][-1], style["color"], name, marker="square")
    panel.legend()
    panel.finish()
    return drawing
