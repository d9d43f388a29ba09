"""Shared parts of all plots: panels drawn by the browser with Bokeh, thinned signals, shaded faults.

A `Drawing` is one figure of a page: one panel or several below each other. `view.report.page` puts the
drawings of a page into one document, where panels over time share their time axis and a cursor.
"""

from __future__ import annotations

import hashlib
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from omnimj.signals import Array
from omnimj.view import palette
from omnimj.view.plots.models import Field, Model, Value, in_frame
from omnimj.view.plots.thinning import BINS, averaged, envelope, log_beyond

Style = str | tuple[int, tuple[float, ...]]
"""Dash pattern: `-`, or an offset and lengths of strokes and gaps."""
SHORT, MIDDLE, TALL = 250, 290, 430
"""Heights of figures [pixels]; those side by side have equal heights."""
BELOW = 34
"""Height of the labels of a horizontal axis [pixels]."""
NOT_HOVERED = np.empty(0)
_LEFT = 62  # [pixels] for the value axis, alike in all panels, so that their time axes are aligned


@dataclass
class Panel:
    """Plot with axes, of a height in pixels; `over_time` if the horizontal axis is the time of the run."""

    height: int
    over_time: bool = True
    label: str = ""
    x_label: str = ""
    x_log: bool = False
    y_log: bool = False
    equal: bool = False
    """True for equal scales of both axes."""
    bins: int = BINS
    """Most bins of a line over time."""
    plot: Any = field(init=False)
    x_axis: Any = field(init=False)
    y_axis: Any = field(init=False)
    sources: dict[tuple[float, ...], Any] = field(init=False, default_factory=dict)
    """Data of lines by their abscissae; equal columns have equal names."""
    _shown: dict[str, list[Any]] = field(init=False, default_factory=dict)
    _hovered: list[tuple[str, str]] = field(init=False, default_factory=list)

    def __post_init__(self) -> None:
        self.x_axis, self.y_axis = _axis(self.x_log), _axis(self.y_log, axis_label_standoff=4)
        self.y_axis.ticker.desired_num_ticks = 4
        self.plot = Model(
            "Figure",
            height=self.height,
            sizing_mode="stretch_width",
            x_range=Model("Range1d", start=0.0, end=1.0) if self.over_time else _fitted(0.1),
            y_range=_fitted(0.08),
            x_scale=Model("LogScale" if self.x_log else "LinearScale"),
            y_scale=Model("LogScale" if self.y_log else "LinearScale"),
            match_aspect=self.equal,
            toolbar=Model("Toolbar", tools=[], logo=None, autohide=True),
            toolbar_location=None,
            min_border_left=_LEFT,
            min_border_right=14,
            outline_line_color=None,
            renderers=[],
            left=[self.y_axis],
            below=[self.x_axis],
            above=[],
            center=[_grid(self.x_axis, 0), _grid(self.y_axis, 1)],
        )

    def values(self, label: str) -> None:
        """Label the value axis."""
        self.label = label

    def _source(self, x: Array) -> Any:
        """Data of the signals that share the abscissae x, shape (k,)."""
        key = (float(len(x)), *map(float, x[:1]), *map(float, x[-1:]), float(np.sum(x)))
        if key not in self.sources:
            self.sources[key] = _source_of(x=_numbers(x))
        return self.sources[key]

    def _draw(self, kind: str, source: Any, label: str = "", **style: Any) -> Any:
        """Add a glyph with a style to the plot, and to an entry of the legend; return its renderer."""
        drawn = Model(
            "GlyphRenderer", data_source=source, glyph=Model(kind, **style), visible=True, level="glyph"
        )
        self.plot.renderers.append(drawn)
        if label:
            self._shown.setdefault(label, []).append(drawn)
        return drawn

    def line(
        self,
        x: Array,
        y: Array,
        color: str = palette.INK,
        label: str = "",
        dash: Style = "-",
        width: float = 1.4,
        alpha: float = 1.0,
        hovered: Array | None = None,
    ) -> Any:
        """Draw y over x, shape (k,) each, thinned to the smallest and largest sample of `BINS` bins.

        x increases where the line is thinned, and NaN in y leaves a gap. The label in the legend switches the
        line. The cursor shows `hovered`, shape (k,): y when None, nothing when empty.
        """
        time, x, y = x, np.asarray(x, float), np.asarray(y, float)
        if self.over_time:
            x, y = envelope(x, y, self.bins)
        source = self._source(x)
        name = _add(source, y)
        style = {"line_color": color, "line_width": width, "line_alpha": alpha, "line_dash": dashes(dash)}
        if hovered is None:
            self._hovered.append((name, label))
        elif len(hovered):
            self._hovered.append((_add(source, envelope(time, hovered, self.bins)[1]), label))
        return self._draw("Line", source, label, x=Field("x"), y=Field(name), **style)

    def rippling(self, time: Array, value: Array, color: str, label: str = "", dash: Style = "-") -> None:
        """Draw a rippling signal, shape (k,), pale, and its mean over `thinning.window` in full colour."""
        middle, mean = averaged(time, value)
        self.line(time, value, color=palette.lighter(color, 0.55), label=label, width=0.8, alpha=0.7)
        self.line(middle, mean, color=color, label=label, dash=dash, hovered=NOT_HOVERED)

    def band(self, x: Array, low: Array, high: Array, color: str, alpha: float) -> None:
        """Fill the area between the curves `low` and `high` over x, shape (k,) each."""
        source = _source_of(x=_numbers(x), y1=_numbers(low), y2=_numbers(high))
        self._draw("VArea", source, **_fields("x", "y1", "y2"), fill_color=color, fill_alpha=alpha)

    def segments(self, x0: Any, y0: Any, x1: Any, y1: Any, color: str, width: float) -> None:
        """Draw straight lines from x0, y0 to x1, y1, shape (k,) each."""
        ends = {"x0": list(x0), "y0": list(y0), "x1": list(x1), "y1": list(y1)}
        style = {"line_color": color, "line_width": width, "line_alpha": 1.0}
        self._draw("Segment", _source_of(**ends), **_fields(*ends), **style)

    def points(
        self,
        x: Any,
        y: Any,
        color: Any = palette.INK,
        label: str = "",
        marker: str = "circle",
        size: float = 7.0,
        alpha: float = 1.0,
        names: Sequence[str] = (),
    ) -> Any:
        """Draw markers at x, y, shape (k,) each or two numbers, in one colour or k colours.

        The marker is a shape by its name in Bokeh, `size` its diameter [pixels]. The cursor shows `names`.
        """
        source = _source_of(x=_numbers(np.atleast_1d(x)), y=_numbers(np.atleast_1d(y)))
        color = _colored(source, color)
        style = {"line_color": color, "line_width": 1, "line_alpha": alpha, "size": size, "marker": marker}
        style |= {"fill_color": color, "fill_alpha": alpha}
        drawn = self._draw("Scatter", source, label, **_fields("x", "y"), **style)
        self._name(drawn, names)
        return drawn

    def polygon(self, corners: Array, fill: str, label: str = "", **style: Any) -> None:
        """Fill a polygon with the corners x, y, shape (k, 2)."""
        source = _source_of(x=_numbers(corners[:, 0]), y=_numbers(corners[:, 1]))
        options = {"fill_color": fill, "fill_alpha": 1.0, "line_color": None, "line_width": 0, **style}
        self._draw("Patch", source, label, **_fields("x", "y"), **options)

    def bars(
        self,
        left: Any,
        right: Any,
        middle: Any,
        thick: float,
        color: Any,
        label: str = "",
        names: Sequence[str] = (),
    ) -> None:
        """Draw horizontal bars from `left` to `right` around `middle`, shape (k,) each, in one colour or k.

        `thick` is in units of the value axis, and `names` are texts below the cursor.
        """
        source = _source_of(left=list(left), right=list(right), middle=list(middle))
        style = {"y": Field("middle"), "height": thick, "line_color": None, "line_width": 0}
        style |= {"fill_color": _colored(source, color), "fill_alpha": 1.0}
        drawn = self._draw("HBar", source, label, **_fields("left", "right"), **style)
        self._name(drawn, names)

    def cells(self, x: Array, y: Array, colors: Sequence[str], names: Sequence[str]) -> None:
        """Draw cells between m + 1 borders x and n + 1 borders y; colours and names go row by row.

        The names show below the cursor.
        """
        (left, low), (right, high) = np.meshgrid(x[:-1], y[:-1]), np.meshgrid(x[1:], y[1:])
        drawn = self._quads(left, right, low, high, line_color=palette.GRID, line_width=0.6, fill_alpha=1.0)
        drawn.glyph.fill_color = _colored(drawn.data_source, colors)
        self._name(drawn, names)

    def frames(self, x: Array, y: Array, color: str) -> None:
        """Draw frames around the cells of unit size whose middles are x, y, shape (k,) each."""
        style = {"line_color": color, "line_width": 1, "fill_color": None, "fill_alpha": 0.0}
        self._quads(x - 0.5, x + 0.5, y - 0.5, y + 0.5, **style)

    def _quads(self, left: Array, right: Array, low: Array, high: Array, **style: Any) -> Any:
        sides = {"left": left, "right": right, "top": high, "bottom": low}
        source = _source_of(**{name: side.ravel().tolist() for name, side in sides.items()})
        return self._draw("Quad", source, **_fields(*sides), line_alpha=1.0, **style)

    def _name(self, drawn: Any, names: Sequence[str]) -> None:
        """Show the name of each part of a glyph below the cursor."""
        if names:
            drawn.data_source.data["name"] = list(names)
            self.hover([drawn], [("", "@name")])

    def hover(
        self,
        drawn: Sequence[Any],
        tips: Sequence[tuple[str, str]],
        mode: Literal["mouse", "vline"] = "mouse",
    ) -> None:
        """Show values below the cursor, or at its abscissa with `vline`.

        A tip is a name and a value: `@column` of the data, `$name` of the renderer, `$snap_x` or `$snap_y`.
        """
        options: dict[str, Any] = {"mode": mode, "point_policy": "follow_mouse"}
        self._add_tool("HoverTool", renderers=list(drawn), tooltips=list(tips), **options)

    def _add_tool(self, kind: str, **options: Any) -> Any:
        tool = Model(kind, **options)
        self.plot.toolbar.tools.append(tool)
        return tool

    def rule(self, at: float, across: bool = True, dash: Style = "-") -> None:
        """Draw a line across the panel at a value, or, if not `across`, upright at an abscissa."""
        look = {"line_color": palette.MUTED, "line_width": 0.9, "line_dash": dashes(dash)}
        where = {"location": at, "dimension": "width" if across else "height"}
        self._annotate("Span", **where, level="underlay", visible=True, **look)

    def shade(self, name: str, start: float | None, end: float | None, alpha: float, **edge: Any) -> None:
        """Shade an interval of the horizontal axis; None for a side at the side of the frame."""
        left = in_frame("left") if start is None else start
        right = in_frame("right") if end is None else end
        fill = {"fill_color": palette.FAULT, "fill_alpha": alpha}
        look = {"level": "underlay", "visible": True, **fill, "line_color": None, "line_width": 0, **edge}
        sides = {"left": left, "right": right, "top": in_frame("top"), "bottom": in_frame("bottom")}
        self._annotate("BoxAnnotation", name=name, **sides, **{"line_dash": [], **look})

    def text(self, x: Any, y: Any, words: str, color: str = palette.INK, **style: Any) -> None:
        """Write words at a point; a coordinate is a number or a place at the frame."""
        place = {"text_baseline": "middle", "text_align": "left", "x_offset": 0, "y_offset": 0}
        look = {"text_font_size": "11px", "text_color": color, "background_fill_color": None}
        self._annotate("Label", x=x, y=y, text=words, **{**place, **look, **style})

    def _annotate(self, kind: str, **attributes: Any) -> None:
        self.plot.center.append(Model(kind, **attributes))

    def limits(self, low: float, high: float) -> None:
        """Fix the value axis."""
        self.plot.y_range = Model("Range1d", start=float(low), end=float(high))

    def x_limits(self, low: float, high: float) -> None:
        """Fix the horizontal axis."""
        self.plot.x_range = Model("Range1d", start=float(low), end=float(high))

    def contains(self, low: Array, high: Array) -> None:
        """Make the axes cover at least the rectangle between two corners x, y, shape (2,)."""
        (left, bottom), (right, top) = low, high
        self.points([left, right], [bottom, top], alpha=0.0)

    def rows(self, names: Sequence[str]) -> None:
        """Name rows 0, 1, … of the value axis, counted from the top."""
        self.limits(len(names) - 0.5, -0.5)
        self.ticks(range(len(names)), names)
        self.hide_grid(across=False)

    def hide_grid(self, across: bool) -> None:
        """Hide the lines at the ticks of the horizontal axis if `across`, else those of the value axis."""
        self.plot.center[0 if across else 1].visible = False

    def ticks(self, places: Sequence[float], names: Sequence[str], across: bool = False) -> None:
        """Mark and name places on an axis."""
        axis = self.x_axis if across else self.y_axis
        axis.ticker = Model("FixedTicker", ticks=[float(place) for place in places])
        axis.major_label_overrides = {
            (int(place) if float(place).is_integer() else float(place)): name
            for place, name in zip(places, names, strict=True)
        }

    def continue_below(self) -> None:
        """Leave the labels of the horizontal axis to the panel below."""
        self.x_axis.major_label_text_font_size = "0px"
        self.plot.min_border_bottom = 4

    def logarithmic(self, linear: float, places: Sequence[float]) -> None:
        """Name values on the axis of lines that `log_beyond` has compressed."""
        self.ticks(log_beyond(np.array(places), linear).tolist(), [f"{at:g}" for at in places])
        self.label += ", logarithmic above the threshold"

    @property
    def unit(self) -> str:
        """Unit of the values, as in the label of their axis; empty if there is none."""
        return self.label.rpartition("[")[2].partition("]")[0] if "[" in self.label else ""

    @property
    def labels(self) -> tuple[str, ...]:
        """Entries of the legend."""
        return tuple(self._shown)

    def legend(self, columns: int = 4) -> None:
        """Add a legend above the panel; a click on an entry hides or shows its lines."""
        items = [
            Model("LegendItem", label=Value(label), renderers=drawn) for label, drawn in self._shown.items()
        ]
        if not items:
            return
        look = {"border_line_width": 0, "background_fill_alpha": 0.0, "label_text_font_size": "12px"}
        room = {"padding": 0, "margin": 2, "spacing": 8, "label_standoff": 4}
        room |= {"glyph_width": 22, "glyph_height": 14}
        options = {"orientation": "horizontal", "ncols": columns, "click_policy": "hide", **look, **room}
        look = {"location": (0, 0), "label_text_color": palette.INK, **options}
        self.plot.above.append(Model("Legend", items=items, **look))

    def finish(self) -> Drawing:
        """Add labels, tools, and the values below the cursor, after everything is drawn; return the panel
        alone.
        """
        self.y_axis.axis_label, self.x_axis.axis_label = self.label, self.x_label
        dimensions = "width" if self.over_time else "both"
        zoom = self._add_tool("BoxZoomTool", dimensions=dimensions, match_aspect=self.equal)
        self._add_tool("PanTool", dimensions=dimensions)
        wheel = self._add_tool("WheelZoomTool", dimensions=dimensions, modifiers={"ctrl": True})
        self._add_tool("ResetTool")
        self._add_tool("SaveTool")
        self.plot.toolbar.active_drag, self.plot.toolbar.active_scroll = zoom, wheel
        for source in self.sources.values():
            self._add_hover(source)
        return Drawing((self,))

    def follow(self, cursor: Model) -> None:
        """Show a line that moves with the cursor of all panels that have it."""
        self._add_tool("CrosshairTool", overlay=cursor)

    def _add_hover(self, source: Any) -> None:
        rows = [(name, label) for name, label in self._hovered if name in source.data]
        if not rows or not self.over_time:
            return
        # an invisible line, so that hiding an entry of the legend leaves the values of the others
        hidden = {"line_color": None, "line_width": 1, "line_alpha": 0.0}
        carrier = self._draw("Line", source, x=Field("x"), y=Field(rows[0][0]), **hidden)
        tips = [(label or "value", f"@{name}{{%.4g}} {self.unit}".strip()) for name, label in rows]
        formats = {f"@{name}": "printf" for name, _ in rows}
        options: dict[str, Any] = {"mode": "vline", "point_policy": "follow_mouse"}
        options |= {"formatters": {"@x": "printf", **formats}}
        tips = [("time", "@x{%.4f} s"), *tips]
        self._add_tool("HoverTool", renderers=[carrier], tooltips=tips, **options)


@dataclass(frozen=True)
class Drawing:
    """Panels below each other."""

    panels: tuple[Panel, ...]

    @property
    def height(self) -> int:
        """Height [pixels]."""
        return sum(panel.height for panel in self.panels)


def new_drawing(height: int, rows: int = 1, shared: bool = False, bins: int = BINS) -> Drawing:
    """Make empty panels over the time of a run, of equal height, together `height` [pixels].

    They share their value axis if `shared`, and a line has at most `bins` bins.
    """
    each = (height - BELOW) // rows
    heights = [each + (BELOW if row == rows - 1 else 0) for row in range(rows)]
    panels = tuple(Panel(height, bins=bins) for height in heights)
    if shared:
        for panel in panels[1:]:
            panel.plot.y_range = panels[0].plot.y_range
    return Drawing(panels)


def _axis(log: bool, **style: Any) -> Model:
    """Axis with ticks and labels."""
    name = "Log" if log else "Linear"
    if log:
        formatter = Model("LogTickFormatter", min_exponent=4)  # 0.01 rather than a power of ten
    else:
        formatter = Model("BasicTickFormatter", power_limit_low=-5)  # 0.0005 rather than 5e-4
    return Model(
        f"{name}Axis",
        ticker=Model("LogTicker" if log else "BasicTicker", desired_num_ticks=6),
        formatter=formatter,
        axis_label="",
        axis_label_text_color=palette.INK,
        axis_label_text_font_size="12px",
        axis_label_text_font_style="normal",
        axis_line_color=palette.MUTED,
        major_label_orientation="horizontal",
        major_label_overrides={},
        major_label_text_color=palette.INK,
        major_label_text_font_size="12px",
        major_tick_line_color=palette.MUTED,
        minor_tick_line_color=None,
        **style,
    )


def _grid(axis: Model, dimension: int) -> Model:
    """Lines at the ticks of an axis, dimension 0 across and 1 up."""
    look = {"grid_line_color": palette.GRID, "level": "underlay", "visible": True}
    return Model("Grid", axis=axis, dimension=dimension, **look)


def _fitted(padding: float) -> Model:
    """Range of the data with padding, a share of their span."""
    return Model("DataRange1d", range_padding=padding)


def _source_of(**columns: Any) -> Model:
    return Model("ColumnDataSource", data=columns)


def _fields(*names: str) -> dict[str, Any]:
    """Properties of a glyph that are columns of the same name."""
    return {name: Field(name) for name in names}


def _colored(source: Any, color: Any) -> Any:
    """One colour, or a new column of the source for several."""
    if isinstance(color, str):
        return color
    source.data["color"] = list(color)
    return Field("color")


def _numbers(values: Any) -> NDArray[np.float32]:
    """Numbers for the page: single precision is finer than any screen."""
    return np.asarray(values, np.float32)


def _add(source: Any, values: Array) -> str:
    """Add a column to a source and return its name, which is the same for equal columns."""
    numbers = _numbers(values)
    name = f"y{hashlib.blake2b(numbers.tobytes(), digest_size=6).hexdigest()}"
    source.data[name] = numbers
    return name


def dashes(style: Style) -> list[int]:
    """Convert a dash pattern to lengths in pixels, none for a solid line."""
    if isinstance(style, str):
        return []
    return [max(1, round(1.2 * length)) for length in style[1]]
