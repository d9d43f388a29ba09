"""Plots of one scenario driven with several methods, overlaid; each function returns one figure."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from omnimj.signals import Trace
from omnimj.view import palette
from omnimj.view.plots.drawing import TALL, finish, legend, line, new_figure, value_axis
from omnimj.view.plots.runs import draw_patch, equal_with_room, planned_heading, planned_position
from omnimj.view.wording import Span

_DEGREES = 180.0 / np.pi


def _style(method: str) -> dict[str, Any]:
    color, dashes, width = palette.METHODS.get(method, (palette.INK, "-", 1.3))
    order = 3.0 - 0.1 * width  # wide lines below narrow ones
    return {"color": color, "linestyle": dashes, "linewidth": width, "label": method, "zorder": order}


def courses(traces: Mapping[str, Trace], spans: Sequence[Span]) -> Figure:
    """Plot heading error, position error and speed of each method's run.

    Args:
      traces: Traces of a robot by method.
      spans: Faults to shade.
    """
    first = next(iter(traces.values()))
    place = "x" in first and "target_x" in first
    speed = "twist_x" in first
    figure, axes = new_figure(TALL, rows=1 + int(place) + int(speed), sharex=True)
    for method, trace in traces.items():
        style, time = _style(method), trace["time"]
        heading, planned = trace["heading" if "heading" in trace else "yaw"], planned_heading(trace)
        away = np.unwrap(heading if planned is None else heading - planned)
        away -= 2.0 * np.pi * np.round(away[0] / (2.0 * np.pi))
        line(axes[0], time, _DEGREES * away, **style)
        if place:
            x, y = trace["x"] - trace["target_x"], trace["y"] - trace["target_y"]
            line(axes[1], time, np.hypot(x, y), **style)
        if speed:
            line(axes[-1], time, np.hypot(trace["twist_x"], trace["twist_y"]), **style)
    value_axis(axes[0], "heading\nerror [°]")
    axes[0].axhline(0.0, color=palette.MUTED, linewidth=0.8, zorder=1)
    if place:
        value_axis(axes[1], "off the\nplan [m]")
    if speed:
        value_axis(axes[-1], "speed [m/s]")
    longest = max((trace["time"] for trace in traces.values()), key=len)
    finish(axes, longest, spans)
    legend(axes[0])
    return figure


def paths(traces: Mapping[str, Trace], patches: Sequence[Any]) -> Figure:
    """Plot the driven paths from above with equal axes.

    Args:
      traces: Traces of a robot with its position, by method.
      patches: Patches of other floors.
    """
    figure, (ax,) = new_figure(TALL)
    for patch in patches:
        draw_patch(ax, patch)
    points = []
    planned = planned_position(next(iter(traces.values())))
    if planned is not None:
        style = {"linestyle": (0, (5, 3)), "linewidth": 1.2, "label": "planned", "zorder": 2}
        ax.plot(planned[:, 0], planned[:, 1], color=palette.PLANNED, **style)
        points.append(planned)
    for method, trace in traces.items():
        x, y, step = trace["x"], trace["y"], max(1, len(trace["x"]) // 1500)
        ax.plot(x[::step], y[::step], **_style(method))
        ax.plot(x[-1], y[-1], "s", color=_style(method)["color"], markersize=5, zorder=4)
        points.append(np.column_stack([x, y]))
    equal_with_room(ax, np.vstack(points))
    ax.set_xlabel("x [m]", fontsize=9)
    value_axis(ax, "y [m]")
    legend(ax)
    return figure
