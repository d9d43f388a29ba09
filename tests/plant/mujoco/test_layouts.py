"""Twins of robots with other wheels than the shipped one, built from its first corner."""

from __future__ import annotations

import dataclasses
import math
from pathlib import Path

import mujoco
import numpy as np
import pytest
from other_robots import mecanum, star

from omnimj.parameters import read_floors, read_robot
from omnimj.physics.kinematics import rolling_matrix
from omnimj.plant.mujoco import assembly
from omnimj.plant.mujoco.assembly import GRAVITY, robot_model
from omnimj.plant.mujoco.mjcf import load_spec
from omnimj.plant.mujoco.twin import RobotTwin
from omnimj.plant.planar import PlanarRobot
from omnimj.resources import models_folder
from omnimj.signals import CurrentCommand

STONE = read_floors()["natural_stone"]
SHIPPED = models_folder() / "uto_robot"


def rotations(quaternions):
    turns = np.empty((len(quaternions), 9))
    for turn, quaternion in zip(turns, quaternions, strict=True):
        mujoco.mju_quat2Mat(turn, quaternion)
    return turns


def test_four_copies_of_a_corner_are_the_shipped_robot(monkeypatch):
    made = robot_model(read_robot(), STONE)
    monkeypatch.setattr(assembly, "load_spec", lambda path, instead: load_spec(path))
    own = robot_model(read_robot(), STONE)
    names = [name for name in dir(own) if isinstance(getattr(own, name), np.ndarray)]
    assert len(names) > 300
    for name in names:
        one, other = getattr(own, name), getattr(made, name)
        if name.endswith("_quat"):
            one, other = rotations(one), rotations(other)
        if one.dtype.kind == "f":
            assert one == pytest.approx(other, abs=1e-12), name
        else:
            assert np.array_equal(one, other), name


@pytest.mark.parametrize("scene", ["scene.xml", "obstacles.xml"])
@pytest.mark.parametrize("count", [3, 5, 6])
def test_any_number_of_wheels_stands_level_and_shares_the_weight(count, scene):
    robot = star(count, 0.25, 0.3)
    robot = dataclasses.replace(robot, body=dataclasses.replace(robot.body, mass=4.0 * count))
    robot = dataclasses.replace(robot, body=dataclasses.replace(robot.body, yaw_inertia=0.14 * count))
    plant = RobotTwin(robot, STONE, ideal_sensors=True, scene=SHIPPED / scene)
    plant.reset()
    for _ in range(300):
        plant.step(CurrentCommand(np.zeros(count)))
    normal = plant.truth()[6 + count : 6 + 2 * count]
    assert plant.mj_model.nu == count
    assert normal.sum() == pytest.approx(robot.body.mass * GRAVITY, rel=1e-3)
    assert normal == pytest.approx(np.full(count, normal.mean()), rel=2e-3)
    assert np.abs(plant.truth()[3:6]).max() < 1e-4


@pytest.mark.parametrize("robot", [star(3), star(5), mecanum()], ids=["three", "five", "mecanum"])
@pytest.mark.parametrize("current", [(1.0, 0.0), (0.3, 0.8)])
def test_a_twin_of_another_layout_moves_as_the_planar_model_does(robot, current):
    """Currents along a direction and about the centre; what moves the planar robot moves the twin as far."""
    a = rolling_matrix(robot.wheel_positions, robot.rolling_directions)
    target = current[0] * a[:, :2] @ (math.cos(0.7), math.sin(0.7)) + current[1] * np.sign(a[:, 2])
    command = CurrentCommand(np.clip(target, -1.4, 1.4))
    planar = PlanarRobot(robot, "natural_stone", ideal_sensors=True)
    twin = RobotTwin(robot, STONE, ideal_sensors=True)
    for plant in (planar, twin):
        plant.reset()
        for _ in range(600):
            plant.step(command)
    one, other = planar.truth()[:6], twin.truth()[:6]
    assert np.hypot(*one[3:5]) + abs(one[5]) > 0.3
    assert other == pytest.approx(one, abs=0.05 * np.abs(one).max())


def test_the_shipped_platform_of_three_is_read_by_its_name():
    robot = read_robot(Path("three_wheel"))
    assert robot.file == models_folder() / "three_wheel" / "robot.toml"
    angles = np.arctan2(*robot.wheel_positions.T[::-1])
    assert np.diff(np.sort(np.mod(angles, 2.0 * math.pi))) == pytest.approx([2.0 * math.pi / 3.0] * 2)
    assert robot_model(robot, STONE).nu == 3
