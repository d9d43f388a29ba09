"""The twin against the planar equations: the rig integrated afresh, the robot by the planar plant."""

import math

import numpy as np
import pytest
from rig_reference import integrate

from omnimj.plant.planar import PlanarRobot
from omnimj.signals import CurrentCommand
from omnimj.twin.twin import RigTwin, RobotTwin

CURRENTS = (0.45, 0.60, 0.75, 0.90, 1.05, 1.20, 1.35, 1.50)


def carriage_error(rig, floor, mass, current, lateral_speed, duration):
    """RMS difference of the carriage speed between twin and integrated equations [m/s]."""
    time, speed, _ = integrate(rig, floor, mass, current, duration, lateral_speed)
    twin = RigTwin(rig, floor, mass=mass, lateral_speed=lateral_speed, ideal_sensors=True)
    twin.reset()
    command = CurrentCommand(np.array([current]))
    column = twin.truth_names.index("true_carriage_speed")
    driven = []
    for _ in range(round(duration / twin.period)):
        twin.step(command)
        driven.append(twin.truth()[column])
    sampled = np.interp(twin.period * np.arange(1, len(driven) + 1), time, speed)
    return math.sqrt(np.mean((np.array(driven) - sampled) ** 2))


@pytest.mark.parametrize("mass", [3.9593, 2.9593, 1.9593])
@pytest.mark.parametrize("floor", ["natural_stone", "pvc", "paperboard"])
def test_the_rig_twin_drives_as_its_equations_say(rig, floors, floor, mass):
    for current in CURRENTS:
        assert carriage_error(rig, floors[floor], mass, current, 0.0, 1.05) <= 0.010, current


@pytest.mark.parametrize("lateral_speed", [0.2, 0.35, 0.5, 0.65, -0.2, -0.35, -0.5, -0.65])
def test_the_rig_twin_drives_as_its_equations_say_when_moved_sideways(rig, floors, lateral_speed):
    for current in (0.6, 0.9, 1.2, 1.5):
        error = carriage_error(rig, floors["natural_stone"], 3.9593, current, lateral_speed, 0.9)
        assert error <= 0.010, current


@pytest.mark.parametrize("floor", ["natural_stone", "pvc", "paperboard"])
@pytest.mark.parametrize("eighth", range(8))
@pytest.mark.parametrize("strength", [0.6, 1.0])
def test_the_robot_twin_drives_as_the_planar_model(robot, floors, floor, eighth, strength):
    along = np.array([math.cos(eighth * math.pi / 4.0), math.sin(eighth * math.pi / 4.0)])
    share = robot.drive_directions @ along
    command = CurrentCommand(strength * share / np.abs(share).max())
    twists = []
    for plant in (
        RobotTwin(robot, floors[floor], ideal_sensors=True),
        PlanarRobot(robot, floor, ideal_sensors=True),
    ):
        plant.reset()
        rows = []
        for _ in range(5000):
            plant.step(command)
            rows.append(plant.truth()[3:6])
        twists.append(np.array(rows))
    off = twists[0] - twists[1]
    assert math.sqrt(np.mean((off[:, :2] ** 2).sum(axis=1))) <= 0.02
    assert math.sqrt(np.mean(off[:, 2] ** 2)) <= 0.05
    assert np.linalg.norm(twists[1][-1, :2]) > 0.5
