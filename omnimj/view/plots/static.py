"""Static SVG pictures of drawings: for browsers without JavaScript, for paper and for the documentation.

They are read from the objects that the browser draws, so that both show the same. Hatches and tooltips are
left out. Anything else that is unknown here is an error, so that nothing is missing silently.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from markupsafe import escape

from omnimj.signals import Array
from omnimj.view import palette
from omnimj.view.plots.models import Model
from omnimj.view.plots.outlines import NO_FILL, fill, glyph_elements, outlines, sample, stroke
from omnimj.view.plots.panels import Drawing, Panel

WIDTH, FILE_WIDTH = 460, 545
"""Widths of a picture in a page and of a file [pixels]; the former is readable on a phone and on paper."""
FONTS = "DejaVu Sans, Verdana, Segoe UI, Helvetica, Arial, sans-serif"
_FAR = 1e4  # [pixels] beyond the frame, where lines end
_SIZE, _LETTER = 11, 0.6  # height of letters [pixels], their mean width / height
_LEFT, _RIGHT, _TICK, _ROW, _SAMPLE = 62, 14, 5, 16, 22  # [pixels]
_SINK = {"top": 0.9, "middle": 0.36, "bottom": -0.25, "alphabetic": 0.0}  # of a base line / height of letters
_ANCHOR = {"left": "start", "center": "middle", "right": "end"}
_SIDE = {"left": 0.0, "top": 0.0, "center": 0.5, "right": 1.0, "bottom": 1.0}  # share of the frame
_LEVELS = ("image", "underlay", "glyph", "guide", "annotation", "overlay")
_Limits = tuple[float, float]


@dataclass(frozen=True)
class _Scale:
    """Map from values of an axis to pixels in the frame."""

    limits: _Limits
    """Values at the left and right end, or at the bottom and top."""
    length: float
    log: bool
    upwards: bool = False

    def __call__(self, values: Any) -> Array:
        start, end, at = (_logged(v) if self.log else np.asarray(v, float) for v in (*self.limits, values))
        share = (at - start) / (end - start)
        return np.clip(self.length * (1.0 - share if self.upwards else share), -_FAR, _FAR)

    def pixel(self, place: Any) -> float:
        """Pixel of a value, or of a place that is fixed to the frame."""
        if isinstance(place, Model):
            return _SIDE[place.symbol] * self.length + place.offset
        return float(self(place))


class _Frame(NamedTuple):
    """Rectangle of the data of a panel in the picture [pixels], and the scales of its axes."""

    left: float
    top: float
    x: _Scale
    y: _Scale


def svg(drawing: Drawing, label: str = "", width: int = WIDTH) -> str:
    """Draw a picture of a drawing, to be a part of a page; its width is in pixels.

    Returns:
      SVG element without ids, so that several are in one page without conflict.

    Raises:
      TypeError: A glyph, an annotation or an axis is of a kind that is unknown here.
    """
    limits = _all_limits(drawing)
    left, top, parts = max(_room(panel, limits) for panel in drawing.panels), 0, []
    for panel in drawing.panels:
        parts += _panel(panel, limits, left, top, width)
        top += panel.height
    words = f' role="img" aria-label="{escape(label)}"' if label else ""
    look = f'font-family="{FONTS}" font-size="{_SIZE}" fill="{palette.INK}"'
    return f'<svg viewBox="0 0 {width} {top}"{words} {look}>{"".join(parts)}</svg>'


def svg_file(drawing: Drawing, label: str = "") -> str:
    """Draw a picture of a drawing, to be a file, on white; arguments as for `svg`."""
    head = f'<svg xmlns="http://www.w3.org/2000/svg" width="{FILE_WIDTH}" height="{drawing.height}"'
    start, _, rest = svg(drawing, label, FILE_WIDTH).removeprefix("<svg").partition(">")
    return f'{head}{start}><rect width="100%" height="100%" fill="white"/>{rest}\n'


def _panel(panel: Panel, limits: dict[str, _Limits], left: float, top: float, width: int) -> Iterator[str]:
    """Yield the elements of one panel, whose upper edge is at `top` and whose frame begins at `left`."""
    plot, entries = panel.plot, list(_entries(panel, width - left))
    above = 6 + _ROW * (1 + max((row for row, *_ in entries), default=-1))
    wide, high = width - left - _RIGHT, panel.height - above - _room_below(panel.x_axis)
    x, y = limits[plot.x_range.id], limits[plot.y_range.id]
    if panel.equal:
        x, y = _equal(x, y, wide / high)
    frame = _Frame(left, top + above, _Scale(x, wide, panel.x_log), _Scale(y, high, panel.y_log, True))
    models = [*plot.center, *plot.renderers]
    inside = [model for model in models if model.kind != "Label" and model.visible]
    drawn = "".join(_inside(m, frame) for m in sorted(inside, key=lambda m: _LEVELS.index(m.level)))
    # an inner picture cuts off what is outside the frame; its style prevails over that of the page
    size = f'width="{wide:g}" height="{high:g}" style="width:{wide:g}px;height:{high:g}px"'
    yield f'<svg x="{left:g}" y="{frame.top:g}" {size}>{drawn}</svg>'
    yield from _axes(panel, frame)
    yield from (_label(model, frame) for model in models if model.kind == "Label")
    for row, place, words, renderers in entries:
        x0, middle = left + place, top + 4 + _ROW * (row + 0.5)
        yield from (sample(renderer, x0, middle, _SAMPLE) for renderer in renderers)
        yield _text(x0 + _SAMPLE + 4, middle + 4, words)


def _all_limits(drawing: Drawing) -> dict[str, _Limits]:
    """Ends of all axes by the id of their range; a range that several panels share covers the data of all."""
    found: dict[str, _Limits] = {}
    for k, panel in itertools.product((0, 1), drawing.panels):
        shown = (panel.plot.x_range, panel.plot.y_range)[k]
        if shown.kind == "Range1d":
            found[shown.id] = _fixed(shown)
        else:
            sharing = [p.plot for p in drawing.panels if shown in (p.plot.x_range, p.plot.y_range)]
            models = itertools.chain.from_iterable(plot.renderers for plot in sharing)
            parts = [part[k] for model in models for part in outlines(model)]
            log = (panel.x_log, panel.y_log)[k]
            found[shown.id] = _padded(np.concatenate(parts or [np.empty(0)]), shown.range_padding, log)
    return found


def _fixed(shown: Any) -> _Limits:
    """Limits of a range with fixed ends, which must differ."""
    start, end = float(shown.start), float(shown.end)
    return start, end if end != start else start + 1.0


def _padded(values: Array, padding: Any, log: bool) -> _Limits:
    """Limits around values, shape (k,), with padding as a share of their span, as Bokeh does it."""
    values = _logged(values) if log else values
    values = values[np.isfinite(values)] if np.isfinite(values).any() else np.array([0.0, 1.0])
    low, high = float(values.min()), float(values.max())
    half, middle = 0.5 * (high - low) * (1.0 + padding) or 1.0, 0.5 * (low + high)
    ends = middle - half, middle + half
    return (10.0 ** ends[0], 10.0 ** ends[1]) if log else ends


def _equal(x: _Limits, y: _Limits, proportion: float) -> tuple[_Limits, _Limits]:
    """Widen one of two ranges to equal scales in a frame whose width / height is given."""
    half = 0.5 * max(x[1] - x[0], proportion * (y[1] - y[0]))
    (a, b), halves = (0.5 * (x[0] + x[1]), 0.5 * (y[0] + y[1])), (half, half / proportion)
    return (a - halves[0], a + halves[0]), (b - halves[1], b + halves[1])


def _ticks(axis: Any, limits: _Limits, log: bool) -> list[tuple[float, str]]:
    """Places and names of the ticks of an axis between its ends."""
    low, high = sorted(limits)
    near = 1e-9 * (high - low)
    places = [at for at in _places(axis.ticker, low, high, log) if low - near <= at <= high + near]
    # nine digits distinguish neighbours, and hide the rounding of multiples
    return [(at, axis.major_label_overrides.get(at, f"{at:.9g}".replace("-", "−"))) for at in places]


def _places(ticker: Any, low: float, high: float, log: bool) -> list[float]:
    """Ticks between two values, 1, 2 or 5 times a power of ten apart, or powers of ten."""
    if ticker.kind == "FixedTicker":
        return [float(place) for place in ticker.ticks]
    if log and high > 30.0 * low:
        first, last = math.floor(math.log10(low)), math.ceil(math.log10(high))
        return [10.0**k for k in range(first, last + 1, 1 + (last - first) // 10)]
    wanted = ticker.desired_num_ticks
    power = 10.0 ** math.floor(math.log10((high - low) / wanted))
    steps = [power * digit for digit in (1, 2, 5, 10)]
    step = min(steps, key=lambda step: abs(wanted - (high - low) / step))
    return [k * step for k in range(math.ceil(low / step - 1e-9), math.floor(high / step + 1e-9) + 1)]


def _inside(model: Any, frame: _Frame) -> str:
    """Draw a glyph, a grid or an annotation in the coordinates of the frame."""
    x, y = frame.x, frame.y
    if model.kind == "GlyphRenderer":
        return glyph_elements(model, x, y)
    if model.kind == "Grid":
        across, look = model.dimension == 1, stroke(model.grid_line_color, 1)
        scale = y if across else x
        places = [scale.pixel(at) for at, _ in _ticks(model.axis, scale.limits, scale.log)]
    elif model.kind == "Span":
        across, look = model.dimension == "width", stroke(model.line_color, model.line_width, model.line_dash)
        places = [(y if across else x).pixel(model.location)]
    elif model.kind == "BoxAnnotation":
        # edges along the frame are drawn beyond it, where they are cut off
        left, right = x.pixel(model.left) - 1.0, x.pixel(model.right) + 1.0
        top, bottom = y.pixel(model.top) - 1.0, y.pixel(model.bottom) + 1.0
        look = fill(model.fill_color, model.fill_alpha) or NO_FILL
        look += " " + stroke(model.line_color, model.line_width, model.line_dash)
        return f'<path d="M{left:.1f} {top:.1f}H{right:.1f}V{bottom:.1f}H{left:.1f}z" {look}/>'
    else:
        raise TypeError(f"found {model.kind}; a static picture has no such part")
    lines = (f"M0 {at:.1f}h{x.length:g}" if across else f"M{at:.1f} 0v{y.length:g}" for at in places)
    return f'<path d="{"".join(lines)}" {look}/>' if look else ""


def _room(panel: Panel, limits: dict[str, _Limits]) -> float:
    """Width left of the frame that label and ticks of the value axis need [pixels]."""
    axis = panel.y_axis
    ticks = _ticks(axis, limits[panel.plot.y_range.id], panel.y_log)
    longest = max((_length(name) for _, name in ticks), default=0.0)
    return max(_LEFT, longest + _TICK + 5 + _ROW * _lines(axis.axis_label))


def _room_below(axis: Any) -> float:
    """Height below the frame that label and ticks of the horizontal axis need [pixels]."""
    names = axis.major_label_overrides.values() if axis.major_label_orientation == "vertical" else ()
    ticks = max(map(_length, names), default=_ROW) if _is_labelled(axis) else 0
    return 7 + ticks + _ROW * _lines(axis.axis_label)


def _is_labelled(axis: Any) -> bool:
    return axis.major_label_text_font_size != "0px"


def _axes(panel: Panel, frame: _Frame) -> Iterator[str]:
    """Yield lines, ticks, names and labels of both axes."""
    x, y, left, (below, beside) = frame.x, frame.y, frame.left, (panel.x_axis, panel.y_axis)
    bottom, lines = frame.top + y.length, ""
    for at, name in _ticks(below, x.limits, x.log):
        place = left + x.pixel(at)
        lines += f"M{place:.1f} {bottom:g}v{_TICK}"
        if _is_labelled(below) and below.major_label_orientation == "vertical":
            yield _text(place + 4, bottom + _TICK + 3, name, "end", turned=True)
        elif _is_labelled(below):
            yield _text(place, bottom + _TICK + _SIZE, name, "middle")
    lines = f"M{left:g} {frame.top:g}V{bottom:g}h{x.length:g}{lines}"
    for at, name in _ticks(beside, y.limits, y.log):
        place = frame.top + y.pixel(at)
        lines += f"M{left:g} {place:.1f}h-{_TICK}"
        if _is_labelled(beside):
            yield _text(left - _TICK - 3, place + 4 - 0.5 * _ROW * (_lines(name) - 1), name, "end")
    yield f'<path d="{lines}" fill="none" {stroke(palette.MUTED, 1)}/>'
    if below.axis_label:
        yield _text(left + 0.5 * x.length, bottom + _room_below(below) - 4, below.axis_label, "middle")
    if beside.axis_label:
        yield _text(_SIZE + 1, frame.top + 0.5 * y.length, beside.axis_label, "middle", turned=True)


def _entries(panel: Panel, room: float) -> Iterator[tuple[int, float, str, list[Any]]]:
    """Yield the entries of the legend: row, place from the left [pixels], words, renderers."""
    row, column, place = 0, 0, 0.0
    for legend in panel.plot.above:
        for item in legend.items:
            words = item.label.value
            needed = _SAMPLE + 4 + _length(words)
            if column == legend.ncols or (column and place + needed > room):
                row, column, place = row + 1, 0, 0.0
            yield row, place, words, item.renderers
            column, place = column + 1, place + needed + 10


def _label(label: Any, frame: _Frame) -> str:
    """Draw words at a point of the panel."""
    size = float(label.text_font_size.removesuffix("px"))
    look = f' font-size="{size:g}" fill="{escape(label.text_color)}"'
    if label.background_fill_color:
        look += ' stroke="white" stroke-opacity="0.7" stroke-width="3" paint-order="stroke"'
    x = frame.left + frame.x.pixel(label.x) + label.x_offset
    y = frame.top + frame.y.pixel(label.y) - label.y_offset + _SINK[label.text_baseline] * size
    return _text(x, y, label.text, _ANCHOR[label.text_align], look)


def _lines(words: str | None) -> int:
    return words.count("\n") + 1 if words else 0


def _length(words: str) -> float:
    """Estimate the width of words [pixels]."""
    return _LETTER * _SIZE * max(map(len, words.split("\n")))


def _text(x: float, y: float, words: str, anchor: str = "start", look: str = "", turned: bool = False) -> str:
    """Write words, whose first line is at a point [pixels], upwards if `turned`."""
    place = f'transform="translate({x:.1f} {y:.1f}) rotate(-90)"' if turned else f'x="{x:.1f}" y="{y:.1f}"'
    look = ("" if anchor == "start" else f' text-anchor="{anchor}"') + look
    first, *others = words.split("\n")
    left = 0.0 if turned else x
    more = "".join(f'<tspan x="{left:.1f}" dy="{_ROW - 3}">{escape(line)}</tspan>' for line in others)
    return f"<text {place}{look}>{escape(first)}{more}</text>"


def _logged(value: Any) -> Array:
    """Decimal logarithm; NaN where there is none."""
    value = np.asarray(value, float)
    return np.log10(np.where(value > 0.0, value, np.nan))
