"""Shared parts of all plots: figures, axes, fault shading, thinning, SVG for a page."""

from __future__ import annotations

import html
import io
import itertools
import re
from collections.abc import Sequence
from typing import Any

import matplotlib
import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_svg import FigureCanvasSVG
from matplotlib.figure import Figure
from numpy.typing import NDArray

from omnimj.view import palette
from omnimj.view.wording import Span

Array = NDArray[np.float64]
WIDTH = 4.8  # [inches] half a desktop page, and still readable when scaled to a phone
SHORT, MIDDLE, TALL = 2.9, 3.3, 4.6  # [inches] figures side by side have equal heights
_BINS = 420
_AVERAGES, _WINDOW = 210, 0.05  # most points of a mean line; window [s], longer than the passage of a roller
_SVG_STYLE: Any = {"svg.fonttype": "none", "svg.hashsalt": "omnimj", "path.simplify": True}
_FONTS = "DejaVu Sans, Verdana, Segoe UI, Helvetica, Arial, sans-serif"


def new_figure(
    height: float, rows: int = 1, sharex: bool = False, sharey: bool = False
) -> tuple[Figure, list[Axes]]:
    """Make an empty figure of the width of the page; return it with its axes, row by row."""
    figure = Figure(figsize=(WIDTH, height), layout="constrained")
    FigureCanvasSVG(figure)
    axes = figure.subplots(rows, 1, squeeze=False, sharex=sharex, sharey=sharey)
    flat = list(axes.ravel())
    for ax in flat:
        _dress(ax)
    return figure, flat


def _dress(ax: Axes) -> None:
    ax.grid(True, color=palette.GRID, linewidth=0.7)
    ax.set_axisbelow(True)
    for side in ("top", "right"):
        ax.spines[side].set_visible(False)
    for side in ("left", "bottom"):
        ax.spines[side].set_color(palette.MUTED)
    ax.tick_params(colors=palette.INK, labelsize=9)


def envelope(time: Array, value: Array, bins: int = _BINS) -> tuple[Array, Array]:
    """Thin a signal to the smallest and largest sample of each bin, which keeps every peak.

    Args:
      time: Times, shape (k,) [s].
      value: Signal, shape (k,).
      bins: Number of bins.

    Returns:
      Times and values, each shape (m,); the signal itself if it is short.
    """
    if len(time) <= 2 * bins:
        return time, value
    edges = np.linspace(0, len(time), bins + 1).astype(int)
    picked = [0, len(time) - 1]
    for first, last in itertools.pairwise(edges):
        part = value[first:last]
        if np.isnan(part).all():
            picked.append(first)
            continue
        picked += [first + int(np.nanargmin(part)), first + int(np.nanargmax(part))]
    keep = np.unique(picked)
    return time[keep], value[keep]


def line(ax: Axes, time: Array, value: Array, **style: object) -> None:
    """Plot a signal, shape (k,), over time, shape (k,) [s], thinned to the visible number of points."""
    ax.plot(*envelope(time, value), **{"linewidth": 1.3, **style})  # pyright: ignore[reportArgumentType]


def averaged(time: Array, value: Array) -> tuple[Array, Array, Array, Array]:
    """Average a rippling signal over `window(time)`, with the smallest and largest sample of each window.

    Returns:
      Time, mean, smallest and largest value, each shape (bins,); the samples themselves if they are few.
    """
    bins = int((time[-1] - time[0]) / window(time)) if len(time) > 1 else 1
    if len(time) < 4 * bins:
        return time, value, value, value
    edges = np.linspace(0, len(time), bins + 1).astype(int)[:-1]
    length = np.diff(np.append(edges, len(time)))
    mean, middle = np.add.reduceat(value, edges) / length, np.add.reduceat(time, edges) / length
    return middle, mean, np.minimum.reduceat(value, edges), np.maximum.reduceat(value, edges)


def window(time: Array) -> float:
    """Return the averaging window of `averaged` [s] for times of shape (k,) [s]."""
    return max(_WINDOW, float(time[-1] - time[0]) / _AVERAGES)


def banded(ax: Axes, time: Array, value: Array, color: str, **style: object) -> None:
    """Plot a rippling signal as a line of means in a band from smallest to largest sample.

    Args:
      ax: Axes.
      time: Times, shape (k,) [s].
      value: Signal, shape (k,).
      color: Colour of line and band.
      **style: Style of the line.
    """
    middle, mean, low, high = averaged(time, value)
    ax.fill_between(middle, low, high, color=color, alpha=0.2, linewidth=0, zorder=1.5)
    ax.plot(middle, mean, **{"color": color, "linewidth": 1.4, **style})  # pyright: ignore[reportArgumentType]


def time_axis(ax: Axes, time: Array) -> None:
    """Label the time axis and fit it to the times of the run, shape (k,) [s]."""
    ax.set_xlabel("time [s]", fontsize=9)
    if len(time) > 1:
        ax.set_xlim(time[0], time[-1])


def value_axis(ax: Axes, label: str) -> None:
    """Label the value axis."""
    ax.set_ylabel(label, fontsize=9)


def headroom(ax: Axes, share: float = 0.16) -> None:
    """Leave room above the signals for labels and legend."""
    low, high = ax.get_ylim()
    ax.set_ylim(low, high + share * (high - low))


def shade_faults(ax: Axes, spans: Sequence[Span], labelled: bool = True) -> None:
    """Shade intervals of active faults, labelled at the top; faults of one interval share a band."""
    for row, ((start, end), labels) in enumerate(_together(spans).items()):
        ax.axvspan(start, end, facecolor=palette.FAULT, alpha=0.16, linewidth=0, zorder=0, gid=f"fault-{row}")
        for edge in (start, end):
            ax.axvline(edge, color=palette.FAULT, linewidth=0.9, linestyle=(0, (2, 2)), zorder=1)
        if labelled:
            _name_band(ax, start, end, "; ".join(labels), row % 4)


def _together(spans: Sequence[Span]) -> dict[tuple[float, float], list[str]]:
    """Group labels by interval; `slip, wheel 1` and `slip, wheel 3` become `slip, wheels 1, 3`."""
    found: dict[tuple[float, float], dict[str, list[str]]] = {}
    for span in spans:
        name, _, wheel = span.label.partition(", wheel ")
        found.setdefault((span.start, span.end), {}).setdefault(name, []).append(wheel)
    return {
        interval: [_named(name, [w for w in wheels if w]) for name, wheels in kinds.items()]
        for interval, kinds in found.items()
    }


def _named(name: str, wheels: list[str]) -> str:
    if not wheels:
        return name
    return f"{name}, wheel{'s' if len(wheels) > 1 else ''} {', '.join(wheels)}"


def _name_band(ax: Axes, start: float, end: float, label: str, row: int) -> None:
    """Write the label of a band below the upper edge, inside the plot even for a band at its side."""
    left, right = ax.get_xlim()
    middle = 0.5 * (start + end)
    if middle > left + 0.75 * (right - left):
        place, side, aside = end, "right", -4.0
    elif middle < left + 0.25 * (right - left):
        place, side, aside = start, "left", 4.0
    else:
        place, side, aside = middle, "center", 0.0
    ax.annotate(
        label,
        (place, 1.0),
        xycoords=ax.get_xaxis_transform(),
        xytext=(aside, -2.5 - 11.0 * row),
        textcoords="offset points",
        fontsize=8,
        color=palette.FAULT_INK,
        ha=side,
        va="top",
        bbox={"facecolor": "white", "alpha": 0.65, "linewidth": 0, "pad": 1.0},
        zorder=6,
    )


def legend(ax: Axes, columns: int = 4) -> None:
    """Add a legend above the plot, where it covers no data."""
    ax.legend(
        loc="lower left",
        bbox_to_anchor=(0.0, 1.0),
        ncols=columns,
        fontsize=8.5,
        frameon=False,
        handlelength=2.2 if columns <= 4 else 1.5,
        columnspacing=1.1 if columns <= 4 else 0.7,
        borderaxespad=0.2,
    )


def finish(axes: Sequence[Axes], time: Array, spans: Sequence[Span]) -> None:
    """Add the time axis below the last plot; shade faults in all plots, labelled in the first.

    Args:
      axes: Axes from top to bottom.
      time: Times, shape (k,) [s].
      spans: Faults to shade.
    """
    for i, ax in enumerate(axes):
        time_axis(ax, time)
        if spans:
            if i == 0:
                headroom(ax, 0.08 + 0.05 * min(len(spans), 4))
            shade_faults(ax, spans, labelled=i == 0)
        if i < len(axes) - 1:
            ax.set_xlabel("")


def svg(figure: Figure, name: str, words: str) -> str:
    """Convert a figure to an SVG element for a page: no declarations, no links, unique ids.

    Args:
      figure: Figure to convert.
      name: Prefix of the ids within the page.
      words: Description for screen readers.
    """
    target, label = io.StringIO(), html.escape(words).replace("\\", r"\\")
    with matplotlib.rc_context(_SVG_STYLE):
        figure.savefig(
            target, format="svg", metadata={"Date": None, "Creator": None, "Format": None, "Type": None}
        )
    text = target.getvalue()
    text = text[text.index("<svg") :]
    text = re.sub(r"<metadata>.*?</metadata>", "", text, flags=re.DOTALL)
    text = re.sub(r"<!--.*?-->", "", text, flags=re.DOTALL)
    text = re.sub(r'\sxmlns(:\w+)?="[^"]*"', "", text)
    text = text.replace("xlink:href", "href")
    text = _own_ids(text, name)
    text = re.sub(r'="[^"]*"', lambda m: re.sub(r"(\d+\.\d{2})\d+", r"\1", m[0]), text)  # only in attributes
    text = re.sub(r"font:\s*([\d.]+px)\s*[^;\"]*", rf"font: \1 {_FONTS}", text)
    text = re.sub(
        r'^<svg [^>]*?viewBox="([^"]*)"[^>]*>', rf'<svg viewBox="\1" role="img" aria-label="{label}">', text
    )
    return re.sub(r">\s+<", "><", text).strip()


def _own_ids(text: str, name: str) -> str:
    """Keep only referenced ids, prefixed with the figure's name."""
    wanted = set(re.findall(r'(?:href="#|url\(#)([^")]+)', text))
    text = re.sub(r'\sid="([^"]*)"', lambda m: f' id="{name}-{m[1]}"' if m[1] in wanted else "", text)
    return text.replace('href="#', f'href="#{name}-').replace("url(#", f"url(#{name}-")
