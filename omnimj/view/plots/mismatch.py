"""Plots of mismatch for the gap report: over regimes, by run, by channel, over time and frequency."""

from __future__ import annotations

import textwrap
from collections.abc import Sequence
from itertools import pairwise
from typing import Any

import numpy as np
from scipy.signal import welch

from omnimj.estimate.gap.records import (
    Finding,
    MismatchRegime,
    Overlay,
    RunGap,
    has_second_model,
    noise_row,
)
from omnimj.estimate.gap.sentences import format_amount, format_number, format_unit, variable_words
from omnimj.estimate.intervals import channel_rms
from omnimj.signals import Array
from omnimj.view import palette
from omnimj.view.palette import AFTER, BEFORE
from omnimj.view.plots.over_time import finish
from omnimj.view.plots.panels import BELOW, MIDDLE, Drawing, Panel, Style, new_drawing

_BEFORE_LINE: Style = (0, (5, 1.8))
_NOISE_LINE: Style = (0, (2, 2))
_LETTERS = 27  # most per line of the name of a row, so that half of a phone's width is left for the plot
_LINE, _AROUND = 14, 100  # [pixels] height of a line of a row's name, and of everything around the rows
_CHANNEL, _SPECTRUM, _WIDE_LEFT = 230, 150, 84  # [pixels] heights per channel, room for wrapped labels
_TICKS = (0.1, 0.2, 0.5, 1, 2, 5, 10, 20, 50, 100, 200, 500, 1000)
_DECADES = [10.0**k for k in range(-8, 5)]
_BINS, _RUNS, _PLACES = 14, 14, 4  # bins of an average, most runs and regimes of a plot
_SEGMENT, _SHORTEST = 64, 8  # most blocks of one periodogram, least blocks of a run with a spectrum
_NO_DETREND: Any = False  # keeps a constant mismatch


def row_panel(labels: Sequence[str], words: str, x_log: bool = False) -> Panel:
    """Make a panel with one named row per label, the first at the top."""
    wrapped = [textwrap.fill(label, _LETTERS) for label in labels]
    lines = max((label.count("\n") + 1 for label in wrapped), default=1)
    height = _AROUND + (_LINE * lines + 12) * max(len(labels), 2)
    panel = Panel(height, over_time=False, x_label=words, x_log=x_log)
    panel.rows(wrapped)
    return panel


def _models(finding: Finding) -> list[tuple[str, str, str, Style]]:
    """Name in an overlay, label, colour and dash pattern of the given model and of any second one."""
    if has_second_model(finding):
        return [("before", "before", BEFORE, _BEFORE_LINE), ("after", "after", AFTER, "-")]
    return [("before", "simulated", BEFORE, _BEFORE_LINE)]


def dumbbells(labels: Sequence[str], before: Sequence[float], after: Sequence[float] | None) -> Panel:
    """Draw RMS mismatches in multiples of the noise: in each named row a ring (before) and a dot (after)."""
    known = [value for value in (*before, *(after or ())) if np.isfinite(value) and value > 0.0]
    smallest, largest = min([1.0, *known]), max(known, default=1.0)
    x_log = largest > 12.0 * max(smallest, 0.2)
    panel = row_panel(labels, "RMS mismatch [multiples of the noise]", x_log)
    if not x_log:
        panel.x_limits(0.0, 1.12 * max(largest, 1.0))
    else:
        panel.ticks(_TICKS, [f"{place:g}" for place in _TICKS], across=True)
    reference_line(panel, 1.0, "noise", (len(before) - 0.5, -0.5))
    rows, name = np.arange(len(before)), "simulated" if after is None else "before"
    if after is not None:
        panel.segments(before, rows, after, rows, palette.lighter(palette.MUTED, 0.45), 2.0)
    rings = panel.points(before, rows, BEFORE, name, names=_in_noise(name, before)).glyph
    rings.fill_color, rings.line_width = "white", 2
    if after is not None:
        panel.points(after, rows, AFTER, "after", size=8, names=_in_noise("after", after))
    panel.legend()
    return panel


def _in_noise(name: str, values: Sequence[float]) -> list[str]:
    return [f"{name}: {format_number(value)} × noise" for value in values]


def reference_line(panel: Panel, at: float, words: str, ends: tuple[float, float]) -> None:
    """Draw an upright line: dotted with a legend entry, or plain without words."""
    panel.line(np.full(2, at), np.array(ends), palette.MUTED, words, _NOISE_LINE if words else "-")


def wrapped_label(words: str, unit: str) -> str:
    """Wrap the axis label of a low plot into short lines, the unit in the last one."""
    return textwrap.fill(f"{words} [{unit}]", 17)


def with_gaps(time: Array, values: Array) -> tuple[Array, Array]:
    """Insert NaN where the time jumps, shape (k,) to (k + jumps,), so that a line has gaps there."""
    steps = np.diff(time)
    if len(steps) == 0:
        return time, values
    jumps = np.flatnonzero((steps > 2.5 * np.median(steps)) | (steps <= 0.0)) + 1
    return np.insert(time, jumps, time[jumps]), np.insert(values, jumps, np.nan)


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


def against_regime(finding: Finding, variable: str, place: MismatchRegime) -> Drawing:
    """Plot the mismatch in the channel of a regime over a variable: blocks, and averages of both models."""
    channel = list(finding.channels).index(place.channel)
    channel_unit, words = finding.channels[place.channel]
    used = [o for o in finding.overlays if variable in o.regimes]
    x = np.concatenate([o.regimes[variable] for o in used]).astype(float)
    if variable.endswith("angle"):
        x = np.mod(x, 2.0 * np.pi)
    unit = format_unit(finding.regimes.get(variable, "1"))
    label, x_label = f"mismatch in\n{words} [{channel_unit}]", f"{variable_words(variable)} [{unit}]"
    panel = Panel(MIDDLE, over_time=False, label=label, x_label=x_label)
    _shade(panel, variable, place, x)
    for (name, label, color, dash), marker in zip(_models(finding), ("circle", "square"), strict=False):
        y = np.concatenate([(o.measured - getattr(o, name))[:, channel] for o in used])
        known = np.isfinite(x) & np.isfinite(y)
        if name == "before":
            panel.points(x[known], y[known], palette.lighter(BEFORE, 0.5), size=2.5)
        _averages(panel, x[known], y[known], marker, label, color, dash)
    panel.rule(0.0)
    panel.legend()
    return panel.finish()


def _shade(panel: Panel, variable: str, place: MismatchRegime, x: Array) -> None:
    """Shade a regime; a side beyond all blocks, whose abscissae are x, shape (k,), is the panel's."""
    least, most = float(np.nanmin(x)), float(np.nanmax(x))
    for start, end in spans_of(place, variable):
        if start > least or end < most:  # a regime over the whole range does not localise the gap
            panel.shade("regime", start if start > least else None, end if end < most else None, 0.13)


def either_sign(place: MismatchRegime, variable: str) -> bool:
    """Check that a regime bounds the absolute value of a variable, described as `(either sign)`."""
    return place.bounds[variable][0] >= 0.0 and f"{variable_words(variable)} (either sign)" in place.regime


def spans_of(place: MismatchRegime, variable: str) -> list[tuple[float, float]]:
    """Return the intervals of a regime on the axis of a variable, mirrored too for `(either sign)`."""
    low, high = place.bounds[variable]
    return [(-high, -low), (low, high)] if either_sign(place, variable) else [(low, high)]


def _averages(panel: Panel, x: Array, y: Array, marker: str, label: str, color: str, dash: Style) -> None:
    """Plot means over bins of equally many blocks, or over each value of a variable with few values."""
    values = np.unique(x)
    if len(values) <= _BINS:
        middle, mean = values, np.array([y[x == value].mean() for value in values])
    else:
        order = np.argsort(x, kind="stable")
        parts = [order[a:b] for a, b in pairwise(np.linspace(0, len(x), _BINS + 1).astype(int)) if b > a]
        middle, mean = np.array([x[p].mean() for p in parts]), np.array([y[p].mean() for p in parts])
    panel.line(middle, mean, color, label, dash, 1.8)
    names = [f"{label}: {format_amount(value, panel.unit)} on average" for value in mean]
    panel.points(middle, mean, color, label, marker, 6, names=names)


def by_run(gaps: Sequence[RunGap]) -> Drawing:
    """Plot the largest mismatches by run over all channels, in units of the noise."""
    shown = gaps[:_RUNS]
    labels = [f"{gap.run}{' (held out)' if gap.heldout and not gap.partly else ''}" for gap in shown]
    after = [gap.total_after for gap in shown if gap.total_after is not None]
    before = [gap.total_before for gap in shown]
    panel = dumbbells(labels, before, after if len(after) == len(shown) else None)
    return panel.finish()


def shrinkage(finding: Finding) -> Drawing:
    """Plot the held-out mismatch before and after, by channel and by regime, in units of the noise."""
    noise = dict(zip(finding.channels, noise_row(finding).tolist(), strict=True))
    rows = [
        (words, gap.before / noise[name], None if gap.after is None else gap.after / noise[name])
        for name, (_, words) in finding.channels.items()
        if (gap := finding.heldout.get(name)) is not None
    ]
    n = len(rows)
    rows += [
        (
            f"place {k}: {finding.channels[p.channel][1]}",
            p.before / noise[p.channel],
            p.after / noise[p.channel],
        )
        for k, p in enumerate(finding.where[:_PLACES], start=1)
        if p.after is not None and p.channel in noise
    ]
    after = [row[2] for row in rows if row[2] is not None]
    same = len(after) == len(rows)
    panel = dumbbells([row[0] for row in rows], [row[1] for row in rows], after if same else None)
    if len(rows) > n:
        panel.rule(n - 0.5)
    return panel.finish()


def largest_mismatch_channels(finding: Finding, windows: Sequence[Overlay], most: int = 2) -> list[int]:
    """Return the sorted indices of the channels with the largest mismatch before, in units of the noise."""
    size = channel_rms(np.concatenate([w.measured - w.before for w in windows])) / noise_row(finding)
    return sorted(np.argsort(-np.nan_to_num(size), kind="stable")[:most].tolist())


def overlay(finding: Finding, windows: Sequence[Overlay]) -> Drawing:
    """Plot one run: channels of largest mismatch, measured and simulated, with the mismatch below."""
    channels = largest_mismatch_channels(finding, windows)
    drawing = new_drawing(60 + _CHANNEL * len(channels), rows=2 * len(channels))
    time = np.concatenate([w.time for w in windows])
    for c, top, below in zip(channels, drawing.panels[::2], drawing.panels[1::2], strict=True):
        unit, words = list(finding.channels.values())[c]
        measured = np.concatenate([w.measured[:, c] for w in windows])
        pale = palette.lighter(palette.INK, 0.45)
        top.line(*with_gaps(time, measured), pale, "measured", width=3.6)
        for name, label, color, dash in _models(finding):
            simulated = np.concatenate([getattr(w, name)[:, c] for w in windows])
            top.line(*with_gaps(time, simulated), color, label, dash, 1.6)
            below.line(*with_gaps(time, measured - simulated), color, label)
        below.rule(0.0)
        top.values(wrapped_label(words, unit))
        below.values(f"mismatch\n[{unit}]")
    for panel in drawing.panels:
        panel.plot.min_border_left = _WIDE_LEFT
    drawing.panels[0].legend()
    return finish(drawing, time, ())


def has_spectra(finding: Finding) -> bool:
    """Check that at least one run is long enough for a spectrum."""
    return any(len(o.time) >= _SHORTEST for o in finding.overlays)


def spectra(finding: Finding, channels: Sequence[int]) -> Drawing:
    """Plot the amplitude density of the held-out mismatch before and after, and of the noise, per channel."""
    long = [o for o in finding.overlays if len(o.time) >= _SHORTEST]
    runs = [o for o in long if o.heldout] or long
    period = float(np.median(np.concatenate([np.diff(o.time) for o in runs])))
    panels: list[Panel] = []
    for c in channels:
        unit, words = list(finding.channels.values())[c]
        is_last, label = c == channels[-1], wrapped_label(words, f"{unit}/√Hz")
        panel = Panel(_SPECTRUM + BELOW * is_last, over_time=False, label=label, x_log=True, y_log=True)
        drawn, frequency = [], np.empty(0)
        for name, label, color, dash in _models(finding):
            parts = [(o.measured - getattr(o, name))[:, c] for o in runs]
            frequency, density = _density(parts, period)
            drawn.append(panel.line(frequency, density, color, label, dash, 1.6))
        # white noise of block means has its variance spread over 0 … half the block rate
        noise = float(noise_row(finding)[c]) * np.sqrt(2.0 * period)
        level = np.full(len(frequency), noise)
        drawn.append(panel.line(frequency, level, palette.MUTED, "noise", _NOISE_LINE))
        # at least one decade, so that noise does not look like more than it is
        panel.contains(np.array([frequency[0], 0.3 * noise]), np.array([frequency[-1], 3.0 * noise]))
        panel.ticks(_DECADES, [f"{place:g}" for place in _DECADES])
        columns = (f"@{one.glyph.y.field} {panel.unit}" for one in drawn)
        tips = list(zip(panel.labels, columns, strict=True))
        panel.hover(drawn[:1], [("frequency", "@x Hz"), *tips], "vline")
        panel.plot.min_border_left = _WIDE_LEFT
        if is_last:
            panel.x_label = "frequency [Hz]"
        else:
            panel.continue_below()
        panels.append(panel)
    panels[0].legend()
    for panel in panels:
        panel.plot.x_range = panels[0].plot.x_range
        panel.finish()
    return Drawing(tuple(panels))


def _density(parts: Sequence[Array], period: float) -> tuple[Array, Array]:
    """Average the power density of mismatches, shapes (k,), at blocks `period` [s] apart, by Welch's method.

    Masked samples count as zero mismatch.

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
