"""Floors of every law under the twin: standstill on a slope, power of the load, any slip speed."""

import dataclasses
import math

import numpy as np
import pytest
from driven import axle, run, without_friction
from nightly import latin, representative

from omnimj.parameters.parts import GRAVITY
from omnimj.plant.faults import Fault
from omnimj.plant.mujoco import slots
from omnimj.plant.mujoco.twin import RigTwin, RobotTwin
from omnimj.plant.planar import PlanarRobot
from omnimj.signals import CurrentCommand

LAWS = ("natural_stone", "dry_asphalt", "linoleum", "soft_mat")
CREEP = ("linoleum", "soft_mat")
OFF = CurrentCommand(np.zeros(4))


def felt(twin, wheels):
    """What each wheel feels of the floor, as views that keep to the twin's present state."""
    block = int(twin.mj_model.sensor("wheel_1_contact").adr[0])
    rows = twin.mj_data.sensordata[block:].reshape(wheels, -1).T
    return dict(zip(slots.SENSOR_FIELDS, rows, strict=True))


def positions(plant, instants):
    """x, y of the plant at these times [m], shape (len(instants), 2)."""
    plant.reset()
    found, k = [], 0
    for instant in instants:
        while k * plant.period < instant:
            plant.step(OFF)
            k += 1
        found.append(plant.truth()[:2])
    return np.array(found)


@pytest.mark.slow
@pytest.mark.parametrize("floor", ["natural_stone", "linoleum", "dry_asphalt", "soft_mat"])
def test_with_locked_wheels_twin_and_equations_stand_on_a_slope(robot, floors, floor, measured):
    faults = [Fault("slope", 0.0, None, None, {"angle": 0.04, "direction": 0.3})]
    faults += [Fault("locked", 0.0, None, wheel, {}) for wheel in (1, 2, 3, 4)]
    twin = positions(RobotTwin(robot, floors[floor], faults, ideal_sensors=True), (4.0, 8.0))
    planar = positions(PlanarRobot(robot, floor, faults=faults, ideal_sensors=True), (4.0, 8.0))
    for places in (twin, planar):
        creep = np.linalg.norm(places[1] - places[0]) / 4.0
        measured("standing on a slope of 4 %, creep [m/s]", creep, 1e-5)
        assert creep < 1e-5
    assert 0.0 < np.linalg.norm(twin[1]) < 0.03  # it has given way, and has not slid off


@pytest.mark.parametrize("floor", LAWS)
@pytest.mark.parametrize("exponent", [0.6667, 1.0, 1.2])
def test_the_rig_twin_with_another_mass_has_the_traction_of_its_load(rig, floors, floor, exponent, measured):
    numbers = {**floors[floor].numbers, "load_exponent": exponent, "reference_load": 30.0}
    chosen = dataclasses.replace(floors[floor], numbers=numbers)
    loads, forces = [], []
    for mass in (3.9593, 1.9593):
        twin = RigTwin(rig, chosen, mass=mass, ideal_sensors=True)
        twin.reset()
        m = twin.mj_model
        run(twin, {axle(m): 0.3 / rig.wheel.radius, int(m.joint("rail").dofadr[0]): 0.25}, 1000)
        now = felt(twin, 1)
        loads.append(now["normal_force"][0])
        forces.append(now["traction_force"][0])
    off = abs(forces[0] / forces[1] / (loads[0] / loads[1]) ** exponent - 1.0)
    # the wheel sinks in with its load, which changes the slip a little
    measured("traction of two loads against the power of their ratio [1]", off, 0.005)
    assert off < 0.005
    assert loads[0] / loads[1] == pytest.approx(3.9593 / 1.9593, rel=0.2)


@pytest.mark.slow
@pytest.mark.parametrize("turning", [2.0, -300.0, 40.0])
@pytest.mark.parametrize("floor", CREEP)
def test_wheels_thrown_on_at_any_speed_saturate_and_come_to_rest(robot, floors, floor, turning):
    twin = RobotTwin(robot, floors[floor], ideal_sensors=True)
    twin.reset()
    n, now = floors[floor].numbers, felt(twin, 4)
    twin.mj_data.qvel[[axle(twin.mj_model, i) for i in (2, 4)]] = -turning, turning
    for _ in range(10_000):
        twin.step(OFF)
        loaded = (now["normal_force"] / n.get("reference_load", 1.0)) ** (n.get("load_exponent", 1.0) - 1.0)
        limit = min(n["mu"], n.get("mu_cap", math.inf)) * loaded * now["normal_force"]
        assert np.all(np.abs(now["traction_force"]) <= limit * (1.0 + 1e-9))
    assert np.abs(twin.mj_data.qvel).max() < 1e-4


@pytest.mark.slow
@pytest.mark.parametrize("floor", CREEP)
def test_a_pushed_robot_holds_below_the_limit_and_slides_above(robot, floors, floor):
    n = floors[floor].numbers
    locked = [Fault("locked", 0.0, None, wheel, {}) for wheel in (1, 2, 3, 4)]
    quarter = robot.body.mass * GRAVITY / 4.0
    loaded = (quarter / n.get("reference_load", 1.0)) ** (n.get("load_exponent", 1.0) - 1.0)
    driven = 2.0 * quarter * loaded * min(n["mu"], n.get("mu_cap", math.inf))
    rollers = 2.0 * quarter * robot.wheel.roller_dry
    for share, slides in ((0.8, False), (1.3, True)):
        twin = RobotTwin(robot, floors[floor], locked, ideal_sensors=True)
        twin.reset()
        twin.mj_data.xfrc_applied[twin.mj_model.body("chassis").id, 0] = share * driven + rollers
        for _ in range(3000):
            twin.step(OFF)
        assert (abs(twin.mj_data.qvel[0]) > 0.5) == slides
        assert slides or abs(twin.mj_data.qvel[0]) < 1e-4


@pytest.mark.slow
@pytest.mark.parametrize("direction", [0.0, math.pi / 4.0])
@pytest.mark.parametrize("floor", ["natural_stone", "linoleum"])
def test_a_twin_without_other_friction_stands_below_the_rolling_resistance_and_rolls_above(
    robot, soft, floor, direction
):
    for share, rolls in ((0.8, False), (1.4, True)):
        slope = Fault("slope", 0.0, None, None, {"angle": share * 0.05, "direction": direction})
        plant = RobotTwin(without_friction(robot), soft[floor], [slope], ideal_sensors=True)
        early, late = positions(plant, (3.0, 4.0))
        passed = np.linalg.norm(late - early)
        assert (passed > 0.3) == rolls
        assert rolls or passed < 1e-4


@pytest.mark.parametrize(("floor", "direction"), latin(["natural_stone", "linoleum"], [0.0, math.pi / 4.0]))
def test_a_coasting_twin_is_slowed_by_the_rolling_resistance_in_any_direction(
    robot, floors, soft, floor, direction, measured
):
    lost = []
    for chosen in (floors, soft):
        twin = RobotTwin(without_friction(robot), chosen[floor], ideal_sensors=True)
        twin.reset()
        d, ahead = twin.mj_data, np.array([math.cos(direction), math.sin(direction)])
        d.qvel[:2] = ahead
        d.qvel[[axle(twin.mj_model, i) for i in (1, 2, 3, 4)]] = (
            robot.drive_directions @ ahead / (robot.wheel.radius)
        )
        speeds = []
        for _ in range(800):
            twin.step(OFF)
            speeds.append(np.linalg.norm(twin.truth()[3:5]))
        lost.append(speeds[199] - speeds[-1])
    inertia = robot.wheel.inertia + robot.motor.reflected_inertia
    moved = robot.body.mass / (robot.body.mass + 2.0 * inertia / robot.wheel.radius**2)
    off = (lost[1] - lost[0]) / (0.6 * 0.05 * GRAVITY * moved) - 1.0
    # the rollers' own inertia, which the closed form leaves out, takes a part
    measured("coasting on a soft floor against its rolling resistance [1]", abs(off), 0.03)
    assert abs(off) < 0.03


@pytest.mark.parametrize("floor", representative("linoleum", "natural_stone"))
def test_a_finer_step_changes_little_on_a_soft_floor(robot, soft, floor):
    ends = []
    for timestep in (1e-3, 5e-4):
        twin = RobotTwin(robot, soft[floor], ideal_sensors=True, timestep=timestep)
        twin.reset()
        for _ in range(3000):
            twin.step(CurrentCommand(np.array([0.9, -1.3, -0.6, 1.2])))
        ends.append(twin.truth()[3:6])
    assert np.linalg.norm(ends[1][:2]) > 0.3
    assert ends[0] == pytest.approx(ends[1], rel=0.01, abs=2e-3)


@pytest.mark.parametrize("floor", representative("linoleum", "natural_stone", "dry_asphalt", keep=2))
def test_on_a_soft_floor_traction_and_rollers_only_take_energy_out(robot, soft, floor):
    twin = RobotTwin(robot, soft[floor], ideal_sensors=True)
    twin.reset()
    rng, taken, command, now = np.random.default_rng(7), np.zeros((2, 4)), OFF, felt(twin, 4)
    for k in range(3000):
        if k % 250 == 0:
            command = CurrentCommand(rng.uniform(-1.5, 1.5, 4))
        twin.step(command)
        taken[0] += now["traction_force"] * now["slip_velocity"] * twin.period
        taken[1] -= now["lateral_force"] * now["lateral_velocity"] * twin.period
        assert taken.min() > -1e-4  # a bristle may give back what it stored; the error of the sum
    assert taken.sum() > 0.01


def test_in_the_twin_rolling_resistance_is_that_of_the_floor_under_each_wheel(robot, floors, soft):
    """Wheel and floor add up; a lifted wheel has none."""
    heavy = dataclasses.replace(robot, wheel=dataclasses.replace(robot.wheel, rolling_resistance=0.03))
    for chosen, whole in ((floors["pvc"], 0.03), (soft["pvc"], 0.08)):
        twin = RobotTwin(heavy, chosen, ideal_sensors=True)
        twin.reset()
        for _ in range(200):
            twin.step(OFF)
        now = felt(twin, 4)
        assert now["rolling_resistance"] == pytest.approx(whole * now["normal_force"], rel=1e-4)
    twin.mj_data.qpos[2] += 0.1
    twin.step(OFF)
    assert np.all(felt(twin, 4)["rolling_resistance"] == 0.0)
