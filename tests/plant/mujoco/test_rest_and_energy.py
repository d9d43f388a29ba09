"""At rest nothing moves; friction only takes energy out; a finer step changes nothing that matters."""

import mujoco
import numpy as np
import pytest
from nightly import representative

from omnimj.parameters import read_floors
from omnimj.plant.mujoco import slots
from omnimj.plant.mujoco.twin import RobotTwin
from omnimj.signals import CurrentCommand

LAWS = ("natural_stone", "dry_asphalt", "linoleum")
"""A floor of every law."""
FLOORS = representative(*LAWS, *(name for name in read_floors() if name not in LAWS), keep=len(LAWS))
OFF = CurrentCommand(np.zeros(4))


def felt(twin):
    """What each wheel feels of the floor, as views that keep to the twin's present state."""
    block = int(twin.mj_model.sensor("wheel_1_contact").adr[0])
    return dict(zip(slots.SENSOR_FIELDS, twin.mj_data.sensordata[block:].reshape(4, -1).T, strict=True))


def drive(twin, current, seconds):
    """Holds currents, without a reading of the sensors."""
    twin.mj_data.ctrl[:] = current
    mujoco.mj_step(twin.mj_model, twin.mj_data, round(seconds / twin.mj_model.opt.timestep))


@pytest.mark.parametrize("floor", FLOORS)
def test_at_rest_the_floor_carries_the_weight_and_nothing_moves(robot, floors, floor, measured):
    twin = RobotTwin(robot, floors[floor], ideal_sensors=True)
    twin.reset()
    drive(twin, np.zeros(4), 2.0)
    off = abs(felt(twin)["normal_force"].sum() / (robot.body.mass * 9.81) - 1.0)
    measured("at rest: normal forces against weight [1]", off, 1e-3)
    measured("at rest: largest speed after 2 s [m/s, rad/s]", np.abs(twin.mj_data.qvel).max(), 1e-5)
    assert off <= 1e-3
    assert np.abs(twin.mj_data.qvel).max() < 1e-5


@pytest.mark.slow
def test_a_resting_robot_drifts_less_than_a_tenth_of_a_millimetre_in_a_minute(robot, floors, measured):
    twin = RobotTwin(robot, floors["natural_stone"], ideal_sensors=True)
    twin.reset()
    start = twin.mj_data.qpos.copy()
    mujoco.mj_step(twin.mj_model, twin.mj_data, 60_000)
    measured("at rest: drift in 60 s [m, rad]", np.abs(twin.mj_data.qpos - start).max(), 1e-4)
    assert np.abs(twin.mj_data.qpos - start).max() < 1e-4


def test_a_dropped_robot_lands_on_its_wheels_and_comes_to_rest(robot, floors):
    twin = RobotTwin(robot, floors["natural_stone"], ideal_sensors=True)
    twin.reset()
    rest = twin.mj_data.qpos[2]
    twin.mj_data.qpos[2] += 0.10  # 1.4 m/s at the floor: deeper than the margin, MuJoCo's solver helps
    drive(twin, np.zeros(4), 4.0)
    assert np.abs(twin.mj_data.qvel[:6]).max() < 1e-4
    assert twin.mj_data.qpos[2] == pytest.approx(rest, abs=1e-3)
    assert felt(twin)["normal_force"].sum() == pytest.approx(robot.body.mass * 9.81, rel=1e-3)


@pytest.mark.slow
@pytest.mark.parametrize("force", [(60.0, 0.0), (0.0, -80.0), (50.0, 50.0)])
@pytest.mark.parametrize("floor", ["natural_stone", "dry_asphalt", "paperboard", "pvc"])
def test_a_pushed_robot_stops_and_stays(robot, floors, floor, force):
    twin = RobotTwin(robot, floors[floor], ideal_sensors=True)
    twin.reset()
    chassis = twin.mj_model.body("chassis").id
    twin.mj_data.xfrc_applied[chassis, :2] = force
    drive(twin, np.zeros(4), 0.3)
    assert np.linalg.norm(twin.mj_data.qvel[:2]) > 0.05
    twin.mj_data.xfrc_applied[chassis, :2] = 0.0
    drive(twin, np.zeros(4), 5.0)
    stopped = twin.mj_data.qpos[:2].copy()
    assert np.abs(twin.mj_data.qvel[:6]).max() < 1e-4
    drive(twin, np.zeros(4), 10.0)
    assert np.abs(twin.mj_data.qpos[:2] - stopped).max() < 1e-4


@pytest.mark.slow
@pytest.mark.parametrize("floor", FLOORS)
def test_traction_and_roller_friction_only_take_energy_out(robot, floors, floor):
    twin = RobotTwin(robot, floors[floor], ideal_sensors=True)
    twin.reset()
    rng = np.random.default_rng(7)
    taken, now = (np.zeros(4), np.zeros(4)), felt(twin)
    for k in range(3000):
        if k % 250 == 0:
            command = CurrentCommand(rng.uniform(-1.5, 1.5, 4))
        twin.step(command)
        taken[0][:] += now["traction_force"] * now["slip_velocity"] * twin.period
        taken[1][:] -= now["lateral_force"] * now["lateral_velocity"] * twin.period
        # a bristle may give back what it stored, never more; 0.1 mJ is the error of the sum
        assert min(taken[0].min(), taken[1].min()) > -1e-4
    assert taken[0].sum() + taken[1].sum() > 0.01


def test_a_coasting_robot_never_gains_mechanical_energy(robot, floors):
    twin = RobotTwin(robot, floors["natural_stone"], ideal_sensors=True)
    twin.mj_model.opt.enableflags |= int(mujoco.mjtEnableBit.mjENBL_ENERGY)
    twin.reset()
    drive(twin, [0.5, -0.9, -0.3, 0.8], 1.0)
    drive(twin, np.zeros(4), 0.02)  # the current decays
    highest, now = np.inf, felt(twin)
    for _ in range(2500):
        twin.step(OFF)
        stored = 0.5 * (now["normal_force"] ** 2).sum() / robot.contact.stiffness
        energy = twin.mj_data.energy.sum() + stored
        assert energy < highest + 1e-3  # of 14 J: the explicit step's own error
        highest = min(highest, energy)


def test_halving_the_time_step_changes_end_speeds_by_less_than_a_percent(robot, floors, measured):
    current = [0.5, -0.9, -0.45, 0.8]
    ends = []
    for timestep in (1e-3, 5e-4):
        twin = RobotTwin(robot, floors["natural_stone"], ideal_sensors=True, timestep=timestep)
        twin.reset()
        drive(twin, current, 5.0)
        ends.append(twin.truth()[3:6])
    coarse, fine = ends
    change = np.linalg.norm(coarse[:2] - fine[:2]) / np.linalg.norm(fine[:2])
    measured("time step halved: change of end speed after 5 s [1]", change, 0.01)
    assert change < 0.01
    assert abs(coarse[2] - fine[2]) < 0.01 * max(abs(fine[2]), 0.1)
