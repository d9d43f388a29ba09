"""Plots of identified floors and robots, and of validations.

An identified floor has its curve, friction level, residuals and traction at several rolling speeds, a robot
its numbers beside those of the model file; a validation overlays measured and simulated runs of rig or robot.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from omnimj.estimate.drives.compare import velocity_course
from omnimj.estimate.drives.records import DrivenRun
from omnimj.estimate.identification.records import IdentifiedFloor, ReplayedRun
from omnimj.estimate.replay.steady.traction import TractionCurves
from omnimj.estimate.robot.records import RobotIdentification
from omnimj.signals import Array
from omnimj.view import palette
from omnimj.view.plots.mismatch import row_panel
from omnimj.view.plots.over_time import finish
from omnimj.view.plots.panels import MIDDLE, NOT_HOVERED, SHORT, TALL, Drawing, Panel, new_drawing
from omnimj.view.plots.runs import draw_path, equal_with_room, map_from_above

_MOST_POINTS = 1500
_MM = 1000.0
_SLIP = "slip velocity V_r [mm/s]"
_PLANTS = {"twin": (palette.ACCENT, "-"), "planar": (palette.HEALTHY, (0, (5, 2)))}
_BEYOND = 1.15  # times the largest slip of its points, to which a curve extends
_LABEL = "F / F_N along the drive"
_SOURCES = {"data": (palette.MEASURED, "circle"), "data and prior": (palette.ACCENT, "diamond")}
_PRIOR = (palette.MUTED, "square")
STYLES = {
    "twin": (palette.ACCENT, "-", 1.4),
    "planar": (palette.HEALTHY, (0, (5, 2)), 1.4),
    "rolling": (palette.MUTED, (0, (2, 2)), 1.0),
}
"""Colour, dash pattern and line width by plant."""
_DEGREES = 180.0 / np.pi


def curve(floor: IdentifiedFloor) -> Drawing:
    """Plot F/F_N over slip velocity: points of Eq. (4.26), and the steady-state curve with its band."""
    panel = Panel(MIDDLE, over_time=False, label="F / F_N", x_label=_SLIP)
    points, fitted = floor.points, floor.curve
    every = max(1, len(points.slip) // _MOST_POINTS)
    for slip, ratio, color, size, label in (
        (points.slip, points.ratio, palette.MEASURED, 4.8, "measured"),
        (points.model_slip, points.model_ratio, palette.INK, 2.6, "fitted model"),
    ):
        panel.points(_MM * slip[::every], ratio[::every], color, label, size=size, alpha=0.45)
    low, high = fitted.covered
    inside = (fitted.slip >= low) & (fitted.slip <= high) if math.isfinite(low) else fitted.slip < 0.0
    drawn = []
    for sign in (1.0, -1.0) if (points.slip < -0.25 * high).any() else (1.0,):
        slip, ratio = sign * _MM * fitted.slip, sign * fitted.ratio
        panel.band(slip, sign * fitted.low, sign * fitted.high, palette.ACCENT, alpha=0.3)
        if sign > 0.0:
            panel.line(slip, ratio, palette.ACCENT, dash=(0, (3, 2)), width=1.1)
        solid = np.where(inside, ratio, np.nan)
        drawn.append(panel.line(slip, solid, palette.ACCENT, "steady curve", width=2.2))
    panel.hover(drawn, [("V_r", "$snap_x{0.0} mm/s"), ("F / F_N", "$snap_y{0.000}")])
    panel.rule(0.0)
    panel.legend()
    return panel.finish()


def level(floor: IdentifiedFloor) -> Drawing:
    """Plot g(V_r) over slip velocity (logarithmic) with its band; the range covered by data is marked."""
    panel = Panel(MIDDLE, over_time=False, label="friction level g", x_label=_SLIP, x_log=True)
    fitted = floor.curve
    slip, top = _MM * fitted.slip, 1.25 * float(np.max(fitted.level_high))
    low, high = (_MM * end for end in fitted.covered)
    if math.isfinite(low):
        panel.band(np.array([low, high]), np.zeros(2), np.full(2, top), palette.HEALTHY, alpha=0.1)
        middle = math.sqrt(low * high)
        panel.text(middle, 0.05 * top, "covered by the runs", palette.HEALTHY, text_align="center")
    panel.band(slip, fitted.level_low, fitted.level_high, palette.MEASURED, alpha=0.25)
    drawn = panel.line(slip, fitted.level, palette.MEASURED, width=1.8)
    panel.hover([drawn], [("V_r", "$snap_x{0.00} mm/s"), ("g", "$snap_y{0.000}")], "vline")
    panel.limits(0.0, top)
    return panel.finish()


def speed_residuals(floor: IdentifiedFloor) -> Drawing:
    """Plot measured − fitted speed of every run over time."""
    return _residuals([(r.run, r.time, _MM * r.speed) for r in floor.residuals], "speed [mm/s]")


def acceleration_residuals(floor: IdentifiedFloor) -> Drawing:
    """Plot measured − fitted acceleration of every run over time."""
    return _residuals([(r.run, r.time, r.acceleration) for r in floor.residuals], "acceleration [m/s²]")


def _residuals(runs: Sequence[tuple[str, Array, Array]], label: str) -> Drawing:
    """Plot names, times and residuals, the latter of shape (m,), of every run."""
    drawing = new_drawing(SHORT)
    (panel,), drawn = drawing.panels, []
    panel.values(label)
    panel.rule(0.0)
    for k, (name, time, values) in enumerate(runs):
        style = {"width": 0.9, "alpha": 0.8, "hovered": NOT_HOVERED}
        drawn.append(panel.line(time, values, palette.wheel_color(k), **style))
        drawn[-1].name = name
    value = f"$snap_y{{0.000}} {panel.unit}"
    panel.hover(drawn, [("run", "$name"), ("time", "$snap_x{0.00} s"), ("", value)])
    times = np.concatenate([time for _, time, _ in runs])
    return finish(drawing, np.array([times.min(), times.max()]), ())


def speed_overlay(runs: Sequence[ReplayedRun]) -> Drawing:
    """Overlay a measured run with each plant's simulation: carriage speed, and simulated − measured."""
    drawing, first = new_drawing(TALL, rows=2), runs[0]
    speed, error = drawing.panels
    speed.values("carriage [m/s]")
    error.values("error [mm/s]")
    speed.line(first.time, first.measured_speed, palette.MEASURED, "measured", width=1.1)
    error.rule(0.0)
    for run in runs:
        color, dash = _PLANTS.get(run.plant, (palette.INK, "-"))
        speed.line(run.time, run.simulated_speed, color, run.plant, dash)
        away = _MM * (run.simulated_speed - run.measured_speed)
        counted = np.isfinite(away)
        error.rippling(run.time[counted], away[counted], color, run.plant, dash)
    speed.legend()
    return finish(drawing, first.time, ())


def over_slip(curves: TractionCurves) -> Drawing:
    """Plot F/F_N over slip velocity: points by the currents, lines by the models."""
    panel = Panel(MIDDLE, over_time=False, label=_LABEL, x_label="slip velocity V_r [mm/s]")
    drawn = []
    for k, speed in enumerate(curves.rolling):
        color, label = palette.wheel_color(k), f"{speed:.2f} m/s"
        slip, ratio = curves.points[k].T
        near = np.abs(curves.slip) <= _BEYOND * np.abs(slip).max()
        over = _MM * curves.slip[near]
        panel.points(_MM * slip, ratio, color, label, size=4.5, alpha=0.5)
        panel.line(over, curves.before[k][near], color, dash=(0, (3, 2)), width=1.1)
        if curves.after is not None:
            drawn.append(panel.line(over, curves.after[k][near], color, label, width=2.0))
    if drawn:
        panel.hover(drawn, [("V_r", "$snap_x{0.0} mm/s"), ("F / F_N", "$snap_y{0.000}")])
    panel.rule(0.0)
    panel.legend()
    return panel.finish()


def identified_numbers(found: RobotIdentification) -> Drawing:
    """Plot each number over that of the model file, with its 90 % interval, unless the latter is 0."""
    shown = [one for one in found.estimates if one.nominal]
    panel = row_panel([one.words for one in shown], "identified / model file")
    for source in ("data", "data and prior", "prior"):
        rows = [row for row, one in enumerate(shown) if one.source == source]
        if not rows:
            continue
        color, marker = _SOURCES.get(source, _PRIOR)
        ends = [
            sorted((shown[row].low / shown[row].nominal, shown[row].high / shown[row].nominal))
            for row in rows
        ]
        panel.bars(
            [low for low, _ in ends], [high for _, high in ends], rows, 0.3, palette.lighter(color, 0.6)
        )
        names = [f"{shown[row].value:.4g} {shown[row].unit}" for row in rows]
        values = [shown[row].value / shown[row].nominal for row in rows]
        panel.points(values, rows, color, f"by {source}", marker, 8, names=names)
    panel.rule(1.0, across=False)
    panel.legend()
    return panel.finish()


def drive_paths(runs: Sequence[DrivenRun]) -> Drawing:
    """Plot the measured path of a run from above, and that on each plant."""
    drawing, first = map_from_above(), runs[0]
    (panel,) = drawing.panels
    poses = [first.measured.pose, *(run.simulated.pose for run in runs)]
    equal_with_room(panel, np.vstack([pose[:, :2] for pose in poses]))
    x, y = first.measured.pose[:, :2].T
    draw_path(panel, x, y, color=palette.MEASURED, label="measured", width=2.2)
    for run in runs:
        color, dash, width = STYLES[run.plant]
        x, y = run.simulated.pose[:, :2].T
        draw_path(panel, x, y, color=color, dash=dash, width=width, label=run.plant)
        panel.points(x[-1:], y[-1:], color, "", marker="square")
    panel.legend()
    panel.finish()
    return drawing


def drive_courses(runs: Sequence[DrivenRun]) -> Drawing:
    """Plot velocity ahead and to the left, heading, and current of the hardest working wheel over time."""
    first, wheel = runs[0], _hardest(runs[0])
    drawing = new_drawing(TALL, rows=4)
    labels = ("ahead [m/s]", "left [m/s]", "heading [°]", f"current {wheel + 1} [A]")
    for panel, label in zip(drawing.panels, labels, strict=True):
        panel.values(label)
    for name, run in (("measured", first), *((run.plant, run) for run in runs)):
        color, dash, width = STYLES.get(name, (palette.MEASURED, "-", 1.4))
        motion = run.measured if name == "measured" else run.simulated
        turned = _DEGREES * (motion.pose[:, 2] - first.simulated.pose[0, 2])
        columns = (*velocity_course(run, motion).T, turned, motion.currents[:, wheel])
        for panel, column in zip(drawing.panels, columns, strict=True):
            if np.isfinite(column).any():
                panel.line(run.time, column, color, name, dash, width)
    drawing.panels[0].legend()
    return finish(drawing, first.time, ())


def _hardest(run: DrivenRun) -> int:
    """Wheel whose measured current is largest, from 0."""
    means = np.abs(np.nan_to_num(run.measured.currents)).mean(axis=0)
    return int(np.argmax(means))
