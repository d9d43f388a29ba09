"""Plots of the search for missing effects: candidates, decoys, refitted parameters, free curves."""

from __future__ import annotations

from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from omnimj.estimate.gap.records import CandidateResult, Finding, Refitted, Stage
from omnimj.estimate.gap.sentences import format_number, format_percent, variable_words
from omnimj.signals import Array
from omnimj.view import palette
from omnimj.view.plots.drawing import new_figure, value_axis
from omnimj.view.plots.mismatch import AFTER, BEATEN, RIVAL, legend_above, reference_line, row_figure

_ROWS, _BINS = 12, 50
_VERDICT_STYLES = {  # verdict → colour, marker, filled or not
    "named": (AFTER, "o", True),
    "rival": (RIVAL, "D", True),
    "beaten": (BEATEN, "s", True),
    "below the margin": (BEATEN, "o", False),
}


def candidate_gains(stage: Stage) -> Figure:
    """Plot the held-out gain of every fitted candidate with its 90 % interval, the best at the top."""
    tried = [c for c in stage.candidates if c.gain is not None][:_ROWS]
    labels = [f"{c.label}{' · sensor' if c.is_sensor else ''}" for c in tried]
    figure, ax = row_figure(labels, [c.verdict == "named" for c in tried])
    labelled: set[str] = set()
    for row, candidate in enumerate(tried):
        gain = candidate.gain
        if gain is None:
            continue
        color, marker, filled = _VERDICT_STYLES.get(candidate.verdict, (BEATEN, "o", False))
        low = gain.value if gain.low is None else gain.low
        high = gain.value if gain.high is None else gain.high
        ax.plot([low, high], [row, row], color=color, linewidth=2.4, alpha=0.75, zorder=2)
        face = color if filled else "white"
        name = candidate.verdict if candidate.verdict not in labelled else None
        labelled.add(candidate.verdict)
        style = {"color": color, "markerfacecolor": face, "markersize": 7, "linestyle": "none", "zorder": 3}
        ax.plot([gain.value], [row], marker=marker, label=name, **style)
    ax.axvline(0.0, color=palette.MUTED, linewidth=0.9, zorder=1)
    _margin(ax, stage)
    ax.set_xlabel("held-out gain", fontsize=9)
    _percent_axis(ax)
    legend_above(figure)
    return figure


def decoy_gains(stage: Stage) -> Figure:
    """Plot the gains of decoys (random curves of equal flexibility) beside that of the best candidate."""
    figure, (ax,) = new_figure(2.6)
    known = stage.decoys[np.isfinite(stage.decoys)]
    best = next((c for c in stage.candidates if c.gain is not None), None)
    if len(known):
        ax.hist(known, bins=_bins(known, stage, best), color=palette.lighter(BEATEN, 0.35))
    ax.plot(
        [], [], "s", color=palette.lighter(BEATEN, 0.35), markersize=7, label=f"{len(known)} random curves"
    )
    top = ax.get_ylim()[1]
    if best is not None and best.gain is not None:
        color, marker, filled = _VERDICT_STYLES.get(best.verdict, (BEATEN, "o", False))
        low = best.gain.value if best.gain.low is None else best.gain.low
        high = best.gain.value if best.gain.high is None else best.gain.high
        ax.plot([low, high], [0.5 * top] * 2, color=color, linewidth=2.4, alpha=0.75)
        face: Any = {"color": color, "markerfacecolor": color if filled else "white", "linestyle": "none"}
        ax.plot([best.gain.value], [0.5 * top], marker=marker, markersize=8, label=best.label, **face)
    _margin(ax, stage)
    ax.set_xlabel("held-out gain", fontsize=9)
    _percent_axis(ax)
    value_axis(ax, "number of curves")
    legend_above(figure)
    return figure


def _bins(known: Array, stage: Stage, best: CandidateResult | None) -> list[float]:
    """Return the edges of bins over the decoys, wide enough to be visible beside a distant candidate."""
    ends = [float(known.min()), float(known.max()), stage.margin]
    if best is not None and best.gain is not None:
        ends.append(best.gain.value)
    width = max((max(ends) - min(ends)) / _BINS, 1e-9)
    return [ends[0] + width * k for k in range(int((ends[1] - ends[0]) / width) + 2)]


def _margin(ax: Axes, stage: Stage) -> None:
    reference_line(ax, stage.margin, f"margin {format_percent(stage.margin)}")


def _percent_axis(ax: Axes) -> None:
    ax.xaxis.set_major_formatter(lambda value, _: f"{format_number(100.0 * value)} %")


def refitted_parameters(refitted: tuple[Refitted, ...]) -> Figure:
    """Plot refitted parameters relative to their stated uncertainty: 0 is nominal, ±1 the limits."""
    figure, ax = row_figure([parameter.name for parameter in refitted])
    for row, parameter in enumerate(refitted):
        half = 0.5 * (parameter.high - parameter.low) or 1.0
        places = [(v - parameter.nominal) / half for v in (parameter.low, parameter.high, parameter.fitted)]
        ax.plot(
            places[:2],
            [row, row],
            color=palette.lighter(palette.MUTED, 0.6),
            linewidth=9.0,
            solid_capstyle="butt",
            zorder=1,
        )
        style = {"linestyle": "none", "zorder": 3, "color": RIVAL if parameter.at_bound else AFTER}
        name = "fitted, at the side of its box" if parameter.at_bound else "fitted"
        first = all(p.at_bound != parameter.at_bound for p in refitted[:row])
        shape = "D" if parameter.at_bound else "o"
        ax.plot([places[2]], [row], shape, markersize=7.5, label=name if first else None, **style)
    ax.axvline(0.0, color=palette.MUTED, linewidth=0.9, zorder=2)
    ax.set_xlim(-1.25, 1.25)
    ax.set_xticks([-1, 0, 1], ["lowest", "nominal", "highest"])
    ax.set_xlabel("within the stated uncertainty", fontsize=9)
    legend_above(figure)
    return figure


def free_curves(finding: Finding) -> Figure:
    """Plot the share of the remaining mismatch that a free curve over each variable explains."""
    order = sorted(finding.flexible.items(), key=lambda item: -item[1])
    figure, ax = row_figure([f"over {variable_words(name)}" for name, _ in order])
    shares = [share for _, share in order]
    ax.barh(np.arange(len(order)), shares, height=0.55, color=palette.DIAGNOSIS, zorder=2)
    for row, share in enumerate(shares):
        ax.annotate(
            f"{100 * share:.0f} %",
            (max(share, 0.0), row),
            xytext=(4, 0),
            textcoords="offset points",
            fontsize=8.5,
            va="center",
        )
    ax.set_xlim(min(0.0, *shares), 1.0)
    ax.set_xlabel("share of the remaining held-out mismatch", fontsize=9)
    _percent_axis(ax)
    return figure
