"""Figures that show where the gap lies: over a regime variable, run by run, before and after."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from omnimj.gap.per_run import RunGap, has_after, noise_row
from omnimj.gap.records import Finding, Place
from omnimj.gap.sentences import shown_unit, variable_words
from omnimj.signals import Array
from omnimj.view import palette
from omnimj.view.drawing import MIDDLE, legend, new_figure, value_axis
from omnimj.view.gap_drawing import (
    AFTER,
    BEFORE,
    BEFORE_LINE,
    dumbbells,
    first_name,
    legend_above,
    noise_axis,
    row_figure,
    zero,
)
from omnimj.view.gap_tables import either_sign

_BINS, _DOTS, _RUNS, _PLACES = 14, 700, 14, 4


def regime_variables(finding: Finding) -> list[tuple[str, Place]]:
    """The variables that places of the gap are bounded by and the overlays know, each with its first "
    "place."""
    known = {
        name
        for overlay in finding.overlays
        for name, values in overlay.regimes.items()
        if np.asarray(values).dtype.kind in "fiu"
    }
    found: dict[str, Place] = {}
    for place in finding.where:
        for variable in place.bounds:
            if variable in known and place.channel in finding.channels:
                found.setdefault(variable, place)
    return list(found.items())


def against_regime(finding: Finding, variable: str, place: Place) -> Figure:
    """Mismatch in the place's channel over a regime variable: every block a dot, averages before and "
    "after."""
    channel = list(finding.channels).index(place.channel)
    channel_unit, words = finding.channels[place.channel]
    used = [o for o in finding.overlays if variable in o.regimes]
    x = np.concatenate([o.regimes[variable] for o in used]).astype(float)
    if variable.endswith("angle"):
        x = np.mod(x, 2.0 * np.pi)
    before = np.concatenate([(o.measured - o.before)[:, channel] for o in used])
    figure, (ax,) = new_figure(MIDDLE)
    second = has_after(finding)
    _shade(ax, finding, variable, place, x)
    known = np.flatnonzero(np.isfinite(x) & np.isfinite(before))
    shown = known[:: max(1, len(known) // _DOTS)]
    ax.plot(x[shown], before[shown], ".", color=palette.lighter(BEFORE, 0.5), markersize=3.0, zorder=2)
    _averages(ax, x, before, color=BEFORE, linestyle=BEFORE_LINE, marker="o", label=first_name(second))
    if second:
        after = np.concatenate([(o.measured - o.after)[:, channel] for o in used])
        _averages(ax, x, after, color=AFTER, linestyle="-", marker="s", label="after")
    zero(ax)
    unit = shown_unit(finding.regimes.get(variable, "1"))
    ax.set_xlabel(f"{variable_words(variable)} [{unit}]", fontsize=9)
    value_axis(ax, f"mismatch in\n{words} [{channel_unit}]")
    legend(ax)
    return figure


def _shade(ax: Axes, finding: Finding, variable: str, place: Place, x: Array) -> None:
    least, most = float(np.nanmin(x)), float(np.nanmax(x))
    room = 0.03 * (most - least) or 1.0
    ax.set_xlim(least - room, most + room)
    for start, end in spans_of(place, variable):
        if start > least or end < most:  # the whole range is no place
            left = start if start > least else least - room
            right = end if end < most else most + room
            ax.axvspan(left, right, facecolor=palette.FAULT, alpha=0.13, linewidth=0, zorder=0)


def spans_of(place: Place, variable: str) -> list[tuple[float, float]]:
    """Where the place lies on the axis of a variable: mirrored too where the words say `(either sign)`."""
    low, high = place.bounds[variable]
    return [(-high, -low), (low, high)] if either_sign(place, variable) else [(low, high)]


def _averages(ax: Axes, x: Array, y: Array, **style: object) -> None:
    """Means over bins of the variable with equally many blocks; over each value of one that takes a few "
    "only."""
    known = np.isfinite(x) & np.isfinite(y)
    x, y = x[known], y[known]
    values = np.unique(x)
    if len(values) <= _BINS:
        middle, mean = values, np.array([y[x == value].mean() for value in values])
    else:
        order = np.argsort(x, kind="stable")
        parts = [order[a:b] for a, b in pairwise(np.linspace(0, len(x), _BINS + 1).astype(int)) if b > a]
        middle, mean = np.array([x[p].mean() for p in parts]), np.array([y[p].mean() for p in parts])
    ax.plot(middle, mean, **{"linewidth": 1.6, "markersize": 4.5, "zorder": 4, **style})  # pyright: ignore


def by_run(gaps: Sequence[RunGap]) -> Figure:
    """Mismatch of the runs with the largest, over all channels in units of noise; held-out runs in bold."""
    shown = gaps[:_RUNS]
    labels = [f"{gap.run}{' (held out)' if gap.heldout and not gap.partly else ''}" for gap in shown]
    figure, ax = row_figure(labels, [gap.heldout and not gap.partly for gap in shown])
    before = [gap.total_before for gap in shown]
    known = [gap.total_after for gap in shown if gap.total_after is not None]
    after = known if len(known) == len(shown) else None
    dumbbells(ax, before, after)
    noise_axis(ax, [*before, *known], "RMS mismatch [multiples of the noise]")
    legend_above(figure)
    return figure


def shrinkage(finding: Finding) -> Figure:
    """Held-out mismatch of every channel, then of every place, in units of noise, before and after."""
    noise = dict(zip(finding.channels, noise_row(finding).tolist(), strict=True))
    rows = [
        (words, gap.before / noise[name], None if gap.after is None else gap.after / noise[name])
        for name, (_, words) in finding.channels.items()
        if (gap := finding.heldout.get(name)) is not None
    ]
    rows += [
        (
            f"place {k}: {finding.channels[p.channel][1]}",
            p.before / noise[p.channel],
            p.after / noise[p.channel],
        )
        for k, p in enumerate(finding.where[:_PLACES], start=1)
        if p.after is not None and p.channel in noise
    ]
    n = sum(name in finding.heldout for name in finding.channels)
    figure, ax = row_figure([row[0] for row in rows], [True] * n, 38)
    for tick in ax.get_yticklabels()[n:]:
        tick.set_fontsize(8)
    before, after = [row[1] for row in rows], [row[2] for row in rows if row[2] is not None]
    dumbbells(ax, before, after if len(after) == len(rows) else None)
    if len(rows) > n:
        ax.axhline(n - 0.5, color=palette.MUTED, linewidth=0.8)
    noise_axis(ax, [*before, *after], "RMS mismatch [multiples of the noise]")
    legend_above(figure)
    return figure
