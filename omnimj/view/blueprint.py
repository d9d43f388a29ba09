"""How the Rerun viewer arranges a recording, so that a stranger understands it at first sight."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import rerun as rr
import rerun.blueprint as rrb

from omnimj.view.rerun_signals import Plot
from omnimj.view.rerun_states import BELIEF, MODE, TRUTH
from omnimj.view.subject import Subject

Point = tuple[float, float, float]
Range = tuple[float, float]
_BOLD = 3.2  # points of the line of a wheel that the scenario is about
_THIN = 1.0  # points of targets and thresholds, which stay thin
_NEWEST = 20.0  # [s] that are seen of a drive without a planned end


@dataclass(frozen=True)
class Eye:
    """Where a spectator stands at first."""

    position: Point
    """[m]"""
    target: Point
    """What is looked at [m]."""
    follows: str | None = None
    """Entity to stay with; None to stand still."""


def run_blueprint(
    plots: Sequence[Plot],
    duration: float | None,
    eye: Eye,
    ranges: Sequence[Range] | None = None,
    lanes: Sequence[str] | None = None,
    subject: Subject | None = None,
    above: Eye | None = None,
) -> rrb.Blueprint:
    """Left the machine, below it the fault states and a legend; right the signals over the same time.

    What the scenario is about comes first: its plots in the first tab, its path from above.

    Args:
      plots: The time series, from top to bottom.
      duration: Of the whole run [s]; None for a drive without a planned end, whose newest is followed.
      eye: First view of the scene.
      ranges: Of the value axes, one per plot; None for a run that goes on, whose axes grow.
      lanes: Of the fault states; None for all.
      subject: What the scenario is about; None where nothing is more to the point than all else.
      above: View of the path from above; None to leave it out.
    """
    time_axis = _newest() if duration is None else _whole(duration)
    panel = "playing" if duration is not None else "following"
    scene: rrb.View | rrb.Container = _scene("Machine, floor, paths and forces", eye, (0, 0, 1))
    if above is not None:
        path = _scene("Path from above", above, (0, 1, 0))
        scene = rrb.Horizontal(path, scene, column_shares=[1, 1])
    if lanes is None:
        lanes = [f"/{entity}/**" for entity in (TRUTH, BELIEF, MODE)]
    name = "Faults: what is broken, and what the controller diagnosed"
    states = rrb.StateTimelineView(origin="/", contents=list(lanes), name=name, time_view=time_axis)
    words = rrb.TextDocumentView(origin="about", name="What you see")
    values = [None] * len(plots) if ranges is None else ranges
    shown = list(zip(plots, values, strict=True))
    series = _series_views(shown, time_axis, Subject() if subject is None else subject)
    return rrb.Blueprint(
        rrb.Horizontal(
            rrb.Vertical(scene, rrb.Horizontal(states, words, column_shares=[3, 2]), row_shares=[2, 1]),
            series,
            column_shares=[3, 2],
        ),
        rrb.TimePanel(
            state="collapsed",
            timeline="time",
            play_state=panel,
            loop_mode="off" if duration is None else "all",
        ),
        rrb.BlueprintPanel(state="hidden"),
        rrb.SelectionPanel(state="hidden"),
    )


def _scene(name: str, eye: Eye, up: Point) -> rrb.Spatial3DView:
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
    shown: Sequence[tuple[Plot, Range | None]], time_axis: rrb.archetypes.TimeAxis, subject: Subject
) -> rrb.Container:
    """Tabs: what the scenario is about, what the method saw, what the machine did; no plot twice."""
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
    """Time series under each other; those with a legend are higher, lines of the wheels `bold` are bold."""
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


def _whole(duration: float) -> rrb.archetypes.TimeAxis:
    """The whole run at once."""
    start, end = rrb.TimeRangeBoundary.absolute(seconds=0.0), rrb.TimeRangeBoundary.absolute(seconds=duration)
    return rrb.TimeAxis(view_range=rr.TimeRange(start=start, end=end))


def _newest() -> rrb.archetypes.TimeAxis:
    """What was last."""
    start = rrb.TimeRangeBoundary.cursor_relative(seconds=-_NEWEST)
    return rrb.TimeAxis(view_range=rr.TimeRange(start=start, end=rrb.TimeRangeBoundary.cursor_relative()))
