"""Scene of a Rerun recording: machine with contact forces, floor, planned and driven path."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
import rerun as rr
from numpy.typing import NDArray

from omnimj.recording.folder import atomic_file
from omnimj.signals import Array, Trace
from omnimj.view import palette
from omnimj.view.motion import patch_corners
from omnimj.view.poses import (
    BodyFrames,
    Poses,
    body_frames,
    hinge_axis,
    identical_bodies,
    relative_frames,
    wheel_axles,
    wheel_bodies,
)
from omnimj.view.rerun.meshes import (
    Appearance,
    appearance_key,
    body_appearance,
    obstacle_appearance,
    striped,
)

RATE = 50.0
"""Poses per second in the recording."""
TRACTION_SCALE, NORMAL_SCALE = 0.02, 0.005
"""Lengths of force arrows [m/N], larger for traction, which is the smaller force."""
MACHINE, FORCES, OBSTACLES = "world/machine", "world/forces", "world/obstacles"
AROUND = "around"
"""Entity of invisible points around a free body, which set the zoom of a camera that follows it."""
_REACH = np.array([0.42, 0.42, 0.17])  # [m] extent of these points
_ARROW_RADIUS = 0.007
_UP = np.array([0.0, 0.0, 1.0])
MEASURED = "#A7AFB8"
"""Colour of a measured machine, visible on dark plots and on the light floor."""
_LIGHTER = 0.55  # for names on dark plates
FLOOR, PATH = "world/floor", "world/path"
_TRAIL_STEPS, _TRAIL_POINTS = 120, 240
_TILE = 0.25  # [m] width of a tile
_MOST_TILES = 512  # tiles along a side: a run that diverged may end anywhere
_MARGIN = 0.6  # [m] of floor around all motion


def time_column(time: Array, timeline: str = "time") -> rr.TimeColumn:
    """Make the index of simulated time, shape (k,) [s]; a recording of several runs has one for each."""
    whole = np.round(1e9 * np.asarray(time)).astype("timedelta64[ns]")  # else 4.0999… is truncated
    return rr.TimeColumn(timeline, duration=whole)


def begin_recording(stream: rr.RecordingStream, title: str) -> None:
    """Give a recording its title, and the world its vertical axis."""
    stream.send_recording_name(title)
    stream.log("world", rr.ViewCoordinates.RIGHT_HAND_Z_UP, static=True)


def log_name(
    stream: rr.RecordingStream, entity: str, place: Sequence[float] | Array, name: str, color: str
) -> None:
    """Log the name of a machine in a lighter shade of its colour at a place in the frame of an entity [m]."""
    shade = palette.rgb(palette.lighter(color, _LIGHTER))
    label = rr.Points3D([place], radii=[0.012], colors=[shade], labels=[name], show_labels=True)
    stream.log(f"{entity}/name", label, static=True)


def body_entity(name: str, root: str = MACHINE) -> str:
    """Return the entity of a body: `world/machine/wheel_1` for `wheel_1_wheel`."""
    return f"{root}/{name.removesuffix('_wheel')}"


class Machine:
    """Visible bodies of a model; identical rollers of a wheel are instances of one mesh."""

    def __init__(self, stream: rr.RecordingStream, mj_model: mujoco.MjModel, root: str = MACHINE):
        """Log the meshes of the bodies below the entity `root`, without poses."""
        self._stream, self._mj_model, self._root = stream, mj_model, root
        self._groups = identical_bodies(mj_model)
        self._wheels = wheel_bodies(mj_model, self._groups)
        grouped = {body for bodies in self._groups for body in bodies}
        self._bodies: list[int] = []
        looks: dict[bytes, Appearance | None] = {}  # identical corners and wheels share a mesh
        for body in sorted(set(range(1, mj_model.nbody)) - grouped):
            key = appearance_key(mj_model, body)
            look = looks[key] if key in looks else looks.setdefault(key, body_appearance(mj_model, body))
            if look is not None:
                self._bodies.append(body)
                _log_mesh(stream, f"{self._entity(body)}/surface", look)
        for bodies in self._groups:
            look, axis = body_appearance(mj_model, bodies[0]), hinge_axis(mj_model, bodies[0])
            if look is not None:
                _log_mesh(stream, self._rollers(bodies), look if axis is None else striped(look, axis))
        obstacles = obstacle_appearance(mj_model)
        if obstacles is not None:
            _log_mesh(stream, OBSTACLES, obstacles)
        for body in self._bodies:
            first = mj_model.body_jntadr[body]
            if first >= 0 and mj_model.jnt_type[first] == mujoco.mjtJoint.mjJNT_FREE:
                # the viewer zooms in until the followed entity fills the view
                unseen = rr.Points3D([-_REACH, _REACH], radii=[0.0], colors=[(0, 0, 0, 0)])
                stream.log(f"{self._entity(body)}/{AROUND}", unseen, static=True)

    def _entity(self, body: int) -> str:
        return body_entity(self._mj_model.body(body).name, self._root)

    def _rollers(self, bodies: list[int]) -> str:
        return f"{self._entity(int(self._mj_model.body_parentid[bodies[0]]))}/rollers"

    def log_motion(self, poses: Poses, trace: Trace) -> None:
        """Log body poses and contact forces."""
        poses = poses.thinned(RATE)
        frames = self.log_bodies(poses)
        self._log_forces(poses, frames, trace)

    def log_bodies(self, poses: Poses, timeline: str = "time", rollers_turn: bool = True) -> BodyFrames:
        """Log body poses, at least one.

        Rollers whose angles are unknown are logged once, at rest in their wheel.
        """
        frames = body_frames(poses)
        index = time_column(frames.time, timeline)
        for body in self._bodies:
            columns = rr.Transform3D.columns(
                translation=frames.position[:, body].astype(np.float32),
                quaternion=_xyzw(frames.quaternion[:, body]),
            )
            self._stream.send_columns(self._entity(body), [index], columns)
        for bodies in self._groups:
            parent = int(self._mj_model.body_parentid[bodies[0]])
            position, quaternion = relative_frames(frames, bodies, parent)
            rows = len(frames.time) if rollers_turn else 1
            columns = rr.InstancePoses3D.columns(
                translations=position[:rows].reshape(-1, 3).astype(np.float32),
                quaternions=_xyzw(quaternion[:rows].reshape(-1, 4)),
            )
            moments = time_column(frames.time[:rows], timeline)
            lengths = np.full(rows, len(bodies))
            self._stream.send_columns(self._rollers(bodies), [moments], columns.partition(lengths))
        return frames

    def _log_forces(self, poses: Poses, frames: BodyFrames, trace: Trace) -> None:
        """Log arrows at the wheel contacts: traction along the driving direction, normal force upwards."""
        wheels = [body for i, body in enumerate(self._wheels, 1) if f"traction_force_{i}" in trace]
        if not wheels:
            return
        ahead = np.cross(wheel_axles(poses, frames, wheels), _UP)
        ahead /= np.linalg.norm(ahead, axis=-1, keepdims=True)
        rows = np.clip(np.searchsorted(trace["time"], frames.time - 1e-9), 0, len(trace["time"]) - 1)
        traction = trace.wheels("traction_force")[rows, : len(wheels), None] * ahead
        normal = trace.wheels("normal_force")[rows, : len(wheels), None] * _UP
        standing = frames.position[:1, wheels, 2:]  # height of a wheel above the floor, which may slope
        foot = frames.position[:, wheels] - (standing - _ARROW_RADIUS) * _UP
        self._log_arrows("traction", frames.time, foot, TRACTION_SCALE * traction, palette.TRACTION)
        self._log_arrows("normal", frames.time, foot, NORMAL_SCALE * normal, palette.NORMAL)

    def _log_arrows(self, name: str, time: Array, origins: Array, vectors: Array, color: str) -> None:
        """Log one arrow per wheel; origins and vectors have shape (k, n, 3) [m]."""
        k, n, _ = vectors.shape
        columns = rr.Arrows3D.columns(
            vectors=vectors.reshape(-1, 3).astype(np.float32),
            origins=origins.reshape(-1, 3).astype(np.float32),
        )
        entity = f"{FORCES}/{name}"
        style = rr.Arrows3D.from_fields(colors=[palette.rgb(color)] * n, radii=[_ARROW_RADIUS] * n)
        self._stream.log(entity, style, static=True)
        self._stream.send_columns(entity, [time_column(time)], columns.partition(np.full(k, n)))


def _xyzw(quaternion: Array) -> NDArray[np.float32]:
    return quaternion[:, [1, 2, 3, 0]].astype(np.float32)


def _log_mesh(stream: rr.RecordingStream, entity: str, look: Appearance) -> None:
    stream.log(
        entity,
        rr.Mesh3D(
            vertex_positions=look.surface.vertices.astype(np.float32),
            vertex_normals=look.surface.normals.astype(np.float32),
            vertex_colors=look.colors,
            triangle_indices=look.surface.triangles.astype(np.uint32),
        ),
        static=True,
    )


def log_floor(stream: rr.RecordingStream, points: Array, patches: Sequence[Any], floor: str) -> None:
    """Log the floor below points, shape (k, 2) [m], as a slab with tiles, and other floors with their names.

    Tiles are 0.25 m wide, larger on a vast floor; patches have `floor`, `center`, `size` and `yaw`.
    """
    low, high = np.floor(points.min(axis=0) - _MARGIN), np.ceil(points.max(axis=0) + _MARGIN)
    slab = rr.Boxes3D(
        centers=[[*(low + high) / 2, -0.008]],
        half_sizes=[[*(high - low) / 2, 0.006]],
        colors=[(214, 212, 206)],
        fill_mode="solid",
    )
    stream.log(f"{FLOOR}/{floor}", slab, static=True)
    tile = _TILE * 2.0 ** max(0, math.ceil(math.log2(float((high - low).max()) / (_MOST_TILES * _TILE))))
    lines = [[[x, low[1], 0], [x, high[1], 0]] for x in np.arange(low[0], high[0] + 1e-9, tile)]
    lines += [[[low[0], y, 0], [high[0], y, 0]] for y in np.arange(low[1], high[1] + 1e-9, tile)]
    stream.log(
        f"{FLOOR}/tiles", rr.LineStrips3D(lines, colors=[(196, 193, 186)], radii=[0.0012]), static=True
    )
    for i, patch in enumerate(patches, start=1):
        _log_patch(stream, f"{FLOOR}/patch_{i}_{patch.floor}", patch)


def _log_patch(stream: rr.RecordingStream, entity: str, patch: Any) -> None:
    corners = np.column_stack([patch_corners(patch), np.full(4, 0.0008)])
    mesh = rr.Mesh3D(
        vertex_positions=corners,
        triangle_indices=[[0, 1, 2], [0, 2, 3]],
        albedo_factor=(143, 196, 228, 255),
    )
    stream.log(entity, mesh, static=True)
    # at the far edge, where a machine that starts on the patch does not cover the name
    name = rr.Points3D(
        [corners[2:].mean(axis=0)],
        radii=[0.004],
        colors=[(245, 248, 252)],
        labels=[patch.floor.replace("_", " ")],
        show_labels=True,
    )
    stream.log(f"{entity}/name", name, static=True)


def log_planned(stream: rr.RecordingStream, planned: Array) -> None:
    """Log the whole planned path, shape (k, 2) [m]."""
    keep = np.unique(np.linspace(0, len(planned) - 1, min(len(planned), _TRAIL_POINTS)).astype(int))
    strip = rr.LineStrips3D(
        [on_floor(planned[keep], 0.002)], colors=[palette.rgb(palette.PLANNED)], radii=[0.004]
    )
    stream.log(f"{PATH}/planned", strip, static=True)


class Trail:
    """Growing line of the driven path, logged as a whole at each step."""

    def __init__(self, stream: rr.RecordingStream, duration: float):
        """Begin the path of a run that lasts at most `duration` [s]."""
        self._stream, self._duration = stream, duration
        self._points = np.empty((0, 2))
        self._last = -1.0
        style = rr.LineStrips3D.from_fields(colors=[palette.rgb(palette.MEASURED)], radii=[0.006])
        stream.log(f"{PATH}/driven", style, static=True)

    def add(self, trace: Trace) -> None:
        """Append the rows of a trace, which follow those added before."""
        time, place = trace["time"], np.column_stack([trace["x"], trace["y"]])
        kept = self._crossed(time, _TRAIL_POINTS)
        ends = np.union1d(self._crossed(time, _TRAIL_STEPS), [len(time) - 1])
        strips = [
            on_floor(np.vstack([self._points, place[kept[kept < end]], place[end]]), 0.004) for end in ends
        ]
        columns = rr.LineStrips3D.columns(strips=strips)
        self._stream.send_columns(f"{PATH}/driven", [time_column(time[ends])], columns)
        # a drive by hand has no time limit, but the trail is limited
        self._points = np.vstack([self._points, place[kept]])[-2 * _TRAIL_POINTS :]
        self._last = float(time[-1])

    def _crossed(self, time: Array, parts: int) -> NDArray[np.int64]:
        """Return the rows at which the next of `parts` equal parts of the run begins, shape (m,)."""
        part = np.floor(np.concatenate([[self._last], time]) * parts / self._duration + 1e-9)
        return np.flatnonzero(np.diff(part) > 0)


def on_floor(points: Array, height: float) -> NDArray[np.float32]:
    """Return places x, y, shape (k, 2) [m], at a height above the floor [m], shape (k, 3)."""
    return np.column_stack([points, np.full(len(points), height)]).astype(np.float32)


@contextmanager
def recording_file(path: Path, application: str) -> Iterator[rr.RecordingStream]:
    """Context with a stream whose data become an `.rrd` file when the block succeeds, in full.

    The viewer keeps one layout for each `application`.

    Raises:
      OutputError: The file cannot be written.
    """
    # Rerun's own file sink leaves half a file without an error on a full disk, and waiting for it never ends
    stream = rr.RecordingStream(application)
    recorded = stream.memory_recording()
    try:
        yield stream
        content = recorded.drain_as_bytes()
    finally:
        stream.disconnect()
    with atomic_file(path) as temporary:
        temporary.write_bytes(content)
