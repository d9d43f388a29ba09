"""Plots of a sensitivity study: parameters to measure first, and μ* and σ for each result."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_svg import FigureCanvasSVG
from matplotlib.figure import Figure

from omnimj.studies.sensitivity.factors import Factor
from omnimj.studies.sensitivity.ranking import FactorRank, ResultSensitivity, shares
from omnimj.view import palette
from omnimj.view.plots.drawing import MIDDLE, WIDTH, new_figure, value_axis

_MOST_ROWS, _SMALLEST = 14, 0.005  # most parameters in the plot over all results, and their least share
_MOST_BARS, _LABELLED = 10, 6
_ROW, _FRAME = 0.27, 1.75  # [inches] height of a row, and of everything around the rows


def rows_shown(ranks: Sequence[FactorRank]) -> int:
    """Return the number of parameters in the plot over all results: those with half a percent or more."""
    return max(1, sum(rank.share >= _SMALLEST for rank in ranks[:_MOST_ROWS]))


def measure_first_picture(
    ranks: Sequence[FactorRank], studies: Sequence[ResultSensitivity], varied: Sequence[Factor]
) -> Figure:
    """Plot the share of each parameter over all results (left) and in each result (right)."""
    shown = list(ranks[: rows_shown(ranks)])
    heard = [study for study in studies if shares(study).any()]
    figure = Figure(figsize=(2.0 * WIDTH, _FRAME + _ROW * len(shown)), layout="constrained")
    FigureCanvasSVG(figure)
    left, right = figure.subplots(1, 2, sharey=True, width_ratios=(1.0, 1.0))
    places = np.arange(len(shown))
    share = 100.0 * np.array([rank.share for rank in shown])
    bounds = 100.0 * np.array([[rank.low for rank in shown], [rank.high for rank in shown]])
    _bars(left, places, share, bounds)
    left.set_yticks(places, [varied[rank.parameter].name for rank in shown], fontsize=8.5)
    left.set_xlabel("share over all results [%]", fontsize=9)
    left.tick_params(axis="y", which="minor", length=0)
    left.set_ylim(len(shown) - 0.5, -0.5)
    table = 100.0 * np.array([shares(study) for study in heard])[:, [rank.parameter for rank in shown]].T
    right.imshow(table, cmap="Blues", vmin=0.0, vmax=100.0, aspect="auto")
    for (row, column), value in np.ndenumerate(table):
        if value >= 0.5:
            ink = "white" if value > 60.0 else palette.INK
            right.text(column, row, f"{value:.0f}", fontsize=8, color=ink, ha="center", va="center")
    right.set_xticks(range(len(heard)), [study.name for study in heard], rotation=50, ha="right", fontsize=8)
    right.tick_params(axis="y", length=0, labelleft=False)
    right.set_xticks(np.arange(len(heard) + 1) - 0.5, minor=True)
    right.set_yticks(np.arange(len(shown) + 1) - 0.5, minor=True)
    right.grid(True, which="minor", color=palette.GRID, linewidth=0.6)
    right.tick_params(which="minor", length=0)
    right.set_title("share in each result [%]", fontsize=9, color=palette.MUTED)
    for side in right.spines.values():
        side.set_visible(False)
    return figure


def _bars(ax: Axes, places: np.ndarray, values: np.ndarray, bounds: np.ndarray) -> None:
    """Draw horizontal bars with their intervals; row 0 is at the top once the axis is inverted."""
    ax.barh(places, values, height=0.62, color=palette.lighter(palette.MEASURED, 0.45), zorder=2)
    ax.hlines(places, bounds[0], bounds[1], color=palette.INK, linewidth=1.3, zorder=3)
    ax.grid(True, axis="x", color=palette.GRID, linewidth=0.7)
    ax.grid(False, axis="y")
    ax.set_axisbelow(True)
    for side in ("top", "right"):
        ax.spines[side].set_visible(False)
    ax.tick_params(colors=palette.INK, labelsize=8.5)
    ax.tick_params(axis="y", length=0)
    ax.set_xlim(left=0.0)


def result_bars(study: ResultSensitivity, varied: Sequence[Factor]) -> Figure:
    """Plot μ* of the highest-ranked parameters with 95 % intervals, and the μ* of noise alone."""
    figure, (ax,) = new_figure(MIDDLE)
    shown = study.ranked[:_MOST_BARS]
    places = np.arange(len(shown))
    found = [study.measures[i] for i in shown]
    bounds = np.array([[one.low for one in found], [one.high for one in found]])
    _bars(ax, places, np.array([one.mu_star for one in found]), bounds)
    ax.set_yticks(places, [f"{k}  {varied[i].name}" for k, i in enumerate(shown, start=1)], fontsize=8.5)
    ax.set_ylim(_MOST_BARS - 0.4, -0.6)
    _floor(ax, study)
    ax.set_xlabel(f"μ*{_in(study.unit)}", fontsize=9)
    return figure


def _floor(ax: Axes, study: ResultSensitivity) -> None:
    """Draw the smallest μ* at which a parameter is ranked."""
    if not study.floor > 0.0:
        return
    ax.axvline(study.floor, color=palette.ACCENT, linewidth=1.0, linestyle=(0, (4, 3)), zorder=4)
    words = "noise" if study.noise >= study.floor else "too small to tell"
    place = {"xytext": (0, 2), "textcoords": "offset points", "xycoords": ax.get_xaxis_transform()}
    ax.annotate(words, (study.floor, 1.0), fontsize=8, color=palette.ACCENT, va="bottom", **place)


def _in(unit: str) -> str:
    return f" [{unit}]" if unit else ""


def result_plane(study: ResultSensitivity) -> Figure:
    """Plot σ over μ*: parameters below the line act linearly, those above nonlinearly or by interaction."""
    figure, (ax,) = new_figure(MIDDLE)
    ranked = set(study.ranked)
    for i, one in enumerate(study.measures):
        if i not in ranked and one.count and not math.isnan(one.sigma) and one.mu_star > 0.0:
            ax.plot(one.mu_star, one.sigma, "o", color=palette.GRID, markersize=4.0, zorder=2)
    for place, i in enumerate(study.ranked, start=1):
        one = study.measures[i]
        ax.plot(one.mu_star, one.sigma, "o", color=palette.MEASURED, markersize=4.5, zorder=3)
        if place <= _LABELLED:
            offset = {"xytext": (4, 3), "textcoords": "offset points"}
            ax.annotate(str(place), (one.mu_star, one.sigma), fontsize=8.5, color=palette.INK, **offset)
    high = max((study.measures[i].mu_star for i in study.ranked), default=1.0)
    top = max([0.3 * high, *(study.measures[i].sigma for i in study.ranked)])
    end = 0.95 * min(high, top)
    ax.plot([0.0, end], [0.0, end], color=palette.MUTED, linewidth=0.9, linestyle=(0, (4, 3)), zorder=1)
    ax.annotate("σ = μ*", (end, end), fontsize=8, color=palette.MUTED, ha="left", va="bottom")
    ax.set_xlim(0.0, 1.1 * high)
    ax.set_ylim(-0.03 * top, 1.12 * top)
    _floor(ax, study)
    ax.set_xlabel(f"μ*{_in(study.unit)}", fontsize=9)
    value_axis(ax, f"σ{_in(study.unit)}")
    return figure
