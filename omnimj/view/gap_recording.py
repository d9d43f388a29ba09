"""`before_after.rrd`: both simulations beside the measured motion, a timeline for every run that is shown."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
import rerun as rr
import rerun.blueprint as rrb

from omnimj.gap import sentences
from omnimj.gap.per_run import has_after, noise_row, run_gaps
from omnimj.gap.records import Finding, Overlay
from omnimj.signals import Array
from omnimj.view import palette
from omnimj.view.gap_scenes import COLORS, Scene, log_place, make_scene, offset, shown_runs
from omnimj.view.rerun_scene import log_floor
from omnimj.view.timeline import time_column

_PLOTS = 7


def write_before_after(path: Path, finding: Finding, machine_file: Path | None = None) -> None:
    """Writes the recording: the worst held-out runs, each on its own timeline.

    Args:
      path: The `.rrd` file to write.
      finding: With overlays of at least one run.
      machine_file: The plant's model file, for what it looks like; the shipped one when None.
    """
    # an application of its own: the viewer keeps one arrangement per application, and runs are its timelines
    stream = rr.RecordingStream(f"omnimj_gap_{sentences.dataset_name(finding)}")
    stream.save(path)
    shown = shown_runs(finding)
    kinds = tuple(kind for kind in COLORS if kind != "after" or has_after(finding))
    plots = _plotted(finding, shown)
    scene = make_scene(stream, finding, kinds, machine_file)
    stream.send_blueprint(_blueprint(finding, scene, shown, plots), make_active=False)
    stream.send_recording_name(f"Gap of {sentences.dataset_name(finding)}")
    stream.log("world", rr.ViewCoordinates.RIGHT_HAND_Z_UP, static=True)
    words = rr.TextDocument(_about(finding, shown, kinds), media_type="text/markdown")
    stream.log("about", words, static=True)
    for kind in kinds:
        log_place(stream, scene, kind)
    offsets = np.array([[0.0, offset(scene, kind)] for kind in kinds])
    corners = (scene.floor[:, None, :] + offsets[None, :, :]).reshape(-1, 2)
    log_floor(stream, corners, (), "floor")
    _log_styles(stream, finding, kinds, plots)
    for run, windows in shown.items():
        motion = scene.motion(windows)
        for kind in kinds:
            scene.log(kind, motion, run)
        _log_signals(stream, finding, run, windows, kinds, plots)
    stream.disconnect()


def _plotted(finding: Finding, shown: Mapping[str, Sequence[Overlay]]) -> list[int]:
    """The channels that are plotted: all, or those with the largest mismatch where there are many."""
    names = list(finding.channels)
    size = {
        gap.run: np.array([gap.before[name] for name in names]) / noise_row(finding)
        for gap in run_gaps(finding)
    }
    largest = np.max([np.nan_to_num(size[run]) for run in shown], axis=0)
    return sorted(np.argsort(-largest, kind="stable")[:_PLOTS].tolist())


def _log_styles(
    stream: rr.RecordingStream, finding: Finding, kinds: Sequence[str], plots: Sequence[int]
) -> None:
    order = ("measured", *(kind for kind in kinds if kind != "measured"))
    widths = {"measured": 3.0, "before": 1.5, "after": 1.5}
    names = list(finding.channels)
    for c in plots:
        style = rr.SeriesLines(
            colors=[palette.rgb(COLORS[kind]) for kind in order],
            names=list(order),
            widths=[widths[kind] for kind in order],
        )
        stream.log(f"plots/{names[c]}", style, static=True)
    simulated = [kind for kind in kinds if kind != "measured"]
    style = rr.SeriesLines(
        colors=[palette.rgb(COLORS[kind]) for kind in simulated],
        names=simulated,
        widths=[1.5] * len(simulated),
    )
    stream.log("plots/mismatch", style, static=True)


def _log_signals(
    stream: rr.RecordingStream,
    finding: Finding,
    run: str,
    windows: Sequence[Overlay],
    kinds: Sequence[str],
    plots: Sequence[int],
) -> None:
    order = ["measured", *(kind for kind in kinds if kind != "measured")]
    index = time_column(np.concatenate([w.time for w in windows]), run)
    values = {kind: np.concatenate([getattr(w, kind) for w in windows]) for kind in order}
    names = list(finding.channels)
    for c in plots:
        _send(stream, f"plots/{names[c]}", index, np.stack([values[kind][:, c] for kind in order], axis=1))
    noise = noise_row(finding)
    sizes = []
    for kind in order[1:]:
        relative = (values["measured"] - values[kind]) / noise
        known = np.isfinite(relative)
        squares = np.where(known, relative, 0.0) ** 2
        sizes.append(np.sqrt(squares.sum(axis=1) / np.maximum(known.sum(axis=1), 1)))
    _send(stream, "plots/mismatch", index, np.stack(sizes, axis=1))


def _send(stream: rr.RecordingStream, entity: str, index: rr.TimeColumn, rows: Array) -> None:
    columns = rr.Scalars.columns(scalars=rows.ravel())
    stream.send_columns(entity, [index], columns.partition(np.full(len(rows), rows.shape[1])))


def _about(finding: Finding, shown: Mapping[str, Sequence[Overlay]], kinds: Sequence[str]) -> str:
    lines = [f"**{sentences.headline(finding)}.** {sentences.summary(finding)}", ""]
    what = "**Orange**: before. **Grey**: measured."
    if "after" in kinds:
        what += " **Blue**: after, with what is missing added."
    lines += [what, ""]
    lines.append("Each run has its timeline: choose it below, left of the time.")
    gaps = {gap.run: gap for gap in run_gaps(finding)}
    for run in shown:
        gap = gaps[run]
        after = "" if gap.total_after is None else f" → {gap.total_after:.3g}"
        lines.append(f"- `{run}`: {gap.total_before:.3g}{after} × the noise")
    if finding.plant == "quarter_rig":
        lines += ["", "Carriage and wheel stand where their speeds have carried them from the start."]
    if finding.plant == "uto_robot":
        words = "Paths are dead reckoning by wheels and gyro, grey: measured. "
        lines += ["", f"{words}Each window begins where the measurement is."]
    return "\n".join(lines)


def _blueprint(
    finding: Finding, scene: Scene, shown: Mapping[str, Sequence[Overlay]], plots: Sequence[int]
) -> rrb.Blueprint:
    longest = max(float(windows[-1].time[-1]) for windows in shown.values())
    start = rrb.TimeRangeBoundary.absolute(seconds=0.0)
    end = rrb.TimeRangeBoundary.absolute(seconds=longest)
    axis = rrb.TimeAxis(view_range=rr.TimeRange(start=start, end=end))
    names = list(finding.channels.items())
    space = rrb.Spatial3DView(
        origin="world",
        name="Before, measured, after",
        background=(238, 241, 245),
        line_grid=False,
        eye_controls=scene.eye,
    )
    series = [
        rrb.TimeSeriesView(
            origin=f"plots/{names[c][0]}",
            name=f"{names[c][1][1].capitalize()} [{sentences.shown_unit(names[c][1][0])}]",
            axis_x=axis,
            plot_legend=rrb.PlotLegend(visible=k == 0, corner=rrb.Corner2D.RightBottom),
        )
        for k, c in enumerate(plots)
    ]
    series.append(
        rrb.TimeSeriesView(
            origin="plots/mismatch",
            name="Mismatch over all channels [multiples of the noise]",
            axis_x=axis,
            plot_legend=rrb.PlotLegend(visible=False),
        )
    )
    words = rrb.TextDocumentView(origin="about", name="What you see")
    return rrb.Blueprint(
        rrb.Horizontal(
            rrb.Vertical(space, words, row_shares=[3, 1]), rrb.Vertical(*series), column_shares=[3, 2]
        ),
        rrb.TimePanel(state="collapsed", timeline=next(iter(shown)), play_state="playing", loop_mode="all"),
        rrb.BlueprintPanel(state="hidden"),
        rrb.SelectionPanel(state="hidden"),
    )
