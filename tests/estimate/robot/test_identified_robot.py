"""A robot identified from healthy drives has the constants of the one that drove."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
from foreign_robot.foreign_dataset import write_dataset
from foreign_robot.foreign_drive import drive
from foreign_robot.mission_plan import straight
from foreign_robot.true_robot import GRAVITY, draw_robot

from omnimj.control.robot_constants import robot_constants
from omnimj.errors import InputError
from omnimj.estimate.robot.files import floors_text
from omnimj.estimate.robot.identify import identify_robot
from omnimj.estimate.robot.model_text import model_text
from omnimj.parameters import read_floors, read_rig, read_robot
from omnimj.recording.read_dataset import read_dataset
from omnimj.workflows import record

LAWS = ("multiplies", "divides", "own")


def identified(folder, robot, seed, runs, length):
    write_dataset(folder, {f"run_{k}": drive(robot, 100 * seed + k, length) for k in range(runs)})
    return identify_robot(read_dataset(folder), read_robot())


def truth(robot):
    """True numbers under the names of the identification, masses and torques as ratios."""
    radius, through = np.array(robot.radius), robot.efficiency * robot.gear_ratio
    traction = np.array(robot.torque_constant) * through / radius
    inertia = robot.yaw_inertia + robot.mass * np.sum(np.square(robot.com))
    back = {"multiplies": 1.0 / robot.efficiency, "divides": robot.efficiency, "own": robot.back_efficiency}
    values = {
        "mass_ratio": robot.mass / traction.mean(),
        "inertia_ratio": inertia / robot.mass,
        "centre_x": robot.com[0],
        "centre_y": robot.com[1],
        "back_driving_efficiency": back[robot.gear_law]
        * robot.efficiency
        / read_robot().motor.gear_efficiency,
        "roller_dry": robot.roller_dry,
        "roller_viscous": robot.roller_viscous,
    }
    return values | {f"torque_ratio_{i + 1}": traction[i] / traction.mean() for i in range(4)}


def losses_per_torque(robot, speed):
    """True loss of each wheel as a force, over the mean traction per ampere [A]."""
    radius, through = np.array(robot.radius), robot.efficiency * robot.gear_ratio
    shaft = np.array(robot.no_load_torque) + np.array(robot.viscous) * robot.gear_ratio * speed
    axle = np.array(robot.bearing) * robot.mass * GRAVITY / 4.0
    traction = np.array(robot.torque_constant) * through / radius
    return (shaft * through + axle) / radius / traction.mean()


def assert_near_truth(found, robot, worst_ratio, worst_mass, worst_centre):
    true = truth(robot)
    for i in range(1, 5):
        assert found[f"torque_ratio_{i}"].value == pytest.approx(true[f"torque_ratio_{i}"], rel=worst_ratio)
    assert found["mass_ratio"].value == pytest.approx(true["mass_ratio"], rel=worst_mass)
    efficiency = found["back_driving_efficiency"].value
    assert efficiency == pytest.approx(true["back_driving_efficiency"], rel=0.10)
    for axis in "xy":
        assert found[f"centre_{axis}"].value == pytest.approx(true[f"centre_{axis}"], abs=worst_centre)
    c = found.fit.unknowns.constants(found.fit.x).robot
    for speed in (5.0, 10.0, 20.0):
        loss = (c.dry + c.viscous * speed) / c.torque.mean()
        assert loss == pytest.approx(losses_per_torque(robot, speed), rel=0.10)


@pytest.fixture(scope="module")
def foreign():
    return draw_robot(31, "own", torque_constant_spread=0.05, doubled_bearings=1)


@pytest.fixture(scope="module")
def found(foreign, tmp_path_factory):
    """Two and a half minutes of the foreign robot."""
    return identified(tmp_path_factory.mktemp("data") / "logs", foreign, 31, 5, 30.0)


@pytest.mark.slow
def test_a_few_minutes_give_motors_masses_and_losses_of_the_robot_that_drove(found, foreign):
    assert_near_truth(found, foreign, 0.02, 0.02, 0.005)


@pytest.mark.slow
def test_data_determine_ratios_and_the_prior_their_common_size(found):
    assert found["mass_ratio"].source == "data" and found["torque_ratio_1"].source == "data"
    ratio, mass = found["mass_ratio"], found["mass"]
    assert (ratio.high - ratio.low) / ratio.value < 0.3 * (mass.high - mass.low) / mass.value
    assert found["torque_constant"].left_of_prior > 0.6
    assert "torque_constant" in [one.estimate.name for one in found.unexcited] or (
        found["torque_constant"].source == "data and prior"
    )


@pytest.mark.slow
def test_the_model_file_has_the_constants_that_were_identified(found, tmp_path):
    (tmp_path / "model.toml").write_text(model_text(found), encoding="utf-8")
    written = robot_constants(read_robot(tmp_path / "model.toml"))
    identified = found.fit.unknowns.constants(found.fit.x).robot._asdict()
    assert not written.floor.stated and not identified.pop("floor").stated
    for name, value in identified.items():
        assert getattr(written, name) == pytest.approx(value, rel=1e-9, abs=1e-12), name


@pytest.mark.slow
def test_the_creep_law_has_the_slope_of_the_floor_and_counts_slip_speed(found, foreign, tmp_path):
    (creep,) = found.floors
    assert creep.chosen.name.startswith("slip speed")
    slip = creep.covered
    dry = foreign.dry * np.tanh(slip / 0.03) + foreign.slope * slip
    numbers = creep.chosen.numbers
    onset = numbers.get("onset", 1.0)
    law = numbers.get("ceiling", 0.0) * np.tanh(slip / onset) + numbers["slope"] * slip
    assert law == pytest.approx(dry, rel=0.15)
    (tmp_path / "floors.toml").write_text(floors_text(found), encoding="utf-8")
    assert read_floors(tmp_path / "floors.toml")["natural_stone"].law == "lugre"


@pytest.mark.slow
def test_a_gentle_drive_straight_ahead_leaves_numbers_open_and_names_a_manoeuvre(foreign, tmp_path):
    logs = {f"run_{k}": drive(foreign, straight(0.3, 0.0, 0.1, 12.0, 20.0), 20.0) for k in range(3)}
    write_dataset(tmp_path, logs)
    found = identify_robot(read_dataset(tmp_path), read_robot())
    open_ones = {one.estimate.name: one.manoeuvre for one in found.unexcited}
    assert {"yaw_rate_delay", "torque_ratio_1", "torque_ratio_3"} <= set(open_ones)
    assert any("turn" in words for words in open_ones.values())
    assert any("square" in words for words in open_ones.values())


@pytest.mark.slow
def test_other_machines_and_too_little_motion_are_refused(foreign, tmp_path):
    write_dataset(tmp_path, {"run": drive(foreign, 1, 4.0)})
    dataset = read_dataset(tmp_path)
    with pytest.raises(InputError, match=r"s of motion.*at least 20 s"):
        identify_robot(dataset, read_robot())
    with pytest.raises(InputError, match=r"found 'quarter_rig'.*uto_robot"):
        identify_robot(dataclasses.replace(dataset, plant="quarter_rig"), read_robot())
    assert read_rig() is not None


@pytest.mark.slow
def test_effects_of_the_planar_plant_come_back(tmp_path):
    effects = {
        "torque_constant": {"wheel": 2, "scale": 0.9},
        "payload": {"mass": 1.5, "x": 0.08, "y": -0.05},
        "bearing_friction": {"wheel": 3, "torque": 0.03},
        "accelerometer_position": {"x": 0.06, "y": -0.04},
    }
    dataset = record("robot_missions", tmp_path / "logs", plant="planar", effects=effects)
    found, robot = identify_robot(dataset, read_robot()), read_robot()
    assert found["torque_ratio_2"].value == pytest.approx(0.9 / 0.975, rel=0.01)
    mass = robot.body.mass + 1.5
    nominal = found["mass_ratio"].nominal / robot.body.mass
    assert found["mass_ratio"].value == pytest.approx(nominal * mass / 0.975, rel=0.02)
    assert found["centre_x"].value == pytest.approx(1.5 * 0.08 / mass, abs=0.003)
    assert found["centre_y"].value == pytest.approx(-1.5 * 0.05 / mass, abs=0.003)
    assert found["accelerometer_x"].value == pytest.approx(0.06, abs=0.005)
    assert found["accelerometer_y"].value == pytest.approx(-0.04, abs=0.005)
    efficiency = found["back_driving_efficiency"].value
    assert efficiency == pytest.approx(robot.motor.gear_efficiency, rel=0.02)
    size = found["torque_constant"].value / (0.975 * robot.motor.torque_constant)
    more = found["dry_loss_3"].value - found["dry_loss_1"].value
    assert more / size == pytest.approx(0.03, abs=0.006)


@pytest.mark.slow
@pytest.mark.parametrize("law", LAWS)
def test_ten_minutes_give_every_gear_law(law, tmp_path):
    robot = draw_robot(32, law, torque_constant_spread=0.05, doubled_bearings=2)
    assert_near_truth(identified(tmp_path, robot, 32, 15, 40.0), robot, 0.01, 0.02, 0.005)


@pytest.mark.slow
def test_most_intervals_contain_the_truth(tmp_path):
    inside = []
    for seed in range(41, 47):
        robot = draw_robot(seed, LAWS[seed % 3], torque_constant_spread=0.05, doubled_bearings=1)
        found = identified(tmp_path / f"{seed}", robot, seed, 10, 40.0)
        inside += [found[name].low <= value <= found[name].high for name, value in truth(robot).items()]
    assert np.mean(inside) >= 0.7


@pytest.fixture(scope="module")
def filmed(foreign, tmp_path_factory):
    """Less than three minutes of the foreign robot by a camera: 30 pictures per second, 2 mm, 3 mrad."""
    folder = tmp_path_factory.mktemp("filmed") / "logs"
    logs = {f"run_{k}": drive(foreign, 3100 + k, 40.0, rate=100.0, pose_measured=True) for k in range(4)}
    write_dataset(folder, logs)
    return identify_robot(read_dataset(folder), read_robot())


@pytest.mark.slow
def test_a_camera_gives_the_same_robot_as_an_inertial_unit(filmed, foreign):
    assert_near_truth(filmed, foreign, 0.03, 0.03, 0.01)
    held = 0.5 * 0.01  # a picture is read by a log of 100 Hz half a step late
    assert filmed["position_delay"].value == pytest.approx(foreign.sensors.camera_delay + held, abs=0.008)
    assert filmed.noise["position_noise"] == pytest.approx(foreign.sensors.camera_noise[0], rel=0.1)
    (creep,) = filmed.floors
    assert creep.chosen.name.startswith("slip speed")


@pytest.fixture(scope="module")
def slowly_filmed(foreign):
    """Two minutes at 50 samples a second."""
    return {f"run_{k}": drive(foreign, 3101 + k, 40.0, rate=50.0, pose_measured=True) for k in range(3)}


@pytest.mark.slow
@pytest.mark.parametrize(
    "wrong, words",
    [
        ({"wheel_speed_1": 9.5493, "wheel_speed_2": 9.5493, "wheel_speed_3": 9.5493, "wheel_speed_4": 9.5493},
         r"wheel speeds: .*may be in rev/min"),
        ({"x": 1000.0, "y": 1000.0}, r"x and y: .*may be in mm"),
        ({"heading": 57.2958}, r"heading: .*may be in deg"),
        ({"wheel_speed_3": -1.0}, r"wheel_speed_3: turns against the pose"),
    ],
)  # fmt: skip
def test_a_wrong_unit_or_sign_beside_a_pose_is_named(wrong, words, slowly_filmed, tmp_path):
    logs = {}
    for name, log in slowly_filmed.items():
        columns = {channel: wrong.get(channel, 1.0) * values for channel, values in log.columns.items()}
        logs[name] = dataclasses.replace(log, columns=columns)
    write_dataset(tmp_path, logs)
    with pytest.raises(InputError, match=words):
        identify_robot(read_dataset(tmp_path), read_robot())


@pytest.mark.slow
@pytest.mark.parametrize("rate, camera", [(20.0, 20.0), (1000.0, 100.0)])
def test_most_intervals_contain_the_truth_at_any_rate_of_the_camera(rate, camera, tmp_path):
    inside = []
    for seed in range(41, 45):
        robot = draw_robot(seed, LAWS[seed % 3], torque_constant_spread=0.05, doubled_bearings=1)
        sensors = dataclasses.replace(robot.sensors, camera_rate=camera)
        robot, folder = dataclasses.replace(robot, sensors=sensors), tmp_path / f"{seed}"
        logs = {
            f"run_{k}": drive(robot, 100 * seed + k, 40.0, rate=rate, pose_measured=True) for k in range(10)
        }
        write_dataset(folder, logs)
        found = identify_robot(read_dataset(folder), read_robot())
        inside += [found[name].low <= value <= found[name].high for name, value in truth(robot).items()]
    assert np.mean(inside) >= 0.7


@pytest.mark.slow
@pytest.mark.parametrize("seed", [31, 32])
def test_a_log_that_aliases_the_currents_is_not_trusted_with_the_yaw_inertia(seed, tmp_path):
    robot = draw_robot(seed, LAWS[seed % 3], torque_constant_spread=0.05, doubled_bearings=1)
    logs = {f"run_{k}": drive(robot, 100 * seed + k, 40.0, rate=100.0, jitter=1.0) for k in range(8)}
    write_dataset(tmp_path / "logs", logs)
    found = identify_robot(read_dataset(tmp_path / "logs"), read_robot())
    ratio = found["inertia_ratio"]
    assert ratio.low <= truth(robot)["inertia_ratio"] <= ratio.high
    assert any("log faster" in note for note in found.notes)
