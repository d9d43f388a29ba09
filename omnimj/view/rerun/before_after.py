"""`before_after.rrd`: simulations before and after beside the measured motion, a timeline per run."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import mujoco
import numpy as np
import rerun as rr
import rerun.blueprint as rrb

from omnimj.estimate.gap import sentences
from omnimj.estimate.gap.records import (
    Finding,
    Overlay,
    has_second_model,
    noise_row,
    overlays_by_run,
    run_gaps,
)
from omnimj.parameters import Floor, read_floors, read_rig, read_robot
from omnimj.plant.mujoco.assembly import rig_model, robot_model
from omnimj.signals import Array
from omnimj.view import palette
from omnimj.view.poses import Poses, robot_poses
from omnimj.view.rerun import dead_reckoning
from omnimj.view.rerun.blueprint import Eye, arranged, scene_view, whole_axis
from omnimj.view.rerun.dead_reckoning import Motion
from omnimj.view.rerun.scene import (
    MEASURED,
    Machine,
    begin_recording,
    log_floor,
    log_name,
    on_floor,
    recording_file,
    time_column,
)
from omnimj.view.rerun.signals import Line, log_rows, log_styles

COLORS: Mapping[str, str] = {"before": palette.BEFORE, "measured": MEASURED, "after": palette.AFTER}
_RUNS = 6
_SIDES: Mapping[str, float] = {"before": 1.0, "measured": 0.0, "after": -1.0}


@dataclass(frozen=True)
class Scene:
    """Machines of one kind of plant: appearance, motion and camera."""

    spacing: float
    """Lateral distance between the machines [m]."""
    label: tuple[float, float, float]
    """Position of the machine's name in the frame of the body `named` [m]."""
    eye: Eye
    log: Callable[[str, Motion, str], None]
    """Function that logs the motion of one machine on a timeline."""
    motion: Callable[[Sequence[Overlay]], Motion]
    floor: Array
    """Points that the floor must cover, shape (k, 2) [m]."""
    named: str = ""
    """Body that carries the name; empty for the machine's base."""


def has_scene(plant: str) -> bool:
    """Return whether the machines of a plant can be shown."""
    return plant in ("quarter_rig", "uto_robot", "linear_axis")


def shown_runs(finding: Finding) -> dict[str, list[Overlay]]:
    """Return the held-out runs with the largest mismatch, worst first; training runs if none is held out."""
    windows, gaps = overlays_by_run(finding), run_gaps(finding)
    chosen = [gap.run for gap in gaps if gap.heldout] or [gap.run for gap in gaps]
    return {run: windows[run] for run in chosen[:_RUNS]}


def offset(scene: Scene, kind: str) -> float:
    """Return the lateral offset of a machine in the scene [m]."""
    return scene.spacing * _SIDES[kind]


def log_place(stream: rr.RecordingStream, scene: Scene, kind: str) -> None:
    """Log the lateral offset of a machine and the name above it, a key of `COLORS`."""
    root = f"world/{kind}"
    stream.log(root, rr.Transform3D(translation=[0.0, offset(scene, kind), 0.0]), static=True)
    carrier = f"{root}/{scene.named}" if scene.named else root
    log_name(stream, carrier, scene.label, kind, COLORS[kind])


def make_scene(
    stream: rr.RecordingStream, finding: Finding, kinds: Sequence[str], machine_file: Path | None
) -> Scene:
    """Log the meshes of the machines and return the scene, which logs their motion."""
    if finding.plant == "quarter_rig":
        return _rig_scene(stream, finding, kinds, machine_file)
    if finding.plant == "uto_robot":
        return _robot_scene(stream, finding, kinds, machine_file)
    return _axis_scene(stream, kinds, finding)


def _floor(finding: Finding) -> Floor:
    """Return the first shipped floor of a run, else a default; for display only."""
    floors = read_floors()
    names = [str(o.conditions["floor"]) for o in finding.overlays if "floor" in o.conditions]
    return next((floors[name] for name in names if name in floors), next(iter(floors.values())))


def _body_logger(
    stream: rr.RecordingStream,
    mj_model: mujoco.MjModel,
    kinds: Sequence[str],
    poses: Callable[[mujoco.MjModel, Array], Array],
) -> Callable[[str, Motion, str], None]:
    """Log the meshes of a machine for each kind; return the function that logs the motion of its bodies."""
    machines = {kind: Machine(stream, mj_model, f"world/{kind}") for kind in kinds}

    def log(kind: str, motion: Motion, timeline: str) -> None:
        qpos = poses(mj_model, motion.coordinates[kind])
        machines[kind].log_bodies(Poses(mj_model, motion.time, qpos), timeline, rollers_turn=False)

    return log


def _rig_scene(
    stream: rr.RecordingStream, finding: Finding, kinds: Sequence[str], machine_file: Path | None
) -> Scene:
    rig = read_rig(machine_file)
    log = _body_logger(stream, rig_model(rig, _floor(finding)), kinds, dead_reckoning.rig_poses)

    def motion(windows: Sequence[Overlay]) -> Motion:
        return dead_reckoning.rig_motion(rig, windows, list(finding.channels))

    reach = rig.rig.rail_length
    corners = np.array([[0.0, -0.3], [reach, 0.3]])
    eye = Eye((0.4, -2.2, 1.3), (0.8, 0.0, 0.1))
    return Scene(0.6, (0.0, 0.0, 0.16), eye, log, motion, corners, named="carriage")


def _robot_scene(
    stream: rr.RecordingStream, finding: Finding, kinds: Sequence[str], machine_file: Path | None
) -> Scene:
    robot = read_robot(machine_file)
    log_bodies = _body_logger(stream, robot_model(robot, _floor(finding)), kinds, robot_poses)

    def log(kind: str, motion: Motion, timeline: str) -> None:
        log_bodies(kind, motion, timeline)
        if kind != "measured":
            _log_path(stream, f"world/{kind}/measured_path", "measured", motion, timeline)
        _log_path(stream, f"world/{kind}/path", kind, motion, timeline)

    def motion(windows: Sequence[Overlay]) -> Motion:
        return dead_reckoning.robot_motion(robot, windows, list(finding.channels))

    places = [motion(windows).coordinates["measured"][:, :2] for windows in shown_runs(finding).values()]
    corners = np.concatenate([np.zeros((1, 2)), *places])
    (x, y), (deep, wide) = 0.5 * (corners.min(axis=0) + corners.max(axis=0)), np.ptp(corners, axis=0) + 0.8
    far = max(1.4 * len(kinds) * float(wide), 1.6 * float(deep))
    eye = Eye((x - 0.62 * far, y, 0.62 * far), (x, y, 0.0))
    return Scene(float(wide), (0.0, 0.0, 0.55), eye, log, motion, corners, named="chassis")


def _log_path(stream: rr.RecordingStream, entity: str, kind: str, motion: Motion, timeline: str) -> None:
    """Log the whole path as one line per window, which shows the distance between paths."""
    lift, radius = (0.004, 0.008) if kind == "measured" else (0.008, 0.012)
    strips = np.split(on_floor(motion.coordinates[kind][:, :2], lift), motion.begins[1:])
    style = rr.LineStrips3D.from_fields(colors=[palette.rgb(COLORS[kind])], radii=[radius])
    stream.log(entity, style, static=True)
    columns = rr.LineStrips3D.columns(strips=strips)
    index = time_column(motion.time[:1], timeline)
    stream.send_columns(entity, [index], columns.partition(np.array([len(strips)])))


def _axis_scene(stream: rr.RecordingStream, kinds: Sequence[str], finding: Finding) -> Scene:
    def motion(windows: Sequence[Overlay]) -> Motion:
        return dead_reckoning.axis_motion(windows, list(finding.channels))

    places = [motion(windows).coordinates["measured"] for windows in shown_runs(finding).values()]
    low, high = (float(f(np.concatenate(places))) for f in (np.min, np.max)) if places else (0.0, 1.0)
    middle, half = 0.5 * (low + high), 0.5 * (high - low) + 0.1
    size = min(max(0.12 * half, 0.02), 0.2)
    for kind in kinds:
        guide = rr.Boxes3D(
            centers=[[middle, 0.0, 0.3 * size]],
            half_sizes=[[half, 0.5 * size, 0.3 * size]],
            colors=[(150, 155, 162)],
            fill_mode="solid",
        )
        stream.log(f"world/{kind}/guide", guide, static=True)
        box = rr.Boxes3D(
            centers=[[0.0, 0.0, 1.4 * size]],
            half_sizes=[[size, size, 0.8 * size]],
            colors=[palette.rgb(COLORS[kind])],
            fill_mode="solid",
        )
        stream.log(f"world/{kind}/carriage", box, static=True)

    def log(kind: str, motion: Motion, timeline: str) -> None:
        place = motion.coordinates[kind][:, 0]
        moved = np.column_stack([place, np.zeros((len(place), 2))]).astype(np.float32)
        columns = rr.Transform3D.columns(translation=moved)
        stream.send_columns(f"world/{kind}/carriage", [time_column(motion.time, timeline)], columns)

    corners = np.array([[low - 0.1, -size], [high + 0.1, size]])
    eye = Eye((middle, -2.0 * half - 4.0 * size, 1.5 * half), (middle, 0.0, 0.0))
    return Scene(4.0 * size, (low - 0.1, 0.0, 2.5 * size), eye, log, motion, corners)


_PLOTS = 7


def write_before_after(path: Path, finding: Finding, machine_file: Path | None = None) -> None:
    """Write the recording: the worst held-out runs, each on its own timeline, looking as in a model file."""
    # a separate application id, since the viewer keeps one layout per application
    with recording_file(path, f"omnimj_gap_{sentences.dataset_name(finding)}") as stream:
        shown = shown_runs(finding)
        kinds = tuple(kind for kind in COLORS if kind != "after" or has_second_model(finding))
        plots = _plotted(finding, shown)
        scene = make_scene(stream, finding, kinds, machine_file)
        stream.send_blueprint(_blueprint(finding, scene, shown, plots), make_active=False)
        begin_recording(stream, f"Gap of {sentences.dataset_name(finding)}")
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


def _plotted(finding: Finding, shown: Mapping[str, Sequence[Overlay]]) -> list[int]:
    """Return the channels to plot: all, or if many, those with the largest mismatch."""
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
    simulated = [Line(kind, kind, COLORS[kind], width=1.5) for kind in kinds if kind != "measured"]
    names = list(finding.channels)
    for c in plots:
        lines = [Line("measured", "measured", MEASURED, width=3.0), *simulated]
        log_styles(stream, f"plots/{names[c]}", lines)
    log_styles(stream, "plots/mismatch", simulated)


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
        rows = np.stack([values[kind][:, c] for kind in order], axis=1)
        log_rows(stream, f"plots/{names[c]}", index, rows)
    noise = noise_row(finding)
    sizes = []
    for kind in order[1:]:
        relative = (values["measured"] - values[kind]) / noise
        known = np.isfinite(relative)
        squares = np.where(known, relative, 0.0) ** 2
        sizes.append(np.sqrt(squares.sum(axis=1) / np.maximum(known.sum(axis=1), 1)))
    log_rows(stream, "plots/mismatch", index, np.stack(sizes, axis=1))


def _about(finding: Finding, shown: Mapping[str, Sequence[Overlay]], kinds: Sequence[str]) -> str:
    lines = [f"**{sentences.headline(finding)}.** {sentences.summarize_finding(finding)}", ""]
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
    axis = whole_axis(max(float(windows[-1].time[-1]) for windows in shown.values()))
    names = list(finding.channels.items())
    series = [
        rrb.TimeSeriesView(
            origin=f"plots/{names[c][0]}",
            name=f"{names[c][1][1].capitalize()} [{sentences.format_unit(names[c][1][0])}]",
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
    words = rrb.TextDocumentView(origin="about", name="Legend")
    left = rrb.Vertical(scene_view("Before, measured, after", scene.eye), words, row_shares=[3, 1])
    return arranged(left, rrb.Vertical(*series), timeline=next(iter(shown)))
