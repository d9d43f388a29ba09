"""The plots of a robot's run that are worth looking at; each function returns one figure."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Polygon
from numpy.typing import NDArray

from omnimj.signals import Trace
from omnimj.view import palette
from omnimj.view.drawing import (
    finish,
    legend,
    line,
    new_figure,
    value_axis,
)
from omnimj.view.wording import Span

Array = NDArray[np.float64]
_DEGREES = 180.0 / np.pi
_PATH_PROPORTION = 1.2  # width to height of the plot seen from above


def wheel_count(trace: Trace) -> int:
    """Number of wheels in a trace."""
    n = 0
    while f"wheel_speed_{n + 1}" in trace:
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


def patch_corners(patch: Any) -> Array:
    """Corners of a stretch of other floor in the world, shape (4, 2) [m]."""
    half = 0.5 * np.asarray(patch.size, float)
    corners = np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]]) * half
    c, s = np.cos(patch.yaw), np.sin(patch.yaw)
    return corners @ np.array([[c, s], [-s, c]]) + np.asarray(patch.center, float)


def path(trace: Trace, patches: Sequence[Any], spans: Sequence[Span]) -> Figure:
    """Driven path against the planned one, seen from above, axes equal."""
    figure, (ax,) = new_figure(4.4)
    planned = planned_position(trace)
    x, y = trace["x"], trace["y"]
    for patch in patches:
        corners = patch_corners(patch)
        ax.add_patch(
            Polygon(
                corners,
                facecolor=palette.DIAGNOSIS,
                edgecolor=palette.MUTED,
                alpha=0.35,
                hatch="///",
                zorder=1,
            )
        )
        ax.annotate(
            patch.floor.replace("_", " "),
            corners.max(axis=0),
            fontsize=8,
            color=palette.INK,
            ha="right",
            va="top",
        )
    if planned is not None:
        ax.plot(
            planned[:, 0],
            planned[:, 1],
            color=palette.PLANNED,
            linestyle=(0, (5, 3)),
            linewidth=1.4,
            label="planned",
        )
    step = max(1, len(x) // 1500)
    ax.plot(x[::step], y[::step], color=palette.MEASURED, linewidth=1.8, label="driven", zorder=3)
    for row, span in enumerate(spans):
        during = (trace["time"] >= span.start) & (trace["time"] <= span.end)
        name = "fault holds" if row == 0 else None
        ax.plot(
            x[during][::step],
            y[during][::step],
            color=palette.FAULT,
            linewidth=5.0,
            alpha=0.45,
            zorder=2,
            label=name,
        )
    ax.plot(x[0], y[0], "o", color=palette.INK, markersize=6, zorder=4, label="start")
    ax.plot(x[-1], y[-1], "s", color=palette.INK, markersize=6, zorder=4, label="end")
    _equal_with_room(
        ax, np.column_stack([x, y]) if planned is None else np.vstack([np.column_stack([x, y]), planned])
    )
    _heading_arrows(ax, trace)
    ax.set_xlabel("x [m]", fontsize=9)
    value_axis(ax, "y [m]")
    legend(ax, 5)
    return figure


def _equal_with_room(ax: Axes, points: Array) -> None:
    """Equal axes in the figure's own proportions, so that a straight path does not flatten the plot."""
    low, high = np.nanmin(points, axis=0), np.nanmax(points, axis=0)
    middle, span = 0.5 * (low + high), np.maximum(1.2 * (high - low), 0.3)
    width = max(span[0], _PATH_PROPORTION * span[1])
    ax.set_xlim(middle[0] - width / 2, middle[0] + width / 2)
    ax.set_ylim(middle[1] - width / _PATH_PROPORTION / 2, middle[1] + width / _PATH_PROPORTION / 2)
    ax.set_aspect("equal")


def _heading_arrows(ax: Axes, trace: Trace) -> None:
    """Where the robot's x axis pointed, a few times along the path."""
    k = np.linspace(0, len(trace["time"]) - 1, 9).astype(int)
    heading = trace["heading"][k]
    ax.quiver(
        trace["x"][k],
        trace["y"][k],
        np.cos(heading),
        np.sin(heading),
        color=palette.INK,
        alpha=0.75,
        width=0.004,
        scale=16.0,
        zorder=4,
    )


def heading(trace: Trace, spans: Sequence[Span]) -> Figure:
    """True and planned heading and, where the plan turns, the difference between them [degrees]."""
    time, planned = trace["time"], planned_heading(trace)
    turns = planned is not None and np.ptp(planned) > 1e-6
    figure, axes = new_figure(3.8 if turns else 2.9, rows=2 if turns else 1, sharex=True)
    driven = np.unwrap(trace["heading"] if "heading" in trace else trace["yaw"])
    line(axes[0], time, _DEGREES * driven, color=palette.MEASURED, label="driven")
    if planned is not None:
        dashes = (0, (5, 3))
        line(axes[0], time, _DEGREES * planned, color=palette.PLANNED, linestyle=dashes, label="planned")
    if planned is not None and turns:
        line(axes[1], time, _DEGREES * (driven - planned), color=palette.ACCENT)
        axes[1].axhline(0.0, color=palette.MUTED, linewidth=0.8)
        value_axis(axes[1], "error [°]")
    value_axis(axes[0], "heading [°]")
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
            line(
                ax,
                time,
                trace[target],
                color=palette.INK,
                linestyle=(0, (3, 3)),
                linewidth=1.0,
                label="target",
            )
        value_axis(ax, f"wheel {i + 1}\n[rad/s]")
    finish(axes, time, spans)
    for ax in axes[:1]:
        legend(ax)
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
    figure, (ax,) = new_figure(2.9)
    _wheel_lines(ax, trace, name)
    if zero:
        ax.axhline(0.0, color=palette.MUTED, linewidth=0.8, zorder=1)
    value_axis(ax, label)
    finish([ax], trace["time"], spans)
    legend(ax)
    return figure


def _wheel_lines(ax: Axes, trace: Trace, name: str) -> None:
    for i in range(wheel_count(trace)):
        if f"{name}_{i + 1}" in trace:
            line(
                ax,
                trace["time"],
                trace[f"{name}_{i + 1}"],
                color=palette.wheel_color(i),
                linestyle=palette.wheel_line(i),
                label=f"wheel {i + 1}",
            )


def forces(trace: Trace, spans: Sequence[Span]) -> Figure:
    """Traction and normal force of every wheel [N]."""
    figure, axes = new_figure(4.4, rows=2, sharex=True)
    _wheel_lines(axes[0], trace, "traction_force")
    _wheel_lines(axes[1], trace, "normal_force")
    axes[0].axhline(0.0, color=palette.MUTED, linewidth=0.8, zorder=1)
    value_axis(axes[0], "traction [N]")
    value_axis(axes[1], "normal force [N]")
    finish(axes, trace["time"], spans)
    legend(axes[0])
    return figure


def currents(trace: Trace, spans: Sequence[Span]) -> Figure:
    """Measured motor currents over what was commanded, a plot per wheel [A]."""
    n, time = wheel_count(trace), trace["time"]
    figure, axes = new_figure(0.9 + 1.15 * n, rows=n, sharex=True, sharey=True)
    for i, ax in enumerate(axes):
        command = f"current_target_{i + 1}"
        if command in trace:
            line(ax, time, trace[command], color="#A9B1BA", linewidth=1.6, label="command")
        line(
            ax, time, trace[f"current_{i + 1}"], color=palette.wheel_color(i), linewidth=0.9, label="measured"
        )
        value_axis(ax, f"wheel {i + 1}\n[A]")
    finish(axes, time, spans)
    legend(axes[0])
    return figure
