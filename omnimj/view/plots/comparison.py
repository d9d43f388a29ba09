"""Plots of one scenario driven with several methods, overlaid; each function returns one figure."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from omnimj.signals import Trace
from omnimj.view import palette
from omnimj.view.motion import planned_heading, planned_position
from omnimj.view.plots.over_time import finish
from omnimj.view.plots.panels import TALL, Drawing, new_drawing
from omnimj.view.plots.runs import draw_patch, draw_path, equal_with_room, map_from_above
from omnimj.view.wording import Span

_DEGREES = 180.0 / np.pi


def _style(method: str) -> dict[str, Any]:
    color, dash, width = palette.METHODS.get(method, (palette.INK, "-", 1.3))
    return {"color": color, "dash": dash, "width": width, "label": method}


def _wide_first(traces: Mapping[str, Trace]) -> list[tuple[str, Trace]]:
    """Methods with the widest line first, so that narrow lines lie on top."""
    return sorted(traces.items(), key=lambda item: -_style(item[0])["width"])


def courses(traces: Mapping[str, Trace], spans: Sequence[Span]) -> Drawing:
    """Plot heading error, position error and speed of each method's run.

    Args:
      traces: Traces of a robot by method.
      spans: Faults to shade.
    """
    first = next(iter(traces.values()))
    place = "x" in first and "target_x" in first
    speed = "twist_x" in first
    drawing = new_drawing(TALL, rows=1 + int(place) + int(speed))
    panels = drawing.panels
    panels[0].values("heading error [°]")
    panels[0].rule(0.0)
    if place:
        panels[1].values("off the plan [m]")
    if speed:
        panels[-1].values("speed [m/s]")
    for method, trace in _wide_first(traces):
        style, time = _style(method), trace["time"]
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
    return finish(drawing, max((trace["time"] for trace in traces.values()), key=len), spans)


def paths(traces: Mapping[str, Trace], patches: Sequence[Any]) -> Drawing:
    """Plot the driven paths from above with equal axes.

    Args:
      traces: Traces of a robot with its position, by method.
      patches: Patches of other floors.
    """
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
    for method, trace in _wide_first(traces):
        style = _style(method)
        draw_path(panel, trace["x"], trace["y"], **style)
        panel.points(trace["x"][-1], trace["y"][-1], style["color"], method, marker="square")
    panel.legend()
    panel.finish()
    return drawing
