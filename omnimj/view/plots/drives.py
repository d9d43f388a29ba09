"""Plots of a robot's measured drive beside its simulation: paths from above, courses over time."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from omnimj.estimate.drives.compare import velocity_course
from omnimj.estimate.drives.records import DrivenRun
from omnimj.view import palette
from omnimj.view.plots.over_time import finish
from omnimj.view.plots.panels import TALL, Drawing, new_drawing
from omnimj.view.plots.runs import draw_path, equal_with_room, map_from_above

STYLES = {
    "twin": (palette.ACCENT, "-", 1.4),
    "planar": (palette.HEALTHY, (0, (5, 2)), 1.4),
    "rolling": (palette.MUTED, (0, (2, 2)), 1.0),
}
"""Colour, dash pattern and line width by plant."""
_DEGREES = 180.0 / np.pi


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
