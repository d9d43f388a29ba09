"""MJCF and TOML agree; the compiled model is the machine that the constants describe."""

import dataclasses

import mujoco
import numpy as np
import pytest

from omnimj.errors import InputError
from omnimj.parameters.floor import TRACTION_SIZE
from omnimj.plant.ground import Patch
from omnimj.plant.mujoco import slots
from omnimj.plant.mujoco.assembly import rig_model, robot_model
from omnimj.plant.mujoco.mjcf import compile_spec, load_spec, part
from omnimj.plant.mujoco.twin import RigTwin, RobotTwin
from omnimj.resources import models_folder
from omnimj.signals import CurrentCommand

COMPARED = (
    "body_mass",
    "body_inertia",
    "body_ipos",
    "body_pos",
    "body_quat",
    "dof_armature",
    "dof_damping",
    "jnt_stiffness",
    "jnt_range",
    "qpos_spring",
    "geom_size",
    "actuator_ctrlrange",
)


def as_file(name):
    return mujoco.MjModel.from_xml_path(str(models_folder() / name / "scene.xml"))


@pytest.mark.parametrize("name", ["uto_robot", "quarter_rig"])
@pytest.mark.parametrize("array", COMPARED)
def test_the_files_mjcf_and_toml_hold_the_same_numbers(name, array, robot, rig, floors):
    file = as_file(name)
    stone = floors["natural_stone"]
    loaded = robot_model(robot, stone) if name == "uto_robot" else rig_model(rig, stone)
    if array == "jnt_range" and name == "quarter_rig":
        # the file's rail begins at its end, the loader puts zero where runs start
        at = file.joint("rail").id
        assert np.ptp(file.jnt_range[at]) == pytest.approx(np.ptp(loaded.jnt_range[at]))
        file.jnt_range[at] = loaded.jnt_range[at]
    assert np.allclose(getattr(file, array), getattr(loaded, array), rtol=1e-5, atol=1e-7)


@pytest.mark.parametrize("name", ["uto_robot", "quarter_rig"])
def test_opened_by_plain_mujoco_the_shipped_machines_stand_on_the_floor(name, robot):
    m = as_file(name)
    d = mujoco.MjData(m)
    mujoco.mj_step(m, d, 1000)
    wheels = [b for b in range(m.nbody) if m.body(b).name.endswith("_wheel")]
    depth = robot.wheel.radius - d.xpos[wheels, 2]
    assert len(depth) == (4 if name == "uto_robot" else 1)
    assert np.all((depth > 1e-6) & (depth < 1e-4))
    assert np.abs(d.qvel).max() < 1e-3


def test_opened_by_plain_mujoco_the_shipped_motors_drive_the_robot_by_their_currents(robot):
    m = as_file("uto_robot")
    d = mujoco.MjData(m)
    motor, wheel = robot.motor, robot.wheel
    mujoco.mj_step(m, d, 500)
    d.ctrl[:] = current = np.array([0.0, -0.3, 0.0, 0.3])
    mujoco.mj_step(m, d, 500)
    torque = motor.torque_constant * motor.gear_ratio * motor.gear_efficiency * current
    driven = wheel.inertia + motor.reflected_inertia
    ahead = np.array(torque) / wheel.radius @ [w.drives_along[0] for w in robot.wheels]
    expected = 0.5 * ahead / (robot.body.mass + 2.0 * driven / wheel.radius**2)
    assert d.qvel[0] == pytest.approx(expected, rel=0.02)
    assert abs(d.qvel[1]) < 0.01 and abs(d.qvel[5]) < 0.05


def test_the_rig_file_has_the_motor_of_the_constants(rig):
    motor = rig.motor
    torque = motor.torque_constant * motor.gear_ratio * motor.gear_efficiency
    assert as_file("quarter_rig").actuator("motor_1").gainprm[0] == pytest.approx(torque)
    assert as_file("uto_robot").actuator("motor_1").gainprm[0] == pytest.approx(torque)


def test_the_twin_s_rollers_are_left_to_the_native_callback_at_any_depth_up_to_3_mm(robot, floors):
    m = robot_model(robot, floors["natural_stone"])
    rollers = m.geom_user[:, slots.KIND] == slots.ROLLER
    assert np.all(m.geom_margin[rollers] == -0.003) and np.all(m.geom_gap[rollers] == 0.003)
    assert np.all(m.actuator_dyntype == mujoco.mjtDyn.mjDYN_USER) and not m.actuator_gainprm[:, 0].any()


def test_the_robot_has_86_degrees_of_freedom_and_72_rollers(robot, floors):
    m = robot_model(robot, floors["natural_stone"])
    assert m.nv == 86
    assert sum(m.body(b).name.count("roller_") for b in range(m.nbody)) == 72
    assert len(set(m.jnt_user.shape) | {m.nu, m.na}) and (m.nu, m.na) == (4, 20)


def test_masses_add_up_to_the_robot_s_mass_and_yaw_inertia(robot, floors):
    m = robot_model(robot, floors["natural_stone"])
    d = mujoco.MjData(m)
    mujoco.mj_forward(m, d)
    assert m.body_subtreemass[0] == pytest.approx(robot.body.mass, rel=1e-12)
    corners = [m.body(f"corner_{i}") for i in range(1, 5)]
    for corner in corners:
        assert m.body_subtreemass[corner.id] == pytest.approx(robot.body.unsprung_mass)
    about_vertical = 0.0
    for body in range(1, m.nbody):
        turn = d.ximat[body].reshape(3, 3)
        about_vertical += (turn @ np.diag(m.body_inertia[body]) @ turn.T)[2, 2]
        about_vertical += m.body_mass[body] * (d.xipos[body][:2] ** 2).sum()
    assert about_vertical == pytest.approx(robot.body.yaw_inertia, rel=1e-3)
    assert d.subtree_com[0][2] == pytest.approx(robot.body.com_height, abs=5e-4)


def test_a_wheel_turns_with_the_stated_inertia(robot, floors):
    m = robot_model(robot, floors["natural_stone"])
    dof = int(m.joint("wheel_1_axle").dofadr[0])
    expected = robot.wheel.inertia + robot.motor.reflected_inertia
    assert m.dof_M0[dof] == pytest.approx(expected, rel=1e-3)
    rollers = [b for b in range(m.nbody) if m.body(b).name.startswith("wheel_1_")]
    assert sum(m.body_mass[rollers]) == pytest.approx(robot.wheel.mass)


def test_wheels_stand_and_drive_where_the_constants_place_them(robot, floors):
    m = robot_model(robot, floors["natural_stone"])
    d = mujoco.MjData(m)
    mujoco.mj_forward(m, d)
    for i, mount in enumerate(robot.wheels, start=1):
        body = m.body(f"wheel_{i}_wheel").id
        assert np.allclose(d.xpos[body][:2], mount.position, atol=1e-9)
        assert np.allclose(d.xmat[body].reshape(3, 3)[:2, 0], mount.drives_along, atol=1e-9)
        assert np.allclose(d.xmat[body].reshape(3, 3)[:, 2], (0.0, 0.0, 1.0), atol=1e-9)


@pytest.mark.parametrize("mass", [3.9593, 2.9593, 1.9593])
def test_the_rig_carries_the_mass_it_is_loaded_to(rig, floors, mass):
    m = rig_model(rig, floors["pvc"], mass)
    assert m.body_subtreemass[m.body("carriage").id] == pytest.approx(mass)


def test_changed_constants_reach_the_model(robot, floors):
    wheel = dataclasses.replace(robot.wheel, radius=0.06, roller_radius=0.010, row_offset=0.013, inertia=6e-4)
    m = robot_model(dataclasses.replace(robot, wheel=wheel), floors["pvc"])
    d = mujoco.MjData(m)
    mujoco.mj_forward(m, d)
    wheel_place = d.xpos[m.body("wheel_4_wheel").id]
    for row in (0, 1):
        roller = m.body(f"wheel_4_roller_0_row_{row}").id
        away = d.xpos[roller] - wheel_place
        assert np.hypot(away[0], away[2]) == pytest.approx(0.05)
        assert abs(away[1]) == pytest.approx(0.013)
    assert d.ncon >= 4
    assert m.actuator_user[0, slots.RADIUS] == 0.06


def test_patches_are_geoms_and_later_ones_lie_on_top(robot, floors):
    patches = (Patch("oil", (0.0, 0.0), (4.0, 4.0)), Patch("pvc", (0.0, 0.0), (1.0, 1.0), 0.3))
    m = robot_model(robot, floors["natural_stone"], patches)
    assert m.geom("patch_2").id == m.geom("patch_1").id + 1
    row = m.geom_user[m.geom("patch_2").id, slots.TRACTION : slots.TRACTION + TRACTION_SIZE]
    assert np.array_equal(row, floors["pvc"].row)


def test_broken_mjcf_gives_one_line_that_names_the_file(tmp_path):
    path = tmp_path / "broken.xml"
    path.write_text("<mujoco><worldbody><geom type='plane'")
    with pytest.raises(InputError, match=r"broken\.xml") as caught:
        load_spec(path)
    assert "\n" not in str(caught.value)


def test_mjcf_that_does_not_compile_gives_one_line_that_names_the_file(tmp_path):
    path = tmp_path / "broken.xml"
    path.write_text(
        "<mujoco><asset><mesh name='m' file='none.obj'/></asset>"
        "<worldbody><geom type='mesh' mesh='m'/></worldbody></mujoco>"
    )
    with pytest.raises(InputError, match=r"broken\.xml") as caught:
        compile_spec(load_spec(path), path)
    assert "\n" not in str(caught.value)


def test_a_missing_part_is_named():
    spec = mujoco.MjSpec.from_string("<mujoco model='bare'><worldbody/></mujoco>")
    with pytest.raises(InputError, match=r"bare.*has no body 'chassis'"):
        part(spec, "body", "chassis")


@pytest.mark.parametrize(
    ("change", "named"),
    [
        ({"rollers_per_row": 10}, "rollers_per_row"),
        ({"inertia": 1e-4}, "wheel.inertia"),
        ({"mass": 0.1}, "wheel.inertia"),
    ],
)
def test_wheels_that_the_file_cannot_be_are_refused(robot, floors, change, named):
    other = dataclasses.replace(robot, wheel=dataclasses.replace(robot.wheel, **change))
    with pytest.raises(InputError, match=named):
        robot_model(other, floors["pvc"])


def test_a_lean_model_steps_to_the_same_state(robot, floors):
    states = []
    for lean in (False, True):
        m = robot_model(robot, floors["natural_stone"], lean=lean)
        d = mujoco.MjData(m)
        d.ctrl[:] = (0.2, -0.8, 0.1, 0.6)
        mujoco.mj_step(m, d, 500)
        states.append(np.concatenate([d.qpos, d.qvel, d.act]))
    assert np.allclose(*states, rtol=0.0, atol=1e-9)


@pytest.mark.parametrize("place", [(0.0, 0.0), (0.12, -0.07)])
@pytest.mark.parametrize("current", [(0.4, -0.9, -0.3, 0.8), (0.7, 0.7, 0.7, 0.9)])
def test_the_twin_s_accelerations_are_those_of_mujoco_s_accelerometer(robot, floors, current, place):
    body = dataclasses.replace(robot.body, accelerometer_x=place[0], accelerometer_y=place[1])
    robot = dataclasses.replace(robot, body=body)
    full = robot_model(robot, floors["natural_stone"])
    d = mujoco.MjData(full)
    twin = RobotTwin(robot, floors["natural_stone"], ideal_sensors=True)
    twin.reset()
    d.qpos[2] = twin.mj_data.qpos[2]
    d.ctrl[:] = current
    command = CurrentCommand(np.array(current))
    for _ in range(800):
        mujoco.mj_step(full, d)
        felt = twin.step(command).acceleration
        assert np.allclose(felt, d.sensor("accelerometer").data[:2], atol=1e-3)


def test_the_rig_s_acceleration_is_that_of_mujoco_s_accelerometer(rig, floors):
    full = rig_model(rig, floors["natural_stone"])
    d = mujoco.MjData(full)
    twin = RigTwin(rig, floors["natural_stone"], ideal_sensors=True)
    twin.reset()
    d.qpos[:] = twin.mj_data.qpos
    d.ctrl[0] = 0.9
    for _ in range(500):
        mujoco.mj_step(full, d)
        felt = twin.step(CurrentCommand(np.array([0.9]))).carriage_acceleration
        assert felt == pytest.approx(d.sensor("accelerometer").data[0], abs=1e-3)
