"""Plots of a gain tuning: search, cost around the result, speed against robustness."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from bokeh.palettes import Viridis256

from omnimj.studies.tuning.cost import DETECTION, TRACKING, Landscape
from omnimj.studies.tuning.search import GainAxis
from omnimj.studies.tuning.study import ScoredCandidate, TuningResult
from omnimj.view import palette
from omnimj.view.plots.panels import MIDDLE, TALL, Drawing, Panel

_COLORS = np.array(Viridis256[::-1])  # from the least cost to the largest
_SCALE = 62  # [pixels] height of the scale of colours


def convergence(result: TuningResult) -> Drawing:
    """Plot the cost of every candidate within all limits, and the best so far."""
    panel = Panel(MIDDLE, over_time=False, label="cost, 1: the gains before", x_label="candidate")
    out = np.array([one.score.violation > 0.0 for one in result.tried])
    cost = np.where(out, np.nan, [one.score.cost for one in result.tried])
    number = np.arange(float(len(cost)))
    top = np.nanmax(cost) if np.isfinite(cost).any() else 1.0
    _candidates(panel, result, ~out, number, cost)
    if out.any():
        style = {"color": palette.ACCENT, "label": "breaks a limit", "marker": "x"}
        _candidates(panel, result, out, number, np.full(len(cost), top), **style)
    steps = np.repeat(number, 2)[1:], np.repeat(np.fmin.accumulate(cost), 2)[:-1]
    panel.line(*steps, palette.INK, "best so far")
    panel.rule(1.0, dash=(0, (4, 3)))
    panel.legend()
    return panel.finish()


def _candidates(
    panel: Panel, result: TuningResult, which: np.ndarray, x: np.ndarray, y: np.ndarray, **style: Any
) -> None:
    """Draw a point for each of the candidates `which`, with its gains below the cursor; shape (n,) each."""
    look = {"color": palette.MEASURED, "label": "candidate", "size": 5.0, "alpha": 0.65}
    drawn = panel.points(x[which], y[which], **(look | style))
    data, tips = drawn.data_source.data, [("candidate", "@candidate"), ("cost", "@cost")]
    data["candidate"] = np.flatnonzero(which)
    data["cost"] = np.array([one.score.cost for one in result.tried])[which]
    for k, axis in enumerate(result.axes):
        data[f"gain{k}"] = np.array([one.values[k] for one in result.tried])[which]
        tips.append((axis.name, f"@gain{k} {axis.unit}".removesuffix(" 1")))
    panel.hover([drawn], tips)


def landscape_picture(found: Landscape) -> Drawing:
    """Plot the cost at every evaluated point, not interpolated; violations of a limit are crossed out."""
    panel = Panel(TALL - _SCALE, False, _words(found.up), _words(found.across), x_log=True, y_log=True)
    scores = [score for row in found.scores for score in row]
    x, y = (grid.ravel() for grid in np.meshgrid(found.x, found.y))
    cost = np.array([score.cost for score in scores])
    broken = np.array([score.violation > 0.0 for score in scores])
    known = np.isfinite(cost)
    low, high = (float(cost[known].min()), float(cost[known].max())) if known.any() else (0.0, 1.0)
    shade = np.where(known, (cost - low) / max(high - low, 1e-9), 0.0)
    colors = np.where(known, _COLORS[np.round(255 * shade).astype(int)], "#FFFFFF")
    names = [
        f"{found.across.name} {a:.4g}, {found.up.name} {b:.4g}: cost {c:.4f}{words}"
        for a, b, c, words in zip(x, y, cost, np.where(broken, ", breaks a limit", ""), strict=True)
    ]
    right, up = _edges(found.x), _edges(found.y)
    panel.cells(right, up, colors.tolist(), names)
    if broken.any():
        panel.points(x[broken], y[broken], palette.ACCENT, "breaks a limit", "x", 9.0)
    panel.points(*found.found, "white", "found", "star", 13.0).glyph.line_color = palette.INK
    before = panel.points(found.across.start, found.up.start, palette.INK, "before", "diamond", 10.0)
    before.glyph.line_color = "white"
    panel.x_limits(right[0], right[-1])
    panel.limits(up[0], up[-1])
    for values, across in ((found.x, True), (found.y, False)):
        places = values[:: max(1, len(values) // 4)]
        panel.ticks(places, [f"{place:.3g}" for place in places], across)
    panel.legend()
    panel.finish()
    return Drawing((panel, _scale(low, high)))


def _scale(low: float, high: float) -> Panel:
    """Scale of the colours of a landscape."""
    panel = Panel(_SCALE, over_time=False, x_label="cost, light is better")
    borders = np.linspace(low, max(high, low + 1e-9), 65)
    names = [f"{cost:.4f}" for cost in borders[:-1]]
    panel.cells(borders, np.array([0.0, 1.0]), _COLORS[::4].tolist(), names)
    panel.x_limits(borders[0], borders[-1])
    panel.x_axis.ticker.desired_num_ticks = 4
    panel.ticks((), ())
    panel.finish()
    return panel


_NARROWEST = 1e-4  # least width of a cell on the logarithmic axis


def _edges(values: Sequence[float]) -> np.ndarray:
    """Return the borders of cells, shape (n + 1,), around n values evenly spaced on a logarithmic axis."""
    logs = np.log(values)
    half = max(0.5 * (logs[1] - logs[0]), _NARROWEST)
    return np.exp(np.append(logs - half, logs[-1] + half))


def _words(of: GainAxis) -> str:
    return f"{of.name.partition('.')[2].replace('_', ' ')} [{of.unit}]"


def pareto(result: TuningResult) -> Drawing:
    """Plot tracking and detection terms against the least phase margin, with the Pareto front."""
    label = "following and detection, 1: before"
    panel = Panel(MIDDLE, over_time=False, label=label, x_label="least phase margin [°]")
    kept = np.array([one.score.violation == 0.0 for one in result.tried])
    speed, margin = np.transpose([speed_and_robustness(one) for one in result.tried])
    _candidates(panel, result, kept, margin, speed)
    if kept.any():
        own = np.flatnonzero(kept)
        front = own[front_of(np.column_stack([speed, margin])[own])]
        panel.line(margin[front], speed[front], palette.INK, "front", width=1.3)
        best = own[np.argmin([result.tried[k].score.cost for k in own])]
        for k, marker, size, color, words in (
            (0, "diamond", 10.0, palette.INK, "before"),
            (best, "star", 13.0, palette.ACCENT, "found"),
        ):
            if kept[k]:
                panel.points(margin[k], speed[k], color, words, marker, size)
    else:
        panel.label = "no candidate keeps the limits"
    panel.legend()
    return panel.finish()


def speed_and_robustness(one: ScoredCandidate) -> tuple[float, float]:
    """Return the cost terms of tracking and detection (small: fast) and the least phase margin [°]."""
    return one.score.group(TRACKING, DETECTION), one.score.loops.phase


def front_of(points: np.ndarray) -> np.ndarray:
    """Return the indices of the Pareto-optimal points, shape (m,), by increasing robustness.

    A point is the speed term (small: fast) and the robustness of a candidate, shape (n, 2).
    """
    order = np.lexsort((points[:, 0], -points[:, 1]))
    front, best = [], np.inf
    for k in order:  # from the most robust down, each must be faster than all before it
        if points[k, 0] < best:
            front.append(int(k))
            best = points[k, 0]
    return np.array(front[::-1], int)
