"""The three plants in a recording of before and after: how their machines look, stand and move."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import rerun as rr
import rerun.blueprint as rrb

from omnimj.gap.per_run import run_gaps, runs_of
from omnimj.gap.records import Finding, Overlay
from omnimj.parameters import Floor, read_floors, read_rig, read_robot
from omnimj.signals import Array
from omnimj.twin.assembly import rig_model, robot_model
from omnimj.view import gap_motion, palette
from omnimj.view.gap_drawing import AFTER, BEFORE
from omnimj.view.gap_motion import Motion
from omnimj.view.rerun_machine import Machine
from omnimj.view.scene3d import Poses
from omnimj.view.timeline import time_column

_GREY = "#A7AFB8"  # stands out from the viewer's dark plots and from its light floor
COLORS: Mapping[str, str] = {"before": BEFORE, "measured": _GREY, "after": AFTER}
_RUNS = 6
_LIGHTER = 0.55  # names stand on dark plates
_SIDES: Mapping[str, float] = {"before": 1.0, "measured": 0.0, "after": -1.0}


@dataclass(frozen=True)
class Scene:
    """A kind of plant: how its machines are seen and moved."""

    spacing: float
    """Between the machines, sideways [m]."""
    label: tuple[float, float, float]
    """Where a machine's name stands, in the frame of `named` [m]."""
    eye: rrb.EyeControls3D
    log: Callable[[str, Motion, str], None]
    """Logs where the machine of a kind was in a motion, on a timeline."""
    motion: Callable[[Sequence[Overlay]], Motion]
    floor: Array
    """Corners of what the floor must lie under, shape (k, 2) [m]."""
    named: str = ""
    """The body that carries the name; the machine's place when empty."""


def shown_runs(finding: Finding) -> dict[str, list[Overlay]]:
    """The held-out runs with the largest mismatch, the worst first; training runs where none is held out."""
    windows, gaps = runs_of(finding), run_gaps(finding)
    chosen = [gap.run for gap in gaps if gap.heldout] or [gap.run for gap in gaps]
    return {run: windows[run] for run in chosen[:_RUNS]}


def offset(scene: Scene, kind: str) -> float:
    """How far aside the machine of a kind stands [m]."""
    return scene.spacing * _SIDES[kind]


def log_place(stream: rr.RecordingStream, scene: Scene, kind: str) -> None:
    """Moves a machine aside and writes its name over it, or over what of it moves."""
    root = f"world/{kind}"
    stream.log(root, rr.Transform3D(translation=[0.0, offset(scene, kind), 0.0]), static=True)
    name = rr.Points3D(
        [scene.label],
        radii=[0.012],
        colors=[palette.rgb(palette.lighter(COLORS[kind], _LIGHTER))],
        labels=[kind],
        show_labels=True,
    )
    stream.log(f"{root}/{scene.named}/name" if scene.named else f"{root}/name", name, static=True)


def make_scene(
    stream: rr.RecordingStream, finding: Finding, kinds: Sequence[str], machine_file: Path | None
) -> Scene:
    """Logs what the machines of a finding's plant look like and says how they move.

    Args:
      stream: Where to log.
      finding: Its overlays are what moves.
      kinds: Of `COLORS`, those to show.
      machine_file: The plant's model file; the shipped one when None.
    """
    channels = list(finding.channels)
    if finding.plant == "quarter_rig":
        return _rig_scene(stream, finding, kinds, channels, machine_file)
    if finding.plant == "uto_robot":
        return _robot_scene(stream, finding, kinds, channels, machine_file)
    return _axis_scene(stream, kinds, channels, finding)


def _floor(finding: Finding) -> Floor:
    """The floor of the first run, as far as it is one of the shipped ones: here it is only seen."""
    floors = read_floors()
    names = [str(o.conditions["floor"]) for o in finding.overlays if "floor" in o.conditions]
    return next((floors[name] for name in names if name in floors), next(iter(floors.values())))


def _rig_scene(
    stream: rr.RecordingStream,
    finding: Finding,
    kinds: Sequence[str],
    channels: list[str],
    machine_file: Path | None,
) -> Scene:
    rig = read_rig(machine_file)
    mj_model = rig_model(rig, _floor(finding))
    machines = {kind: Machine(stream, mj_model, f"world/{kind}") for kind in kinds}

    def log(kind: str, motion: Motion, timeline: str) -> None:
        qpos = gap_motion.rig_poses(mj_model, motion.coordinates[kind])
        machines[kind].log_bodies(Poses(mj_model, motion.time, qpos), timeline, rollers_turn=False)

    def motion(windows: Sequence[Overlay]) -> Motion:
        return gap_motion.rig_motion(rig, windows, channels)

    reach = rig.rig.rail_length
    corners = np.array([[0.0, -0.3], [reach, 0.3]])
    eye = _eye((0.4, -2.2, 1.3), (0.8, 0.0, 0.1))
    return Scene(0.6, (0.0, 0.0, 0.16), eye, log, motion, corners, named="carriage")


def _robot_scene(
    stream: rr.RecordingStream,
    finding: Finding,
    kinds: Sequence[str],
    channels: list[str],
    machine_file: Path | None,
) -> Scene:
    robot = read_robot(machine_file)
    mj_model = robot_model(robot, _floor(finding))
    machines = {kind: Machine(stream, mj_model, f"world/{kind}") for kind in kinds}

    def log(kind: str, motion: Motion, timeline: str) -> None:
        qpos = gap_motion.robot_poses(mj_model, motion.coordinates[kind])
        machines[kind].log_bodies(Poses(mj_model, motion.time, qpos), timeline, rollers_turn=False)
        if kind != "measured":
            _log_path(stream, f"world/{kind}/measured_path", "measured", motion, timeline)
        _log_path(stream, f"world/{kind}/path", kind, motion, timeline)

    def motion(windows: Sequence[Overlay]) -> Motion:
        return gap_motion.robot_motion(robot, windows, channels)

    places = [motion(windows).coordinates["measured"][:, :2] for windows in shown_runs(finding).values()]
    corners = np.concatenate([np.zeros((1, 2)), *places])
    (x, y), (deep, wide) = 0.5 * (corners.min(axis=0) + corners.max(axis=0)), np.ptp(corners, axis=0) + 0.8
    far = max(1.4 * len(kinds) * float(wide), 1.6 * float(deep))
    eye = _eye((x - 0.62 * far, y, 0.62 * far), (x, y, 0.0))
    return Scene(float(wide), (0.0, 0.0, 0.55), eye, log, motion, corners, named="chassis")


def _log_path(stream: rr.RecordingStream, entity: str, kind: str, motion: Motion, timeline: str) -> None:
    """The whole path as a line of its own per window: the eye then sees by how much two paths part."""
    place = motion.coordinates[kind][:, :2]
    lift = 0.004 if kind == "measured" else 0.008
    points = np.column_stack([place, np.full(len(place), lift)]).astype(np.float32)
    strips = np.split(points, motion.begins[1:])
    radius = 0.008 if kind == "measured" else 0.012
    style = rr.LineStrips3D.from_fields(colors=[palette.rgb(COLORS[kind])], radii=[radius])
    stream.log(entity, style, static=True)
    columns = rr.LineStrips3D.columns(strips=strips)
    index = time_column(motion.time[:1], timeline)
    stream.send_columns(entity, [index], columns.partition(np.array([len(strips)])))


def _axis_scene(
    stream: rr.RecordingStream, kinds: Sequence[str], channels: list[str], finding: Finding
) -> Scene:
    def motion(windows: Sequence[Overlay]) -> Motion:
        return gap_motion.axis_motion(windows, channels)

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
    eye = _eye((middle, -2.0 * half - 4.0 * size, 1.5 * half), (middle, 0.0, 0.0))
    return Scene(4.0 * size, (low - 0.1, 0.0, 2.5 * size), eye, log, motion, corners)


def _eye(position: tuple[float, float, float], target: tuple[float, float, float]) -> rrb.EyeControls3D:
    kind = rrb.Eye3DKind.Orbital
    return rrb.EyeControls3D(kind=kind, position=position, look_target=target, eye_up=(0, 0, 1))
