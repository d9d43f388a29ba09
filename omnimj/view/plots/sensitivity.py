"""Plots of a sensitivity study: parameters to measure first, and μ* and σ for each result."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from omnimj.studies.sensitivity.elementary_effects import FactorRank, ResultSensitivity, shares
from omnimj.studies.sensitivity.factors import Factor
from omnimj.view import palette
from omnimj.view.plots.matrix import ROW, matrix_panel
from omnimj.view.plots.panels import MIDDLE, Drawing, Panel

_MOST_ROWS, _SMALLEST = 14, 0.005  # most parameters in the plots over all results, and their least share
_MOST_BARS, _LABELLED = 10, 6
_AXIS = 60  # [pixels] height around the bars
_DASHES = (0, (4, 3))


def rows_shown(ranks: Sequence[FactorRank]) -> int:
    """Return the number of parameters in the plots over all results: those with half a percent or more."""
    return max(1, sum(rank.share >= _SMALLEST for rank in ranks[:_MOST_ROWS]))


def share_bars(ranks: Sequence[FactorRank], varied: Sequence[Factor]) -> Drawing:
    """Plot the share of each parameter over all results."""
    shown = ranks[: rows_shown(ranks)]
    panel = Panel(_AXIS + ROW * len(shown), over_time=False, x_label="share over all results [%]")
    values = [(100.0 * rank.share, 100.0 * rank.low, 100.0 * rank.high) for rank in shown]
    _bars(panel, [varied[rank.parameter].name for rank in shown], values, "%")
    return panel.finish()


def share_matrix(
    ranks: Sequence[FactorRank], studies: Sequence[ResultSensitivity], varied: Sequence[Factor]
) -> Drawing:
    """Plot the share of each parameter in each result."""
    shown = [rank.parameter for rank in ranks[: rows_shown(ranks)]]
    affected = [study for study in studies if shares(study).any()]
    table = np.array([shares(study) for study in affected])[:, shown].T
    rows, columns = [varied[i].name for i in shown], [study.name for study in affected]
    words = [f"{100.0 * share:.0f}" if share >= _SMALLEST else "" for share in table.ravel()]
    pairs = [f"{row} in {column}" for row in rows for column in columns]
    names = [f"{pair}: {100.0 * share:.1f} %" for pair, share in zip(pairs, table.ravel(), strict=True)]
    panel = matrix_panel(table, rows, columns, words, names)
    panel.x_label = "share in each result [%]"
    return panel.finish()


def _bars(
    panel: Panel, names: Sequence[str], values: Sequence[tuple[float, float, float]], unit: str
) -> None:
    """Draw a bar with its interval in each row: value, low and high end."""
    (value, low, high), rows = np.transpose(values), np.arange(len(names))
    each = zip(names, values, strict=True)
    texts = [f"{name}: {v:.3g} ({a:.3g} … {b:.3g}) {unit}" for name, (v, a, b) in each]
    color = palette.lighter(palette.MEASURED, 0.45)
    panel.bars(np.zeros(len(rows)), value, rows, 0.62, color, names=texts)
    panel.segments(low, rows, high, rows, palette.INK, 1.5)
    panel.rows(names)
    panel.x_limits(0.0, 1.05 * float(np.max([value, high])))


def result_bars(study: ResultSensitivity, varied: Sequence[Factor]) -> Drawing:
    """Plot μ* of the highest-ranked parameters with 95 % intervals, and the μ* of noise alone."""
    panel = Panel(MIDDLE, over_time=False, x_label=f"μ*{_in(study.unit)}")
    shown = study.ranked[:_MOST_BARS]
    found = [study.measures[i] for i in shown]
    names = [f"{k}  {varied[i].name}" for k, i in enumerate(shown, start=1)]
    _bars(panel, names, [(one.mu_star, one.low, one.high) for one in found], study.unit)
    panel.limits(_MOST_BARS - 0.4, -0.6)
    _floor(panel, study, (_MOST_BARS - 0.4, -0.6))
    return panel.finish()


def _floor(panel: Panel, study: ResultSensitivity, ends: tuple[float, float]) -> None:
    """Draw the smallest μ* at which a parameter is ranked, between the ends of the value axis."""
    if study.floor > 0.0:
        words = "noise" if study.noise >= study.floor else "too small to tell"
        panel.line(np.full(2, study.floor), np.array(ends), palette.ACCENT, words, _DASHES, 1.1)
    panel.legend()


def _in(unit: str) -> str:
    return f" [{unit}]" if unit else ""


def result_plane(study: ResultSensitivity, varied: Sequence[Factor]) -> Drawing:
    """Plot σ over μ*: parameters below the line act linearly, those above nonlinearly or by interaction."""
    panel = Panel(MIDDLE, over_time=False, label=f"σ{_in(study.unit)}", x_label=f"μ*{_in(study.unit)}")
    ranked = [(varied[i].name, study.measures[i]) for i in study.ranked]
    others = [
        (factor.name, one)
        for i, (factor, one) in enumerate(zip(varied, study.measures, strict=True))
        if i not in study.ranked and one.count and not math.isnan(one.sigma) and one.mu_star > 0.0
    ]
    high = max((one.mu_star for _, one in ranked), default=1.0)
    top = max([0.3 * high, *(one.sigma for _, one in ranked)])
    diagonal = np.array([0.0, 0.95 * min(high, top)])
    panel.line(diagonal, diagonal, palette.MUTED, "σ = μ*", _DASHES, 1.0)
    for found, color in ((others, palette.GRID), (ranked, palette.MEASURED)):
        names = [f"{name}: μ* {one.mu_star:.3g}, σ {one.sigma:.3g} {study.unit}" for name, one in found]
        x, y = [one.mu_star for _, one in found], [one.sigma for _, one in found]
        panel.points(x, y, color, size=6.0, names=names)
    for place, (_, one) in enumerate(ranked[:_LABELLED], start=1):
        panel.text(one.mu_star, one.sigma, str(place), x_offset=6, y_offset=6)
    panel.x_limits(0.0, 1.1 * high)
    panel.limits(-0.03 * top, 1.12 * top)
    _floor(panel, study, (-0.03 * top, 1.12 * top))
    return panel.finish()
