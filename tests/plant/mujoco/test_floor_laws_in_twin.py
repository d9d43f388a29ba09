"""Floors of every law under the twin: standstill on a slope, power of the load, any slip speed."""

import dataclasses
import math

import numpy as np
import pytest
from driven import axle, run

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


@pytest.mark.parametrize("floor", LAWS)
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


@pytest.mark.parametrize("floor", CREEP)
@pytest.mark.parametrize("turning", [2.0, 40.0, -300.0])
def test_wheels_thrown_on_at_any_speed_saturate_and_come_to_rest(robot, floors, floor, turning):
    twin = RobotTwin(robot, floors[floor], ideal_sensors=True)
    twin.reset()
    n = floors[floor].numbers
    twin.mj_data.qvel[[axle(twin.mj_model, i) for i in (2, 4)]] = -turning, turning
    for _ in range(10_000):
        twin.step(OFF)
        now = felt(twin, 4)
        loaded = (now["normal_force"] / n.get("reference_load", 1.0)) ** (n.get("load_exponent", 1.0) - 1.0)
        limit = min(n["mu"], n.get("mu_cap", math.inf)) * loaded * now["normal_force"]
        assert np.all(np.abs(now["traction_force"]) <= limit * (1.0 + 1e-9))
    assert np.abs(twin.mj_data.qvel).max() < 1e-4


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
