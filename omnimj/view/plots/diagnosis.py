"""Plots of residuals, thresholds, diagnoses, modes and floors under the wheels; each returns one figure."""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator, Sequence

import numpy as np
from numpy.typing import NDArray

from omnimj.signals import Array, Trace, equal_stretches
from omnimj.view import palette
from omnimj.view.plots.over_time import finish
from omnimj.view.plots.panels import MIDDLE, Drawing, Panel, new_drawing
from omnimj.view.plots.thinning import BINS, log_beyond
from omnimj.view.residuals import Family
from omnimj.view.wording import Span, mode_name, recovery_spans

_LOG_SCALE_BEYOND = (
    15.0  # × threshold: on a linear axis, larger residuals would make the threshold indistinguishable from 0
)
_ROW = 215  # height of one of several families of residuals [pixels]
_LANE, _BAR, _AROUND = 26, 0.72, 80  # least height of a lane, height of a bar in lanes, all other heights
_SEEN = 400  # most changes of mode that can be distinguished
_WIDE = 0.018  # share of the duration needed per letter of a label inside its bar
_FLOOR_ROW = 130  # height of a wheel's panel [pixels]
_MARGIN = 0.06  # of the probability axis


def residual_families(
    trace: Trace, families: Sequence[Family], spans: Sequence[Span], bins: int = BINS
) -> Drawing:
    """Plot families of residuals with their thresholds, one below the other, wheels in their colours.

    For residuals far beyond their thresholds, the axis is logarithmic above the thresholds, so that both are
    readable.
    """
    rows = len(families)
    drawing = new_drawing(max(MIDDLE, _ROW * rows), rows, bins=bins)
    for panel, family in zip(drawing.panels, families, strict=True):
        _draw_family(panel, trace, family)
        if family.thresholds or len(family.residuals) > 1:
            panel.legend()
    return finish(drawing, trace["time"], spans)


def _draw_family(panel: Panel, trace: Trace, family: Family) -> None:
    time, linear = trace["time"], _linear_up_to(trace, family)
    panel.values(family.label)
    if family.is_signed or not family.thresholds:
        panel.rule(0.0)
    for residual in family.residuals:
        dash = "-" if residual.wheel is None else palette.wheel_line(residual.wheel)
        label = family.quantity if len(family.residuals) == 1 else residual.label
        value = trace[residual.column]
        panel.line(time, _scaled(value, linear), residual.color, label, dash, 1.2, hovered=value)
    for threshold, color in _thresholds(trace, family):
        for sign in (1.0, -1.0) if family.is_signed else (1.0,):
            limit = _scaled(sign * threshold, linear)
            style = {"dash": (0, (2, 1.6)), "width": 1.1, "hovered": sign * threshold}
            panel.line(time, limit, color, "threshold", **style)
    _fit_axis(panel, trace, family, linear)


def _thresholds(trace: Trace, family: Family) -> Iterator[tuple[Array, str]]:
    """Yield the thresholds with their colours; equal ones once."""
    drawn: list[Array] = []
    for residual in family.residuals:
        if residual.threshold is None:
            continue
        threshold = trace[residual.threshold]
        if not any(np.array_equal(threshold, other) for other in drawn):
            drawn.append(threshold)
            alike = all(np.array_equal(threshold, trace[name]) for name in family.thresholds)
            yield threshold, palette.INK if alike else residual.color


def _largest(trace: Trace, family: Family) -> float:
    return max(float(np.nanmax(np.abs(trace[r.column]), initial=0.0)) for r in family.residuals)


def _linear_up_to(trace: Trace, family: Family) -> float:
    """Value beyond which the axis is logarithmic; 0 for a linear axis."""
    level = min((float(np.nanmin(np.abs(trace[name]))) for name in family.thresholds), default=0.0)
    return level if level > 0.0 and _largest(trace, family) > _LOG_SCALE_BEYOND * level else 0.0


def _scaled(value: Array, linear: float) -> Array:
    return log_beyond(value, linear) if linear else value


def _fit_axis(panel: Panel, trace: Trace, family: Family, linear: float) -> None:
    """Scale the axis so that thresholds and residuals are both readable, zero included."""
    largest = _largest(trace, family)
    if linear:
        high = 1.6 * largest
        low = -high if family.is_signed else 0.0
        panel.limits(*log_beyond(np.array([low, high]), linear))
        decades = [10.0**k for k in range(math.ceil(math.log10(linear)), math.floor(math.log10(high)) + 1)]
        panel.logarithmic(linear, [0.0, *decades, *(-at for at in decades if family.is_signed)])
    elif not family.is_signed and family.thresholds:
        levels = [float(np.nanmin(np.abs(trace[name]))) for name in family.thresholds]
        panel.limits(0.0, 1.08 * max(largest, *levels))


def effectiveness(trace: Trace, spans: Sequence[Span], bins: int = BINS) -> Drawing:
    """Plot the estimated effectiveness of each wheel's drive, 1 when healthy."""
    drawing = new_drawing(MIDDLE, bins=bins)
    (panel,) = drawing.panels
    panel.values("effectiveness [1]")
    columns = [column for column in trace.columns if column.startswith("effectiveness_")]
    for i, column in enumerate(columns):
        style = palette.wheel_color(i), f"wheel {i + 1}", palette.wheel_line(i)
        panel.line(trace["time"], trace[column], *style)
    panel.limits(min(0.0, *(float(np.nanmin(trace[column])) for column in columns)), 1.08)
    panel.legend()
    return finish(drawing, trace["time"], spans)


def state_lanes(
    trace: Trace,
    truth: Sequence[Span],
    diagnosed: Sequence[Span],
    method: str,
    is_rig: bool,
    least: int = MIDDLE,
) -> Drawing:
    """Plot strips over time: true faults, below them diagnoses per wheel, and the mode at the bottom.

    The names of the modes depend on `method`; the drawing is at least `least` pixels high.
    """
    true, found = _lanes(truth), _lanes(diagnosed)
    rows = [("true", lane) for lane in true or [()]] + [("diagnosed", lane) for lane in found or [()]]
    rows += [("active", lane) for lane in _lanes(recovery_spans(trace))]
    names = [f"{what}: {spans[0].lane.replace('_', ' ') if spans else 'nothing'}" for what, spans in rows]
    if "mode" in trace:
        names.append("mode")
    drawing = new_drawing(max(least, _AROUND + _LANE * len(names)))
    (panel,) = drawing.panels
    time = trace["time"]
    for row, (_, spans) in enumerate(rows):
        _strip(panel, row, spans, time)
    if "mode" in trace:
        _modes(panel, len(rows), trace, method, is_rig)
        panel.rule(len(rows) - 0.5)
        panel.legend(3)
    panel.rows(names)
    panel.rule(max(len(true), 1) - 0.5)
    return finish(drawing, time, truth, labelled=False)


def event_lanes(duration: float, truth: Sequence[Span], diagnosed: Sequence[Span]) -> Drawing:
    """Plot true faults and diagnoses per wheel for a run of `duration` [s] whose signals are not kept."""
    trace = Trace({"time": np.array([0.0, duration])}, {})
    return state_lanes(trace, truth, diagnosed, "", False, least=0)


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


def _strip(panel: Panel, row: int, spans: Sequence[Span], time: Array) -> None:
    """Draw the bars of one lane, with a label in each bar that is long enough."""
    if not spans:
        return
    duration, free = float(time[-1] - time[0]), -np.inf  # a label beside a short bar needs the space after it
    # keeps a diagnosis of a single step visible
    ends = [max(span.end, span.start + 0.004 * duration) for span in spans]
    texts = [f"{span.state}, {span.start:.3f} to {span.end:.3f} s" for span in spans]
    colors = [palette.state_color(span.state) for span in spans]
    panel.bars([s.start for s in spans], ends, [row] * len(spans), _BAR, colors, names=texts)
    for k, span in enumerate(spans):
        room = len(span.state) * _WIDE * duration
        ahead = spans[k + 1].start if k + 1 < len(spans) else np.inf
        if span.end - span.start > room:
            middle, ink = 0.5 * (span.start + span.end), palette.ink_on(colors[k])
            panel.text(middle, row, span.state, ink, text_align="center")
        elif span.end + room < min(ahead, float(time[-1])) and span.start >= free:
            panel.text(span.end + 0.008 * duration, row, span.state)
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


def _modes(panel: Panel, row: int, trace: Trace, method: str, is_rig: bool) -> None:
    """Draw the column `mode` as a strip of colours, named in the legend."""
    time, mode = _few_changes(trace["time"], trace["mode"].astype(int))
    starts = equal_stretches(mode)
    ends = np.append(time[starts[1:]], time[-1])
    for value in dict.fromkeys(mode[starts].tolist()):
        name, own = mode_name(method, is_rig, int(value)), mode[starts] == value
        lengths = zip(time[starts][own], ends[own], strict=True)
        texts = [f"{name}, {start:.3f} to {end:.3f} s" for start, end in lengths]
        color, middle = palette.state_color(name), [row] * int(own.sum())
        panel.bars(time[starts][own], ends[own], middle, _BAR, color, name, texts)


def floor_probabilities(time: Array, probability: Array, truth: Array | None, floor: str) -> Drawing:
    """Probability of one floor under each of n wheels, one panel below the other, with the camera's truth.

    Both have a row per window, shape (w, n), whose centres are the times, shape (w,) [s]. The truth is 1
    where the camera sees the contact on this floor and NaN where unknown; None without camera.
    """
    n = probability.shape[1]
    drawing = new_drawing(_FLOOR_ROW * n, n)
    for i, panel in enumerate(drawing.panels):
        panel.values(f"wheel {i + 1}")
        panel.limits(-_MARGIN, 1.0 + _MARGIN)
        if truth is not None:
            panel.line(time, truth[:, i], palette.MUTED, "camera", width=5.0, alpha=0.45)
        panel.line(time, probability[:, i], palette.wheel_color(i), f"on {floor}")
        if i == 0:
            panel.legend()
    return finish(drawing, np.asarray(time), ())
