"""Plots of residuals, thresholds, diagnoses and modes; each function returns one figure."""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Patch
from numpy.typing import NDArray

from omnimj.signals import Trace, equal_stretches
from omnimj.view import palette
from omnimj.view.plots.drawing import (
    MIDDLE,
    envelope,
    finish,
    legend,
    line,
    new_figure,
    shade_faults,
    time_axis,
    value_axis,
)
from omnimj.view.residuals import Family
from omnimj.view.wording import Span, mode_name, recovery_spans

Array = NDArray[np.float64]
_LOG_SCALE_BEYOND = (
    15.0  # × threshold: on a linear axis, larger residuals would make the threshold indistinguishable from 0
)
_ROW = 2.4  # [inches] height of one of several families of residuals
_LANE, _BAR, _AROUND = 0.27, 0.22, 0.95  # [inches] least lane, largest bar, all other heights
_SEEN = 400  # most changes of mode that can be distinguished
_WIDE = 0.018  # share of the duration needed per letter of a label inside its bar


def residual_families(trace: Trace, families: Sequence[Family], spans: Sequence[Span]) -> Figure:
    """Plot families of residuals with their thresholds, one below the other, wheels in their colours.

    For residuals far beyond their thresholds, the axis is logarithmic above the thresholds, so that both are
    readable.

    Args:
      trace: Signals of a run, with the residuals.
      families: At least one family of residuals.
      spans: Faults or diagnoses to shade.
    """
    rows = len(families)
    figure, axes = new_figure(max(MIDDLE, _ROW * rows), rows=rows, sharex=True)
    for ax, family in zip(axes, families, strict=True):
        _draw_family(ax, trace, family)
    finish(axes, trace["time"], spans)
    for ax, family in zip(axes, families, strict=True):
        if family.thresholds or len(family.residuals) > 1:
            _narrow_legend(ax)
    return figure


def _draw_family(ax: Axes, trace: Trace, family: Family) -> None:
    time = trace["time"]
    if family.is_signed or not family.thresholds:
        ax.axhline(0.0, color=palette.MUTED, linewidth=0.8, zorder=1)
    for residual in family.residuals:
        style = {"linewidth": 1.2, "color": residual.color, "label": residual.label}
        if residual.wheel is not None:
            style["linestyle"] = palette.wheel_line(residual.wheel)
        line(ax, time, trace[residual.column], **style)
    if len(family.residuals) == 1:
        ax.get_lines()[-1].set_label(family.quantity)
    _thresholds(ax, trace, family)
    value_axis(ax, family.label)
    _axis(ax, trace, family)


def _narrow_legend(ax: Axes) -> None:
    """Add a legend with room for four wheels and their threshold in one row above the plot."""
    style = {"fontsize": 8, "handlelength": 1.6, "handletextpad": 0.45, "columnspacing": 0.85}
    place = {"loc": "lower left", "bbox_to_anchor": (-0.02, 1.0), "borderaxespad": 0.2}
    ax.legend(ncols=5, frameon=False, **style, **place)


def _thresholds(ax: Axes, trace: Trace, family: Family) -> None:
    """Draw the thresholds; equal ones share a line and a legend entry."""
    time, drawn, named = trace["time"], [], False
    for residual in family.residuals:
        if residual.threshold is None:
            continue
        threshold = trace[residual.threshold]
        if any(np.array_equal(threshold, other) for other in drawn):
            continue
        drawn.append(threshold)
        alike = all(np.array_equal(threshold, trace[name]) for name in family.thresholds)
        color = palette.INK if alike else residual.color
        for sign in (1.0, -1.0) if family.is_signed else (1.0,):
            style = {"linewidth": 1.1, "linestyle": (0, (2, 1.6)), "color": color, "gid": "threshold"}
            ax.plot(*envelope(time, sign * threshold), label=None if named else "threshold", **style)  # pyright: ignore[reportArgumentType]
            named = True


def _axis(ax: Axes, trace: Trace, family: Family) -> None:
    """Scale the axis so that thresholds and residuals are both readable, zero included."""
    levels = [float(np.nanmin(np.abs(trace[name]))) for name in family.thresholds]
    level = min(levels, default=0.0)
    largest = max(float(np.nanmax(np.abs(trace[r.column]), initial=0.0)) for r in family.residuals)
    if level > 0.0 and largest > _LOG_SCALE_BEYOND * level:
        ax.set_yscale("symlog", linthresh=level, linscale=0.6)
        low = 0.0 if not family.is_signed else -1.6 * largest
        ax.set_ylim(low, 1.6 * largest)
        decades = range(math.ceil(math.log10(level)), math.floor(math.log10(1.6 * largest)) + 1)
        ticks = [10.0**k for k in decades]
        ax.set_yticks([0.0, *ticks, *(-tick for tick in ticks if family.is_signed)])
        ax.set_ylabel(f"{ax.get_ylabel()}\nlogarithmic above the threshold", fontsize=9)
    elif not family.is_signed and family.thresholds:
        ax.set_ylim(0.0, 1.08 * max(largest, *levels))


def effectiveness(trace: Trace, spans: Sequence[Span]) -> Figure:
    """Plot the estimated effectiveness of each wheel's drive, 1 when healthy."""
    figure, (ax,) = new_figure(MIDDLE)
    wheels = sum(column.startswith("effectiveness_") for column in trace.columns)
    for i in range(wheels):
        style = {"color": palette.wheel_color(i), "linestyle": palette.wheel_line(i)}
        line(ax, trace["time"], trace[f"effectiveness_{i + 1}"], label=f"wheel {i + 1}", **style)
    value_axis(ax, "effectiveness [1]")
    low = min(float(np.nanmin(trace[f"effectiveness_{i + 1}"])) for i in range(wheels))
    ax.set_ylim(min(0.0, low), 1.08)
    finish([ax], trace["time"], spans)
    legend(ax)
    return figure


def state_lanes(
    trace: Trace, truth: Sequence[Span], diagnosed: Sequence[Span], method: str, is_rig: bool
) -> Figure:
    """Plot strips over time: true faults, below them diagnoses per wheel, and the mode at the bottom."""
    true, found = _lanes(truth), _lanes(diagnosed)
    rows = [("true", lane) for lane in true or [()]] + [("diagnosed", lane) for lane in found or [()]]
    rows += [("active", lane) for lane in _lanes(recovery_spans(trace))]
    count = len(rows) + int("mode" in trace)
    height = max(MIDDLE, _AROUND + _LANE * count)
    figure, (ax,) = new_figure(height)
    thick = _BAR / (height - _AROUND) * count
    time = trace["time"]
    time_axis(ax, time)
    ax.grid(False, axis="y")
    ax.set_ylim(count - 0.5, -0.5)
    for row, (_, spans) in enumerate(rows):
        _strip(ax, row, spans, float(time[-1] - time[0]), thick)
    names = [f"{what}: {spans[0].lane.replace('_', ' ') if spans else 'nothing'}" for what, spans in rows]
    if "mode" in trace:
        _modes(ax, len(rows), trace, method, is_rig, thick)
        names.append("mode")
    ax.set_yticks(range(count), names)
    ax.axhline(max(len(true), 1) - 0.5, color=palette.MUTED, linewidth=0.8)
    if "mode" in trace:
        ax.axhline(len(rows) - 0.5, color=palette.MUTED, linewidth=0.8)
    shade_faults(ax, truth, labelled=False)
    return figure


def _lanes(spans: Sequence[Span]) -> list[Sequence[Span]]:
    """Assign the spans to lanes by wheel or robot, overlapping states to separate lanes."""
    lanes: list[Sequence[Span]] = []
    for name in sorted({span.lane for span in spans}):
        own = sorted((span for span in spans if span.lane == name), key=lambda span: span.start)
        if all(before.end <= after.start for before, after in itertools.pairwise(own)):
            lanes.append(own)
        else:
            lanes += [[s for s in own if s.state == state] for state in dict.fromkeys(s.state for s in own)]
    return lanes


def _strip(ax: Axes, row: int, spans: Sequence[Span], duration: float, thick: float) -> None:
    """Draw the bars of one lane, with a label in each bar that is long enough."""
    free = -np.inf  # a label beside a short bar needs the space after it
    for k, span in enumerate(spans):
        color, width = palette.state_color(span.state), span.end - span.start
        # keeps a diagnosis of a single step visible
        ax.barh(row, max(width, 0.004 * duration), left=span.start, height=thick, color=color, linewidth=0)
        room, ahead = len(span.state) * _WIDE * duration, spans[k + 1].start if k + 1 < len(spans) else np.inf
        style = {"fontsize": 8, "va": "center", "color": palette.INK}
        inside = palette.ink_on(color)
        if width > room:
            middle = 0.5 * (span.start + span.end)
            ax.text(middle, row, span.state, ha="center", clip_on=True, **{**style, "color": inside})
        elif span.end + room < min(ahead, ax.get_xlim()[1]) and span.start >= free:
            ax.text(span.end + 0.008 * duration, row, span.state, ha="left", **style)
            free = span.end + room


def _few_changes(time: Array, mode: NDArray[np.int_]) -> tuple[Array, NDArray[np.int_]]:
    """Thin mode changes, shape (k,), to a visible number, keeping every short mode other than 0."""
    if np.count_nonzero(np.diff(mode)) <= _SEEN:
        return time, mode
    edges = np.linspace(0, len(time), _SEEN + 1).astype(int)
    kept = [
        int(np.bincount(part[part > 0]).argmax()) if (part > 0).any() else 0
        for part in np.split(mode, edges[1:-1])
    ]
    return np.append(time[edges[:-1]], time[-1]), np.append(kept, kept[-1])


def _modes(ax: Axes, row: int, trace: Trace, method: str, is_rig: bool, thick: float) -> None:
    """Draw the column `mode` as a strip of colours with a legend above."""
    time, mode = _few_changes(trace["time"], trace["mode"].astype(int))
    starts = equal_stretches(mode)
    ends = np.append(time[starts[1:]], time[-1])
    seen: dict[str, str] = {}
    for start, end in zip(starts.tolist(), ends.tolist(), strict=True):
        name = mode_name(method, is_rig, int(mode[start]))
        seen[name] = palette.state_color(name)
        ax.barh(row, end - time[start], left=time[start], height=thick, color=seen[name], linewidth=0)
    ax.legend(
        handles=[Patch(color=color, label=name) for name, color in seen.items()],
        loc="lower left",
        bbox_to_anchor=(0.0, 1.0),
        ncols=2 if max(map(len, seen)) > 14 else 4,
        fontsize=8.5,
        frameon=False,
        handlelength=1.2,
        columnspacing=1.1,
        borderaxespad=0.2,
    )
