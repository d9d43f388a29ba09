"""The plots of a test rig's run; each function returns one figure."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from matplotlib.figure import Figure

from omnimj.signals import Trace
from omnimj.view import palette
from omnimj.view.drawing import SHORT, finish, legend, line, new_figure, value_axis
from omnimj.view.wording import Span


def speeds(trace: Trace, wheel_radius: float, spans: Sequence[Span]) -> Figure:
    """Rim speed r·φ̇ against the carriage's speed [m/s]."""
    figure, (ax,) = new_figure(SHORT)
    time = trace["time"]
    line(ax, time, wheel_radius * trace["wheel_speed"], color=palette.ACCENT, label="wheel rim, r·φ̇")
    line(ax, time, trace["carriage_speed"], color=palette.MEASURED, linestyle=(0, (6, 1.5)), label="carriage")
    value_axis(ax, "speed [m/s]")
    return _finished(figure, trace, spans, legend_columns=2)


def slip(trace: Trace, wheel_radius: float, spans: Sequence[Span]) -> Figure:
    """Slip velocity V_r = r·φ̇ − V, true where the plant knows it, else from the two encoders [m/s]."""
    figure, (ax,) = new_figure(SHORT)
    time = trace["time"]
    measured = wheel_radius * trace["wheel_speed"] - trace["carriage_speed"]
    line(ax, time, measured, color=palette.DIAGNOSIS, linewidth=0.9, label="from the encoders")
    if "slip_velocity_1" in trace:
        line(ax, time, trace["slip_velocity_1"], color=palette.ACCENT, label="true")
    ax.axhline(0.0, color=palette.MUTED, linewidth=0.8, zorder=1)
    value_axis(ax, "slip velocity [m/s]")
    return _finished(figure, trace, spans, legend_columns=2)


def forces(trace: Trace, spans: Sequence[Span]) -> Figure:
    """Traction along the rail and lateral friction at the floor [N]."""
    figure, (ax,) = new_figure(SHORT)
    time = trace["time"]
    line(ax, time, trace["traction_force_1"], color=palette.ACCENT, label="traction")
    if "lateral_force_1" in trace and np.any(trace["lateral_force_1"]):
        style = {"color": palette.HEALTHY, "linestyle": (0, (6, 1.5)), "label": "lateral"}
        line(ax, time, trace["lateral_force_1"], **style)
    ax.axhline(0.0, color=palette.MUTED, linewidth=0.8, zorder=1)
    value_axis(ax, "force [N]")
    return _finished(figure, trace, spans, legend_columns=2)


def normal(trace: Trace, spans: Sequence[Span]) -> Figure:
    """Normal force at the floor [N]."""
    figure, (ax,) = new_figure(SHORT)
    line(ax, trace["time"], trace["normal_force_1"], color=palette.MEASURED)
    value_axis(ax, "normal force [N]")
    return _finished(figure, trace, spans, legend_columns=1)


def current(trace: Trace, spans: Sequence[Span]) -> Figure:
    """Motor current, measured and commanded [A]."""
    figure, (ax,) = new_figure(SHORT)
    line(ax, trace["time"], trace["current"], color=palette.MEASURED, linewidth=1.0, label="measured")
    if "current_target" in trace:
        wanted = trace["current_target"]
        line(ax, trace["time"], wanted, color=palette.INK, linestyle=(0, (4, 2)), label="command")
    ax.set_ylim(min(0.0, ax.get_ylim()[0]), ax.get_ylim()[1])
    value_axis(ax, "current [A]")
    return _finished(figure, trace, spans, legend_columns=2)


def lateral(trace: Trace, spans: Sequence[Span]) -> Figure:
    """Speed of the gantry sideways [m/s]."""
    figure, (ax,) = new_figure(SHORT)
    line(ax, trace["time"], trace["lateral_speed"], color=palette.HEALTHY, label="gantry")
    ax.axhline(0.0, color=palette.MUTED, linewidth=0.8, zorder=1)
    value_axis(ax, "lateral speed [m/s]")
    return _finished(figure, trace, spans, legend_columns=1)


def _finished(figure: Figure, trace: Trace, spans: Sequence[Span], legend_columns: int) -> Figure:
    axes = figure.get_axes()
    finish(axes, trace["time"], spans)
    if len(axes[0].get_legend_handles_labels()[1]) > 1:
        legend(axes[0], legend_columns)
    return figure
