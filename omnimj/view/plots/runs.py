"""Plots of a run of robot or rig; each function returns one figure."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from omnimj.parameters import Robot
from omnimj.signals import Array, Trace
from omnimj.view import palette
from omnimj.view.motion import patch_corners, planned_heading, planned_position, wheel_count
from omnimj.view.plots.over_time import finish
from omnimj.view.plots.panels import MIDDLE, NOT_HOVERED, SHORT, TALL, Drawing, Panel, Style, new_drawing
from omnimj.view.plots.thinning import averaged
from omnimj.view.wording import Span

_DEGREES = 180.0 / np.pi
_DASHES = (0, (5, 3))
_PROPORTION = 1.15  # width of a map / height
_PER_WHEEL = 112  # height of one of several panels [pixels]
_Line = tuple[Array, str, str, Style]  # values, colour, label, dash pattern


def deviation(trace: Trace, spans: Sequence[Span]) -> Drawing:
    """Plot heading and heading error [degrees], and the distance from the planned position [m]."""
    time, planned, place = trace["time"], planned_heading(trace), planned_position(trace)
    turns = planned is not None and np.ptp(planned) > 1e-6
    placed = place is not None and "x" in trace
    rows = 1 + int(turns) + int(placed)
    drawing = new_drawing(TALL if rows > 1 else SHORT, rows)
    first, last = drawing.panels[0], drawing.panels[-1]
    driven = np.unwrap(trace["heading"] if "heading" in trace else trace["yaw"])
    first.values("heading [°]")
    first.line(time, _DEGREES * driven, palette.MEASURED, "driven")
    if planned is not None:
        first.line(time, _DEGREES * planned, palette.PLANNED, "planned", _DASHES)
    if planned is not None and turns:
        drawing.panels[1].values("heading error [°]")
        drawing.panels[1].line(time, _DEGREES * (driven - planned), palette.ACCENT)
    if place is not None and placed:
        _distance(last, trace, place)
    for panel in drawing.panels[1:]:
        panel.rule(0.0)
    first.legend()
    if placed:
        last.legend()
    return finish(drawing, time, spans)


def _distance(panel: Panel, trace: Trace, place: Array) -> None:
    """Plot driven − planned position over time, by component and as distance; `place` is (k, 2) [m]."""
    time, x, y = trace["time"], trace["x"] - place[:, 0], trace["y"] - place[:, 1]
    panel.values("off the plan [m]")
    panel.line(time, np.hypot(x, y), palette.INK, "distance", width=1.7)
    panel.line(time, x, palette.MEASURED, "in x", (0, (6, 1.5)))
    panel.line(time, y, palette.ACCENT, "in y", (0, (3, 1.2)))


def velocity(trace: Trace, spans: Sequence[Span]) -> Drawing:
    """Plot velocity in the world [m/s] and yaw rate [rad/s], driven and planned."""
    drawing = new_drawing(MIDDLE, rows=2)
    linear, angular = drawing.panels
    time, c, s = trace["time"], np.cos(trace["heading"]), np.sin(trace["heading"])
    x, y = trace["twist_x"], trace["twist_y"]
    linear.values("velocity [m/s]")
    angular.values("yaw rate [rad/s]")
    for name, driven, color in (("x", c * x - s * y, palette.MEASURED), ("y", s * x + c * y, palette.ACCENT)):
        linear.line(time, driven, color, f"in {name}")
        if f"target_velocity_{name}" in trace:
            planned = trace[f"target_velocity_{name}"]
            linear.line(time, planned, palette.PLANNED, f"planned in {name}", _DASHES, 1.0)
    angular.rippling(time, trace["twist_yaw"], palette.HEALTHY)
    linear.legend()
    return finish(drawing, time, spans)


def wheel_speeds(trace: Trace, spans: Sequence[Span]) -> Drawing:
    """Plot measured and target speed of each wheel, in small plots of equal scale."""
    n, time = wheel_count(trace), trace["time"]
    drawing = new_drawing(_PER_WHEEL * n + 50, rows=n, shared=True)
    for i, panel in enumerate(drawing.panels):
        panel.values(f"wheel {i + 1} [rad/s]")
        panel.line(time, trace[f"wheel_speed_{i + 1}"], palette.wheel_color(i), "measured")
        target = f"target_wheel_speed_{i + 1}"
        if target in trace:
            panel.line(time, trace[target], palette.INK, "target", (0, (3, 3)), 1.0)
    drawing.panels[0].legend()
    return finish(drawing, time, spans)


def per_wheel(trace: Trace, name: str, label: str, spans: Sequence[Span], zero: bool = True) -> Drawing:
    """Plot one quantity of all wheels; `name` is its column without the wheel's number."""
    drawing = new_drawing(MIDDLE)
    (panel,) = drawing.panels
    panel.values(label)
    for i in range(wheel_count(trace, name)):
        value, style = trace[f"{name}_{i + 1}"], palette.wheel_line(i)
        panel.rippling(trace["time"], value, palette.wheel_color(i), f"wheel {i + 1}", style)
    if zero:
        panel.rule(0.0)
    panel.legend()
    return finish(drawing, trace["time"], spans)


def currents(trace: Trace, spans: Sequence[Span]) -> Drawing:
    """Plot measured motor current and mean command [A], one plot per wheel."""
    n, time = wheel_count(trace, "current"), trace["time"]
    drawing = new_drawing(_PER_WHEEL * n + 50, rows=n, shared=True)
    for i, panel in enumerate(drawing.panels):
        color, command = palette.wheel_color(i), f"current_target_{i + 1}"
        panel.values(f"wheel {i + 1} [A]")
        panel.line(time, trace[f"current_{i + 1}"], palette.lighter(color, 0.55), "measured", width=1.0)
        if command in trace:
            panel.line(*averaged(time, trace[command]), color, "command (mean)", hovered=NOT_HOVERED)
    drawing.panels[0].legend()
    return finish(drawing, time, spans)


def path(
    trace: Trace, patches: Sequence[Any], spans: Sequence[Span], constants: Robot | None = None
) -> Drawing:
    """Plot driven and planned path from above with equal axes, and the robot at its start and end."""
    drawing = map_from_above()
    (panel,) = drawing.panels
    planned = planned_position(trace)
    x, y = trace["x"], trace["y"]
    points = np.column_stack([x, y]) if planned is None else np.vstack([np.column_stack([x, y]), planned])
    width = equal_with_room(panel, points)
    for patch in patches:
        draw_patch(panel, patch)
    if planned is not None:
        draw_path(panel, planned[:, 0], planned[:, 1], color=palette.PLANNED, label="planned", dash=_DASHES)
    for row, span in enumerate(spans):
        during = (trace["time"] >= span.start) & (trace["time"] <= span.end)
        label = "" if row else "fault present"
        draw_path(panel, x[during], y[during], color=palette.FAULT, label=label, width=6.0, alpha=0.45)
    draw_path(panel, x, y, color=palette.MEASURED, label="driven", width=2.0)
    panel.points(x[0], y[0], label="start", marker="circle")
    panel.points(x[-1], y[-1], label="end", marker="square")
    _heading_arrows(panel, trace, 0.06 * width)
    if constants is not None:
        for row in (0, -1):
            _outline(panel, constants, trace, row, width)
    panel.legend(5)
    panel.finish()
    return drawing


def map_from_above() -> Drawing:
    """Make an empty map of the floor, x to the right and y upwards [m]."""
    panel = Panel(TALL, over_time=False, label="y [m]", x_label="x [m]", equal=True)
    return Drawing((panel,))


def draw_path(panel: Panel, x: Array, y: Array, **style: Any) -> None:
    """Draw a path, shape (k,) [m] each, as by `Panel.line`; one with 6000 points or more is thinned."""
    step = max(1, len(x) // 3000)
    panel.line(x[::step], y[::step], **style)


def draw_patch(panel: Panel, patch: Any) -> None:
    """Draw a floor patch with its name."""
    corners = patch_corners(patch)
    look = {"fill_alpha": 0.35, "line_color": palette.MUTED, "line_width": 1, "hatch_pattern": "/"}
    panel.polygon(corners, palette.DIAGNOSIS, **look, hatch_color=palette.MUTED, hatch_alpha=0.5)
    place, name = corners.max(axis=0), patch.floor.replace("_", " ")
    panel.text(place[0], place[1], name, text_align="right", text_baseline="bottom")


def _outline(panel: Panel, robot: Robot, trace: Trace, row: int, width: float) -> None:
    """Draw the robot's wheels and outline from above where the plot is fine enough to show them."""
    reach = float(np.linalg.norm(robot.wheel_positions, axis=1).max())
    if reach < 0.04 * width:
        return
    place, heading = np.array([trace["x"][row], trace["y"][row]]), trace["heading"][row]
    c, s = np.cos(heading), np.sin(heading)
    turn = np.array([[c, -s], [s, c]])
    around = np.linspace(0.0, 2.0 * np.pi, 61)
    circle = place + 0.6 * reach * np.column_stack([np.cos(around), np.sin(around)])
    panel.line(circle[:, 0], circle[:, 1], palette.MUTED, width=0.8)
    radius = robot.wheel.radius
    for i, (p, u) in enumerate(zip(robot.wheel_positions, robot.drive_directions, strict=True)):
        across = np.array([-u[1], u[0]])
        sides = [(1, 0.4), (1, -0.4), (-1, -0.4), (-1, 0.4)]
        corners = np.array([p + radius * (a * u + b * across) for a, b in sides]) @ turn.T + place
        panel.polygon(corners, palette.wheel_color(i), fill_alpha=0.8)
        number = 1.42 * p @ turn.T + place
        look = {"background_fill_color": "white", "background_fill_alpha": 0.75}
        panel.text(number[0], number[1], str(i + 1), text_align="center", **look)


def equal_with_room(panel: Panel, points: Array) -> float:
    """Set equal scales around points, shape (k, 2) [m], NaN ignored, with room for the robot.

    Returns:
      Width that is shown [m].
    """
    low, high = np.nanmin(points, axis=0), np.nanmax(points, axis=0)
    middle, span = 0.5 * (low + high), 1.1 * (high - low) + 0.8  # includes the size of the robot
    panel.contains(middle - 0.5 * span, middle + 0.5 * span)
    return float(max(span[0], _PROPORTION * span[1]))


def _heading_arrows(panel: Panel, trace: Trace, length: float) -> None:
    """Draw arrows of a length [m] along the x axis of the robot at a few points of the path."""
    for k in np.linspace(0, len(trace["time"]) - 1, 9).astype(int):
        heading = trace["heading"][k]
        u = np.array([np.cos(heading), np.sin(heading)])
        tail, across = np.array([trace["x"][k], trace["y"][k]]), np.array([-u[1], u[0]])
        tip = tail + length * u
        barbs = [tip - 0.35 * length * u + side * 0.18 * length * across for side in (1.0, -1.0)]
        panel.line(*np.array([tail, tip]).T, color=palette.INK, width=1.2, alpha=0.75)
        panel.polygon(np.array([tip, *barbs]), palette.INK, fill_alpha=0.75)


def rig_plots(trace: Trace, wheel_radius: float, spans: Sequence[Span]) -> dict[str, Drawing]:
    """Plot the signals of a rig over time, one drawing by name for each quantity that the run has.

    Slip velocity V_r = r·φ̇ − V, with the wheel's radius r [m], is that of the two encoders and, if recorded,
    the true one.
    """
    rim, carriage = wheel_radius * trace["wheel_speed"], trace["carriage_speed"]
    plots: dict[str, tuple[str, list[_Line]]] = {
        "speeds": ("speed [m/s]", [(rim, palette.ACCENT, "wheel rim, r·φ̇", "-")]),
        "slip": ("slip velocity [m/s]", [(rim - carriage, palette.DIAGNOSIS, "from the encoders", "-")]),
        "forces": ("force [N]", []),
        "normal": ("normal force [N]", []),
        "current": ("current [A]", []),
        "lateral": ("lateral speed [m/s]", []),
    }
    for name, column, color, label, dash in _RIG_LINES:
        if column in trace and (column != "lateral_force_1" or np.any(trace[column])):
            plots[name][1].append((trace[column], color, label, dash))
    zero = ("slip", "forces", "current", "lateral")
    return {
        name: _rig_plot(trace, label, lines, spans, name in zero)
        for name, (label, lines) in plots.items()
        if lines
    }


_RIG_LINES: tuple[tuple[str, str, str, str, Style], ...] = (
    ("speeds", "carriage_speed", palette.MEASURED, "carriage", (0, (6, 1.5))),
    ("slip", "slip_velocity_1", palette.ACCENT, "true", "-"),
    ("forces", "traction_force_1", palette.ACCENT, "traction", "-"),
    ("forces", "lateral_force_1", palette.HEALTHY, "lateral", (0, (6, 1.5))),
    ("normal", "normal_force_1", palette.MEASURED, "", "-"),
    ("current", "current", palette.MEASURED, "measured", "-"),
    ("current", "current_target", palette.INK, "command", (0, (4, 2))),
    ("lateral", "lateral_speed", palette.HEALTHY, "gantry", "-"),
)
"""Plot, column, colour, label and dash pattern of the lines of a rig."""


def _rig_plot(trace: Trace, label: str, lines: Sequence[_Line], spans: Sequence[Span], zero: bool) -> Drawing:
    drawing = new_drawing(SHORT)
    (panel,) = drawing.panels
    panel.values(label)
    for value, color, name, dash in lines:
        panel.line(trace["time"], value, color, name, dash)
    if zero:
        panel.rule(0.0)
    if len(lines) > 1:
        panel.legend()
    return finish(drawing, trace["time"], spans)
