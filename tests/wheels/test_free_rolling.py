"""Robots on generated wheels roll in plain MuJoCo as kinematics say, by kinematics of the test's own."""

import math

import mujoco
import numpy as np
import pytest

from omnimj.wheels import SolverContact, mecanum_wheel, omni_wheel, robot_file, wheeled_robot

SPEED, RADIUS = 0.5, 0.05


def wheel_speeds(layout, v_x, v_y, yaw_rate=0.0):
    """Textbook inverse kinematics of the default robots."""
    if layout == "mecanum4":
        lever = 0.4 * yaw_rate  # half the wheelbase plus half the track
        speeds = (v_x - v_y - lever, v_x + v_y - lever, v_x - v_y + lever, v_x + v_y + lever)
    else:
        count = int(layout[-1])
        at = [(2 * k + 1) * math.pi / count for k in range(count)]
        speeds = [-math.sin(a) * v_x + math.cos(a) * v_y + 0.25 * yaw_rate for a in at]
    return np.array(speeds) / RADIUS


def drive(layout, twist, seed, seconds=1.0, contact=None, standing=None):
    """Mean velocity in the body's frame, yaw rates, and heights of a driven robot.

    Wheels begin at random angles, those that are not driven at `standing` if given [rad].
    """
    m = mujoco.MjModel.from_xml_string(robot_file(wheeled_robot(layout), contact))
    d = mujoco.MjData(m)
    command = wheel_speeds(layout, *twist)
    rng = np.random.default_rng(seed)
    for i in range(m.nu):
        is_held = standing is not None and abs(command[i]) < 1e-9
        d.joint(f"wheel_{i + 1}_axle").qpos[0] = standing if is_held else rng.uniform(0.0, 2.0 * math.pi)
    for k in range(800):
        d.ctrl[:] = min(1.0, k / 400.0) * command
        mujoco.mj_step(m, d)
    velocity, rate, height = [], [], []
    for _ in range(round(seconds / m.opt.timestep)):
        mujoco.mj_step(m, d)
        velocity.append(d.sensor("velocity").data[:2].copy())
        rate.append(d.sensor("turning").data[2])
        height.append(d.qpos[2])
    return np.mean(velocity, axis=0), np.array(rate), np.array(height)


def check_direction(layout, direction, seed, seconds=1.0, standing=None):
    """Along the commanded direction and at right angles to it within 0.5 % of the speed."""
    ahead = np.array([math.cos(direction), math.sin(direction)])
    velocity, rate, _ = drive(layout, SPEED * ahead, seed, seconds, standing=standing)
    assert velocity == pytest.approx(SPEED * ahead, abs=0.005 * SPEED)
    assert velocity @ ahead == pytest.approx(SPEED, rel=0.005)
    assert abs(velocity @ np.array([-ahead[1], ahead[0]])) < 0.005 * SPEED
    assert np.abs(rate).max() < 0.01


@pytest.mark.slow
@pytest.mark.parametrize("layout", ["omni3", "omni4", "mecanum4"])
@pytest.mark.parametrize("k", [0, 7, 14])
def test_a_free_rolling_robot_has_the_speed_of_its_kinematics(layout, k):
    check_direction(layout, 2.0 * math.pi * k / 24, seed=k)


@pytest.mark.slow
@pytest.mark.parametrize("layout", ["omni3", "omni4", "mecanum4"])
@pytest.mark.parametrize("k", range(24))
def test_a_free_rolling_robot_has_the_speed_of_its_kinematics_in_24_directions(layout, k):
    check_direction(layout, 2.0 * math.pi * k / 24, seed=100 + k, seconds=2.0)


# where a roller is lowest, where one hands over to the next, and between
@pytest.mark.slow
@pytest.mark.parametrize("turn", [0.0, 5.0, 8.9])
@pytest.mark.parametrize("k", [3, 9])
def test_a_mecanum_robot_keeps_its_direction_whatever_the_angle_of_its_standing_wheels(k, turn):
    check_direction("mecanum4", 2.0 * math.pi * k / 24, seed=k, standing=math.radians(turn))


@pytest.mark.slow
@pytest.mark.parametrize("turn", [-8.9, -6.0, -3.0, 0.0, 3.0, 6.0, 8.9])
@pytest.mark.parametrize("k", range(24))
def test_a_mecanum_robot_keeps_its_direction_from_any_angle_of_its_wheels(k, turn):
    check_direction("mecanum4", 2.0 * math.pi * k / 24, seed=200 + k, standing=math.radians(turn))


@pytest.mark.slow
@pytest.mark.parametrize("layout", ["omni3", "omni4", "mecanum4"])
@pytest.mark.parametrize("yaw_rate", [-1.0, 0.5])
def test_a_robot_turns_on_the_spot_at_the_yaw_rate_of_its_kinematics(layout, yaw_rate):
    velocity, rate, _ = drive(layout, (0.0, 0.0, yaw_rate), seed=3)
    assert rate.mean() == pytest.approx(yaw_rate, rel=0.01)  # the contact moves between rows, 11 mm of 250
    assert np.abs(velocity).max() < 0.005


@pytest.mark.parametrize("layout", ["omni3", "mecanum4"])
def test_the_file_s_kinematics_are_the_textbook_s(layout):
    for twist in np.random.default_rng(0).normal(size=(5, 3)):
        assert wheeled_robot(layout).wheel_speeds(twist) == pytest.approx(wheel_speeds(layout, *twist))


@pytest.mark.slow
@pytest.mark.parametrize("layout", ["omni4", "mecanum4"])
@pytest.mark.parametrize("radius", [0.01, 0.02, 0.2])
def test_robots_of_other_sizes_roll_as_their_kinematics_say(layout, radius):
    wheel = (omni_wheel if layout == "omni4" else mecanum_wheel)(radius)
    m = mujoco.MjModel.from_xml_string(robot_file(wheeled_robot(layout, wheel)))
    d = mujoco.MjData(m)
    command = wheel_speeds(layout, 0.2, 0.0) * RADIUS / radius
    for k in range(1000):
        d.ctrl[:] = min(1.0, k / 500.0) * command
        mujoco.mj_step(m, d)
    speeds = []
    for _ in range(1000):
        mujoco.mj_step(m, d)
        speeds.append(d.sensor("velocity").data[0])
    assert np.mean(speeds) == pytest.approx(0.2, rel=0.008 if radius < 0.02 else 0.005)


def test_mujoco_s_default_contact_rolls_slower_than_the_chosen_one():
    soft = SolverContact(time_constant=0.02, impedance=0.9)
    speeds = [drive("omni4", (SPEED, 0.0), 1, contact=c)[0][0] for c in (None, soft)]
    assert abs(speeds[0] / SPEED - 1.0) < 0.005 < abs(speeds[1] / SPEED - 1.0)


def test_more_rollers_ripple_less():
    ripples = []
    for rollers in (5, 12):
        wheel = omni_wheel(rollers=rollers)
        m = mujoco.MjModel.from_xml_string(robot_file(wheeled_robot("omni4", wheel), SolverContact()))
        d = mujoco.MjData(m)
        d.ctrl[:] = wheel_speeds("omni4", 0.1, 0.0)
        mujoco.mj_step(m, d, 500)
        heights = []
        for _ in range(500):
            mujoco.mj_step(m, d)
            heights.append(d.qpos[2])
        ripples.append(np.ptp(heights))
    assert ripples[0] > 2.0 * ripples[1]


def test_rollers_mounted_at_45_degrees_drive_sideways_slower_than_those_of_the_files():
    """On 9 rollers by 3 %: without the files' angle all cotangents that a turn shows are above 1."""
    tilt = math.pi / 9
    lost = 2.0 * math.cos(tilt) / (1.0 + math.cos(tilt))
    speeds = []
    for angle in (math.atan(lost), math.pi / 4):
        wheel = mecanum_wheel(rollers=9, roller_angle=angle)
        m = mujoco.MjModel.from_xml_string(robot_file(wheeled_robot("mecanum4", wheel)))
        d = mujoco.MjData(m)
        command = wheel_speeds("mecanum4", 0.0, 0.3)
        for k in range(1000):
            d.ctrl[:] = min(1.0, k / 500.0) * command
            mujoco.mj_step(m, d)
        found = []
        for _ in range(1500):
            mujoco.mj_step(m, d)
            found.append(d.sensor("velocity").data[1])
        speeds.append(np.mean(found))
    assert mecanum_wheel(rollers=9, roller_angle=math.atan(lost)).mounted_angle == pytest.approx(math.pi / 4)
    assert speeds[0] / speeds[1] == pytest.approx(lost, abs=0.005)
