"""A shorted motor brakes by its own current, whatever its amplifier does, in both plants."""

from __future__ import annotations

import numpy as np
import pytest

from omnimj.parameters import read_floors, read_robot
from omnimj.plant.faults import Fault
from omnimj.plant.mujoco.twin import RobotTwin
from omnimj.plant.planar import PlanarRobot
from omnimj.signals import CurrentCommand

ROBOT = read_robot()
FORWARD = np.array([0.0, -0.9, 0.0, 0.9])
NOTHING = np.zeros(4)


def make(plant, faults=()):
    if plant == "planar":
        return PlanarRobot(ROBOT, "natural_stone", faults=faults, seed=1, ideal_sensors=True)
    return RobotTwin(ROBOT, read_floors()["natural_stone"], faults, seed=1, ideal_sensors=True)


def driven(plant, command, steps):
    measurement = None
    for _ in range(steps):
        measurement = plant.step(command)
    assert measurement is not None
    return measurement


@pytest.mark.parametrize("plant", ["planar", "twin"])
def test_a_shorted_motor_drives_the_current_of_its_back_emf_through_itself(plant):
    robot, motor = make(plant), ROBOT.motor
    robot.reset()
    driven(robot, CurrentCommand(FORWARD), 800)
    found = driven(robot, CurrentCommand(NOTHING, (2, 4)), 30)
    expected = -motor.torque_constant * motor.gear_ratio * found.wheel_speed / motor.resistance
    assert np.abs(found.wheel_speed[[1, 3]]).min() > 1.0
    assert found.current[[1, 3]] == pytest.approx(expected[[1, 3]], abs=0.05)
    assert found.current[[0, 2]] == pytest.approx(np.zeros(2), abs=0.01)


@pytest.mark.parametrize("plant", ["planar", "twin"])
def test_the_brake_stops_a_robot_sooner_than_motors_without_current_and_releases(plant):
    speeds = []
    for brake in ((), (2, 4)):
        robot = make(plant)
        robot.reset()
        driven(robot, CurrentCommand(FORWARD), 800)
        found = driven(robot, CurrentCommand(NOTHING, brake), 200)
        speeds.append(abs(found.wheel_speed[1]))
        again = driven(robot, CurrentCommand(FORWARD), 20)
        assert again.current[3] == pytest.approx(0.9, abs=0.02)
    assert speeds[1] < 0.7 * speeds[0]


@pytest.mark.parametrize("plant", ["planar", "twin"])
@pytest.mark.parametrize("kind", ["free", "hard_over"])
def test_the_brake_holds_a_motor_with_a_dead_or_runaway_amplifier_also_when_the_fault_comes_later(
    plant, kind
):
    robot = make(plant, [Fault(kind, 0.1, None, 1)])
    robot.reset()
    found = driven(robot, CurrentCommand(NOTHING, (1,)), 600)
    assert abs(found.wheel_speed[0]) < 0.05
    assert abs(found.current[0]) < 0.05
