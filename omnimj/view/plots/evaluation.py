"""Plots of an evaluation: confusion matrix, detection delays, excursions with and without recovery."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from math import isfinite

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Rectangle

from omnimj.studies.evaluation.scoring import CaseScore, label_sort_key
from omnimj.view import palette
from omnimj.view.plots.drawing import MIDDLE, WIDTH, legend, new_figure, value_axis

_SHORTEST, _LONGEST = 0.01, 60.0  # limits of the axis of delays [s]
_DEGREES = 180.0 / np.pi


def confusion_picture(confusion: Mapping[str, Mapping[str, int]]) -> Figure:
    """Plot the confusion matrix: numbers of cases, shaded by their share of the true class."""
    rows = list(confusion)
    columns = sorted({name for row in confusion.values() for name in row} | set(rows), key=label_sort_key)
    counts = np.array([[confusion[row].get(name, 0) for name in columns] for row in rows], float)
    figure, (ax,) = new_figure(1.6 + 0.19 * len(rows))
    figure.set_size_inches(max(2.0 * WIDTH, 2.0 + 0.3 * len(columns)), 1.6 + 0.19 * len(rows))
    shares = counts / counts.sum(axis=1, keepdims=True)
    ax.grid(False)
    ax.imshow(shares, cmap="Blues", vmin=0.0, vmax=1.0, aspect="auto")
    for i, row in enumerate(rows):
        ax.axhline(i + 0.5, color=palette.GRID, linewidth=0.5)
        for j, name in enumerate(columns):
            if counts[i, j]:
                dark = shares[i, j] > 0.6
                ink = "white" if dark else palette.INK
                ax.text(j, i, f"{counts[i, j]:.0f}", fontsize=8, color=ink, ha="center", va="center")
            if row == name:
                style = {"fill": False, "edgecolor": palette.HEALTHY, "linewidth": 1.0}
                ax.add_patch(Rectangle((j - 0.5, i - 0.5), 1.0, 1.0, **style))
    ax.set_xticks(range(len(columns)), columns, rotation=60, ha="right", fontsize=8)
    ax.set_yticks(range(len(rows)), rows, fontsize=8)
    ax.set_xlabel("diagnosed", fontsize=9)
    value_axis(ax, "truth")
    return figure


def delay_curves(scores: Sequence[CaseScore], in_use: bool) -> Figure:
    """Plot the share of cases with an alarm over the time since onset, or since first use, by fault class."""
    figure, (ax,) = new_figure(MIDDLE)
    used = [s for s in scores if s.was_in_use]
    for k, name in enumerate(sorted({s.fault for s in used}, key=label_sort_key)):
        values = [s.delay_in_use if in_use else s.delay for s in used if s.fault == name]
        _curve(ax, [v for v in values if v is not None], palette.wheel_color(k), name)
    ax.set_xscale("log")
    ax.set_xlim(_SHORTEST, _LONGEST)
    ax.set_ylim(0.0, 1.0)
    ax.set_xlabel("time since first use [s]" if in_use else "time since onset [s]", fontsize=9)
    value_axis(ax, "share of cases with an alarm")
    legend(ax, 4)
    return figure


def _curve(ax: Axes, values: Sequence[float], color: str, name: str) -> None:
    found = np.sort([v for v in values if isfinite(v)])
    time = np.concatenate([[_SHORTEST], np.maximum(found, _SHORTEST), [_LONGEST]])
    share = np.concatenate([[0.0], np.arange(1, len(found) + 1), [len(found)]]) / max(len(values), 1)
    ax.step(time, share, where="post", color=color, linewidth=1.4, label=f"{name} ({len(values)})")


def with_and_without(
    scores: Sequence[CaseScore], of: Callable[[CaseScore], tuple[float | None, float | None]], words: str
) -> Figure:
    """Plot excursions with recovery over those without, case by case; points below the line are improved."""
    figure, (ax,) = new_figure(MIDDLE)
    values: list[float] = []
    for k, name in enumerate(sorted({s.fault for s in scores}, key=label_sort_key)):
        pairs = [of(s) for s in scores if s.fault == name]
        both = np.array([(a, b) for a, b in pairs if a is not None and b is not None]).reshape(-1, 2)
        if not len(both):
            continue
        values += both.ravel().tolist()
        dots = {"linestyle": "none", "marker": "o", "markersize": 3.0, "alpha": 0.6, "markeredgewidth": 0}
        ax.plot(both[:, 1], both[:, 0], color=palette.wheel_color(k), label=name, **dots)
    positive = [v for v in values if v > 0.0]
    low, high = (min(positive), max(positive)) if positive else (0.1, 1.0)
    ax.plot([low, high], [low, high], color=palette.MUTED, linewidth=0.9, linestyle=(0, (4, 3)))
    ax.set_xscale("log")
    ax.set_yscale("log")
    ax.set_xlabel(f"{words}, without recovery", fontsize=9)
    value_axis(ax, "with recovery")
    legend(ax, 4)
    return figure


def headings(score: CaseScore) -> tuple[float | None, float | None]:
    """Return the heading excursion with and without recovery [°]."""
    return _degrees(score.heading), _degrees(score.heading_off)


def paths(score: CaseScore) -> tuple[float | None, float | None]:
    """Return the path excursion with and without recovery [m]."""
    return score.path, score.path_off


def _degrees(value: float | None) -> float | None:
    return None if value is None else _DEGREES * value
