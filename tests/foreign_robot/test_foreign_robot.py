"""The foreign robot obeys the laws that it is written from; it shares no equation with the package."""

from __future__ import annotations

import tomllib
from dataclasses import replace

import numpy as np
import pyarrow.parquet as pq
import pytest
from foreign_robot.foreign_dataset import loaded_moment, write_dataset
from foreign_robot.foreign_drive import Log, drive
from foreign_robot.mission_plan import Plan, random_mission, rounded, straight
from foreign_robot.true_robot import (
    DIRECTIONS,
    GRAVITY,
    IDEAL_SENSORS,
    PLACES,
    Fault,
    ForeignRobot,
    GearLaw,
    draw_robot,
    with_payload,
)

from omnimj.recording.read_dataset import read_dataset

TICK = 1e-3
LAWS: tuple[GearLaw, ...] = ("multiplies", "divides", "own")


@pytest.fixture(scope="module")
def loaded() -> ForeignRobot:
    """A drawn robot with a heavy payload off its centre, on a sloping floor, with perfect sensors."""
    robot = with_payload(draw_robot(5, "divides", torque_constant_spread=0.05), 2.0, 0.15, 0.7)
    return replace(robot, sensors=IDEAL_SENSORS, floor_slope=(0.004, -0.003))


@pytest.fixture(scope="module")
def driven(loaded: ForeignRobot) -> Log:
    return drive(loaded, 3, 20.0)


def four_of(truth: dict[str, np.ndarray], name: str) -> np.ndarray:
    return np.column_stack([truth[f"{name}_{i}"] for i in range(1, 5)])


def floor_forces(truth: dict[str, np.ndarray]) -> np.ndarray:
    """Force of the floor in the body's axes, n × 2 [N]."""
    axles = PLACES / np.linalg.norm(PLACES, axis=1, keepdims=True)
    return four_of(truth, "traction") @ DIRECTIONS - four_of(truth, "drag") @ axles


def in_world(truth: dict[str, np.ndarray], along: np.ndarray) -> np.ndarray:
    cos, sin = np.cos(truth["heading"]), np.sin(truth["heading"])
    return np.column_stack([cos * along[:, 0] - sin * along[:, 1], sin * along[:, 0] + cos * along[:, 1]])


def driven_by_the_floor(robot: ForeignRobot) -> float:
    """η of the gear where the floor drives the motor."""
    if robot.gear_law == "own":
        return 1.0 / robot.back_efficiency
    return robot.efficiency if robot.gear_law == "multiplies" else 1.0 / robot.efficiency


def place_of(truth: dict[str, np.ndarray], robot: ForeignRobot) -> np.ndarray:
    """Where the centre of mass is in the world, n × 2 [m]."""
    com = np.tile(robot.com, (len(truth["x"]), 1))
    return np.column_stack([truth["x"], truth["y"]]) + in_world(truth, com)


@pytest.mark.slow
def test_the_floors_forces_and_gravity_change_the_momentum(driven: Log, loaded: ForeignRobot):
    """m d²x_c/dt² = F + m g s over every stretch of time: the impulse is what the momentum gains."""
    force = in_world(driven.truth, floor_forces(driven.truth))
    force += loaded.mass * GRAVITY * np.array(loaded.floor_slope)
    impulse = np.cumsum(0.5 * (force[1:] + force[:-1]), axis=0) * TICK
    velocity = np.gradient(place_of(driven.truth, loaded), TICK, axis=0)
    gained = loaded.mass * (velocity[2:-1] - velocity[1])
    np.testing.assert_allclose(gained, impulse[1:-1] - impulse[0], atol=2e-3 * loaded.mass)


@pytest.mark.slow
def test_the_moment_about_the_centre_of_mass_changes_the_spin(driven: Log, loaded: ForeignRobot):
    truth, com = driven.truth, np.array(loaded.com)
    force = floor_forces(truth)
    arms = PLACES - com
    moments = arms[:, 0] * DIRECTIONS[:, 1] - arms[:, 1] * DIRECTIONS[:, 0]
    axles = PLACES / np.linalg.norm(PLACES, axis=1, keepdims=True)
    moment = four_of(truth, "traction") @ moments
    moment -= four_of(truth, "drag") @ (arms[:, 0] * axles[:, 1] - arms[:, 1] * axles[:, 0])
    spun = np.cumsum(0.5 * (moment[1:] + moment[:-1])) * TICK
    np.testing.assert_allclose(loaded.yaw_inertia * truth["yaw_rate"][1:], spun, atol=2e-3)
    assert np.abs(force).max() > 5.0


@pytest.mark.slow
def test_the_floor_carries_the_weight_and_balances_the_acceleration(driven: Log, loaded: ForeignRobot):
    """Σ N = m g; a force of the floor forward unloads the wheels ahead, by h F in all."""
    normal, weight = four_of(driven.truth, "normal"), loaded.mass * GRAVITY
    np.testing.assert_allclose(normal.sum(axis=1), weight, rtol=1e-9)
    moment = normal @ (PLACES - loaded.com)
    slow = np.cumsum(moment + loaded.com_height * floor_forces(driven.truth), axis=0) * TICK
    assert np.abs(slow).max() < 0.05  # N.m.s: but for the suspension's 10 ms the moments cancel
    assert np.ptp(normal[:, 0]) > 2.0


@pytest.mark.slow
@pytest.mark.parametrize("law", ["divides", "own"])
def test_energy_is_never_created(loaded: ForeignRobot, law: GearLaw):
    """∫ K_t i ω dt covers the gain of kinetic energy less what gravity gave, at all times."""
    robot = replace(loaded, gear_law=law)
    truth = drive(robot, 3, 20.0).truth
    turning = robot.gear_ratio * four_of(truth, "wheel_speed")
    power = (np.array(robot.torque_constant) * four_of(truth, "current") * turning).sum(axis=1)
    power += robot.mass * GRAVITY * np.gradient(place_of(truth, robot), TICK, axis=0) @ robot.floor_slope
    wheels = np.array(robot.wheel_inertia) + np.array(robot.rotor_inertia) * robot.gear_ratio**2
    kinetic = 0.5 * four_of(truth, "wheel_speed") ** 2 @ wheels
    kinetic += 0.5 * robot.yaw_inertia * truth["yaw_rate"] ** 2
    velocity = np.gradient(place_of(truth, robot), TICK, axis=0)
    kinetic += 0.5 * robot.mass * (velocity**2).sum(axis=1)
    lost = np.concatenate([[0.0], np.cumsum(0.5 * (power[1:] + power[:-1])) * TICK]) - kinetic
    # the loss only grows; the tyre stores a little, and gives it back
    assert (np.maximum.accumulate(lost) - lost).max() < 0.02
    assert lost[-1] > 5.0 * kinetic.max()


@pytest.mark.parametrize("law", LAWS)
def test_gear_passes_power_by_its_law(loaded: ForeignRobot, law: GearLaw):
    """T_wheel = η G T_shaft: η = E where the motor drives; driven by the floor E, 1/E or 1/E_b."""
    robot = replace(loaded, gear_law=law)
    back = driven_by_the_floor(robot)
    truth = drive(robot, 3, 20.0).truth
    shaft, torque = four_of(truth, "shaft_torque"), four_of(truth, "wheel_torque")
    power = shaft * robot.gear_ratio * four_of(truth, "wheel_speed")
    driving, driven = power > 0.2, power < -0.2
    assert driving.sum() > 1000
    assert driven.sum() > 1000
    ideal = robot.gear_ratio * shaft
    np.testing.assert_allclose(torque[driving], robot.efficiency * ideal[driving], rtol=1e-6)
    np.testing.assert_allclose(torque[driven], back * ideal[driven], rtol=1e-6)
    created = torque * four_of(truth, "wheel_speed") - power
    assert (created[driven].max() > 0.1) == (law == "multiplies")


@pytest.mark.parametrize("law", LAWS)
@pytest.mark.parametrize("downhill", [0.0, 0.12])
def test_steady_current_has_a_closed_form(law: GearLaw, downhill: float):
    """At constant speed K_t i = (T_bearing + r X)/(η G) + T_nl + d ω, with X from the balance of the body.

    On the level the motors push (η = E); on a slope of 0.12 gravity pushes them (η by the gear's law).
    """
    robot = ForeignRobot(gear_law=law, floor_slope=(downhill, 0.0), sensors=IDEAL_SENSORS)
    truth = drive(robot, straight(0.6, 0.0, 0.5, 6.0, 6.0), 6.0).truth
    speed = truth["v_x"][-1]
    weight = robot.mass * GRAVITY
    # wheels 2 and 4 roll along x; 1 and 3 are dragged along their axles
    drag = 0.5 * weight * (robot.roller_dry + robot.roller_viscous * speed)
    traction = 0.5 * (drag - weight * downhill)
    turning = robot.gear_ratio * truth["wheel_speed_4"][-1]
    load = robot.bearing[3] * truth["normal_4"][-1] + robot.radius[3] * traction
    back = driven_by_the_floor(robot)
    factor = robot.efficiency if load > 0 else back
    torque = load / (factor * robot.gear_ratio) + robot.no_load_torque[3] + robot.viscous[3] * turning
    assert (load > 0) == (downhill == 0.0)
    assert truth["current_4"][-200:].mean() == pytest.approx(torque / robot.torque_constant[3], rel=0.01)
    assert speed == pytest.approx(0.6, abs=0.1)  # the floor lets the wheels slip under load


@pytest.mark.slow
def test_halving_the_step_quarters_the_error(loaded: ForeignRobot):
    plan = random_mission(3, 6.0)

    def pose(substeps: int) -> np.ndarray:
        truth = drive(loaded, plan, 6.0, substeps=substeps).truth
        return np.column_stack([truth["x"], truth["y"], truth["heading"]])

    fine = pose(64)
    coarse, usual = (np.abs(pose(n) - fine).max() for n in (4, 8))
    assert coarse < 1e-4
    assert usual < 0.4 * coarse


@pytest.mark.slow
@pytest.mark.parametrize("place", [(0.0, 0.0), (0.1, -0.06)])
def test_accelerometer_reads_the_second_derivative_of_its_place(loaded: ForeignRobot, place):
    """Specific force at its place, not at the centre of mass: d²p/dt² without the pull of the slope."""
    robot = replace(loaded, sensors=replace(loaded.sensors, acceleration_place=place))
    driven = drive(robot, 3, 20.0)
    truth = driven.truth
    cos, sin = np.cos(truth["heading"]), np.sin(truth["heading"])
    track = np.column_stack([truth["x"], truth["y"]])
    track += np.column_stack([cos * place[0] - sin * place[1], sin * place[0] + cos * place[1]])
    second = np.gradient(np.gradient(track, TICK, axis=0), TICK, axis=0)
    second -= GRAVITY * np.array(loaded.floor_slope)
    expected = cos * second[:, 0] + sin * second[:, 1], cos * second[:, 1] - sin * second[:, 0]
    for axis, wanted in zip("xy", expected, strict=True):
        error = driven.columns[f"acceleration_{axis}"] - wanted
        assert np.sqrt(np.mean(error[5:-5] ** 2)) < 0.03


def test_each_sensor_has_its_stated_noise_and_bias():
    robot = draw_robot(9, "own")
    log = drive(robot, Plan(np.zeros((4000, 3))), 4.0)
    sensors, columns = robot.sensors, log.columns
    assert np.std(columns["acceleration_x"]) == pytest.approx(sensors.acceleration_noise, rel=0.1)
    offset = sensors.acceleration_bias[1] + GRAVITY * (sensors.acceleration_tilt[1] - robot.floor_slope[1])
    assert columns["acceleration_y"].mean() == pytest.approx(offset, abs=0.01)
    assert columns["yaw_rate"].mean() == pytest.approx(sensors.gyro_bias, abs=5e-4)
    error = columns["current_2"] - log.truth["current_2"]
    assert error.mean() == pytest.approx(sensors.current_offset[1], abs=1e-3)


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(4))
def test_healthy_robot_tracks_its_plan(seed: int):
    robot = draw_robot(seed, LAWS[seed % 3], torque_constant_spread=0.05, doubled_bearings=seed)
    log = drive(robot, seed, 30.0)
    truth = log.truth
    velocity = np.column_stack([truth["v_x"], truth["v_y"]])
    if log.plan.in_world:
        velocity = in_world(truth, velocity)
    error = np.hypot(*(velocity - log.plan.twists[:, :2]).T)
    assert np.sqrt(np.mean(error**2)) < 0.05
    assert np.sqrt(np.mean((truth["yaw_rate"] - log.plan.twists[:, 2]) ** 2)) < 0.05
    assert np.abs(log.plan.twists[:, :2]).max() > 0.2


def test_wheel_on_a_patch_slips_and_a_weak_motor_takes_more_current():
    robot = draw_robot(2, "divides")
    healthy = drive(robot, 3, 20.0)
    onset, under_load = loaded_moment(healthy, 2, 0.15 * robot.grip, 3.0, 5.0)
    assert under_load > 0.5
    patch = drive(robot, 3, 20.0, [Fault("slip", 2, onset, 0.15, onset + 3.0)]).truth
    on_patch = (patch["time"] > onset + 0.1) & (patch["time"] < onset + 3.0)
    ratio = np.abs(patch["traction_2"] / patch["normal_2"])
    assert ratio[on_patch].max() < 0.15 * robot.grip * 1.02
    slips = np.abs(four_of(patch, "slip")[on_patch]).max(axis=0)
    assert np.argmax(slips) == 1
    assert slips[1] > 2.0 * np.abs(healthy.truth["slip_2"][on_patch]).max()
    weak = drive(robot, 3, 20.0, [Fault("motor", 3, 8.0, 0.5)]).truth
    later = weak["time"] > 9.0
    demanded = [np.abs(truth["current_3"][later]).mean() for truth in (weak, healthy.truth)]
    assert demanded[0] > 1.4 * demanded[1]
    np.testing.assert_array_equal(weak["x"][:8000], healthy.truth["x"][:8000])


def test_rounded_plan_ends_where_the_trapezoids_end():
    twists = np.zeros((3000, 3))
    twists[500:1500] = (0.4, -0.2, 0.1)
    smooth = rounded(twists)
    np.testing.assert_allclose(smooth.sum(axis=0), twists.sum(axis=0))
    assert np.abs(np.diff(smooth, axis=0)).max() < 0.01


def test_written_dataset_is_read_back(tmp_path):
    robot = draw_robot(4, "own")
    logs = {"even": drive(robot, 1, 5.0, rate=200.0), "uneven": drive(robot, 2, 5.0, jitter=0.4, lost=0.02)}
    write_dataset(tmp_path / "unit", logs)
    read = read_dataset(tmp_path / "unit")
    assert sorted(run.name for run in read.runs) == ["even", "uneven"]
    for run in read.runs:
        np.testing.assert_array_equal(run.columns["current_3"], logs[run.name].columns["current_3"])
        assert not set(run.columns) & {"traction_1", "slip_1", "heading", "x"}


def test_log_of_a_camera_has_the_pose_and_nothing_inertial(tmp_path):
    """The pose of 30 ms ago, held between 30 pictures a second; the dataset says that it is measured."""
    log = drive(draw_robot(4, "own"), 1, 5.0, rate=500.0, pose_measured=True)
    write_dataset(tmp_path, {"camera": log})
    table = pq.read_table(tmp_path / "camera.parquet")
    wheels = {f"{n}_{i}" for n in ("current", "current_target", "wheel_speed") for i in range(1, 5)}
    assert set(table.column_names) == {"time", "x", "y", "heading"} | wheels
    defaults = tomllib.loads((tmp_path / "dataset.toml").read_text())["defaults"]
    assert defaults == {"floor": "natural_stone", "pose_measured": True}
    time, x = table["time"].to_numpy(), table["x"].to_numpy()
    assert len(np.unique(x)) == pytest.approx(5.0 * 30.0, abs=3)
    delayed = np.interp(time - 0.03, log.truth["time"], log.truth["x"])
    assert np.sqrt(np.mean((x - delayed) ** 2)) < 0.02
