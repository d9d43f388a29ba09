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
from bokeh.models import (
    BasicTickFormatter,
    BoxZoomTool,
    ColumnDataSource,
    FixedTicker,
    HoverTool,
    Label,
    Legend,
    LegendItem,
    Line,
    PanTool,
    Patch,
    Range1d,
    ResetTool,
    SaveTool,
    WheelZoomTool,
)
from bokeh.models import Span as Rule
from bokeh.models.renderers import GlyphRenderer
from bokeh.plotting import figure as bokeh_figure
from numpy.typing import NDArray

from omnimj.signals import Array
from omnimj.view import palette
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
    _shown: dict[str, list[GlyphRenderer]] = field(init=False, default_factory=dict)
    _sources: dict[tuple[float, ...], Any] = field(init=False, default_factory=dict)
    _hovered: list[tuple[str, str]] = field(init=False, default_factory=list)

    def __post_init__(self) -> None:
        self.plot = bokeh_figure(
            height=self.height,
            sizing_mode="stretch_width",
            x_axis_type="log" if self.x_log else "linear",
            y_axis_type="log" if self.y_log else "linear",
            match_aspect=self.equal,
            tools=[],
            toolbar_location=None,
            min_border_left=_LEFT,
            min_border_right=14,
            outline_line_color=None,
            output_backend="canvas",
        )
        _dress(self.plot)
        if self.over_time:
            self.plot.x_range = Range1d()

    def values(self, label: str) -> None:
        """Label the value axis."""
        self.label = label

    def _source(self, x: Array) -> Any:
        """Data of the signals that share the abscissae x, shape (k,)."""
        key = (float(len(x)), *map(float, x[:1]), *map(float, x[-1:]), float(np.sum(x)))
        if key not in self._sources:
            self._sources[key] = ColumnDataSource({"x": _numbers(x)}, tags=list(key))
        return self._sources[key]

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
    ) -> GlyphRenderer:
        """Draw y over x, shape (k,) each, thinned to the smallest and largest sample of `BINS` bins.

        x increases where the line is thinned, and NaN in y leaves a gap. The label in the legend switches the
        line. The cursor shows `hovered`, shape (k,): y when None, nothing when empty.
        """
        time, x, y = x, np.asarray(x, float), np.asarray(y, float)
        if self.over_time:
            x, y = envelope(x, y, self.bins)
        source = self._source(x)
        name = _add(source, y)
        style: Any = {"line_color": color, "line_width": width, "line_alpha": alpha}
        style |= {"x": "x", "y": name, "line_dash": dashes(dash)}
        # glyphs are added without `bokeh.plotting`, which makes five of each
        drawn = self.plot.add_glyph(source, Line(**style))
        if hovered is None:
            self._hovered.append((name, label))
        elif len(hovered):
            self._hovered.append((_add(source, envelope(time, hovered, self.bins)[1]), label))
        return self._shows(label, drawn)

    def rippling(self, time: Array, value: Array, color: str, label: str = "", dash: Style = "-") -> None:
        """Draw a rippling signal, shape (k,), pale, and its mean over `thinning.window` in full colour."""
        middle, mean = averaged(time, value)
        self.line(time, value, color=palette.lighter(color, 0.55), label=label, width=0.8, alpha=0.7)
        self.line(middle, mean, color=color, label=label, dash=dash, hovered=NOT_HOVERED)

    def band(self, x: Array, low: Array, high: Array, color: str, alpha: float) -> None:
        """Fill the area between the curves `low` and `high` over x, shape (k,) each."""
        self.plot.varea(_numbers(x), _numbers(low), _numbers(high), fill_color=color, fill_alpha=alpha)

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
    ) -> GlyphRenderer:
        """Draw markers at x, y, shape (k,) each or two numbers, in one colour or k colours.

        The marker is a shape by its name in Bokeh, `size` its diameter [pixels]. The cursor shows `names`.
        """
        x, y = _numbers(np.atleast_1d(x)), _numbers(np.atleast_1d(y))
        source: Any = ColumnDataSource({"x": x, "y": y})
        if not isinstance(color, str):
            source.data["color"], color = list(color), "color"
        style = {"color": color, "alpha": alpha, "size": size, "marker": marker}
        drawn = self.plot.scatter("x", "y", source=source, **style)
        if names:
            source.data["name"] = list(names)
            self.hover([drawn], [("", "@name")])
        return self._shows(label, drawn)

    def polygon(self, corners: Array, fill: str, label: str = "", **style: Any) -> None:
        """Fill a polygon with the corners x, y, shape (k, 2)."""
        source = ColumnDataSource({"x": _numbers(corners[:, 0]), "y": _numbers(corners[:, 1])})
        options = {"x": "x", "y": "y", "fill_color": fill, "line_width": 0, **style}
        self._shows(label, self.plot.add_glyph(source, Patch(**options)))

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
        source: Any = ColumnDataSource({"left": list(left), "right": list(right), "middle": list(middle)})
        if not isinstance(color, str):
            source.data["color"], color = list(color), "color"
        style = {"height": thick, "fill_color": color, "line_width": 0}
        drawn = self.plot.hbar(y="middle", left="left", right="right", source=source, **style)
        if names:
            source.data["name"] = list(names)
            self.hover([drawn], [("", "@name")])
        self._shows(label, drawn)

    def cells(self, x: Array, y: Array, colors: Sequence[str], names: Sequence[str]) -> None:
        """Draw cells between m + 1 borders x and n + 1 borders y; colours and names go row by row.

        The names show below the cursor.
        """
        (left, low), (right, high) = np.meshgrid(x[:-1], y[:-1]), np.meshgrid(x[1:], y[1:])
        sides = {"left": left, "right": right, "top": high, "bottom": low}
        data: Any = {name: side.ravel().tolist() for name, side in sides.items()}
        source = ColumnDataSource(data | {"color": list(colors), "name": list(names)})
        style = {"fill_color": "color", "line_color": palette.GRID, "line_width": 0.6}
        self.hover([self.plot.quad(*sides, source=source, **style)], [("", "@name")])

    def hover(
        self,
        drawn: Sequence[GlyphRenderer],
        tips: Sequence[tuple[str, str]],
        mode: Literal["mouse", "vline"] = "mouse",
    ) -> None:
        """Show values below the cursor, or at its abscissa with `vline`.

        A tip is a name and a value: `@column` of the data, `$name` of the renderer, `$snap_x` or `$snap_y`.
        """
        options: dict[str, Any] = {"mode": mode, "point_policy": "follow_mouse"}
        self.plot.add_tools(HoverTool(renderers=list(drawn), tooltips=list(tips), **options))

    def rule(self, at: float, across: bool = True, dash: Style = "-") -> None:
        """Draw a line across the panel at a value, or, if not `across`, upright at an abscissa."""
        where: Literal["width", "height"] = "width" if across else "height"
        look = {"line_color": palette.MUTED, "line_width": 0.9, "line_dash": dashes(dash)}
        self.plot.add_layout(Rule(location=at, dimension=where, level="underlay", **look))

    def text(self, x: float, y: float, words: str, color: str = palette.INK, **style: Any) -> None:
        """Write words at a point."""
        options = {"text_font_size": "11px", "text_baseline": "middle", **style}
        self.plot.add_layout(Label(x=x, y=y, text=words, text_color=color, **options))

    def limits(self, low: float, high: float) -> None:
        """Fix the value axis."""
        self.plot.y_range = Range1d(start=float(low), end=float(high))

    def x_limits(self, low: float, high: float) -> None:
        """Fix the horizontal axis."""
        self.plot.x_range = Range1d(start=float(low), end=float(high))

    def contains(self, low: Array, high: Array) -> None:
        """Make the axes cover at least the rectangle between two corners x, y, shape (2,)."""
        corners = ColumnDataSource({"x": [low[0], high[0]], "y": [low[1], high[1]]})
        self.plot.scatter("x", "y", source=corners, alpha=0.0)

    def rows(self, names: Sequence[str]) -> None:
        """Name rows 0, 1, … of the value axis, counted from the top."""
        self.limits(len(names) - 0.5, -0.5)
        self.ticks(range(len(names)), names)
        self.plot.ygrid.visible = False

    def ticks(self, places: Sequence[float], names: Sequence[str], across: bool = False) -> None:
        """Mark and name places on an axis."""
        axis = self.plot.xaxis if across else self.plot.yaxis
        axis.ticker = FixedTicker(ticks=[float(place) for place in places])
        axis.major_label_overrides = {
            (int(place) if float(place).is_integer() else float(place)): name
            for place, name in zip(places, names, strict=True)
        }

    def continue_below(self) -> None:
        """Leave the labels of the horizontal axis to the panel below."""
        self.plot.xaxis.major_label_text_font_size = "0px"
        self.plot.min_border_bottom = 4

    def logarithmic(self, linear: float, places: Sequence[float]) -> None:
        """Name values on the axis of lines that `log_beyond` has compressed."""
        self.ticks(log_beyond(np.array(places), linear).tolist(), [f"{at:g}" for at in places])
        self.label += ", logarithmic above the threshold"

    def _shows(self, label: str, drawn: GlyphRenderer) -> GlyphRenderer:
        if label:
            self._shown.setdefault(label, []).append(drawn)
        return drawn

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
        items = [LegendItem(label=label, renderers=drawn) for label, drawn in self._shown.items()]
        if not items:
            return
        look = {"border_line_width": 0, "background_fill_alpha": 0.0, "label_text_font_size": "12px"}
        room = {"padding": 0, "margin": 2, "spacing": 8, "label_standoff": 4}
        room |= {"glyph_width": 22, "glyph_height": 14}
        options = {"orientation": "horizontal", "ncols": columns, "click_policy": "hide", **look, **room}
        self.plot.add_layout(
            Legend(items=items, location=(0, 0), label_text_color=palette.INK, **options), "above"
        )

    def finish(self) -> Drawing:
        """Add labels, tools, and the values below the cursor, after everything is drawn; return the panel
        alone.
        """
        plot = self.plot
        plot.yaxis.axis_label, plot.xaxis.axis_label = self.label, self.x_label
        dimensions: Literal["width", "both"] = "width" if self.over_time else "both"
        zoom = BoxZoomTool(dimensions=dimensions, match_aspect=self.equal)
        wheel = WheelZoomTool(dimensions=dimensions, modifiers="ctrl")
        plot.add_tools(zoom, PanTool(dimensions=dimensions), wheel, ResetTool(), SaveTool())
        plot.toolbar.active_drag, plot.toolbar.active_scroll = zoom, wheel
        for source in self._sources.values():
            self._add_hover(source)
        return Drawing((self,))

    def _add_hover(self, source: Any) -> None:
        rows = [(name, label) for name, label in self._hovered if name in source.data]
        if not rows or not self.over_time:
            return
        # an invisible line, so that hiding an entry of the legend leaves the values of the others
        carrier = self.plot.add_glyph(source, Line(x="x", y=rows[0][0], line_alpha=0.0))
        tips = [(label or "value", f"@{name}{{%.4g}} {self.unit}".strip()) for name, label in rows]
        formats = {f"@{name}": "printf" for name, _ in rows}
        options: dict[str, Any] = {"mode": "vline", "point_policy": "follow_mouse"}
        options |= {"formatters": {"@x": "printf", **formats}}
        tips = [("time", "@x{%.4f} s"), *tips]
        self.plot.add_tools(HoverTool(renderers=[carrier], tooltips=tips, **options))


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


def _dress(plot: Any) -> None:
    plot.grid.grid_line_color = palette.GRID
    plot.axis.axis_line_color = plot.axis.major_tick_line_color = palette.MUTED
    plot.axis.minor_tick_line_color = None
    plot.axis.major_label_text_color = plot.axis.axis_label_text_color = palette.INK
    plot.axis.major_label_text_font_size = "12px"
    plot.axis.axis_label_text_font_size, plot.axis.axis_label_text_font_style = "12px", "normal"
    plot.yaxis.axis_label_standoff = 4
    plot.yaxis.ticker.desired_num_ticks = 4
    for axis in plot.axis:
        if isinstance(axis.formatter, BasicTickFormatter):
            axis.formatter.power_limit_low = -5  # 0.0005 rather than 5e-4
        else:
            axis.formatter.min_exponent = 4  # 0.01 rather than a power of ten
    plot.y_range.range_padding = 0.08
    plot.toolbar.logo, plot.toolbar.autohide = None, True


def _numbers(values: Any) -> NDArray[np.float32]:
    """Numbers for the page: single precision is finer than any screen."""
    return np.asarray(values, np.float32)


def _add(source: Any, values: Array) -> str:
    """Add a column to a source and return its name, which is the same for equal columns."""
    numbers = _numbers(values)
    name = f"y{hashlib.blake2b(numbers.tobytes(), digest_size=6).hexdigest()}"
    source.data[name] = numbers
    return name


def dashes(style: Style) -> str | list[int]:
    """Convert a dash pattern to lengths in pixels, or `solid`."""
    if isinstance(style, str):
        return "solid" if style == "-" else style
    return [max(1, round(1.2 * length)) for length in style[1]]
