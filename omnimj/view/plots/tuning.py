"""Plots of a gain tuning: search, cost around the result, speed against robustness."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import FuncFormatter, NullLocator

from omnimj.studies.tuning.cost import DETECTION, TRACKING
from omnimj.studies.tuning.landscape import Landscape
from omnimj.studies.tuning.study import ScoredCandidate, TuningResult
from omnimj.view import palette
from omnimj.view.plots.drawing import MIDDLE, TALL, legend, new_figure, value_axis

_DOTS = {"linestyle": "none", "marker": "o", "markersize": 3.4, "markeredgewidth": 0, "alpha": 0.65}


def convergence(result: TuningResult) -> Figure:
    """Plot the cost of every candidate within all limits, and the best so far."""
    figure, (ax,) = new_figure(MIDDLE)
    cost = [_cost(one) for one in result.tried]
    number = np.arange(len(cost))
    best = np.fmin.accumulate(cost)
    ax.plot(number, cost, color=palette.MEASURED, label="candidate", **_DOTS)
    out = [k for k, one in enumerate(result.tried) if one.score.violation > 0.0]
    if out:
        top = np.nanmax(cost) if np.isfinite(cost).any() else 1.0
        style = {"linestyle": "none", "marker": "x", "markersize": 3.4, "alpha": 0.6}
        ax.plot(out, [top] * len(out), color=palette.ACCENT, label="breaks a limit", **style)
    ax.step(number, best, where="post", color=palette.INK, linewidth=1.4, label="best so far")
    ax.axhline(1.0, color=palette.MUTED, linewidth=0.9, linestyle=(0, (4, 3)))
    ax.set_xlabel("candidate", fontsize=9)
    value_axis(ax, "cost, 1: the gains before")
    legend(ax, 3)
    return figure


def _cost(one: ScoredCandidate) -> float:
    return one.score.cost if one.score.violation == 0.0 else np.nan


def landscape_picture(found: Landscape) -> Figure:
    """Plot the cost at every evaluated point, not interpolated; violations of a limit are crossed out."""
    figure, (ax,) = new_figure(TALL)
    cost = np.array([[score.cost for score in row] for row in found.scores])
    broken = np.array([[score.violation > 0.0 for score in row] for row in found.scores])
    shown = np.ma.masked_invalid(np.where(np.isfinite(cost), cost, np.nan))
    ax.grid(False)
    mesh = ax.pcolormesh(_edges(found.x), _edges(found.y), shown, cmap="viridis_r", shading="flat")
    bar = figure.colorbar(mesh, ax=ax, pad=0.02)
    bar.ax.tick_params(labelsize=8)
    bar.set_label("cost, light is better", fontsize=9)
    grid_x, grid_y = np.meshgrid(found.x, found.y)
    style = {"linestyle": "none", "markersize": 6}
    if broken.any():
        ax.plot(
            grid_x[broken], grid_y[broken], marker="x", color=palette.ACCENT, label="breaks a limit", **style
        )
    ax.plot(*found.found, marker="*", color="white", markeredgecolor=palette.INK, label="found", **style)
    ax.plot(
        found.across.start,
        found.up.start,
        marker="D",
        color=palette.INK,
        markeredgecolor="white",
        label="before",
        **{**style, "markersize": 4},
    )
    ax.set_xscale("log")
    ax.set_yscale("log")
    ax.set_xlim(*_edges(found.x)[[0, -1]])
    ax.set_ylim(*_edges(found.y)[[0, -1]])
    _plain_ticks(ax, found)
    legend(ax, 3)
    return figure


_NARROWEST = 1e-4  # least width of a cell on the logarithmic axis


def _edges(values: Sequence[float]) -> np.ndarray:
    """Return the borders of cells, shape (n + 1,), around n values evenly spaced on a logarithmic axis."""
    logs = np.log(values)
    half = max(0.5 * (logs[1] - logs[0]), _NARROWEST)
    return np.exp(np.append(logs - half, logs[-1] + half))


def _plain_ticks(ax: Axes, found: Landscape) -> None:
    for axis, values, of in ((ax.xaxis, found.x, found.across), (ax.yaxis, found.y, found.up)):
        axis.set_minor_locator(NullLocator())
        axis.set_ticks(values[:: max(1, len(values) // 4)])
        axis.set_major_formatter(FuncFormatter(lambda v, _: f"{v:.3g}"))
        words = f"{of.name.partition('.')[2].replace('_', ' ')} [{of.unit}]"
        axis.set_label_text(words, fontsize=9)


def pareto(result: TuningResult) -> Figure:
    """Plot tracking and detection terms against the least phase margin, with the Pareto front."""
    figure, (ax,) = new_figure(MIDDLE)
    kept = [one for one in result.tried if one.score.violation == 0.0]
    points = np.array([speed_and_robustness(one) for one in kept]).reshape(-1, 2)
    if not len(kept):
        value_axis(ax, "no candidate keeps the limits")
        return figure
    front = front_of(points)
    ax.plot(points[:, 1], points[:, 0], color=palette.MEASURED, label="candidate", **_DOTS)
    ax.plot(points[front, 1], points[front, 0], color=palette.INK, linewidth=1.2, label="front")
    for one, marker, color, words in (
        (result.tried[0], "D", palette.INK, "before"),
        (min(kept, key=lambda t: t.score.cost), "*", palette.ACCENT, "found"),
    ):
        if one.score.violation == 0.0:
            speed, margin = speed_and_robustness(one)
            style = {"linestyle": "none", "markersize": 8 if marker == "*" else 5}
            ax.plot(margin, speed, marker=marker, color=color, label=words, **style)
    ax.set_xlabel("least phase margin [°]", fontsize=9)
    value_axis(ax, "following and detection, 1: before")
    legend(ax, 4)
    return figure


def speed_and_robustness(one: ScoredCandidate) -> tuple[float, float]:
    """Return the cost terms of tracking and detection (small: fast) and the least phase margin [°]."""
    return one.score.group(TRACKING, DETECTION), one.score.loops.phase


def front_of(points: np.ndarray) -> np.ndarray:
    """Return the indices of the Pareto-optimal points, shape (m,), by increasing robustness.

    Args:
      points: Speed term (small: fast) and robustness of each candidate, shape (n, 2).
    """
    order = np.lexsort((points[:, 0], -points[:, 1]))
    front, best = [], np.inf
    for k in order:  # from the most robust down, each must be faster than all before it
        if points[k, 0] < best:
            front.append(int(k))
            best = points[k, 0]
    return np.array(front[::-1], int)
