"""The twin against the planar equations: the rig integrated afresh, the robot by the planar plant."""

import dataclasses
import math

import numpy as np
import pytest
from nightly import in_turn, latin
from rig_reference import integrate

from omnimj.plant.mujoco.twin import RigTwin, RobotTwin
from omnimj.plant.planar import PlanarRobot
from omnimj.signals import CurrentCommand
from omnimj.simulate.driving import drive_rig

ON_FLOORS = ("natural_stone", "pvc", "paperboard")
OTHER_LAWS = ("dry_asphalt", "linoleum", "soft_mat")
CURRENTS = (0.45, 0.60, 0.75, 0.90, 1.05, 1.20, 1.35, 1.50)


def carriage_error(rig, floor, mass, current, lateral_speed, duration):
    """RMS difference of the carriage speed between twin and integrated equations [m/s]."""
    time, speed, _ = integrate(rig, floor, mass, current, duration, lateral_speed)
    twin = RigTwin(rig, floor, mass=mass, lateral_speed=lateral_speed, ideal_sensors=True)
    driven = drive_rig(twin, np.full(round(duration / twin.period) + 1, current))["true_carriage_speed"][1:]
    sampled = np.interp(twin.period * np.arange(1, len(driven) + 1), time, speed)
    return math.sqrt(np.mean((driven - sampled) ** 2))


def planar_error(robot, floors, current, floor="natural_stone"):
    """RMS difference of body velocity and of yaw rate between twin and planar model over 5 s."""
    twists = []
    for plant in (
        RobotTwin(robot, floors[floor], ideal_sensors=True),
        PlanarRobot(robot, floor, ideal_sensors=True, floors=floors),
    ):
        plant.reset()
        rows, command = [], CurrentCommand(np.asarray(current))
        for _ in range(5000):
            plant.step(command)
            rows.append(plant.truth()[3:6])
        twists.append(np.array(rows))
    assert np.abs(twists[1][-1]).max() > 0.5  # two robots at rest would agree, too
    off = twists[0] - twists[1]
    return math.sqrt(np.mean((off[:, :2] ** 2).sum(axis=1))), math.sqrt(np.mean(off[:, 2] ** 2))


@pytest.mark.parametrize(("floor", "mass"), latin(ON_FLOORS, [3.9593, 2.9593, 1.9593]))
def test_the_rig_twin_drives_as_its_equations(rig, floors, floor, mass, measured):
    for current in CURRENTS:
        error = carriage_error(rig, floors[floor], mass, current, 0.0, 1.05)
        measured("rig twin against Eqs. 4.31-4.40, RMS of carriage speed [m/s]", error, 0.010)
        assert error <= 0.010, current


@pytest.mark.slow
@pytest.mark.parametrize("lateral_speed", [0.65, -0.35, 0.2, 0.35, 0.5, -0.2, -0.5, -0.65])
def test_the_rig_twin_drives_as_its_equations_when_moved_sideways(rig, floors, lateral_speed, measured):
    for current in (0.6, 0.9, 1.2, 1.5):
        error = carriage_error(rig, floors["natural_stone"], 3.9593, current, lateral_speed, 0.9)
        measured("the same with the gantry moving sideways [m/s]", error, 0.010)
        assert error <= 0.010, current


def test_rolling_resistance_acts_on_the_carriage_as_in_the_equations(rig, floors):
    heavy = dataclasses.replace(rig, wheel=dataclasses.replace(rig.wheel, rolling_resistance=0.03))
    assert carriage_error(heavy, floors["natural_stone"], 3.9593, 0.9, 0.0, 0.9) <= 0.010


@pytest.mark.slow
def test_rolling_resistance_takes_its_torque_from_the_robot_s_wheels(robot, floors):
    heavy = dataclasses.replace(robot, wheel=dataclasses.replace(robot.wheel, rolling_resistance=0.03))
    command = CurrentCommand(np.array([0.0, -0.9, 0.0, 0.9]))
    speeds = []
    for machine in (robot, heavy):
        twin = RobotTwin(machine, floors["natural_stone"], ideal_sensors=True)
        twin.reset()
        for _ in range(500):
            twin.step(command)
        speeds.append(twin.truth()[3])
    inertia = robot.wheel.inertia + robot.motor.reflected_inertia
    moving = robot.body.mass + 2.0 * inertia / robot.wheel.radius**2
    # two driving wheels carry half the weight; the wheels at the sides do not turn
    lost = 0.03 * 0.5 * robot.body.mass * 9.81 * 0.5 / moving
    assert speeds[0] - speeds[1] == pytest.approx(lost, rel=0.06)


@pytest.mark.parametrize(
    ("floor", "eighth", "strength"), in_turn((*ON_FLOORS, *OTHER_LAWS), range(8), [0.6, 1.0])
)
def test_the_robot_twin_drives_as_the_planar_model(robot, floors, floor, eighth, strength, measured):
    along = np.array([math.cos(eighth * math.pi / 4.0), math.sin(eighth * math.pi / 4.0)])
    share = robot.drive_directions @ along
    linear, angular = planar_error(robot, floors, strength * share / np.abs(share).max(), floor)
    measured("robot twin against planar model, 5 s, RMS of velocity [m/s]", linear, 0.02)
    measured("robot twin against planar model, 5 s, RMS of yaw rate [rad/s]", angular, 0.05)
    assert linear <= 0.02
    assert angular <= 0.05


@pytest.mark.slow
@pytest.mark.parametrize("eighth", range(8))
@pytest.mark.parametrize("floor", ["natural_stone", "linoleum"])
def test_the_robot_twin_drives_as_the_planar_model_on_soft_floors(robot, soft, floor, eighth, measured):
    along = np.array([math.cos(eighth * math.pi / 4.0), math.sin(eighth * math.pi / 4.0)])
    share = robot.drive_directions @ along
    linear, angular = planar_error(robot, soft, 1.2 * share / np.abs(share).max() + 0.05, floor)
    measured("robot twin against planar model on soft floors, RMS of velocity [m/s]", linear, 0.02)
    measured("robot twin against planar model on soft floors, RMS of yaw rate [rad/s]", angular, 0.05)
    assert linear <= 0.02
    assert angular <= 0.05


@pytest.mark.parametrize("lateral_speed", [0.0, 0.35, -0.65])
def test_the_rig_twin_drives_as_its_equations_on_a_soft_floor(rig, floors, lateral_speed, measured):
    stone = floors["natural_stone"]
    # with more resistance to its rollers, one row of them lifts off in the equations
    soft = dataclasses.replace(stone, numbers={**stone.numbers, "rolling_resistance": 0.008})
    for current in (0.75, 1.2):
        error = carriage_error(rig, soft, 3.9593, current, lateral_speed, 0.9)
        measured("rig twin against its equations on a soft floor [m/s]", error, 0.010)
        assert error <= 0.010, current


@pytest.mark.slow
def test_turning_on_the_spot_the_two_rows_scrub_which_the_planar_model_lacks(robot, floors, measured):
    one_row = dataclasses.replace(robot, wheel=dataclasses.replace(robot.wheel, row_offset=0.0))
    scrubbing, single = (planar_error(machine, floors, np.full(4, 0.6))[1] for machine in (robot, one_row))
    measured("robot twin turning on the spot, rollers in one plane, RMS of yaw rate [rad/s]", single, 0.05)
    measured("the same with the two rows 22 mm apart (the planar model has no rows)", scrubbing, 0.1)
    assert single <= 0.05
    assert 2.0 * single < scrubbing <= 0.1


@pytest.mark.slow
def test_on_the_diagonal_at_low_current_the_rollers_inertia_is_what_the_planar_model_lacks(
    robot, floors, measured
):
    light = dataclasses.replace(robot, wheel=dataclasses.replace(robot.wheel, roller_mass=1e-4))
    current = 0.45 * np.sign(robot.drive_directions @ np.ones(2))
    heavy_error, light_error = (
        planar_error(robot, floors, current)[0],
        planar_error(light, floors, current)[0],
    )
    measured("robot on the diagonal at 0.45 A, rollers without mass [m/s]", light_error, 0.02)
    measured("the same with the rollers' 10 g (the goal of 0.02 is missed)", heavy_error, 0.03)
    assert light_error <= 0.02
    assert light_error < heavy_error <= 0.03


@pytest.mark.slow
@pytest.mark.parametrize("eighth", [1, 4, 0, 2, 3, 5, 6, 7])
def test_driving_and_turning_at_once_the_twin_drives_as_the_planar_model(robot, floors, eighth, measured):
    along = np.array([math.cos(eighth * math.pi / 4.0), math.sin(eighth * math.pi / 4.0)])
    share = robot.drive_directions @ along
    linear, angular = planar_error(robot, floors, 0.8 * share / np.abs(share).max() + 0.05)
    measured("robot driving and turning, RMS of velocity [m/s]", linear, 0.02)
    measured("robot driving and turning, RMS of yaw rate [rad/s]", angular, 0.05)
    assert linear <= 0.02
    assert angular <= 0.05
