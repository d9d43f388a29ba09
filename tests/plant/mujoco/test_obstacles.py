"""Ramps, thresholds and height fields: MuJoCo finds the contacts, the wheels do the rest."""

import math

import numpy as np
import pytest

from omnimj.plant.faults import Fault
from omnimj.plant.mujoco.twin import RobotTwin
from omnimj.resources import models_folder
from omnimj.signals import CurrentCommand

SCENE = models_folder() / "uto_robot" / "obstacles.xml"


def travel(robot, floors, current, seconds, start=(0.0, 0.0, 0.0)):
    """Pose and truth along a drive with constant currents."""
    twin = RobotTwin(robot, floors["natural_stone"], scene=SCENE, start=start, ideal_sensors=True)
    twin.reset()
    command = CurrentCommand(np.array(current))
    places, truths = [], []
    for _ in range(round(seconds / twin.period)):
        twin.step(command)
        places.append(twin.pose()[:7])
        truths.append(twin.truth())
    return np.array(places), np.array(truths)


def test_the_robot_climbs_a_ramp_at_the_ramp_s_angle(robot, floors):
    places, truths = travel(robot, floors, [0.0, -1.4, 0.0, 1.4], 3.0)
    on_ramp = (places[:, 0] > 1.3) & (places[:, 0] < 2.0)
    assert on_ramp.sum() > 100
    slope = np.polyfit(places[on_ramp, 0], places[on_ramp, 2], 1)[0]
    assert slope == pytest.approx(math.tan(math.radians(3.0)), rel=0.02)
    pitch = 2.0 * np.degrees(np.arcsin(places[on_ramp, 5]))  # about y
    assert np.mean(pitch) == pytest.approx(-3.0, abs=0.1)
    weight = robot.body.mass * 9.81 * math.cos(math.radians(3.0))
    assert truths[on_ramp, 10:14].sum(axis=1).mean() == pytest.approx(weight, rel=0.02)


def test_a_tilted_floor_takes_its_share_of_the_acceleration(robot, floors):
    downhill = Fault("slope", 0.0, None, None, {"angle": math.radians(3.0), "direction": math.pi})
    speeds = []
    for faults in ((), (downhill,)):
        twin = RobotTwin(robot, floors["natural_stone"], faults=faults, ideal_sensors=True)
        twin.reset()
        for _ in range(500):
            twin.step(CurrentCommand(np.array([0.0, -0.9, 0.0, 0.9])))
        speeds.append(twin.truth()[3])
    expected = 9.81 * math.sin(math.radians(3.0)) * 0.5 * robot.body.mass / _moving_mass(robot)
    assert speeds[0] - speeds[1] == pytest.approx(expected, rel=0.05)


def _moving_mass(robot):
    """Mass with the rotating parts of the two wheels that drive along x."""
    inertia = robot.wheel.inertia + robot.motor.reflected_inertia
    return robot.body.mass + 2.0 * inertia / robot.wheel.radius**2


def test_the_robot_crosses_a_threshold_and_drives_on(robot, floors):
    places, _ = travel(robot, floors, [-1.2, 0.0, 1.2, 0.0], 2.6)
    assert places[-1, 1] > 1.3
    assert places[:, 2].max() > places[0, 2] + 0.001
    assert places[-1, 2] == pytest.approx(places[0, 2], abs=1e-3)
    assert np.abs(places[:, 4:6]).max() < 0.05


def test_wheels_follow_a_height_field(robot, floors):
    places, truths = travel(robot, floors, [0.0, 1.2, 0.0, -1.2], 3.0)
    assert places[-1, 0] < -2.0
    on_waves = places[:, 0] < -1.2
    assert np.ptp(places[on_waves, 2]) > 0.0015
    weight = robot.body.mass * 9.81
    assert truths[on_waves, 10:14].sum(axis=1).mean() == pytest.approx(weight, rel=0.03)
