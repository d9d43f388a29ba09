"""Overlays of measured and simulated speeds."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from matplotlib.figure import Figure

from omnimj.identification.records import ReplayedRun
from omnimj.view import palette
from omnimj.view.drawing import TALL, banded, legend, line, new_figure, time_axis, value_axis

PLANT_STYLE = {
    "twin": {"color": palette.ACCENT, "linestyle": "-"},
    "planar": {"color": palette.HEALTHY, "linestyle": (0, (5, 2))},
}


def overlay(runs: Sequence[ReplayedRun]) -> Figure:
    """One measured run and each plant's: speed of the carriage, and simulated − measured.

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
    value_axis(axes[1], "off [mm/s]")
    time_axis(axes[1], first.time)
    legend(axes[0], 3)
    return figure
