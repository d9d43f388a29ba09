"""Plots of an identified floor (curve, friction level, residuals) and of a validation (speed overlays)."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from omnimj.estimate.identification.records import IdentifiedFloor, ReplayedRun
from omnimj.signals import Array
from omnimj.view import palette
from omnimj.view.plots.over_time import finish
from omnimj.view.plots.panels import MIDDLE, NOT_HOVERED, SHORT, TALL, Drawing, Panel, new_drawing

_MOST_POINTS = 1500
_MM = 1000.0
_SLIP = "slip velocity V_r [mm/s]"


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


_PLANTS = {"twin": (palette.ACCENT, "-"), "planar": (palette.HEALTHY, (0, (5, 2)))}


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
