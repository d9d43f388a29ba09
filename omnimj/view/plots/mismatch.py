"""Plots of mismatch for the gap report: over regimes, by run, by channel, over time and frequency."""

from __future__ import annotations

import textwrap
from collections.abc import Sequence
from itertools import pairwise
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import NullFormatter
from scipy.signal import welch

from omnimj.estimate.gap.records import (
    Finding,
    MismatchRegime,
    Overlay,
    RunGap,
    channel_rms,
    has_second_model,
    noise_row,
)
from omnimj.estimate.gap.sentences import format_unit, variable_words
from omnimj.signals import Array
from omnimj.view import palette
from omnimj.view.plots.drawing import MIDDLE, legend, line, new_figure, time_axis, value_axis

BEFORE, AFTER, MEASURED = palette.ACCENT, palette.MEASURED, palette.INK
RIVAL, BEATEN = palette.FAULT, "#8A939D"
BEFORE_LINE, AFTER_LINE = (0, (5, 1.8)), "-"
_ROW, _FRAME = 0.27, 0.95  # [inches] height of a row, and of everything around the rows


def row_figure(labels: Sequence[str], strong: Sequence[bool] = (), width: int = 27) -> tuple[Figure, Axes]:
    """Make a figure with one named row per label, the first at the top.

    Args:
      labels: Names of the rows.
      strong: True for labels in bold; empty for none.
      width: Most letters per line of a label.
    """
    wrapped = ["\n".join(textwrap.wrap(label, width)) or " " for label in labels]
    highest = max((1 + 0.55 * label.count("\n") for label in wrapped), default=1.0)
    figure, (ax,) = new_figure(_FRAME + _ROW * highest * max(len(labels), 2))
    ax.set_yticks(np.arange(len(labels)), wrapped, fontsize=8.5)
    for tick, bold in zip(ax.get_yticklabels(), strong, strict=False):
        tick.set_fontweight("bold" if bold else "normal")
    ax.set_ylim(len(labels) - 0.4, -0.6)
    ax.grid(True, axis="y", color=palette.GRID, linewidth=0.5)
    ax.tick_params(axis="y", length=0)
    return figure, ax


def baseline_name(second: bool) -> str:
    """Return the label of the given model: `before` beside a second model, else `simulated`."""
    return "before" if second else "simulated"


def dumbbells(ax: Axes, before: Sequence[float], after: Sequence[float] | None) -> None:
    """Draw in each row a ring (before) and a dot (after), joined by a line."""
    rows = np.arange(len(before))
    if after is not None:
        for row, (start, end) in enumerate(zip(before, after, strict=True)):
            ax.plot(
                [start, end], [row, row], color=palette.lighter(palette.MUTED, 0.45), linewidth=2.0, zorder=2
            )
    style = {"linestyle": "none", "markersize": 6.5, "zorder": 3}
    ax.plot(
        before,
        rows,
        "o",
        markerfacecolor="white",
        markeredgewidth=2.0,
        color=BEFORE,
        **style,
        label=baseline_name(after is not None),
    )
    if after is not None:
        ax.plot(after, rows, "o", color=AFTER, label="after", **style)


def noise_axis(ax: Axes, values: Sequence[float], words: str) -> None:
    """Scale an axis in multiples of the noise, logarithmic for wide ranges, with a line at 1."""
    known = [v for v in values if np.isfinite(v) and v > 0.0]
    largest, smallest = max(known, default=1.0), min(known, default=1.0)
    if largest > 12.0 * max(min(smallest, 1.0), 0.2):
        ax.set_xscale("log")
        ticks = [t for t in (0.1, 0.2, 0.5, 1, 2, 5, 10, 20, 50, 100, 200, 500, 1000) if t < 1.5 * largest]
        ticks = [t for t in ticks if t > 0.6 * min(smallest, 1.0)]
        ax.set_xticks(ticks, [f"{t:g}" for t in ticks])
        ax.set_xticks([], minor=True)
        ax.set_xlim(0.75 * min(smallest, 1.0), 1.35 * largest)
    else:
        ax.set_xlim(0.0, 1.12 * max(largest, 1.0))
    reference_line(ax, 1.0, "noise")
    ax.xaxis.grid(True, color=palette.GRID, linewidth=0.7)
    ax.set_xlabel(words, fontsize=9)


def reference_line(ax: Axes, place: float, words: str) -> None:
    """Draw a dotted vertical line with a legend entry."""
    ax.axvline(place, color=palette.MUTED, linewidth=1.3, linestyle=(0, (2, 2)), zorder=1, label=words)


def zero_line(ax: Axes) -> None:
    """Mark zero on the value axis."""
    ax.axhline(0.0, color=palette.MUTED, linewidth=0.9, zorder=1)


def legend_above(figure: Figure) -> None:
    """Add a legend across the top of the figure, where it covers no data."""
    handles, names = figure.get_axes()[0].get_legend_handles_labels()
    figure.legend(
        handles,
        names,
        loc="outside upper left",
        ncols=4,
        fontsize=8.5,
        frameon=False,
        handlelength=1.8,
        columnspacing=1.3,
        borderaxespad=0.1,
        handletextpad=0.5,
    )


def wrapped_label(words: str, unit: str) -> str:
    """Wrap the axis label of a low plot into short lines, the unit in the last one."""
    return "\n".join([*textwrap.wrap(words, 13), f"[{unit}]"])


def with_gaps(time: Array, values: Array) -> tuple[Array, Array]:
    """Insert NaN into values, shape (k,), wherever time, shape (k,) [s], jumps."""
    steps = np.diff(time)
    if len(steps) == 0:
        return time, values
    jumps = np.flatnonzero((steps > 2.5 * np.median(steps)) | (steps <= 0.0)) + 1
    return np.insert(time, jumps, np.nan), np.insert(values, jumps, np.nan)


_BINS, _DOTS, _RUNS, _PLACES = 14, 700, 14, 4


def regime_variables(finding: Finding) -> list[tuple[str, MismatchRegime]]:
    """Return the recorded variables that bound regimes of the gap, each with its first regime."""
    known = {
        name
        for overlay in finding.overlays
        for name, values in overlay.regimes.items()
        if np.asarray(values).dtype.kind in "fiu"
    }
    found: dict[str, MismatchRegime] = {}
    for place in finding.where:
        for variable in place.bounds:
            if variable in known and place.channel in finding.channels:
                found.setdefault(variable, place)
    return list(found.items())


def against_regime(finding: Finding, variable: str, place: MismatchRegime) -> Figure:
    """Plot the mismatch of a channel over a regime variable: a dot per block, averages before and after."""
    channel = list(finding.channels).index(place.channel)
    channel_unit, words = finding.channels[place.channel]
    used = [o for o in finding.overlays if variable in o.regimes]
    x = np.concatenate([o.regimes[variable] for o in used]).astype(float)
    if variable.endswith("angle"):
        x = np.mod(x, 2.0 * np.pi)
    before = np.concatenate([(o.measured - o.before)[:, channel] for o in used])
    figure, (ax,) = new_figure(MIDDLE)
    second = has_second_model(finding)
    _shade(ax, finding, variable, place, x)
    known = np.flatnonzero(np.isfinite(x) & np.isfinite(before))
    shown = known[:: max(1, len(known) // _DOTS)]
    ax.plot(x[shown], before[shown], ".", color=palette.lighter(BEFORE, 0.5), markersize=3.0, zorder=2)
    _averages(ax, x, before, color=BEFORE, linestyle=BEFORE_LINE, marker="o", label=baseline_name(second))
    if second:
        after = np.concatenate([(o.measured - o.after)[:, channel] for o in used])
        _averages(ax, x, after, color=AFTER, linestyle="-", marker="s", label="after")
    zero_line(ax)
    unit = format_unit(finding.regimes.get(variable, "1"))
    ax.set_xlabel(f"{variable_words(variable)} [{unit}]", fontsize=9)
    value_axis(ax, f"mismatch in\n{words} [{channel_unit}]")
    legend(ax)
    return figure


def _shade(ax: Axes, finding: Finding, variable: str, place: MismatchRegime, x: Array) -> None:
    least, most = float(np.nanmin(x)), float(np.nanmax(x))
    room = 0.03 * (most - least) or 1.0
    ax.set_xlim(least - room, most + room)
    for start, end in spans_of(place, variable):
        if start > least or end < most:  # a regime over the whole range does not localise the gap
            left = start if start > least else least - room
            right = end if end < most else most + room
            ax.axvspan(left, right, facecolor=palette.FAULT, alpha=0.13, linewidth=0, zorder=0)


def either_sign(place: MismatchRegime, variable: str) -> bool:
    """Check that a regime bounds the absolute value of a variable, described as `(either sign)`."""
    return place.bounds[variable][0] >= 0.0 and f"{variable_words(variable)} (either sign)" in place.regime


def spans_of(place: MismatchRegime, variable: str) -> list[tuple[float, float]]:
    """Return the intervals of a regime on the axis of a variable, mirrored too for `(either sign)`."""
    low, high = place.bounds[variable]
    return [(-high, -low), (low, high)] if either_sign(place, variable) else [(low, high)]


def _averages(ax: Axes, x: Array, y: Array, **style: object) -> None:
    """Plot means over bins of equally many blocks, or over each value of a variable with few values."""
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
    """Plot the largest mismatches by run over all channels, in units of the noise; held-out runs in bold."""
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
    """Plot the held-out mismatch before and after, by channel and by regime, in units of the noise."""
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


_SEGMENT, _SHORTEST = 64, 8  # most blocks of one periodogram, least blocks of a run with a spectrum
_NO_DETREND: Any = False  # keeps a constant mismatch


def largest_mismatch_channels(finding: Finding, windows: Sequence[Overlay], most: int = 2) -> list[int]:
    """Return the sorted indices of the channels with the largest mismatch before, in units of the noise."""
    size = channel_rms(np.concatenate([w.measured - w.before for w in windows])) / noise_row(finding)
    return sorted(np.argsort(-np.nan_to_num(size), kind="stable")[:most].tolist())


def overlay(finding: Finding, windows: Sequence[Overlay]) -> Figure:
    """Plot one run: channels of largest mismatch, measured and simulated, with the mismatch below."""
    channels, second = largest_mismatch_channels(finding, windows), has_second_model(finding)
    figure, axes = new_figure(1.0 + 1.75 * len(channels), rows=2 * len(channels), sharex=True)
    time = np.concatenate([w.time for w in windows])
    for row, c in enumerate(channels):
        measured, before, after = (
            np.concatenate([values[:, c] for values in _columns(windows, name)])
            for name in ("measured", "before", "after")
        )
        unit, words = list(finding.channels.values())[c]
        top, below = axes[2 * row], axes[2 * row + 1]
        _line(top, time, measured, color=palette.lighter(MEASURED, 0.45), linewidth=3.4, label="measured")
        _line(
            top, time, before, color=BEFORE, linestyle=BEFORE_LINE, linewidth=1.6, label=baseline_name(second)
        )
        _line(below, time, measured - before, color=BEFORE, linewidth=1.3)
        if second:
            _line(top, time, after, color=AFTER, linewidth=1.3, label="after")
            _line(below, time, measured - after, color=AFTER, linewidth=1.2)
        zero_line(below)
        value_axis(top, wrapped_label(words, unit))
        value_axis(below, f"mismatch\n[{unit}]")
    for ax in axes:
        ax.yaxis.label.set_fontsize(8)
        ax.tick_params(labelsize=8)
    time_axis(axes[-1], time)
    legend_above(figure)
    return figure


def _columns(windows: Sequence[Overlay], name: str) -> list[Array]:
    return [getattr(window, name) for window in windows]


def _line(ax: Axes, time: Array, values: Array, **style: object) -> None:
    line(ax, *with_gaps(time, values), **style)


def has_spectra(finding: Finding) -> bool:
    """Check that at least one run is long enough for a spectrum."""
    return any(len(o.time) >= _SHORTEST for o in finding.overlays)


def spectra(finding: Finding, channels: Sequence[int]) -> Figure:
    """Plot the amplitude density of the held-out mismatch before and after, and of the noise, per channel."""
    long = [o for o in finding.overlays if len(o.time) >= _SHORTEST]
    runs = [o for o in long if o.heldout] or long
    figure, axes = new_figure(0.9 + 1.35 * len(channels), rows=len(channels), sharex=True)
    period = float(np.median(np.concatenate([np.diff(o.time) for o in runs])))
    for ax, c in zip(axes, channels, strict=True):
        unit, words = list(finding.channels.values())[c]
        pairs: list[tuple[str, str, Any, str]] = [
            ("before", BEFORE, BEFORE_LINE, baseline_name(has_second_model(finding)))
        ]
        if has_second_model(finding):
            pairs.append(("after", AFTER, "-", "after"))
        for name, color, dashes, label in pairs:
            frequency, density = _density([(o.measured - getattr(o, name))[:, c] for o in runs], period)
            ax.loglog(frequency, density, color=color, linestyle=dashes, linewidth=1.6, label=label)
        noise = float(noise_row(finding)[c])
        # white noise of block means has its variance spread over 0 … half the block rate
        style = {"color": palette.MUTED, "linewidth": 1.1, "linestyle": (0, (2, 2)), "label": "noise"}
        ax.axhline(noise * np.sqrt(2.0 * period), **style)
        _at_least_one_decade(ax)
        value_axis(ax, wrapped_label(words, f"{unit}/√Hz"))
        ax.yaxis.label.set_fontsize(8)
    axes[-1].xaxis.set_major_formatter(lambda value, _: f"{value:g}")
    axes[-1].set_xlabel("frequency [Hz]", fontsize=9)
    legend_above(figure)
    return figure


def _at_least_one_decade(ax: Axes) -> None:
    """Show at least one decade, with labels at powers of ten only."""
    low, high = ax.get_ylim()
    room = max(0.5 * np.log10(12.0 * low / high), 0.0)
    ax.set_ylim(low / 10.0**room, high * 10.0**room)
    ax.yaxis.set_minor_formatter(NullFormatter())


def _density(parts: Sequence[Array], period: float) -> tuple[Array, Array]:
    """Average the power density over runs by Welch's method; masked samples count as zero mismatch.

    Args:
      parts: Mismatch of each run, shapes (k,).
      period: Interval between blocks [s].

    Returns:
      Frequencies above zero [Hz] and amplitude density [unit/√Hz].
    """
    longest = max(len(part) for part in parts)
    length = min(_SEGMENT, longest)
    powers, weights = [], []
    frequency = np.fft.rfftfreq(length, period)
    for part in parts:
        whole = np.nan_to_num(part)
        if len(whole) < length:
            whole = np.pad(whole, (0, length - len(whole)))
        scale = length / min(len(part), length)  # padded zeros carry no power
        _, power = welch(whole, 1.0 / period, nperseg=length, detrend=_NO_DETREND)
        powers.append(scale * power)
        weights.append(len(part))
    mean = np.average(np.array(powers), axis=0, weights=weights)
    density = np.sqrt(np.where(mean > 0.0, mean, np.nan))
    return np.asarray(frequency[1:], float), np.asarray(density[1:], float)
