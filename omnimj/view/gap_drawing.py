"""What the figures of the gap report share: how before, after and measured look, rows with names, fine "
"marks."""

from __future__ import annotations

import textwrap
from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from omnimj.signals import Array
from omnimj.view import palette
from omnimj.view.drawing import new_figure

BEFORE, AFTER, MEASURED = palette.ACCENT, palette.MEASURED, palette.INK
RIVAL, BEATEN = palette.FAULT, "#8A939D"
BEFORE_LINE, AFTER_LINE = (0, (5, 1.8)), "-"
_ROW, _FRAME = 0.27, 0.95  # inches of a row with a name, and of what lies around the rows


def row_figure(labels: Sequence[str], strong: Sequence[bool] = (), width: int = 27) -> tuple[Figure, Axes]:
    """A figure with one named row per label, the first at the top.

    Args:
      labels: Names of the rows.
      strong: Which of them are set in bold; none when empty.
      width: Letters of a line of a name at most.
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


def first_name(second: bool) -> str:
    """What the model as it was given is called: beside a second one, or alone."""
    return "before" if second else "simulated"


def dumbbells(ax: Axes, before: Sequence[float], after: Sequence[float] | None) -> None:
    """Per row a ring where it was and a dot where it is now, joined by a line."""
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
        label=first_name(after is not None),
    )
    if after is not None:
        ax.plot(after, rows, "o", color=AFTER, label="after", **style)


def noise_axis(ax: Axes, values: Sequence[float], words: str) -> None:
    """An axis in multiples of the noise, logarithmic where the values ask for it, with a mark at the "
    "noise."""
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
    mark(ax, 1.0, "noise")
    ax.xaxis.grid(True, color=palette.GRID, linewidth=0.7)
    ax.set_xlabel(words, fontsize=9)


def mark(ax: Axes, place: float, words: str) -> None:
    """A dotted vertical line that the legend names."""
    ax.axvline(place, color=palette.MUTED, linewidth=1.3, linestyle=(0, (2, 2)), zorder=1, label=words)


def zero(ax: Axes) -> None:
    """Marks zero on the value axis."""
    ax.axhline(0.0, color=palette.MUTED, linewidth=0.9, zorder=1)


def legend_above(figure: Figure, columns: int = 4) -> None:
    """A legend over the whole width of the figure, where it hides nothing."""
    handles, names = figure.get_axes()[0].get_legend_handles_labels()
    figure.legend(
        handles,
        names,
        loc="outside upper left",
        ncols=columns,
        fontsize=8.5,
        frameon=False,
        handlelength=1.8,
        columnspacing=1.3,
        borderaxespad=0.1,
        handletextpad=0.5,
    )


def narrow(words: str, unit: str) -> str:
    """A label for a low plot: short lines, the unit in the last."""
    return "\n".join([*textwrap.wrap(words, 13), f"[{unit}]"])


def with_gaps(time: Array, values: Array) -> tuple[Array, Array]:
    """The same with a NaN wherever time jumps, so that no line is drawn across."""
    steps = np.diff(time)
    if len(steps) == 0:
        return time, values
    jumps = np.flatnonzero((steps > 2.5 * np.median(steps)) | (steps <= 0.0)) + 1
    return np.insert(time, jumps, np.nan), np.insert(values, jumps, np.nan)
