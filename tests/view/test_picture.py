"""Pictures come out with OpenGL and without, and a broken OpenGL never reaches the run."""

from __future__ import annotations

import os
import subprocess

import numpy as np
import pytest
from matplotlib.image import imread

from omnimj.view import picture as picture_room
from omnimj.view.picture import BACKENDS, Camera, picture_of_run, render
from omnimj.view.rerun.meshes import box, capsule, cylinder, ellipsoid, mesh

SIZE = (320, 216)


def volume(surface) -> float:
    """∫ x·n dA / 3 over triangles, the divergence theorem; positive when all of them face outwards."""
    a, b, c = np.moveaxis(surface.vertices[surface.triangles], 1, 0)
    return float(np.einsum("ij,ij->", a, np.cross(b, c)) / 6.0)


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
    pixels = imread(path)[..., :3]
    height, width = pixels.shape[:2]
    return pixels[height // 4 : -height // 4, width // 4 : -width // 4].mean(axis=2)


def test_a_machine_is_drawn_without_any_opengl(tmp_path, robot_model):
    made = render(robot_model, robot_model.qpos0, tmp_path / "drawn.png", size=SIZE, backends=())
    assert made.way == "drawn"
    assert "no OpenGL" in made.way_in_words
    assert imread(made.path).shape[:2] == SIZE[::-1]
    assert looked_at(made.path).std() > 0.1  # dark plates on a light floor


def test_the_drawing_shows_what_moved(tmp_path, robot_model):
    camera = Camera()
    moved = robot_model.qpos0.copy()
    moved[0] += 0.3
    first = render(robot_model, robot_model.qpos0, tmp_path / "a.png", camera=camera, size=SIZE, backends=())
    second = render(robot_model, moved, tmp_path / "b.png", camera=camera, size=SIZE, backends=())
    assert np.abs(looked_at(first.path) - looked_at(second.path)).mean() > 0.02


def test_a_broken_opengl_falls_back_to_the_drawing(tmp_path, robot_model):
    # "nonsense" is refused by MuJoCo when it is imported: the process that renders ends, this one goes on
    made = render(robot_model, robot_model.qpos0, tmp_path / "b.png", size=SIZE, backends=("nonsense",))
    assert made.way == "drawn"


def test_a_renderer_that_hangs_is_given_up(tmp_path, robot_model, monkeypatch):
    def hang(command, **keywords):
        raise subprocess.TimeoutExpired(command, keywords["timeout"])

    monkeypatch.setattr(picture_room.subprocess, "run", hang)
    assert render(robot_model, robot_model.qpos0, tmp_path / "b.png", size=SIZE).way == "drawn"


def test_mujoco_renders_where_opengl_is_found_and_agrees_with_the_drawing(tmp_path, robot_model):
    before = os.environ.get("MUJOCO_GL")
    made = render(robot_model, robot_model.qpos0, tmp_path / "gl.png", size=SIZE)
    assert os.environ.get("MUJOCO_GL") == before
    if made.way == "drawn":
        pytest.skip("no OpenGL library on this machine")
    assert made.way in BACKENDS
    drawn = render(robot_model, robot_model.qpos0, tmp_path / "drawn.png", size=SIZE, backends=())
    rendered, own = looked_at(made.path), looked_at(drawn.path)
    # two independent projections of one scene: the dark plates must lie in the same place
    assert np.corrcoef((rendered < 0.3).ravel(), (own < 0.3).ravel())[0, 1] > 0.7


def test_a_runs_picture_shows_the_middle_of_its_first_fault(
    tmp_path, robot_poses, robot_trace, robot_metrics
):
    made = picture_of_run(robot_poses, robot_trace, robot_metrics, tmp_path / "run.png", backends=())
    assert made.subject == "the robot and its path, 4 s into the run"


def test_the_rig_has_a_picture_too(tmp_path, rig_poses, rig_trace, rig_metrics):
    made = picture_of_run(rig_poses, rig_trace, rig_metrics, tmp_path / "rig.png", backends=())
    assert made.subject.startswith("the test rig")
    assert looked_at(made.path).std() > 0.05
