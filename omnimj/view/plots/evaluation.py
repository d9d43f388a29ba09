"""Plots of an evaluation: confusion matrix, detection delays, excursions with and without recovery."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from math import isfinite

import numpy as np

from omnimj.studies.evaluation.scoring import CaseScore, label_sort_key
from omnimj.view import palette
from omnimj.view.plots.matrix import matrix_panel
from omnimj.view.plots.panels import MIDDLE, Drawing, Panel

_SHORTEST, _LONGEST = 0.01, 60.0  # limits of the axis of delays [s]
_DELAYS = MIDDLE + 40  # [pixels] height, with four rows of legend
_DEGREES = 180.0 / np.pi


def confusion_picture(confusion: Mapping[str, Mapping[str, int]]) -> Drawing:
    """Plot the confusion matrix: numbers of cases, shaded by their share of the true class."""
    rows = list(confusion)
    columns = sorted({name for row in confusion.values() for name in row} | set(rows), key=label_sort_key)
    counts = np.array([[confusion[row].get(name, 0) for name in columns] for row in rows], int)
    cases = counts.sum(axis=1, keepdims=True)
    words = [str(count or "") for count in counts.ravel()]
    names = [
        f"truth {row}, diagnosed {column}: {count} of {total} cases"
        for row, own, (total,) in zip(rows, counts, cases, strict=True)
        for column, count in zip(columns, own, strict=True)
    ]
    panel = matrix_panel(counts / cases, rows, columns, words, names)
    panel.values("truth")
    panel.x_label = "diagnosed"
    # correct diagnoses
    x, y = np.array([float(columns.index(name)) for name in rows]), np.arange(float(len(rows)))
    panel.frames(x, y, palette.HEALTHY)
    return panel.finish()


def delay_curves(scores: Sequence[CaseScore], in_use: bool) -> Drawing:
    """Plot the share of cases with an alarm over the time since onset, or since first use, by fault class."""
    since = "time since first use [s]" if in_use else "time since onset [s]"
    panel = Panel(_DELAYS, over_time=False, label="share of cases with an alarm", x_label=since, x_log=True)
    used, drawn = [s for s in scores if s.was_in_use], []
    for k, name in enumerate(sorted({s.fault for s in used}, key=label_sort_key)):
        values = [s.delay_in_use if in_use else s.delay for s in used if s.fault == name]
        known = [v for v in values if v is not None]
        found = np.sort([v for v in known if isfinite(v)])
        time = np.concatenate([[_SHORTEST], np.maximum(found, _SHORTEST), [_LONGEST]])
        share = np.append(np.arange(len(found) + 1), len(found)) / max(len(known), 1)
        x, y = np.repeat(time, 2)[1:], np.repeat(share, 2)[:-1]  # a staircase
        drawn.append(panel.line(x, y, palette.wheel_color(k), f"{name} ({len(known)})"))
        drawn[-1].name = name
    panel.hover(drawn, [("", "$name"), ("within", "$snap_x{0.000} s"), ("alarm", "$snap_y{0 %} of cases")])
    panel.x_limits(_SHORTEST, _LONGEST)
    panel.limits(0.0, 1.04)
    panel.legend(2)
    return panel.finish()


def with_and_without(
    scores: Sequence[CaseScore], of: Callable[[CaseScore], tuple[float | None, float | None]], words: str
) -> Drawing:
    """Plot excursions with recovery over those without, case by case; points below the line are improved.

    `of` returns the excursions of a case with and without recovery, or None to leave the case out; `words`
    are their quantity and unit.
    """
    without = f"{words}, without recovery"
    panel = Panel(MIDDLE, False, "with recovery", without, x_log=True, y_log=True)
    values: list[float] = []
    for k, fault in enumerate(sorted({s.fault for s in scores}, key=label_sort_key)):
        found = [(s.name, *of(s)) for s in scores if s.fault == fault]
        both = [(name, a, b) for name, a, b in found if a is not None and b is not None]
        on, off = [a for _, a, _ in both], [b for *_, b in both]
        values += on + off
        names = [f"{name}: {a:.3g} with recovery, {b:.3g} without" for name, a, b in both]
        if both:
            panel.points(off, on, palette.wheel_color(k), fault, size=5.0, alpha=0.6, names=names)
    positive = [v for v in values if v > 0.0] or [0.1, 1.0]
    ends = np.array([min(positive), max(positive)])
    panel.line(ends, ends, palette.MUTED, dash=(0, (4, 3)), width=0.9)
    panel.legend(3)
    return panel.finish()


def headings(score: CaseScore) -> tuple[float | None, float | None]:
    """Return the heading excursion with and without recovery [°]."""
    return _degrees(score.heading), _degrees(score.heading_off)


def paths(score: CaseScore) -> tuple[float | None, float | None]:
    """Return the path excursion with and without recovery [m]."""
    return score.path, score.path_off


def _degrees(value: float | None) -> float | None:
    return None if value is None else _DEGREES * value
