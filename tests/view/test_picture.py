"""A run has a picture where OpenGL is found, and a broken OpenGL never reaches the run."""

from __future__ import annotations

import functools
import os
import subprocess
import sys

import numpy as np
import pytest
from PIL import Image

from omnimj.view import picture as picture_room
from omnimj.view.opengl import choose_backend
from omnimj.view.picture import BACKENDS, picture_of_run, render
from omnimj.view.rerun.meshes import box, capsule, cylinder, ellipsoid, mesh

SIZE = (320, 216)


def volume(surface) -> float:
    """∫ x·n dA / 3 over triangles, the divergence theorem; positive when all of them face outwards."""
    a, b, c = np.moveaxis(surface.vertices[surface.triangles], 1, 0)
    return float(np.einsum("ij,ij->", a, np.cross(b, c)) / 6.0)


def test_a_pixel_is_the_mean_of_its_samples():
    samples = np.random.default_rng(0).integers(0, 256, (40, 60, 3), np.uint8)
    mean = samples.reshape(20, 2, 30, 2, 3).mean(axis=(1, 3))
    np.testing.assert_allclose(picture_room.smoothed(samples, (30, 20)), mean, atol=0.5)


@pytest.mark.parametrize(
    "surface, expected",
    [
        (box(np.array([0.1, 0.2, 0.3])), 8 * 0.1 * 0.2 * 0.3),
        (cylinder(0.1, 0.2, 200), np.pi * 0.01 * 0.4),
        (ellipsoid(np.array([0.1, 0.2, 0.3]), 200), 4 / 3 * np.pi * 0.006),
        (capsule(0.1, 0.2, 200), np.pi * 0.01 * 0.4 + 4 / 3 * np.pi * 0.001),
    ],
    ids=["box", "cylinder", "ellipsoid", "capsule"],
)
def test_surfaces_enclose_the_volume_of_their_shape_facing_outwards(surface, expected):
    assert volume(surface) == pytest.approx(expected, rel=0.05)
    np.testing.assert_allclose(np.linalg.norm(surface.normals, axis=1), 1.0, atol=1e-9)
    corners = surface.vertices[surface.triangles]
    faces = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    real = np.linalg.norm(faces, axis=1) > 1e-12
    assert np.all(
        np.einsum("ij,ij->i", faces[real], surface.normals[surface.triangles[real]].mean(axis=1)) > 0
    )


def test_the_rollers_mesh_is_closed(robot_model):
    assert volume(mesh(robot_model, 0)) == pytest.approx(np.pi * 0.0085**2 * 0.025, rel=0.15)


def looked_at(path) -> np.ndarray:
    """The middle of a picture, grey levels."""
    with Image.open(path) as image:
        pixels = np.asarray(image.convert("RGB")) / 255.0
    height, width = pixels.shape[:2]
    return pixels[height // 4 : -height // 4, width // 4 : -width // 4].mean(axis=2)


def opengl() -> str | None:
    """The first backend that renders on this machine."""
    return next((name for name in BACKENDS if _can_render(name)), None)


@functools.cache
def _can_render(name: str) -> bool:
    code = "import mujoco; mujoco.GLContext(8, 8).make_current()"
    environment = {**os.environ, "MUJOCO_GL": name}
    return subprocess.run([sys.executable, "-c", code], env=environment, capture_output=True).returncode == 0


def test_without_opengl_there_is_no_picture_and_the_caption_explains_how_to_get_one(tmp_path, robot_model):
    # "nonsense" is refused by MuJoCo when it is imported: the process that renders ends, this one goes on
    for backends in ((), ("nonsense",)):
        made = render(robot_model, robot_model.qpos0, tmp_path / "b.png", size=SIZE, backends=backends)
        assert made.path is None and not (tmp_path / "b.png").exists()
        assert "libosmesa6" in made.caption and "MUJOCO_GL=osmesa" in made.caption


def test_a_renderer_that_hangs_is_stopped(tmp_path, robot_model, monkeypatch):
    def hang(command, **keywords):
        raise subprocess.TimeoutExpired(command, keywords["timeout"])

    monkeypatch.setattr(picture_room.subprocess, "run", hang)
    monkeypatch.delattr("mujoco.GLContext", raising=False)
    assert render(robot_model, robot_model.qpos0, tmp_path / "b.png", size=SIZE).path is None


TWICE = """
import os, sys
from pathlib import Path
from omnimj.parameters import read_floors, read_robot
from omnimj.plant.mujoco.assembly import robot_model
from omnimj.view.opengl import choose_backend
from omnimj.view.picture import render
model = robot_model(read_robot(), read_floors()["pvc"])
folder = Path(sys.argv[1])
assert render(model, model.qpos0, folder / "here.png", size=(320, 216)).backend == "osmesa"
import mujoco
del mujoco.GLContext
assert render(model, model.qpos0, folder / "apart.png", size=(320, 216)).backend == "osmesa"
"""


@pytest.mark.slow
@pytest.mark.skipif(not _can_render("osmesa"), reason="no software rendering on this machine")
def test_the_process_of_the_run_renders_the_picture_that_a_separate_one_does(tmp_path):
    environment = {**os.environ, "MUJOCO_GL": "osmesa", "PYOPENGL_PLATFORM": "osmesa"}
    subprocess.run([sys.executable, "-c", TWICE, str(tmp_path)], env=environment, check=True)
    with Image.open(tmp_path / "here.png") as here, Image.open(tmp_path / "apart.png") as apart:
        assert np.array_equal(np.asarray(here), np.asarray(apart))


def test_software_rendering_is_chosen_only_where_nothing_else_is(monkeypatch):
    monkeypatch.setattr("ctypes.util.find_library", lambda name: "libOSMesa.so.8")
    monkeypatch.setattr(sys, "platform", "linux")
    for name in ("MUJOCO_GL", "DISPLAY", "WAYLAND_DISPLAY"):
        monkeypatch.delenv(name, raising=False)
    choose_backend()  # MuJoCo is imported already, and has chosen
    assert "MUJOCO_GL" not in os.environ
    monkeypatch.delitem(sys.modules, "mujoco")
    for name, value in (("DISPLAY", ":0"), ("MUJOCO_GL", "egl")):
        with monkeypatch.context() as patched:
            patched.setenv(name, value)
            choose_backend()
            assert os.environ.get("MUJOCO_GL") == (value if name == "MUJOCO_GL" else None)
    monkeypatch.setenv("MUJOCO_GL", "")
    choose_backend()
    assert os.environ["MUJOCO_GL"] == "osmesa"


@pytest.mark.skipif(opengl() is None, reason="no OpenGL library on this machine")
def test_mujoco_renders_the_machine_in_the_middle_where_opengl_is_found(tmp_path, robot_model):
    before = os.environ.get("MUJOCO_GL")
    made = render(robot_model, robot_model.qpos0, tmp_path / "gl.png", size=SIZE)
    assert os.environ.get("MUJOCO_GL") == before
    assert made.backend == opengl() and made.path is not None
    with Image.open(made.path) as image:
        assert image.size == SIZE
    assert looked_at(made.path).std() > 0.1  # dark plates on a light floor


def test_a_runs_picture_shows_the_middle_of_its_first_fault(
    tmp_path, robot_poses, robot_trace, robot_metrics
):
    made = picture_of_run(robot_poses, robot_trace, robot_metrics, tmp_path / "run.png", backends=())
    assert made.subject == "the robot and its path, 4 s into the run"


def test_the_rig_has_a_picture_too(tmp_path, rig_poses, rig_trace, rig_metrics):
    made = picture_of_run(rig_poses, rig_trace, rig_metrics, tmp_path / "rig.png", backends=())
    assert made.subject.startswith("the test rig")
