"""The plot of a robot's path seen from above."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Circle, Polygon
from numpy.typing import NDArray

from omnimj.parameters import Robot
from omnimj.signals import Trace
from omnimj.view import palette
from omnimj.view.drawing import TALL, legend, new_figure, value_axis
from omnimj.view.plots import planned_position
from omnimj.view.wording import Span

Array = NDArray[np.float64]
_PROPORTION = 1.15  # width to height of the axes


def patch_corners(patch: Any) -> Array:
    """Corners of a stretch of other floor in the world, shape (4, 2) [m]."""
    half = 0.5 * np.asarray(patch.size, float)
    corners = np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]]) * half
    c, s = np.cos(patch.yaw), np.sin(patch.yaw)
    return corners @ np.array([[c, s], [-s, c]]) + np.asarray(patch.center, float)


def path(
    trace: Trace, patches: Sequence[Any], spans: Sequence[Span], constants: Robot | None = None
) -> Figure:
    """Driven path against the planned one, seen from above, axes equal; the robot at its start and end."""
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
        name = "fault holds" if row == 0 else None
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
    """A stretch of other floor with its name."""
    corners = patch_corners(patch)
    style = {"facecolor": palette.DIAGNOSIS, "edgecolor": palette.MUTED, "alpha": 0.35, "hatch": "///"}
    ax.add_patch(Polygon(corners, zorder=1, **style))
    place, name = corners.max(axis=0), patch.floor.replace("_", " ")
    ax.annotate(name, place, fontsize=8, color=palette.INK, ha="right", va="bottom")


def _outline(ax: Axes, robot: Robot, trace: Trace, row: int) -> None:
    """The robot's wheels and their rim seen from above, where the plot is not too coarse to show them."""
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
    """Equal axes in the figure's own proportions, so that a straight path does not flatten the plot."""
    low, high = np.nanmin(points, axis=0), np.nanmax(points, axis=0)
    middle, span = 0.5 * (low + high), 1.1 * (high - low) + 0.8  # the robot itself needs room
    width = max(span[0], _PROPORTION * span[1])
    ax.set_xlim(middle[0] - width / 2, middle[0] + width / 2)
    ax.set_ylim(middle[1] - width / _PROPORTION / 2, middle[1] + width / _PROPORTION / 2)
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
