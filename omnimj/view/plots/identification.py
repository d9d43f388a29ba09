"""Plots of an identified floor (curve, friction level, residuals) and of a validation (speed overlays)."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from matplotlib.figure import Figure

from omnimj.estimate.identification.records import IdentifiedFloor, ReplayedRun
from omnimj.signals import Array
from omnimj.view import palette
from omnimj.view.plots.drawing import (
    MIDDLE,
    SHORT,
    TALL,
    banded,
    legend,
    line,
    new_figure,
    time_axis,
    value_axis,
)

_MOST_POINTS = 1500
_MM = 1000.0


def curve(floor: IdentifiedFloor) -> Figure:
    """Plot F/F_N over slip velocity: points of Eq. (4.26), and the steady-state curve with its band."""
    figure, (ax,) = new_figure(MIDDLE)
    points, fitted = floor.points, floor.curve
    every = max(1, len(points.slip) // _MOST_POINTS)
    dots = {"linestyle": "none", "marker": "o", "markeredgewidth": 0}
    for slip, ratio, color, size, label in (
        (points.slip, points.ratio, palette.MEASURED, 3.0, "measured"),
        (points.model_slip, points.model_ratio, palette.INK, 1.6, "fitted model"),
    ):
        ax.plot(
            _MM * slip[::every], ratio[::every], color=color, markersize=size, alpha=0.45, label=label, **dots
        )
    low, high = fitted.covered
    inside = (fitted.slip >= low) & (fitted.slip <= high) if math.isfinite(low) else fitted.slip < 0.0
    sides = (1.0, -1.0) if (points.slip < -0.25 * high).any() else (1.0,)
    for sign in sides:
        slip = sign * _MM * fitted.slip
        ax.fill_between(
            slip, sign * fitted.low, sign * fitted.high, color=palette.ACCENT, alpha=0.3, linewidth=0
        )
        if sign > 0.0:
            ax.plot(slip, fitted.ratio, color=palette.ACCENT, linestyle=(0, (3, 2)), linewidth=1.0)
        label = "steady curve" if sign > 0.0 else None
        solid = np.where(inside, sign * fitted.ratio, np.nan)
        ax.plot(slip, solid, color=palette.ACCENT, linewidth=2.0, label=label)
    ax.axhline(0.0, color=palette.MUTED, linewidth=0.8, zorder=1)
    ax.set_xlabel("slip velocity V_r [mm/s]", fontsize=9)
    value_axis(ax, "F / F_N")
    legend(ax, 3)
    return figure


def level(floor: IdentifiedFloor) -> Figure:
    """Plot g(V_r) over slip velocity (logarithmic) with its band; the range covered by data is marked."""
    figure, (ax,) = new_figure(MIDDLE)
    fitted = floor.curve
    low, high = fitted.covered
    slip = _MM * fitted.slip
    ax.fill_between(
        slip, fitted.level_low, fitted.level_high, color=palette.MEASURED, alpha=0.25, linewidth=0
    )
    ax.plot(slip, fitted.level, color=palette.MEASURED, linewidth=1.6)
    ax.set_xscale("log")
    ax.set_ylim(0.0, 1.25 * float(np.max(fitted.level_high)))
    if math.isfinite(low):
        ax.axvspan(_MM * low, _MM * high, color=palette.HEALTHY, alpha=0.10, linewidth=0)
        style = {"ha": "center", "fontsize": 8, "color": palette.HEALTHY}
        place = (_MM * math.sqrt(low * high), 0.03)
        ax.annotate("covered by the runs", place, xycoords=ax.get_xaxis_transform(), **style)
    ax.set_xlabel("slip velocity V_r [mm/s]", fontsize=9)
    value_axis(ax, "friction level g")
    return figure


def speed_residuals(floor: IdentifiedFloor) -> Figure:
    """Plot measured − fitted speed of every run over time."""
    return _residuals([(run.time, _MM * run.speed) for run in floor.residuals], "speed [mm/s]")


def acceleration_residuals(floor: IdentifiedFloor) -> Figure:
    """Plot measured − fitted acceleration of every run over time."""
    return _residuals([(run.time, run.acceleration) for run in floor.residuals], "acceleration [m/s²]")


def _residuals(runs: Sequence[tuple[Array, Array]], label: str) -> Figure:
    """Plot times and residuals, each of shape (m,), of every run."""
    figure, (ax,) = new_figure(SHORT)
    for k, (time, values) in enumerate(runs):
        ax.plot(time, values, color=palette.wheel_color(k), linewidth=0.7, alpha=0.8)
    ax.axhline(0.0, color=palette.MUTED, linewidth=0.8, zorder=1)
    ax.set_xlabel("time [s]", fontsize=9)
    value_axis(ax, label)
    return figure


PLANT_STYLE = {
    "twin": {"color": palette.ACCENT, "linestyle": "-"},
    "planar": {"color": palette.HEALTHY, "linestyle": (0, (5, 2))},
}


def speed_overlay(runs: Sequence[ReplayedRun]) -> Figure:
    """Overlay a measured run with each plant's simulation: carriage speed, and simulated − measured.

    Args:
      runs: The same measured run on each plant.
    """
    figure, axes = new_figure(TALL, rows=2, sharex=True)
    first = runs[0]
    line(axes[0], first.time, first.measured_speed, color=palette.MEASURED, linewidth=1.0, label="measured")
    for run in runs:
        style = PLANT_STYLE.get(run.plant, {"color": palette.INK})
        line(axes[0], run.time, run.simulated_speed, label=run.plant, **style)
        error = 1000.0 * (run.simulated_speed - run.measured_speed)
        counted = np.isfinite(error)
        banded(axes[1], run.time[counted], error[counted], **style)
    axes[1].axhline(0.0, color=palette.MUTED, linewidth=0.8, zorder=1)
    value_axis(axes[0], "carriage [m/s]")
    value_axis(axes[1], "error [mm/s]")
    time_axis(axes[1], first.time)
    legend(axes[0], 3)
    return figure
