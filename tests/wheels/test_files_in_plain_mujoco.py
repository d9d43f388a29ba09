"""The written files in plain MuJoCo: they compile, keep their numbers, stand, hand over, attach and roll."""

import functools
import itertools
import math

import mujoco
import numpy as np
import pytest

from omnimj.errors import InputError
from omnimj.wheels import SolverContact, mecanum_wheel, omni_wheel, robot_file, wheel_file, wheeled_robot

CONTACT, WHEEL_CONTACT = SolverContact(), SolverContact(timestep=0.002)
WHEELS = {"omni": omni_wheel(), "omni_3_rows": omni_wheel(rollers=6, rows=3), "mecanum": mecanum_wheel()}
ROBOTS = {
    f"{layout}_{touch}_{actuators}": (layout, touch, actuators, bare)
    for layout, touch, (actuators, bare) in itertools.product(
        ("omni3", "omni4", "mecanum4"),
        ("floor", "everything"),
        (("velocity", False), ("motor", True)),
    )
}


@functools.cache
def text_of(name):
    if name in WHEELS:
        command = f'omnimj wheel --out "a & b".xml # {name}'
        return wheel_file(WHEELS[name], WHEEL_CONTACT, command=command)
    layout, touch, actuators, bare = ROBOTS[name]
    return robot_file(wheeled_robot(layout, actuators=actuators), CONTACT, touch, bare)


def compiled(name):
    return mujoco.MjModel.from_xml_string(text_of(name))


@pytest.mark.slow
@pytest.mark.parametrize("name", [*WHEELS, *ROBOTS])
def test_a_file_opens_by_every_way_into_mujoco_without_a_warning(name, tmp_path):
    path, saved = tmp_path / "file.xml", tmp_path / "saved.xml"
    path.write_text(text_of(name), encoding="utf-8")
    warned = []
    mujoco.set_mju_user_warning(warned.append)
    try:
        opened = mujoco.MjModel.from_xml_path(str(path))
        mujoco.mj_saveLastXML(str(saved), opened)
        again = mujoco.MjModel.from_xml_path(str(saved))
        others = [
            mujoco.MjSpec.from_file(str(path)).compile(),
            mujoco.MjSpec.from_string(text_of(name)).compile(),
            mujoco.MjModel.from_xml_string(text_of(name)),
        ]
    finally:
        mujoco.set_mju_user_warning(None)
    assert not warned
    for other in (again, *others):
        assert (other.nv, other.ngeom, other.npair, other.nu) == (
            opened.nv,
            opened.ngeom,
            opened.npair,
            opened.nu,
        )
        assert np.allclose(other.body_mass, opened.body_mass, rtol=1e-5)
        assert np.allclose(other.body_inertia, opened.body_inertia, rtol=1e-4, atol=1e-12)


@pytest.mark.parametrize("name", [*WHEELS, *ROBOTS])
def test_rollers_turn_freely_about_their_centre_of_mass(name):
    m = compiled(name)
    rollers = [b for b in range(m.nbody) if "roller" in m.body(b).name]
    dofs = m.body_dofadr[rollers]
    assert len(rollers) in (18, 20, 54, 72, 80)
    assert not m.body_ipos[rollers].any() and not m.jnt_pos[m.body_jntadr[rollers]].any()
    for array in (m.dof_frictionloss, m.dof_armature, m.dof_damping):
        assert not array[dofs].any()


@pytest.mark.parametrize("name", ["omni3_floor_velocity", "omni4_floor_velocity", "mecanum4_floor_velocity"])
def test_masses_add_up_to_the_robot_s(name):
    m = compiled(name)
    assert m.body_mass.sum() == pytest.approx(15.0, rel=1e-6)


@pytest.mark.parametrize("kind", WHEELS)
def test_a_wheel_turns_with_the_stated_mass_and_inertia(kind):
    m, wheel = compiled(kind), WHEELS[kind]
    d = mujoco.MjData(m)
    mujoco.mj_forward(m, d)
    body = m.body("wheel").id
    assert m.body_subtreemass[body] == pytest.approx(wheel.mass, rel=1e-6)
    assert m.dof_M0[m.joint("axle").dofadr[0]] == pytest.approx(wheel.inertia, rel=1e-4)


def hub_heights(m, turns):
    """Height at which the wheel just touches the floor, from MuJoCo's distances of ellipsoids and floor."""
    m.geom_margin[m.geom("floor").id] = 0.1  # so that rollers above the floor are listed, too
    d, heights = mujoco.MjData(m), []
    for turn in turns:
        d.joint("axle").qpos[0] = turn
        mujoco.mj_forward(m, d)
        heights.append(d.body("wheel").xpos[2] - d.contact.dist.min())
    return np.array(heights)


@pytest.mark.parametrize("kind", WHEELS)
def test_the_stated_drop_is_that_of_mujoco_s_own_distances(kind):
    wheel = WHEELS[kind]
    heights = hub_heights(compiled(kind), np.linspace(0.0, 2.0 * math.pi / wheel.count, 101))
    assert heights.max() == pytest.approx(wheel.radius, abs=1e-7)
    assert heights.max() - heights.min() == pytest.approx(wheel.drop, rel=0.01, abs=2e-7)
    assert f"roller: {1e6 * wheel.drop:.3g} µm" in text_of(kind)


@pytest.mark.parametrize("kind", WHEELS)
def test_the_hub_of_a_slowly_rolling_wheel_drops_as_stated(kind):
    wheel = WHEELS[kind]
    m = mujoco.MjModel.from_xml_string(wheel_file(wheel, SolverContact(0.002, 0.999), load=0.5))
    d = mujoco.MjData(m)
    d.ctrl[0] = 0.02 / wheel.radius
    mujoco.mj_step(m, d, 300)
    heights = []
    for _ in range(round(2.2 * math.pi * wheel.radius / wheel.count / 0.02 / m.opt.timestep)):
        mujoco.mj_step(m, d)
        heights.append(d.body("wheel").xpos[2])
    assert np.ptp(heights) == pytest.approx(wheel.drop, rel=0.15, abs=1e-6)


@pytest.mark.parametrize("name", ["omni3_floor_motor", "omni4_everything_velocity", "mecanum4_floor_motor"])
def test_a_robot_at_rest_stays_at_rest(name):
    m = compiled(name)
    d = mujoco.MjData(m)
    mujoco.mj_step(m, d, 1000)
    assert np.abs(d.qpos[:2]).max() < 1e-5 and np.abs(d.qvel).max() < 1e-3
    assert 0.0 < 0.05 - d.qpos[2] < 1e-4


@pytest.mark.parametrize("radius", [0.005, 1.0])
@pytest.mark.parametrize("layout", ["omni3", "mecanum4"])
def test_the_smallest_and_the_largest_robot_stand(layout, radius):
    wheel = (mecanum_wheel if layout == "mecanum4" else omni_wheel)(radius)
    m = mujoco.MjModel.from_xml_string(robot_file(wheeled_robot(layout, wheel)))
    d = mujoco.MjData(m)
    mujoco.mj_step(m, d, 1000)
    assert d.qpos[2] == pytest.approx(radius, rel=0.01)
    assert np.abs(d.qvel[:6]).max() < 0.01


@pytest.mark.parametrize("kind", ["omni", "mecanum"])
def test_a_wheel_file_attaches_to_another_body(kind):
    spec = mujoco.MjSpec.from_string(
        "<mujoco><compiler angle='radian'/><worldbody><geom type='plane' size='5 5 .1'/>"
        "<body name='cart' pos='0 0 .05'><joint type='slide' axis='1 0 0'/><joint type='slide' axis='0 0 1'/>"
        "<inertial pos='0 0 0' mass='4' diaginertia='.1 .1 .1'/></body></worldbody></mujoco>"
    )
    child = mujoco.MjSpec.from_string(text_of(kind))
    frame = spec.body("cart").add_frame()
    frame.attach_body(child.body("wheel"), "left_", "")
    m = spec.compile()
    d = mujoco.MjData(m)
    d.ctrl[0] = 4.0  # the wheel's actuator comes along
    mujoco.mj_step(m, d, 500)
    turning, moving = d.joint("left_axle").qvel[0], d.qvel[0]
    assert turning == pytest.approx(4.0, rel=0.05)
    assert moving == pytest.approx(turning * 0.05, rel=0.03)


def test_rollers_that_touch_everything_climb_a_ramp_and_those_of_the_floor_do_not():
    heights = []
    for touch in ("floor", "everything"):
        spec = mujoco.MjSpec.from_string(robot_file(wheeled_robot("omni4"), CONTACT, touch))
        spec.worldbody.add_geom(
            type=mujoco.mjtGeom.mjGEOM_BOX,
            size=[1.0, 1.0, 0.02],
            pos=[1.3, 0.0, 0.05],
            euler=[0.0, -3.0, 0.0],
        )
        m = spec.compile()
        d = mujoco.MjData(m)
        d.ctrl[:] = wheeled_robot("omni4").wheel_speeds(np.array([0.5, 0.0, 0.0]))
        mujoco.mj_step(m, d, 1500)
        heights.append(d.qpos[2])
    assert heights[0] == pytest.approx(0.05, abs=1e-3) and heights[1] > 0.055


@pytest.mark.slow
def test_any_numbers_make_a_file_that_mujoco_opens_or_are_refused():
    rng, accepted = np.random.default_rng(5), 0
    for _ in range(60):
        radius = 10.0 ** rng.uniform(-2.2, -0.1)
        numbers = {"radius": radius, "roller_radius": radius * rng.uniform(0.03, 0.35)}
        numbers["rollers"] = int(rng.integers(3, 30))
        try:
            if rng.random() < 0.5:
                wheel = omni_wheel(**numbers, rows=int(rng.integers(1, 5)))
            else:
                wheel = mecanum_wheel(**numbers, roller_angle=rng.uniform(0.5, 1.2))
        except InputError:
            continue
        m = mujoco.MjModel.from_xml_string(wheel_file(wheel))
        heights = hub_heights(m, np.linspace(0.0, 2.0 * math.pi / wheel.count, 21))
        assert np.ptp(heights) == pytest.approx(wheel.drop, rel=0.01, abs=1e-6 * radius)
        assert wheel.hub_mass > 0.0 and wheel.inertia > 0.0
        accepted += 1
    assert accepted > 15
