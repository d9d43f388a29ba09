"""How the Rerun viewer arranges a recording, so that a stranger understands it at first sight."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import rerun as rr
import rerun.blueprint as rrb

from omnimj.view.rerun_signals import Plot
from omnimj.view.rerun_states import BELIEF, MODE, TRUTH

Point = tuple[float, float, float]
Range = tuple[float, float]
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
) -> rrb.Blueprint:
    """Left the machine, below it the fault states and a legend; right the signals over the same time.

    Args:
      plots: The time series, from top to bottom.
      duration: Of the whole run [s]; None for a drive without a planned end, whose newest is followed.
      eye: First view of the scene.
      ranges: Of the value axes, one per plot; None for a run that goes on, whose axes grow.
      lanes: Of the fault states; None for all.
    """
    time_axis = _newest() if duration is None else _whole(duration)
    panel = "playing" if duration is not None else "following"
    scene = rrb.Spatial3DView(
        origin="world",
        name="Machine, floor, paths and forces",
        background=(238, 241, 245),
        line_grid=False,
        eye_controls=rrb.EyeControls3D(
            kind=rrb.Eye3DKind.Orbital,
            position=eye.position,
            look_target=eye.target,
            eye_up=(0, 0, 1),
            tracking_entity=eye.follows,
        ),
    )
    if lanes is None:
        lanes = [f"/{entity}/**" for entity in (TRUTH, BELIEF, MODE)]
    name = "Faults: what is broken, and what the controller diagnosed"
    states = rrb.StateTimelineView(origin="/", contents=list(lanes), name=name, time_view=time_axis)
    words = rrb.TextDocumentView(origin="about", name="What you see")
    values = [None] * len(plots) if ranges is None else ranges
    shown = list(zip(plots, values, strict=True))
    signals = _stack([(p, r) for p, r in shown if not p.of_diagnosis], time_axis, "What the machine did")
    seen = [(p, r) for p, r in shown if p.of_diagnosis]
    # residuals stand beside the fault states; what the machine did is one click away
    series = rrb.Tabs(_stack(seen, time_axis, "What the method saw"), signals) if seen else signals
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


def _stack(
    plots: Sequence[tuple[Plot, Range | None]], time_axis: rrb.archetypes.TimeAxis, name: str
) -> rrb.Vertical:
    """Time series under each other; those with a legend are higher."""
    series = [_series(plot, time_axis, shown) for plot, shown in plots]
    return rrb.Vertical(*series, row_shares=[2.0 if plot.legend else 1.4 for plot, _ in plots], name=name)


def _series(plot: Plot, time_axis: rrb.archetypes.TimeAxis, shown: Range | None) -> rrb.TimeSeriesView:
    return rrb.TimeSeriesView(
        origin=plot.entity,
        name=plot.heading,
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
