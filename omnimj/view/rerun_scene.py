"""The 3-D part of a Rerun recording: machine, floor, paths and force arrows."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import rerun as rr
from numpy.typing import NDArray

from omnimj.signals import Trace
from omnimj.view import palette
from omnimj.view.plots import patch_corners, planned_position
from omnimj.view.scene3d import (
    Frames,
    Look,
    Poses,
    body_frames,
    body_look,
    hinge_axis,
    relative_frames,
    striped,
    thin,
    twins,
    wheel_axles,
    wheel_bodies,
)

Array = NDArray[np.float64]
RATE = 50.0
"""Poses per second in the recording."""
TRACTION_SCALE, NORMAL_SCALE = 0.02, 0.005
"""Length of a force arrow [m/N]; traction is the smaller force and lies on the floor."""
MACHINE, FLOOR, PATH, FORCES = "world/machine", "world/floor", "world/path", "world/forces"
_ARROW_RADIUS = 0.006
_TRAIL_STEPS, _TRAIL_POINTS = 120, 240
_TILE = 0.25  # [m]


def time_column(time: Array) -> rr.TimeColumn:
    """The one timeline of a recording: simulated time [s]."""
    whole = np.round(1e9 * np.asarray(time)).astype("timedelta64[ns]")  # a float would be cut off, 4.0999…
    return rr.TimeColumn("time", duration=whole)


def log_scene(
    stream: rr.RecordingStream, trace: Trace, poses: Poses | None, patches: Sequence[Any], floor: str
) -> None:
    """Everything that stands or moves in the world."""
    stream.log("world", rr.ViewCoordinates.RIGHT_HAND_Z_UP, static=True)
    frames = None
    if poses is not None:
        poses = poses.thinned(RATE)
        frames = body_frames(poses)
        groups = twins(poses.mj_model)
        log_machine(stream, poses, frames, groups)
        _log_forces(stream, trace, poses, frames, wheel_bodies(poses.mj_model, groups))
    log_floor(stream, _extent(trace, frames), patches, floor)
    if "x" in trace:
        _log_paths(stream, trace)


def log_machine(stream: rr.RecordingStream, poses: Poses, frames: Frames, groups: list[list[int]]) -> None:
    """Every visible body: its surface once, its pose through time; alike rollers as instances of one mesh."""
    mj_model, index = poses.mj_model, time_column(frames.time)
    grouped = {body for bodies in groups for body in bodies}
    for body in range(1, mj_model.nbody):
        look = None if body in grouped else body_look(mj_model, body)
        if look is None:
            continue
        entity = body_entity(mj_model.body(body).name)
        _log_mesh(stream, f"{entity}/surface", look)
        stream.send_columns(
            entity,
            [index],
            rr.Transform3D.columns(
                translation=frames.position[:, body].astype(np.float32),
                quaternion=_xyzw(frames.quaternion[:, body]),
            ),
        )
    for bodies in groups:
        _log_twins(stream, poses, frames, bodies)


def body_entity(name: str) -> str:
    """Where a body lies in the recording: `wheel_1_wheel` → `world/machine/wheel_1`."""
    return f"{MACHINE}/{name.removesuffix('_wheel')}"


def _log_twins(stream: rr.RecordingStream, poses: Poses, frames: Frames, bodies: list[int]) -> None:
    mj_model = poses.mj_model
    parent = int(mj_model.body_parentid[bodies[0]])
    look, axis = body_look(mj_model, bodies[0]), hinge_axis(mj_model, bodies[0])
    if look is None:
        return
    entity = f"{body_entity(mj_model.body(parent).name)}/rollers"
    _log_mesh(stream, entity, look if axis is None else striped(look, axis))
    position, quaternion = relative_frames(frames, bodies, parent)
    columns = rr.InstancePoses3D.columns(
        translations=position.reshape(-1, 3).astype(np.float32), quaternions=_xyzw(quaternion.reshape(-1, 4))
    )
    lengths = np.full(len(frames.time), len(bodies))
    stream.send_columns(entity, [time_column(frames.time)], columns.partition(lengths))


def _xyzw(quaternion: Array) -> NDArray[np.float32]:
    return quaternion[:, [1, 2, 3, 0]].astype(np.float32)


def _log_mesh(stream: rr.RecordingStream, entity: str, look: Look) -> None:
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


def _log_forces(
    stream: rr.RecordingStream, trace: Trace, poses: Poses, frames: Frames, wheels: list[int]
) -> None:
    """Arrows at the wheels' contacts: traction along the driving direction, normal force upwards."""
    n = 0
    while n < len(wheels) and f"traction_force_{n + 1}" in trace:
        n += 1
    if n == 0:
        return
    up = np.array([0.0, 0.0, 1.0])
    ahead = np.cross(wheel_axles(poses, frames, wheels[:n]), up)
    ahead /= np.linalg.norm(ahead, axis=-1, keepdims=True)
    floor = frames.position[:, wheels[:n]] * [1.0, 1.0, 0.0]
    rows = np.clip(np.searchsorted(trace["time"], frames.time - 1e-9), 0, len(trace["time"]) - 1)
    traction = TRACTION_SCALE * trace.wheels("traction_force")[rows, :n, None] * ahead
    normal = NORMAL_SCALE * trace.wheels("normal_force")[rows, :n, None] * up
    lifted = floor + _ARROW_RADIUS * up
    for name, vectors, color in (
        ("traction", traction, palette.TRACTION),
        ("normal", normal, palette.NORMAL),
    ):
        stream.log(
            f"{FORCES}/{name}",
            rr.Arrows3D.from_fields(colors=[palette.rgb(color)] * n, radii=[_ARROW_RADIUS] * n),
            static=True,
        )
        columns = rr.Arrows3D.columns(
            vectors=vectors.reshape(-1, 3).astype(np.float32),
            origins=lifted.reshape(-1, 3).astype(np.float32),
        )
        stream.send_columns(
            f"{FORCES}/{name}", [time_column(frames.time)], columns.partition(np.full(len(frames.time), n))
        )


def _extent(trace: Trace, frames: Frames | None) -> tuple[Array, Array]:
    """Corners of the floor that is worth drawing, shape (2,) each [m]."""
    points = [np.zeros((1, 2))]
    if "x" in trace:
        points.append(np.column_stack([trace["x"], trace["y"]]))
        planned = planned_position(trace)
        if planned is not None:
            points.append(planned)
    elif frames is not None:
        points += [
            frames.position[:, 1:, :2].min(axis=(0, 1))[None],
            frames.position[:, 1:, :2].max(axis=(0, 1))[None],
        ]
    together = np.concatenate(points)
    return np.floor(together.min(axis=0) - 0.6), np.ceil(together.max(axis=0) + 0.6)


def log_floor(
    stream: rr.RecordingStream, extent: tuple[Array, Array], patches: Sequence[Any], floor: str
) -> None:
    """The floor as a slab with tiles of 0.25 m, and each patch of other floor with its name."""
    low, high = extent
    slab = rr.Boxes3D(
        centers=[[*(low + high) / 2, -0.008]],
        half_sizes=[[*(high - low) / 2, 0.006]],
        colors=[(214, 212, 206)],
        fill_mode="solid",
    )
    stream.log(f"{FLOOR}/{floor}", slab, static=True)
    lines = [[[x, low[1], 0], [x, high[1], 0]] for x in np.arange(low[0], high[0] + 1e-9, _TILE)]
    lines += [[[low[0], y, 0], [high[0], y, 0]] for y in np.arange(low[1], high[1] + 1e-9, _TILE)]
    stream.log(
        f"{FLOOR}/tiles", rr.LineStrips3D(lines, colors=[(196, 193, 186)], radii=[0.0012]), static=True
    )
    for i, patch in enumerate(patches, start=1):
        corners = np.column_stack([patch_corners(patch), np.full(4, 0.0008)])
        entity = f"{FLOOR}/patch_{i}_{patch.floor}"
        mesh = rr.Mesh3D(
            vertex_positions=corners,
            triangle_indices=[[0, 1, 2], [0, 2, 3]],
            albedo_factor=(143, 196, 228, 255),
        )
        stream.log(entity, mesh, static=True)
        label = rr.Points3D(
            [corners.mean(axis=0)],
            radii=[0.004],
            colors=[(245, 248, 252)],
            labels=[patch.floor.replace("_", " ")],
        )
        stream.log(f"{entity}/name", label, static=True)


def _log_paths(stream: rr.RecordingStream, trace: Trace) -> None:
    """The planned path whole, the driven one as it grows."""
    planned = planned_position(trace)
    if planned is not None:
        strip = _on_floor(planned[thin(trace["time"], _TRAIL_POINTS / max(trace["time"][-1], 1e-6))], 0.002)
        stream.log(
            f"{PATH}/planned",
            rr.LineStrips3D([strip], colors=[palette.rgb(palette.PLANNED)], radii=[0.004]),
            static=True,
        )
    driven = np.column_stack([trace["x"], trace["y"]])
    ends = np.unique(np.linspace(1, len(driven) - 1, _TRAIL_STEPS).astype(int))
    each = max(1, len(driven) // _TRAIL_POINTS)
    strips = [_on_floor(np.vstack([driven[: end + 1 : each], driven[end]]), 0.004) for end in ends]
    columns = rr.LineStrips3D.columns(strips=strips)
    entity = f"{PATH}/driven"
    style = rr.LineStrips3D.from_fields(colors=[palette.rgb(palette.MEASURED)], radii=[0.006])
    stream.log(entity, style, static=True)
    stream.send_columns(entity, [time_column(trace["time"][ends])], columns)


def _on_floor(points: Array, height: float) -> NDArray[np.float32]:
    return np.column_stack([points, np.full(len(points), height)]).astype(np.float32)
