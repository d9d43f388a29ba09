"""Plots of a run of robot or rig; each function returns one figure."""

from __future__ import annotations

from collections.abc import Container, Sequence
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Circle, Polygon
from numpy.typing import NDArray

from omnimj.parameters import Robot
from omnimj.signals import Trace
from omnimj.view import palette
from omnimj.view.plots.drawing import (
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
    """Return the number of wheels in a trace."""
    n = 0
    while f"wheel_speed_{n + 1}" in columns:
        n += 1
    return n


def planned_position(trace: Trace) -> Array | None:
    """Return the planned path, shape (k, 2) [m]; None for a run without a plan."""
    if "target_x" in trace and "target_y" in trace:
        return np.stack([trace["target_x"], trace["target_y"]], axis=1)
    return None


def planned_heading(trace: Trace) -> Array | None:
    """Return the planned heading, shape (k,) [rad]; None for a run without a plan."""
    for name in ("target_heading", "target_yaw"):
        if name in trace:
            return trace[name]
    return None


def deviation(trace: Trace, spans: Sequence[Span]) -> Figure:
    """Plot heading and heading error [degrees], and the distance from the planned position [m]."""
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
    """Plot driven − planned position over time, by component and as distance; `place` is (k, 2) [m]."""
    x, y = trace["x"] - place[:, 0], trace["y"] - place[:, 1]
    line(ax, trace["time"], np.hypot(x, y), color=palette.INK, label="distance", linewidth=1.6)
    line(ax, trace["time"], x, color=palette.MEASURED, label="in x", linestyle=(0, (6, 1.5)))
    line(ax, trace["time"], y, color=palette.ACCENT, label="in y", linestyle=(0, (3, 1.2)))
    value_axis(ax, "off the plan [m]")


def velocity(trace: Trace, spans: Sequence[Span]) -> Figure:
    """Plot velocity in the world [m/s] and yaw rate [rad/s], driven and planned."""
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
    """Plot measured and target speed of each wheel, in small plots of equal scale."""
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
    """Plot one quantity of all wheels.

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
    """Plot measured motor current and mean command [A], one plot per wheel."""
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


_PROPORTION = 1.15  # width of the axes / height


def patch_corners(patch: Any) -> Array:
    """Return the corners of a floor patch in the world, shape (4, 2) [m]."""
    half = 0.5 * np.asarray(patch.size, float)
    corners = np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]]) * half
    c, s = np.cos(patch.yaw), np.sin(patch.yaw)
    return corners @ np.array([[c, s], [-s, c]]) + np.asarray(patch.center, float)


def path(
    trace: Trace, patches: Sequence[Any], spans: Sequence[Span], constants: Robot | None = None
) -> Figure:
    """Plot driven and planned path from above with equal axes, and the robot at its start and end."""
    figure, (ax,) = new_figure(TALL)
    planned = planned_position(trace)
    x, y = trace["x"], trace["y"]
    for patch in patches:
        draw_patch(ax, patch)
    if planned is not None:
        style = {"linestyle": (0, (5, 3)), "linewidth": 1.4, "label": "planned"}
        ax.plot(planned[:, 0], planned[:, 1], color=palette.PLANNED, **style)
    step = max(1, len(x) // 1500)
    ax.plot(x[::step], y[::step], color=palette.MEASURED, linewidth=1.8, label="driven", zorder=3)
    for row, span in enumerate(spans):
        during = (trace["time"] >= span.start) & (trace["time"] <= span.end)
        name = "fault present" if row == 0 else None
        style = {"linewidth": 5.0, "alpha": 0.45, "zorder": 2, "label": name}
        ax.plot(x[during][::step], y[during][::step], color=palette.FAULT, **style)
    ax.plot(x[0], y[0], "o", color=palette.INK, markersize=6, zorder=4, label="start")
    ax.plot(x[-1], y[-1], "s", color=palette.INK, markersize=6, zorder=4, label="end")
    equal_with_room(
        ax, np.column_stack([x, y]) if planned is None else np.vstack([np.column_stack([x, y]), planned])
    )
    _heading_arrows(ax, trace)
    if constants is not None:
        _outline(ax, constants, trace, 0)
        _outline(ax, constants, trace, -1)
    ax.set_xlabel("x [m]", fontsize=9)
    value_axis(ax, "y [m]")
    legend(ax, 5)
    return figure


def draw_patch(ax: Axes, patch: Any) -> None:
    """Draw a floor patch with its name."""
    corners = patch_corners(patch)
    style = {"facecolor": palette.DIAGNOSIS, "edgecolor": palette.MUTED, "alpha": 0.35, "hatch": "///"}
    ax.add_patch(Polygon(corners, zorder=1, **style))
    place, name = corners.max(axis=0), patch.floor.replace("_", " ")
    ax.annotate(name, place, fontsize=8, color=palette.INK, ha="right", va="bottom")


def _outline(ax: Axes, robot: Robot, trace: Trace, row: int) -> None:
    """Draw the robot's wheels and outline from above where the plot is fine enough to show them."""
    reach = float(np.linalg.norm(robot.wheel_positions, axis=1).max())
    if reach < 0.04 * np.ptp(ax.get_xlim()):
        return
    place, heading = np.array([trace["x"][row], trace["y"][row]]), trace["heading"][row]
    c, s = np.cos(heading), np.sin(heading)
    turn = np.array([[c, -s], [s, c]])
    ax.add_patch(
        Circle((place[0], place[1]), 0.6 * reach, facecolor="none", edgecolor=palette.MUTED, linewidth=0.8)
    )
    radius = robot.wheel.radius
    for i, (p, u) in enumerate(zip(robot.wheel_positions, robot.drive_directions, strict=True)):
        across = np.array([-u[1], u[0]])
        sides = [(1, 0.4), (1, -0.4), (-1, -0.4), (-1, 0.4)]
        corners = np.array([p + radius * (a * u + b * across) for a, b in sides]) @ turn.T + place
        ax.add_patch(Polygon(corners, facecolor=palette.wheel_color(i), linewidth=0, alpha=0.8, zorder=4))
        number = 1.42 * p @ turn.T + place
        ax.annotate(
            str(i + 1),
            number,
            fontsize=8,
            color=palette.INK,
            ha="center",
            va="center",
            bbox={"facecolor": "white", "alpha": 0.75, "linewidth": 0, "pad": 0.6},
            zorder=5,
        )


def equal_with_room(ax: Axes, points: Array) -> None:
    """Set equal scales around points, shape (k, 2) [m], in the proportions of the figure."""
    low, high = np.nanmin(points, axis=0), np.nanmax(points, axis=0)
    middle, span = 0.5 * (low + high), 1.1 * (high - low) + 0.8  # includes the size of the robot
    width = max(span[0], _PROPORTION * span[1])
    ax.set_xlim(middle[0] - width / 2, middle[0] + width / 2)
    ax.set_ylim(middle[1] - width / _PROPORTION / 2, middle[1] + width / _PROPORTION / 2)
    ax.set_aspect("equal")


def _heading_arrows(ax: Axes, trace: Trace) -> None:
    """Draw arrows along the x axis of the robot at a few points of the path."""
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


def rig_speeds(trace: Trace, wheel_radius: float, spans: Sequence[Span]) -> Figure:
    """Plot rim speed r·φ̇ and carriage speed [m/s]."""
    figure, (ax,) = new_figure(SHORT)
    time = trace["time"]
    line(ax, time, wheel_radius * trace["wheel_speed"], color=palette.ACCENT, label="wheel rim, r·φ̇")
    line(ax, time, trace["carriage_speed"], color=palette.MEASURED, linestyle=(0, (6, 1.5)), label="carriage")
    value_axis(ax, "speed [m/s]")
    return _finished(figure, trace, spans, legend_columns=2)


def rig_slip(trace: Trace, wheel_radius: float, spans: Sequence[Span]) -> Figure:
    """Plot slip velocity V_r = r·φ̇ − V, the true one if recorded, else from the two encoders [m/s]."""
    figure, (ax,) = new_figure(SHORT)
    time = trace["time"]
    measured = wheel_radius * trace["wheel_speed"] - trace["carriage_speed"]
    line(ax, time, measured, color=palette.DIAGNOSIS, linewidth=0.9, label="from the encoders")
    if "slip_velocity_1" in trace:
        line(ax, time, trace["slip_velocity_1"], color=palette.ACCENT, label="true")
    ax.axhline(0.0, color=palette.MUTED, linewidth=0.8, zorder=1)
    value_axis(ax, "slip velocity [m/s]")
    return _finished(figure, trace, spans, legend_columns=2)


def rig_forces(trace: Trace, spans: Sequence[Span]) -> Figure:
    """Plot traction along the rail and lateral friction at the floor [N]."""
    figure, (ax,) = new_figure(SHORT)
    time = trace["time"]
    line(ax, time, trace["traction_force_1"], color=palette.ACCENT, label="traction")
    if "lateral_force_1" in trace and np.any(trace["lateral_force_1"]):
        style = {"color": palette.HEALTHY, "linestyle": (0, (6, 1.5)), "label": "lateral"}
        line(ax, time, trace["lateral_force_1"], **style)
    ax.axhline(0.0, color=palette.MUTED, linewidth=0.8, zorder=1)
    value_axis(ax, "force [N]")
    return _finished(figure, trace, spans, legend_columns=2)


def rig_normal_force(trace: Trace, spans: Sequence[Span]) -> Figure:
    """Plot the normal force at the floor [N]."""
    figure, (ax,) = new_figure(SHORT)
    line(ax, trace["time"], trace["normal_force_1"], color=palette.MEASURED)
    value_axis(ax, "normal force [N]")
    return _finished(figure, trace, spans, legend_columns=1)


def rig_current(trace: Trace, spans: Sequence[Span]) -> Figure:
    """Plot motor current, measured and commanded [A]."""
    figure, (ax,) = new_figure(SHORT)
    line(ax, trace["time"], trace["current"], color=palette.MEASURED, linewidth=1.0, label="measured")
    if "current_target" in trace:
        wanted = trace["current_target"]
        line(ax, trace["time"], wanted, color=palette.INK, linestyle=(0, (4, 2)), label="command")
    ax.set_ylim(min(0.0, ax.get_ylim()[0]), ax.get_ylim()[1])
    value_axis(ax, "current [A]")
    return _finished(figure, trace, spans, legend_columns=2)


def rig_lateral_speed(trace: Trace, spans: Sequence[Span]) -> Figure:
    """Plot the lateral speed of the gantry [m/s]."""
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
