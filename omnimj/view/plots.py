"""The plots of a robot's run that are worth looking at; each function returns one figure."""

from __future__ import annotations

from collections.abc import Container, Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import NDArray

from omnimj.signals import Trace
from omnimj.view import palette
from omnimj.view.drawing import (
    MIDDLE,
    SHORT,
    TALL,
    averaged,
    banded,
    finish,
    headroom,
    legend,
    line,
    new_figure,
    value_axis,
)
from omnimj.view.wording import Span

Array = NDArray[np.float64]
_DEGREES = 180.0 / np.pi
_DASHES = (0, (5, 3))


def wheel_count(columns: Container[str]) -> int:
    """Number of wheels that a trace has columns of."""
    n = 0
    while f"wheel_speed_{n + 1}" in columns:
        n += 1
    return n


def planned_position(trace: Trace) -> Array | None:
    """Planned path, shape (k, 2) [m]; None where the run had none."""
    if "target_x" in trace and "target_y" in trace:
        return np.stack([trace["target_x"], trace["target_y"]], axis=1)
    return None


def planned_heading(trace: Trace) -> Array | None:
    """Planned heading [rad]; None where the run had none."""
    for name in ("target_heading", "target_yaw"):
        if name in trace:
            return trace[name]
    return None


def deviation(trace: Trace, spans: Sequence[Span]) -> Figure:
    """Heading [degrees], how far it is from a plan that turns, and how far the robot is from its plan [m]."""
    time, planned, place = trace["time"], planned_heading(trace), planned_position(trace)
    turns = planned is not None and np.ptp(planned) > 1e-6
    placed = place is not None and "x" in trace
    rows = 1 + int(turns) + int(placed)
    figure, axes = new_figure(TALL if rows > 1 else SHORT, rows=rows, sharex=True)
    driven = np.unwrap(trace["heading"] if "heading" in trace else trace["yaw"])
    line(axes[0], time, _DEGREES * driven, color=palette.MEASURED, label="driven")
    if planned is not None:
        line(axes[0], time, _DEGREES * planned, color=palette.PLANNED, linestyle=_DASHES, label="planned")
    if planned is not None and turns:
        line(axes[1], time, _DEGREES * (driven - planned), color=palette.ACCENT)
        value_axis(axes[1], "heading error [°]")
    if place is not None and placed:
        _distance(axes[-1], trace, place)
    for ax in axes[1:]:
        ax.axhline(0.0, color=palette.MUTED, linewidth=0.8, zorder=1)
    value_axis(axes[0], "heading [°]")
    finish(axes, time, spans)
    legend(axes[0])
    if placed:
        headroom(axes[-1], 0.3)
        axes[-1].legend(
            loc="upper left", ncols=3, fontsize=8, frameon=False, handlelength=1.6, borderaxespad=0.1
        )
    return figure


def _distance(ax: Axes, trace: Trace, place: Array) -> None:
    """Driven − planned position at each instant: both parts and the distance."""
    x, y = trace["x"] - place[:, 0], trace["y"] - place[:, 1]
    line(ax, trace["time"], np.hypot(x, y), color=palette.INK, label="distance", linewidth=1.6)
    line(ax, trace["time"], x, color=palette.MEASURED, label="in x", linestyle=(0, (6, 1.5)))
    line(ax, trace["time"], y, color=palette.ACCENT, label="in y", linestyle=(0, (3, 1.2)))
    value_axis(ax, "off the plan [m]")


def velocity(trace: Trace, spans: Sequence[Span]) -> Figure:
    """Velocity in the world [m/s] and yaw rate [rad/s], driven and planned."""
    figure, axes = new_figure(MIDDLE, rows=2, sharex=True)
    time, c, s = trace["time"], np.cos(trace["heading"]), np.sin(trace["heading"])
    x, y = trace["twist_x"], trace["twist_y"]
    for name, driven, color in (("x", c * x - s * y, palette.MEASURED), ("y", s * x + c * y, palette.ACCENT)):
        line(axes[0], time, driven, color=color, label=f"in {name}")
        if f"target_velocity_{name}" in trace:
            planned = trace[f"target_velocity_{name}"]
            line(axes[0], time, planned, color=palette.PLANNED, linestyle=_DASHES, linewidth=1.0)
    banded(axes[1], time, trace["twist_yaw"], palette.HEALTHY)
    value_axis(axes[0], "velocity [m/s]")
    value_axis(axes[1], "yaw rate [rad/s]")
    finish(axes, time, spans)
    legend(axes[0])
    return figure


def wheel_speeds(trace: Trace, spans: Sequence[Span]) -> Figure:
    """Each wheel's speed, measured and target, in small plots of one scale."""
    n, time = wheel_count(trace), trace["time"]
    figure, axes = new_figure(0.9 + 1.15 * n, rows=n, sharex=True, sharey=True)
    for i, ax in enumerate(axes):
        line(ax, time, trace[f"wheel_speed_{i + 1}"], color=palette.wheel_color(i), label="measured")
        target = f"target_wheel_speed_{i + 1}"
        if target in trace:
            style = {"linestyle": (0, (3, 3)), "linewidth": 1.0, "label": "target"}
            line(ax, time, trace[target], color=palette.INK, **style)
        value_axis(ax, f"wheel {i + 1}\n[rad/s]")
    finish(axes, time, spans)
    if "target_wheel_speed_1" in trace:
        legend(axes[0])
    return figure


def per_wheel(trace: Trace, name: str, label: str, spans: Sequence[Span], zero: bool = True) -> Figure:
    """One quantity of all wheels in one plot.

    Args:
      trace: The run.
      name: Column without the wheel's number.
      label: Quantity and unit.
      spans: Faults to shade.
      zero: Whether to mark zero.
    """
    figure, (ax,) = new_figure(MIDDLE)
    for i in range(wheel_count(trace)):
        if f"{name}_{i + 1}" in trace:
            style = {"linestyle": palette.wheel_line(i), "label": f"wheel {i + 1}"}
            banded(ax, trace["time"], trace[f"{name}_{i + 1}"], palette.wheel_color(i), **style)
    if zero:
        ax.axhline(0.0, color=palette.MUTED, linewidth=0.8, zorder=1)
    value_axis(ax, label)
    finish([ax], trace["time"], spans)
    legend(ax)
    return figure


def currents(trace: Trace, spans: Sequence[Span]) -> Figure:
    """Measured motor currents and the mean of what was commanded, a plot per wheel [A]."""
    n, time = wheel_count(trace), trace["time"]
    figure, axes = new_figure(0.9 + 1.15 * n, rows=n, sharex=True, sharey=True)
    for i, ax in enumerate(axes):
        color, command = palette.wheel_color(i), f"current_target_{i + 1}"
        measured = trace[f"current_{i + 1}"]
        line(ax, time, measured, color=palette.lighter(color, 0.55), linewidth=1.0, label="measured")
        if command in trace:
            middle, mean, _, _ = averaged(time, trace[command])
            ax.plot(middle, mean, color=color, linewidth=1.3, label="command (mean)")
        value_axis(ax, f"wheel {i + 1}\n[A]")
    finish(axes, time, spans)
    legend(axes[0])
    return figure
