"""Pictures of robot or rig, rendered by MuJoCo.

A missing or broken OpenGL library can terminate a process without a message. A run therefore loads only the
one that MUJOCO_GL names (`opengl.choose_backend` names Mesa's where it is installed) and tries others in
separate processes. Without OpenGL the caption explains how to enable the picture.
"""

from __future__ import annotations

import copy
import itertools
import json
import os
import subprocess
import sys
import tempfile
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
from numpy.typing import NDArray

from omnimj.signals import Array, Trace
from omnimj.view.poses import Poses
from omnimj.view.wording import Span, fault_spans

BACKENDS = ("osmesa", "egl")
SUPERSAMPLING = 2
"""Samples per pixel and direction: multisampling by OpenGL leaves the edges of shadows rough."""
_TRAIL_RADIUS = 0.004  # [m] of the line that shows a path
_TIMEOUT = 90.0  # [s], enough for a software renderer on a slow machine
HOW_TO_RENDER = (
    "No picture: MuJoCo found no OpenGL library to render with. For software rendering install libosmesa6 "
    "(Debian, Ubuntu: apt install libosmesa6), then run again with MUJOCO_GL=osmesa."
)


@dataclass(frozen=True)
class Camera:
    """Orbiting camera."""

    target: tuple[float, float, float] = (0.0, 0.0, 0.05)
    """Point in the middle of the picture [m]."""
    distance: float = 0.92
    """Distance from the target [m]."""
    azimuth: float = 140.0
    """Azimuth in MuJoCo's convention [°]."""
    elevation: float = -27.0
    """Elevation [°]; negative: looking down."""


@dataclass(frozen=True)
class Picture:
    """Picture of a machine, possibly missing for lack of OpenGL."""

    path: Path | None
    """PNG file; None if rendering failed."""
    backend: str
    """Backend, `osmesa` or `egl`; empty if rendering failed."""
    subject: str
    """Content of the picture in words."""

    @property
    def caption(self) -> str:
        """Text below the picture: its renderer, or instructions to enable rendering."""
        if self.path is None:
            return HOW_TO_RENDER
        return f"Rendered by MuJoCo ({self.backend}) from the simulated state."


def camera_at(mj_model: mujoco.MjModel, qpos: Array) -> Camera:
    """Choose a camera that shows the machine in the pose `qpos`, shape (nq,).

    The robot is seen from its front left, the rig from its side.
    """
    mj_data = mujoco.MjData(mj_model)
    mj_data.qpos[:] = qpos
    mujoco.mj_kinematics(mj_model, mj_data)
    x, y, _ = mj_data.xpos[1]
    if mj_model.jnt_type[0] == mujoco.mjtJoint.mjJNT_FREE:
        return Camera(target=(float(x), float(y), 0.06))
    x, y = mj_data.xpos[mj_model.nbody - 1][:2]
    return Camera(target=(float(x), float(y), 0.14), distance=0.85, azimuth=-58.0, elevation=-16.0)


def render(
    mj_model: mujoco.MjModel,
    qpos: Array,
    path: Path,
    subject: str = "the machine",
    camera: Camera | None = None,
    trail: Array | None = None,
    size: tuple[int, int] = (1280, 860),
    backends: Sequence[str] = BACKENDS,
) -> Picture:
    """Render a model in one pose, shape (nq,), to a PNG file; missing OpenGL is not an error.

    `subject` is the content in words, for captions, `trail` a path to draw on the floor, shape (k, 2) [m],
    and `size` in pixels. The values of MUJOCO_GL in `backends` are tried in turn; the path of the picture is
    None if all fail.
    """
    camera = camera_at(mj_model, qpos) if camera is None else camera
    points = np.empty((0, 2)) if trail is None else np.asarray(trail, float)
    # MuJoCo chose when it was imported, whatever the environment says now
    chosen = mujoco.GLContext.__module__.rpartition(".")[2] if hasattr(mujoco, "GLContext") else ""
    if chosen in backends and _render_here(mj_model, (qpos, camera, points), size, path):
        return Picture(path, chosen, subject)
    with tempfile.TemporaryDirectory() as folder:
        job = Path(folder)
        mujoco.mj_saveModel(mj_model, str(job / "model.mjb"))
        np.savez(job / "state.npz", qpos=qpos, trail=points)
        (job / "job.json").write_text(json.dumps({"camera": asdict(camera), "size": size}), encoding="utf-8")
        for backend in backends:
            if _render_apart(job, backend):
                path.write_bytes((job / "picture.png").read_bytes())
                return Picture(path, backend, subject)
    return Picture(None, "", subject)


def picture_of_run(
    poses: Poses,
    trace: Trace,
    metrics: Mapping[str, Any],
    path: Path,
    backends: Sequence[str] = BACKENDS,
) -> Picture:
    """Render the machine half-way along the path driven during its first fault, else along the whole path."""
    spans = fault_spans(metrics, float(trace["time"][-1]))
    k = _half_way(poses, spans[0] if spans else None)
    until = trace["time"] <= poses.time[k]
    trail = np.column_stack([trace["x"], trace["y"]])[until] if "x" in trace else None
    machine = "the robot and its path" if trail is not None else "the test rig"
    subject = f"{machine}, {poses.time[k]:.2g} s into the run"
    return render(poses.mj_model, poses.qpos[k], path, subject, trail=trail, backends=backends)


def _half_way(poses: Poses, span: Span | None) -> int:
    """Return the index of the pose at half the distance driven within the span, or within the run."""
    start, end = (span.start, span.end) if span else (poses.time[0], poses.time[-1])
    held = np.flatnonzero((poses.time >= start) & (poses.time <= end))
    if not len(held):
        return int(np.argmin(np.abs(poses.time - start)))
    # the first two coordinates are a position on the floor: x and y of the robot, gantry and rail of the rig
    steps = np.linalg.norm(np.diff(poses.qpos[held, :2], axis=0), axis=1)
    distance = np.concatenate([[0.0], np.cumsum(steps)])
    return int(held[np.searchsorted(distance, 0.5 * distance[-1])])


def _render_here(
    mj_model: mujoco.MjModel, shot: tuple[Array, Camera, Array], size: tuple[int, int], path: Path
) -> bool:
    """Render one frame in this process; False if OpenGL reports an error."""
    from OpenGL.error import Error  # loaded with MuJoCo's context

    own = copy.copy(mj_model)  # `frames` moves lights
    try:
        pixels = next(frames(own, [shot], size))
    except (Error, mujoco.FatalError, RuntimeError, AttributeError):  # no context, or one without a function
        return False
    _save(pixels, path)
    return True


def _save(pixels: NDArray[np.uint8], path: Path) -> None:
    from PIL import Image  # imported when a picture is written

    Image.fromarray(pixels).save(path)


def _render_apart(job: Path, backend: str) -> bool:
    """Render a job in a separate process with the given MUJOCO_GL; return True on success."""
    command = [sys.executable, "-m", "omnimj.view.picture", str(job)]
    environment = {**os.environ, "MUJOCO_GL": backend}
    if backend == "osmesa":
        environment["PYOPENGL_PLATFORM"] = "osmesa"
    try:
        ended = subprocess.run(command, env=environment, capture_output=True, timeout=_TIMEOUT, check=False)
    except (subprocess.TimeoutExpired, OSError):
        return False
    return ended.returncode == 0 and (job / "picture.png").is_file()


def _render_job(job: Path) -> None:
    """Render in this process; a broken OpenGL may terminate it."""
    description = json.loads((job / "job.json").read_text(encoding="utf-8"))
    state = np.load(job / "state.npz")
    mj_model = mujoco.MjModel.from_binary_path(str(job / "model.mjb"))
    camera, size = Camera(**description["camera"]), tuple(description["size"])
    _save(next(frames(mj_model, [(state["qpos"], camera, state["trail"])], size)), job / "picture.png")


def frames(
    mj_model: mujoco.MjModel, shots: Iterable[tuple[Array, Camera, Array]], size: tuple[int, int]
) -> Iterator[NDArray[np.uint8]]:
    """Render shots in this process, with the OpenGL that MUJOCO_GL selects; the lights follow the camera.

    A shot is a pose, shape (nq,), a camera, and the points of a path on the floor, shape (k, 2) [m]; it
    becomes RGB pixels, shape (height, width, 3).
    """
    width, height = (SUPERSAMPLING * side for side in size)
    mj_model.vis.global_.offwidth, mj_model.vis.global_.offheight = width, height
    mj_model.vis.quality.offsamples = 0  # a picture is averaged over more samples than one per pixel anyway
    mj_data, eye = mujoco.MjData(mj_model), mujoco.MjvCamera()
    lamps = mj_model.light_pos.copy()
    with mujoco.Renderer(mj_model, height, width) as renderer:
        for qpos, camera, trail in shots:
            mj_model.light_pos[:, :2] = lamps[:, :2] + camera.target[:2]
            place(mj_model, mj_data, qpos)
            eye.lookat[:], eye.distance = camera.target, camera.distance
            eye.azimuth, eye.elevation = camera.azimuth, camera.elevation
            renderer.update_scene(mj_data, eye)
            add_path(renderer.scene, trail, (0.0, 0.447, 0.698), _TRAIL_RADIUS)
            yield smoothed(renderer.render(), size)


def place(mj_model: mujoco.MjModel, mj_data: mujoco.MjData, qpos: Array) -> None:
    """Put the machine and its lights in a pose, generalised positions of shape (nq,)."""
    mj_data.qpos[:] = qpos
    mujoco.mj_kinematics(mj_model, mj_data)
    mujoco.mj_comPos(mj_model, mj_data)
    mujoco.mj_camlight(mj_model, mj_data)


def smoothed(pixels: NDArray[np.uint8], size: tuple[int, int]) -> NDArray[np.uint8]:
    """Average `SUPERSAMPLING` pixels per direction to a picture of a width and height."""
    blocks = pixels.reshape(size[1], SUPERSAMPLING, size[0], SUPERSAMPLING, 3)
    total = np.full((size[1], size[0], 3), SUPERSAMPLING**2 // 2, np.uint16)  # rounds to the nearest
    for row, column in np.ndindex(SUPERSAMPLING, SUPERSAMPLING):
        total += blocks[:, row, :, column]
    return (total // SUPERSAMPLING**2).astype(np.uint8)


def add_path(
    scene: mujoco.MjvScene,
    points: Array,
    color: tuple[float, float, float],
    radius: float,
    most: int = 400,
) -> None:
    """Add a path on the floor, shape (k, 2) [m], as at most `most` thin capsules of a radius [m].

    Fewer are added if the scene has no room for them.
    """
    room, rgba = min(len(points) - 1, scene.maxgeom - scene.ngeom, most), np.array([*color, 1.0], np.float32)
    if room < 1:
        return
    kept = points[np.linspace(0, len(points) - 1, room + 1).astype(int)]
    for ends in itertools.pairwise(kept):
        geom, capsule = scene.geoms[scene.ngeom], mujoco.mjtGeom.mjGEOM_CAPSULE
        mujoco.mjv_initGeom(geom, capsule, np.zeros(3), np.zeros(3), np.zeros(9), rgba)
        first, second = (np.array([*end, radius]) for end in ends)
        mujoco.mjv_connector(geom, capsule, radius, first, second)
        scene.ngeom += 1


if __name__ == "__main__":
    _render_job(Path(sys.argv[1]))
