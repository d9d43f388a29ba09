"""Layout of a recording in the Rerun viewer, the subject of its scenario first."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import rerun as rr
import rerun.blueprint as rrb

from omnimj.simulate.scenario.scenario import Scenario
from omnimj.view.rerun.signals import DIAGNOSIS_LANE, FAULT_LANE, MODE_LANE, Plot

_MOTORS = frozenset({"motor", "free", "locked", "hard_over"})
_SLIPS = frozenset({"slip", "all_wheel_slip"})
_PUSHES = frozenset({"payload", "slope"})
_LENGTHS = frozenset({"misalignment", "wheel_radius"})
_CHANNELS = {
    "yaw_rate": ("yaw_rate", "heading"),
    "yaw": ("yaw_rate", "heading"),
    "acceleration_x": ("acceleration",),
    "acceleration_y": ("acceleration",),
}


@dataclass(frozen=True)
class Focus:
    """Content of a recording to show first."""

    heading: str = ""
    """Heading of the first plots, short enough for a tab; empty if no plot comes first."""
    plots: tuple[str, ...] = ()
    """First plots from top to bottom, as names under `plots/`."""
    wheels: tuple[int, ...] = ()
    """Wheels 1 … n with bold lines; empty if all lines are equal."""
    from_above: bool = False
    """True to show the path from above, beside the machine."""
    from_the_side: bool = False
    """True for a first camera at the side, where slopes are visible."""


@dataclass(frozen=True)
class _Rule:
    """Kinds of faults and the plots that show them."""

    kinds: Collection[str]
    heading: str
    plots: tuple[str, ...]


_RULES = (
    _Rule(_SLIPS, "Slip and traction", ("slip_velocity", "traction_force", "residual_slip")),
    _Rule(_MOTORS, "Motors", ("current", "effectiveness", "residual_motor")),
    _Rule(_PUSHES, "External forces", ("current", "residual_force")),
    _Rule(_LENGTHS, "Heading", ("heading", "yaw_rate")),
)
"""Rules: the first that applies gives the heading, and all that apply give the plots in their order."""
_RIG = Focus("Current, slip, speed", ("current", "slip_velocity", "speed"))


def focus_of(scenario: Scenario, faults: Sequence[Mapping[str, Any]]) -> Focus:
    """Choose the content to show first from the content of a scenario, not from its name."""
    if scenario.is_rig:
        return _RIG
    kinds = [str(fault["kind"]) for fault in faults] + ["slip"] * len(scenario.patches)
    headings, plots = [], []
    for fault in faults:
        if fault["kind"] == "sensor":
            headings.append("Faulty sensor")
            plots += _of_channel(str(fault.get("channel", "")))
    for rule in _RULES:
        if any(kind in rule.kinds for kind in kinds):
            headings.append(rule.heading)
            plots += rule.plots
    slopes = scenario.scene is not None or "slope" in kinds
    path = "path_error_max" in scenario.metric_units
    if not plots and slopes:
        headings, plots = ["Load on slopes"], ["normal_force", "current"]
    elif not plots and path:
        headings, plots = ["Heading and wheels"], ["heading", "wheel_speed"]
    wheels = sorted({int(fault["wheel"]) for fault in faults if fault.get("wheel") is not None})
    heading = headings[0] if headings else ""
    return Focus(heading, tuple(dict.fromkeys(plots)), tuple(wheels), path, slopes)


def _of_channel(channel: str) -> tuple[str, ...]:
    """Return the plots of a sensor channel, such as `wheel_speed` for `wheel_speed_2`."""
    name, _, number = channel.rpartition("_")
    return _CHANNELS.get(channel) or ((name,) if number.isdecimal() else (channel,))


Point = tuple[float, float, float]
Range = tuple[float, float]
_BOLD = 3.2  # [points] lines of wheels in focus
_THIN = 1.0  # [points] lines of targets and thresholds
_NEWEST = 20.0  # [s] visible of a drive without a planned end


@dataclass(frozen=True)
class Eye:
    """Camera of a 3D view."""

    position: Point
    """Position of the camera [m]."""
    target: Point
    """Point in the middle of the view [m]."""
    follows: str | None = None
    """Entity that the camera follows; None for a fixed camera."""


def run_blueprint(
    plots: Sequence[Plot],
    duration: float | None,
    eye: Eye,
    ranges: Sequence[Range] | None = None,
    lanes: Sequence[str] | None = None,
    subject: Focus | None = None,
    above: Eye | None = None,
) -> rrb.Blueprint:
    """Arrange the views: machine on the left, fault states and legend below it, signals on the right.

    The plots in focus (`subject`) are in the first tab. Without `duration` [s] the drive has no planned end,
    and without `ranges`, one per plot, it is in progress and its axes grow. `lanes` None means all, and
    `above` is the view of the path from above.
    """
    time_axis = _newest() if duration is None else whole_axis(duration)
    panel = "playing" if duration is not None else "following"
    scene: rrb.View | rrb.Container = scene_view("Machine, floor, paths and forces", eye)
    if above is not None:
        path = scene_view("Path from above", above, (0, 1, 0))
        scene = rrb.Horizontal(path, scene, column_shares=[1, 1])
    if lanes is None:
        lanes = [f"/{entity}/**" for entity in (FAULT_LANE, DIAGNOSIS_LANE, MODE_LANE)]
    name = "Faults: truth, and diagnoses of the controller"
    states = rrb.StateTimelineView(origin="/", contents=list(lanes), name=name, time_view=time_axis)
    words = rrb.TextDocumentView(origin="about", name="Legend")
    values = [None] * len(plots) if ranges is None else ranges
    shown = list(zip(plots, values, strict=True))
    series = _series_views(shown, time_axis, Focus() if subject is None else subject)
    left = rrb.Vertical(scene, rrb.Horizontal(states, words, column_shares=[3, 2]), row_shares=[2, 1])
    return arranged(left, series, play_state=panel, loop_mode="off" if duration is None else "all")


def arranged(
    left: rrb.View | rrb.Container, right: rrb.View | rrb.Container, timeline: str = "time", **playback: Any
) -> rrb.Blueprint:
    """Arrange views of the machine on the left and plots on the right, without panels.

    The timeline plays by the options of the time panel, in a loop without any.
    """
    panel = {"play_state": "playing", "loop_mode": "all", **playback}
    return rrb.Blueprint(
        rrb.Horizontal(left, right, column_shares=[3, 2]),
        rrb.TimePanel(state="collapsed", timeline=timeline, **panel),
        rrb.BlueprintPanel(state="hidden"),
        rrb.SelectionPanel(state="hidden"),
    )


def scene_view(name: str, eye: Eye, up: Point = (0, 0, 1)) -> rrb.Spatial3DView:
    """Make the view of the world from a camera."""
    return rrb.Spatial3DView(
        origin="world",
        name=name,
        background=(238, 241, 245),
        line_grid=False,
        eye_controls=rrb.EyeControls3D(
            kind=rrb.Eye3DKind.Orbital,
            position=eye.position,
            look_target=eye.target,
            eye_up=up,
            tracking_entity=eye.follows,
        ),
    )


def _series_views(
    shown: Sequence[tuple[Plot, Range | None]], time_axis: rrb.archetypes.TimeAxis, subject: Focus
) -> rrb.Container:
    """Make tabs for plots in focus, residuals of the method and signals of the machine, each plot once."""
    names = [f"plots/{name}" for name in subject.plots]
    first = sorted((s for s in shown if s[0].entity in names), key=lambda s: names.index(s[0].entity))
    rest = [s for s in shown if s[0].entity not in names]
    tabs = [
        (subject.heading, first, subject.wheels),
        ("What the method saw", [s for s in rest if s[0].of_diagnosis], ()),
        ("What the machine did", [s for s in rest if not s[0].of_diagnosis], ()),
    ]
    stacks = [_stack(plots, time_axis, name, bold) for name, plots, bold in tabs if plots]
    return stacks[0] if len(stacks) == 1 else rrb.Tabs(*stacks, active_tab=0)


def _stack(
    plots: Sequence[tuple[Plot, Range | None]],
    time_axis: rrb.archetypes.TimeAxis,
    name: str,
    bold: Sequence[int] = (),
) -> rrb.Vertical:
    """Stack time series; those with a legend are taller, and lines of the wheels `bold` are bold."""
    series = [_series(plot, time_axis, shown, bold) for plot, shown in plots]
    return rrb.Vertical(*series, row_shares=[2.0 if plot.legend else 1.4 for plot, _ in plots], name=name)


def _series(
    plot: Plot, time_axis: rrb.archetypes.TimeAxis, shown: Range | None, bold: Sequence[int] = ()
) -> rrb.TimeSeriesView:
    ends = tuple(f"_{wheel}" for wheel in bold)
    widths = (
        [_BOLD if line.column.endswith(ends) and line.width > _THIN else line.width for line in plot.lines]
        if bold
        else []
    )
    style: Any = {plot.entity: rr.SeriesLines.from_fields(widths=widths)} if _BOLD in widths else None
    return rrb.TimeSeriesView(
        origin=plot.entity,
        name=plot.heading,
        overrides=style,
        axis_x=time_axis,
        axis_y=None if shown is None else rrb.ScalarAxis(range=shown),
        plot_legend=rrb.PlotLegend(visible=plot.legend, corner=rrb.Corner2D.RightTop),
    )


def whole_axis(duration: float) -> rrb.archetypes.TimeAxis:
    """Make a time axis over the whole run."""
    start, end = rrb.TimeRangeBoundary.absolute(seconds=0.0), rrb.TimeRangeBoundary.absolute(seconds=duration)
    return rrb.TimeAxis(view_range=rr.TimeRange(start=start, end=end))


def _newest() -> rrb.archetypes.TimeAxis:
    """Make a time axis that follows the newest data."""
    start = rrb.TimeRangeBoundary.cursor_relative(seconds=-_NEWEST)
    return rrb.TimeAxis(view_range=rr.TimeRange(start=start, end=rrb.TimeRangeBoundary.cursor_relative()))
