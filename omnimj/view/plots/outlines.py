"""Glyphs of Bokeh as SVG paths, with few points: omitted samples deviate invisibly little from the line."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import Any

import numpy as np
from markupsafe import escape
from numpy.typing import NDArray

from omnimj.signals import Array
from omnimj.view.plots.models import Field
from omnimj.view.plots.thinning import envelope

ToPixels = Callable[[Array], Array]
NO_FILL = 'fill="none"'
_BINS = 400
CLOSE = 3.0
"""Greatest distance of a left-out point from the line [pixels / 10]."""
_OPEN = ("Line", "Segment")
_TURN = np.linspace(-0.25, 0.75, 20, endpoint=False)
_MARKERS = {  # corners in units of half the size, downwards is positive
    "circle": np.exp(2j * np.pi * _TURN),
    "square": np.array([-1 - 1j, 1 - 1j, 1 + 1j, -1 + 1j]),
    "diamond": np.array([-1j, 0.7, 1j, -0.7]),
    "star": np.exp(2j * np.pi * _TURN[::2]) * np.tile([1.0, 0.4], 5),
    "x": 0.8 * np.array([-1 - 1j, 1 + 1j, 0, -1 + 1j, 1 - 1j, 0]),  # encloses no area
}


def outlines(renderer: Any) -> list[tuple[Array, Array]]:
    """Return abscissae and ordinates, shape (k,) each, of each line or area of a glyph; markers are one line.

    Raises:
      TypeError: The kind of glyph is unknown.
    """
    kind = renderer.glyph.kind

    def values(*names: str) -> list[Array]:
        read = (np.asarray(_read(renderer, name), float) for name in names)
        return [np.atleast_1d(one) for one in np.broadcast_arrays(*read)]

    if kind == "Line":
        return [_thinned(*values("x", "y"))]
    if kind in ("Scatter", "Patch"):
        x, y = values("x", "y")
        return [(x, y)]
    if kind == "VArea":
        x, low, high = values("x", "y1", "y2")
        (x, low), (_, high) = _thinned(x, low), _thinned(x, high)
        return [(np.append(x, x[::-1]), np.append(low, high[::-1]))]
    if kind == "Segment":
        x0, y0, x1, y1 = values("x0", "y0", "x1", "y1")
        return list(zip(np.column_stack([x0, x1]), np.column_stack([y0, y1]), strict=True))
    if kind == "HBar":
        left, right, y, height = values("left", "right", "y", "height")
        low, high = y - 0.5 * height, y + 0.5 * height
    elif kind == "Quad":
        left, right, low, high = values("left", "right", "bottom", "top")
    else:
        raise TypeError(f"found {kind}; a static picture has no such glyph")
    corners = np.column_stack([left, right, right, left]), np.column_stack([low, low, high, high])
    return list(zip(*corners, strict=True))


def glyph_elements(renderer: Any, x: ToPixels, y: ToPixels) -> str:
    """Draw a glyph; parts that look alike are one element."""
    found: dict[str, list[str]] = {}
    if renderer.glyph.kind == "Scatter":
        parts = _markers(renderer, x, y)
    else:
        is_open = renderer.glyph.kind in _OPEN
        lines = (_path(x(a), y(b), is_open) for a, b in outlines(renderer))
        parts = ((line, _look(renderer, i)) for i, line in enumerate(lines))
    for path, look in parts:
        found.setdefault(look, []).append(path)
    return "".join(f'<path d="{"".join(dict.fromkeys(d))}" {look}/>' for look, d in found.items() if look)


def sample(renderer: Any, x: float, y: float, length: float) -> str:
    """Draw the sample of a glyph in a legend: left end at x, middle at the height y, a length [pixels]."""
    middle, look = x + 0.5 * length, _look(renderer, 0)
    if renderer.glyph.kind == "Scatter":
        path = _marker(_one(_read(renderer, "marker"), 0), complex(middle, y), 7.0)
    elif renderer.glyph.kind in _OPEN:
        path = f"M{x:.1f} {y:.1f}h{length:g}"
    else:
        path = _marker("square", complex(middle, y), 10.0)
    return f'<path d="{path}" {look}/>' if look else ""


def stroke(color: Any, width: float | None, dash: Any = (), alpha: float | None = 1.0) -> str:
    """Return the SVG attributes of a line, width and dashes in pixels; empty if it is invisible."""
    if not color or not width or not alpha:
        return ""
    dashes = f' stroke-dasharray="{" ".join(map(str, dash))}"' if dash else ""
    return f'stroke="{escape(color)}" stroke-width="{width:g}"{dashes}' + _opacity("stroke", alpha)


def fill(color: Any, alpha: float | None) -> str:
    """Return the SVG attributes of an area in a colour, None for no area; empty if it is invisible."""
    return f'fill="{escape(color)}"' + _opacity("fill", alpha) if color and alpha else ""


def _opacity(what: str, alpha: float) -> str:
    return f' {what}-opacity="{alpha:g}"' if alpha < 1.0 else ""


def _read(renderer: Any, name: str) -> Any:
    """Property of a glyph: one value, or a column of its data."""
    value = getattr(renderer.glyph, name, None)
    return renderer.data_source.data[value.field] if isinstance(value, Field) else value


def _one(value: Any, i: int) -> Any:
    return value if value is None or isinstance(value, str | int | float) else value[i]


def _look(renderer: Any, i: int) -> str:
    """Attributes of part i of a glyph; empty if it is invisible."""
    line, width, opacity, area, area_opacity = (
        _one(_read(renderer, name), i)
        for name in ("line_color", "line_width", "line_alpha", "fill_color", "fill_alpha")
    )
    edge = stroke(line, width, getattr(renderer.glyph, "line_dash", ()), opacity)
    inside = fill(area, area_opacity)
    return f"{inside or NO_FILL} {edge}" if inside or edge else ""


def _markers(renderer: Any, x: ToPixels, y: ToPixels) -> Iterator[tuple[str, str]]:
    """Yield path and attributes of each marker."""
    ((across, up),) = outlines(renderer)
    names = "marker", "size", "line_color", "fill_color", "fill_alpha"
    for i, place in enumerate((x(across) + 1j * y(up)).tolist()):
        kind, size, line, area, opacity = (_one(_read(renderer, name), i) for name in names)
        if not np.isfinite(place):
            continue
        if kind == "circle" and line == area:  # the end of a round line is short and looks the same
            look = stroke(area, size, alpha=opacity)
            yield f"M{place.real:.1f} {place.imag:.1f}h0", look and f'{look} stroke-linecap="round"'
        else:
            yield _marker(kind, place, size), _look(renderer, i)


def _marker(kind: str, place: complex, size: float) -> str:
    """Path of a marker of a size around a point [pixels]."""
    if kind not in _MARKERS:
        raise TypeError(f"found a marker {kind}; a static picture has {', '.join(_MARKERS)}")
    corners = place + 0.5 * size * _MARKERS[kind]
    return f"M{' '.join(f'{corner.real:.1f} {corner.imag:.1f}' for corner in corners)}z"


def _thinned(x: Array, y: Array) -> tuple[Array, Array]:
    """Thin a line from left to right, shape (k,) each; others, like a path on a map, stay."""
    return envelope(x, y, _BINS) if np.all(np.diff(x) >= 0.0) else (x, y)


def _path(x: Array, y: Array, is_open: bool) -> str:
    """Path through pixels, shape (k,) each, in steps of whole tenths; those that are not finite are gaps."""
    places, text = np.round(10.0 * (x + 1j * y)), ""
    known = np.isfinite(places)
    for run in np.split(places, np.flatnonzero(np.diff(known)) + 1):
        if len(run) and np.isfinite(run[0]):
            kept = simplified(run)
            steps = np.diff(kept, prepend=0.0)
            first, *rest = (f"{step.real / 10.0:g} {step.imag / 10.0:g}" for step in steps)
            text += f"M{first}l{' '.join(rest) or '0 0'}" + ("" if is_open else "z")
    return text.replace(" 0.", " .").replace("-0.", "-.").replace(" -", "-")


def simplified(places: NDArray[np.complex128]) -> NDArray[np.complex128]:
    """Leave out points of a line, shape (k,), that are close to it without them (Douglas and Peucker)."""
    if len(places) < 3:
        return places
    kept = np.array([0, len(places) - 1])  # in order
    is_open = np.ones(1, bool)  # of the parts between them, those that may need another point
    while is_open.any():
        first, last = kept[:-1][is_open], kept[1:][is_open]
        length = last - first
        starts = np.cumsum(length) - length  # of the parts in the arrays of all their points
        part = np.repeat(np.arange(len(first)), length)
        point = first[part] + np.arange(len(part)) - starts[part]
        chord, aside = (places[last] - places[first])[part], places[point] - places[first[part]]
        # distance from the chord between its ends: a path may go on beyond an end and return
        square = np.maximum(np.abs(chord) ** 2, 1e-12)
        along = np.minimum(np.maximum((aside * chord.conj()).real / square, 0.0), 1.0)
        away = np.abs(aside - along * chord)
        farthest = np.maximum.reduceat(away, starts)
        candidate = np.where(away == farthest[part], point, len(places))
        added = np.minimum.reduceat(candidate, starts)[farthest > CLOSE]
        merged = np.concatenate([kept, added])
        order = np.argsort(merged, kind="stable")
        kept = merged[order]
        is_new = order >= len(order) - len(added)
        is_open = is_new[:-1] | is_new[1:]
    return places[kept]
