"""Figures of single runs: both simulations over the measurement, and the spectra of what is left."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import NullFormatter
from scipy.signal import welch

from omnimj.gap.per_run import has_after, noise_row, rms
from omnimj.gap.records import Finding, Overlay
from omnimj.signals import Array
from omnimj.view import palette
from omnimj.view.drawing import line, new_figure, time_axis, value_axis
from omnimj.view.gap_drawing import (
    AFTER,
    BEFORE,
    BEFORE_LINE,
    MEASURED,
    first_name,
    legend_above,
    narrow,
    with_gaps,
    zero,
)

_SEGMENT, _SHORTEST = 64, 8  # blocks of one periodogram at most, of a run that has one
_AS_IT_IS: Any = False  # a constant mismatch is a mismatch


def telling_channels(finding: Finding, windows: Sequence[Overlay], most: int = 2) -> list[int]:
    """The channels with the largest mismatch before, in units of noise, in the order of the channels."""
    size = rms(np.concatenate([w.measured - w.before for w in windows])) / noise_row(finding)
    return sorted(np.argsort(-np.nan_to_num(size), kind="stable")[:most].tolist())


def overlay(finding: Finding, windows: Sequence[Overlay]) -> Figure:
    """One run: the channels that tell most, measured and simulated, each above its mismatch."""
    channels, second = telling_channels(finding, windows), has_after(finding)
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
        _line(top, time, before, color=BEFORE, linestyle=BEFORE_LINE, linewidth=1.6, label=first_name(second))
        _line(below, time, measured - before, color=BEFORE, linewidth=1.3)
        if second:
            _line(top, time, after, color=AFTER, linewidth=1.3, label="after")
            _line(below, time, measured - after, color=AFTER, linewidth=1.2)
        zero(below)
        value_axis(top, narrow(words, unit))
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
    """Whether any run is long enough for a spectrum."""
    return any(len(o.time) >= _SHORTEST for o in finding.overlays)


def spectra(finding: Finding, channels: Sequence[int]) -> Figure:
    """Amplitude density of the held-out mismatch before and after, and that of the noise, per channel."""
    long = [o for o in finding.overlays if len(o.time) >= _SHORTEST]
    runs = [o for o in long if o.heldout] or long
    figure, axes = new_figure(0.9 + 1.35 * len(channels), rows=len(channels), sharex=True)
    period = float(np.median(np.concatenate([np.diff(o.time) for o in runs])))
    for ax, c in zip(axes, channels, strict=True):
        unit, words = list(finding.channels.values())[c]
        pairs: list[tuple[str, str, Any, str]] = [
            ("before", BEFORE, BEFORE_LINE, first_name(has_after(finding)))
        ]
        if has_after(finding):
            pairs.append(("after", AFTER, "-", "after"))
        for name, color, dashes, label in pairs:
            frequency, density = _density([(o.measured - getattr(o, name))[:, c] for o in runs], period)
            ax.loglog(frequency, density, color=color, linestyle=dashes, linewidth=1.6, label=label)
        noise = float(noise_row(finding)[c])
        # white noise of a block mean has its whole variance below half the rate of the blocks
        style = {"color": palette.MUTED, "linewidth": 1.1, "linestyle": (0, (2, 2)), "label": "noise"}
        ax.axhline(noise * np.sqrt(2.0 * period), **style)
        _a_decade(ax)
        value_axis(ax, narrow(words, f"{unit}/√Hz"))
        ax.yaxis.label.set_fontsize(8)
    axes[-1].xaxis.set_major_formatter(lambda value, _: f"{value:g}")
    axes[-1].set_xlabel("frequency [Hz]", fontsize=9)
    legend_above(figure)
    return figure


def _a_decade(ax: Axes) -> None:
    """Shows a decade at least, with names at powers of ten only."""
    low, high = ax.get_ylim()
    room = max(0.5 * np.log10(12.0 * low / high), 0.0)
    ax.set_ylim(low / 10.0**room, high * 10.0**room)
    ax.yaxis.set_minor_formatter(NullFormatter())


def _density(parts: Sequence[Array], period: float) -> tuple[Array, Array]:
    """Root of the mean power density over runs, by Welch's method; what is masked counts as no mismatch.

    Args:
      parts: Mismatch of each run.
      period: Between blocks [s].

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
        scale = length / min(len(part), length)  # zeros that were added carry no power
        _, power = welch(whole, 1.0 / period, nperseg=length, detrend=_AS_IT_IS)
        powers.append(scale * power)
        weights.append(len(part))
    mean = np.average(np.array(powers), axis=0, weights=weights)
    density = np.sqrt(np.where(mean > 0.0, mean, np.nan))
    return np.asarray(frequency[1:], float), np.asarray(density[1:], float)
