"""Plot of traction over slip on a floor at several rolling speeds, before and after."""

from __future__ import annotations

import numpy as np

from omnimj.estimate.replay.steady.traction import TractionCurves
from omnimj.view import palette
from omnimj.view.plots.panels import MIDDLE, Drawing, Panel

_MM = 1000.0
_BEYOND = 1.15  # times the largest slip of its points, to which a curve extends
_LABEL = "F / F_N along the drive"


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
