"""A picture of robot or rig: rendered by MuJoCo in a process of its own, drawn where no OpenGL is found.

A missing or broken OpenGL library can end a process without a word, so the run itself never loads one.
"""

from __future__ import annotations

import itertools
import json
import os
import subprocess
import sys
import tempfile
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
from numpy.typing import NDArray

from omnimj.signals import Trace
from omnimj.view.poses import Poses
from omnimj.view.wording import Span, fault_spans

Array = NDArray[np.float64]
BACKENDS = ("osmesa", "egl")
_FINE = 2  # rendered pixels per pixel and direction: multisampling alone leaves the edges of shadows rough
_PATIENCE = 90.0  # [s] for a software renderer on a slow machine


@dataclass(frozen=True)
class Camera:
    """An orbiting camera."""

    target: tuple[float, float, float] = (0.0, 0.0, 0.05)
    """The point in the middle of the picture [m]."""
    distance: float = 0.92
    """[m]"""
    azimuth: float = 140.0
    """Degrees, MuJoCo's convention."""
    elevation: float = -27.0
    """Degrees, negative looks down."""


@dataclass(frozen=True)
class Picture:
    """A picture file and how it was made."""

    path: Path
    way: str
    """`osmesa` or `egl` (rendered by MuJoCo), or `drawn`."""
    subject: str
    """What it shows."""

    @property
    def way_in_words(self) -> str:
        """For a caption."""
        if self.way == "drawn":
            return "Drawn from the MuJoCo model's geometry, since no OpenGL library was found to render it."
        return f"Rendered by MuJoCo ({self.way}) from the simulated state."


def camera_at(mj_model: mujoco.MjModel, qpos: Array) -> Camera:
    """A camera that holds what moves in view: the robot from ahead and left, the rig from its side."""
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
    """Makes a PNG of a model in one pose; never fails for want of OpenGL.

    Args:
      mj_model: Compiled model, with floor and lights.
      qpos: Generalised positions, shape (nq,).
      path: The PNG to write.
      subject: What it shows, for captions.
      camera: Where to look from; a view that holds the machine when None.
      trail: Points of a path to draw on the floor, shape (k, 2) [m].
      size: Width and height [pixels].
      backends: Values of MUJOCO_GL to try in turn; none forces the drawing.

    Returns:
      The picture and which way it was made.
    """
    camera = camera_at(mj_model, qpos) if camera is None else camera
    points = np.empty((0, 2)) if trail is None else np.asarray(trail, float)
    with tempfile.TemporaryDirectory() as folder:
        order = Path(folder)
        mujoco.mj_saveModel(mj_model, str(order / "model.mjb"))
        np.savez(order / "state.npz", qpos=qpos, trail=points)
        (order / "order.json").write_text(
            json.dumps({"camera": asdict(camera), "size": size}), encoding="utf-8"
        )
        for backend in backends:
            if _rendered(order, backend):
                path.write_bytes((order / "picture.png").read_bytes())
                return Picture(path, backend, subject)
    from omnimj.view.drawn_picture import draw  # matplotlib is not needed where OpenGL is

    draw(mj_model, qpos, path, camera, points, size)
    return Picture(path, "drawn", subject)


def picture_of_run(
    poses: Poses,
    trace: Trace,
    metrics: Mapping[str, Any],
    path: Path,
    backends: Sequence[str] = BACKENDS,
) -> Picture:
    """A picture of the machine half-way through what it drives with its first fault, or through the run.

    Args:
      poses: What moved.
      trace: For the driven path on the floor, where the plant knows it.
      metrics: Content of `metrics.json`, for the faults.
      path: The PNG to write.
      backends: As in `render`.
    """
    spans = fault_spans(metrics, float(trace["time"][-1]))
    k = _half_way(poses, spans[0] if spans else None)
    until = trace["time"] <= poses.time[k]
    trail = np.column_stack([trace["x"], trace["y"]])[until] if "x" in trace else None
    machine = "the robot and its path" if trail is not None else "the test rig"
    subject = f"{machine}, {poses.time[k]:.2g} s into the run"
    return render(poses.mj_model, poses.qpos[k], path, subject, trail=trail, backends=backends)


def _half_way(poses: Poses, span: Span | None) -> int:
    """Index of the pose at which half of the way driven within the span, or the run, is behind."""
    start, end = (span.start, span.end) if span else (poses.time[0], poses.time[-1])
    held = np.flatnonzero((poses.time >= start) & (poses.time <= end))
    if not len(held):
        return int(np.argmin(np.abs(poses.time - start)))
    # the first two coordinates are a place on the floor: x and y of the robot, gantry and rail of the rig
    steps = np.linalg.norm(np.diff(poses.qpos[held, :2], axis=0), axis=1)
    way = np.concatenate([[0.0], np.cumsum(steps)])
    return int(held[np.searchsorted(way, 0.5 * way[-1])])


def _rendered(order: Path, backend: str) -> bool:
    """Whether a process of its own could render the order with this MUJOCO_GL."""
    command = [sys.executable, "-m", "omnimj.view.picture", str(order)]
    environment = {**os.environ, "MUJOCO_GL": backend}
    if backend == "osmesa":
        environment["PYOPENGL_PLATFORM"] = "osmesa"
    try:
        ended = subprocess.run(command, env=environment, capture_output=True, timeout=_PATIENCE, check=False)
    except (subprocess.TimeoutExpired, OSError):
        return False
    return ended.returncode == 0 and (order / "picture.png").is_file()


def _render_order(order: Path) -> None:
    """Renders in this process; may end it where OpenGL is broken."""
    from matplotlib.image import imsave

    asked = json.loads((order / "order.json").read_text(encoding="utf-8"))
    state = np.load(order / "state.npz")
    width, height = (_FINE * side for side in asked["size"])
    mj_model = mujoco.MjModel.from_binary_path(str(order / "model.mjb"))
    mj_model.vis.global_.offwidth, mj_model.vis.global_.offheight = width, height
    mj_model.vis.quality.offsamples = 4
    mj_model.light_pos[:, :2] += asked["camera"]["target"][:2]  # the lamps come along
    mj_data = mujoco.MjData(mj_model)
    mj_data.qpos[:] = state["qpos"]
    mujoco.mj_kinematics(mj_model, mj_data)
    mujoco.mj_comPos(mj_model, mj_data)
    mujoco.mj_camlight(mj_model, mj_data)
    eye = mujoco.MjvCamera()
    eye.lookat[:], eye.distance = asked["camera"]["target"], asked["camera"]["distance"]
    eye.azimuth, eye.elevation = asked["camera"]["azimuth"], asked["camera"]["elevation"]
    with mujoco.Renderer(mj_model, height, width) as renderer:
        renderer.update_scene(mj_data, eye)
        _add_trail(renderer.scene, state["trail"])
        pixels = renderer.render()
    blocks = pixels.reshape(height // _FINE, _FINE, width // _FINE, _FINE, 3)
    imsave(order / "picture.png", np.round(blocks.mean(axis=(1, 3))).astype(np.uint8))


def _add_trail(scene: mujoco.MjvScene, points: Array, radius: float = 0.004) -> None:
    """Puts a path on the floor as thin capsules, as many as the scene has room for."""
    room = min(len(points) - 1, scene.maxgeom - scene.ngeom, 400)
    if room < 1:
        return
    kept = points[np.linspace(0, len(points) - 1, room + 1).astype(int)]
    for first, second in itertools.pairwise(kept):
        geom = scene.geoms[scene.ngeom]
        rgba = np.array([0.0, 0.447, 0.698, 1.0], np.float32)
        mujoco.mjv_initGeom(geom, mujoco.mjtGeom.mjGEOM_CAPSULE, np.zeros(3), np.zeros(3), np.zeros(9), rgba)
        mujoco.mjv_connector(
            geom,
            mujoco.mjtGeom.mjGEOM_CAPSULE,
            radius,
            np.array([*first, radius]),
            np.array([*second, radius]),
        )
        scene.ngeom += 1


if __name__ == "__main__":
    _render_order(Path(sys.argv[1]))
