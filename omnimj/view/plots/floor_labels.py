"""Plots of the floor under each wheel over time."""

from __future__ import annotations

import numpy as np

from omnimj.signals import Array
from omnimj.view import palette
from omnimj.view.plots.over_time import finish
from omnimj.view.plots.panels import Drawing, new_drawing

_ROW = 130  # height of a wheel's panel [pixels]
_MARGIN = 0.06  # of the probability axis


def floor_probabilities(time: Array, probability: Array, truth: Array | None, floor: str) -> Drawing:
    """Probability of one floor under each wheel, one panel below the other, with the camera's truth.

    Args:
      time: Windows' centres, shape (w,) [s].
      probability: Probability of the floor under each wheel, shape (w, n).
      truth: 1 where the camera sees the contact on this floor, NaN where unknown, shape (w, n); None
        without camera.
      floor: Name of the floor.
    """
    n = probability.shape[1]
    drawing = new_drawing(_ROW * n, n)
    for i, panel in enumerate(drawing.panels):
        panel.values(f"wheel {i + 1}")
        panel.limits(-_MARGIN, 1.0 + _MARGIN)
        if truth is not None:
            panel.line(time, truth[:, i], palette.MUTED, "camera", width=5.0, alpha=0.45)
        panel.line(time, probability[:, i], palette.wheel_color(i), f"on {floor}")
        if i == 0:
            panel.legend()
    return finish(drawing, np.asarray(time), ())
