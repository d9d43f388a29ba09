"""The planar plants: contract, faults, patches, and agreement with the models behind them."""

from __future__ import annotations

import dataclasses
import math

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal
from rig_reference import integrate

from omnimj.errors import InputError, UnknownNameError
from omnimj.parameters import read_floors, read_rig, read_robot
from omnimj.plant.faults import Fault
from omnimj.plant.ground import Patch
from omnimj.plant.planar import PlanarRobot
from omnimj.plant.planar_rig import PlanarRig
from omnimj.signals import CurrentCommand

ROBOT, RIG, FLOORS = read_robot(), read_rig(), read_floors()
AHEAD = (0.0, -0.6, 0.0, 0.6)
SAND = Patch("sand", center=(0.0, 0.0), size=(1.0, 1.0))
TURN = (0.5, 0.5, 0.5, 0.5)


def _drive(plant, current, duration):
    """Measurements and truth at every period, the start included."""
    command = CurrentCommand(np.array(current, float))
    measured, truth = [plant.reset()], [plant.truth()]
    for _ in range(round(duration / plant.period)):
        measured.append(plant.step(command))
        truth.append(plant.truth())
    return measured, dict(zip(plant.truth_names, np.array(truth).T, strict=True))


def _robot(*faults, floor="natural_stone", ideal_sensors=True, **options):
    return PlanarRobot(ROBOT, floor, faults=faults, ideal_sensors=ideal_sensors, **options)


def _fault(kind, wheel=None, onset=0.0, end=None, **numbers):
    return Fault(kind, onset, end, wheel, numbers)


def _speeds(measured):
    return np.array([m.wheel_speed for m in measured])


def test_time_goes_on_by_the_period():
    plant = _robot()
    measured, _ = _drive(plant, AHEAD, 0.05)
    assert plant.period == 1e-3
    assert_allclose([m.time for m in measured], np.arange(51) * 1e-3, atol=1e-12)


def test_reset_repeats_the_run_bit_for_bit_and_a_seed_makes_another():
    fault = _fault("slip", wheel=1, onset=0.1, grip=0.2)
    plant = _robot(fault, ideal_sensors=False, seed=3)
    first, truth = _drive(plant, AHEAD, 0.3)
    again, truth_again = _drive(plant, AHEAD, 0.3)
    other, truth_other = _drive(_robot(fault, ideal_sensors=False, seed=4), AHEAD, 0.3)
    for name in truth:
        assert_array_equal(truth[name], truth_again[name])
        assert_array_equal(truth[name], truth_other[name])
    assert all(np.array_equal(a.current, b.current) for a, b in zip(first, again, strict=True))
    assert any(not np.array_equal(a.current, b.current) for a, b in zip(first, other, strict=True))


def test_ideal_sensors_read_the_truth():
    plant = _robot(start=(1.0, 2.0, 0.5))
    measured, truth = _drive(plant, TURN, 0.5)
    assert_allclose([m.yaw for m in measured], np.mod(truth["heading"], 2 * math.pi), atol=1e-12)
    assert_allclose([m.yaw_rate for m in measured], truth["twist_yaw"], atol=1e-12)
    assert (truth["x"][0], truth["y"][0], truth["heading"][0]) == (1.0, 2.0, 0.5)


def test_the_accelerometer_reads_the_change_of_world_velocity():
    measured, truth = _drive(_robot(), (0.2, -0.7, 0.1, 0.9), 1.0)
    c, s = np.cos(truth["heading"]), np.sin(truth["heading"])
    world = np.stack(
        [c * truth["twist_x"] - s * truth["twist_y"], s * truth["twist_x"] + c * truth["twist_y"]]
    )
    rate = np.gradient(world, 1e-3, axis=1)
    read = np.array([m.acceleration for m in measured]).T
    along = np.stack([c * rate[0] + s * rate[1], c * rate[1] - s * rate[0]])
    assert_allclose(read[:, 100:-1], along[:, 100:-1], atol=0.01)


def test_an_accelerometer_beside_the_centre_reads_the_change_of_its_own_velocity():
    x, y = 0.11, -0.06
    body = dataclasses.replace(ROBOT.body, accelerometer_x=x, accelerometer_y=y)
    plant = PlanarRobot(dataclasses.replace(ROBOT, body=body), "natural_stone", ideal_sensors=True)
    measured, truth = _drive(plant, (0.9, -0.2, 0.7, 0.9), 1.0)
    c, s = np.cos(truth["heading"]), np.sin(truth["heading"])
    place = np.stack([truth["x"] + c * x - s * y, truth["y"] + s * x + c * y])
    rate = np.gradient(np.gradient(place, 1e-3, axis=1), 1e-3, axis=1)
    along = np.stack([c * rate[0] + s * rate[1], c * rate[1] - s * rate[0]])
    read = np.array([m.acceleration for m in measured]).T
    assert_allclose(read[:, 100:-2], along[:, 100:-2], atol=0.03)
    assert np.abs(truth["twist_yaw"]).max() > 2.0  # the turning takes part


def test_at_rest_on_a_slope_the_accelerometer_reads_gravity():
    plant = _robot(_fault("slope", angle=0.004, direction=0.3), start=(0.0, 0.0, 1.0))
    measured, truth = _drive(plant, (0.0,) * 4, 6.0)
    uphill = -9.81 * math.sin(0.004) * np.array([math.cos(0.3 - 1.0), math.sin(0.3 - 1.0)])
    assert_allclose(measured[-1].acceleration, uphill, atol=1e-4)
    assert abs(truth["twist_x"][-1]) < 1e-6


def test_a_slope_loads_the_lower_wheels():
    plant = _robot(_fault("slope", angle=0.1, direction=math.pi / 2), start=(0.0, 0.0, math.pi / 2))
    plant.reset()
    normal = plant.truth()[10:14]  # downhill is ahead
    weight = ROBOT.body.mass * 9.81
    assert normal.sum() == pytest.approx(weight * math.cos(0.1))
    assert normal[0] - normal[2] == pytest.approx(weight * math.sin(0.1) * ROBOT.body.com_height / 0.25)
    assert normal[1] == pytest.approx(normal[3])


def test_a_fault_holds_from_onset_to_end_only():
    fault = _fault("hard_over", wheel=1, onset=0.3, end=0.5)
    measured, _ = _drive(_robot(fault), AHEAD, 0.8)
    healthy, _ = _drive(_robot(), AHEAD, 0.8)
    faulty, sound = np.array([m.current for m in measured]), np.array([m.current for m in healthy])
    assert_array_equal(faulty[:301], sound[:301])
    assert faulty[301, 0] > 1.0  # in the very period that begins at the onset
    assert_allclose(faulty[310:501, 0], 1.5, atol=1e-3)
    assert faulty[501, 0] < 0.5
    assert_allclose(faulty[510:, 0], 0.0, atol=1e-3)


def test_a_locked_wheel_stands_still():
    measured, truth = _drive(_robot(_fault("locked", wheel=4, onset=0.5)), AHEAD, 1.5)
    speed = _speeds(measured)
    assert speed[500, 3] > 1.0
    assert np.all(speed[600:, 3] == 0.0)
    assert abs(speed[-1, 1]) > 1.0
    assert abs(truth["twist_yaw"][-1]) > 0.1  # it drags that side


def test_a_free_motor_takes_no_current():
    measured, _ = _drive(_robot(_fault("free", wheel=2, onset=0.2)), AHEAD, 0.5)
    current = np.array([m.current for m in measured])
    assert current[199, 1] == pytest.approx(-0.6, abs=1e-3)
    assert_allclose(current[210:, 1], 0.0, atol=1e-6)


def test_a_lost_torque_constant_halves_the_driving_force():
    lossy = [_fault("motor", wheel=w, loss=0.5) for w in (2, 4)]
    _, truth = _drive(_robot(*lossy), AHEAD, 0.2)
    _, sound = _drive(_robot(), AHEAD, 0.2)
    motor = ROBOT.motor
    torque, dry = motor.torque_constant * 0.6, motor.no_load_torque
    share = (0.5 * torque - dry) / (torque - dry)
    assert truth["traction_force_4"][-1] / sound["traction_force_4"][-1] == pytest.approx(share, rel=0.05)


def test_a_second_motor_eats_current_that_is_still_measured():
    measured, truth = _drive(_robot(_fault("motor", wheel=4, braking_torque=0.01)), AHEAD, 0.3)
    _, sound = _drive(_robot(), AHEAD, 0.3)
    assert measured[-1].current[3] == pytest.approx(0.6, abs=1e-3)
    assert truth["traction_force_4"][-1] < 0.7 * sound["traction_force_4"][-1]


@pytest.mark.parametrize("fault", [{"grip": 0.1}, {"floor": "oil"}])
def test_a_slipping_wheel_runs_ahead_of_the_floor(fault):
    _, truth = _drive(_robot(_fault("slip", wheel=4, onset=0.2, **fault)), AHEAD, 0.5)
    assert truth["slip_velocity_4"][-1] > 3.0 * abs(truth["slip_velocity_2"][-1])
    assert abs(truth["traction_force_4"][-1]) < abs(truth["traction_force_2"][-1])


def test_oil_everywhere_takes_traction_from_all():
    _, truth = _drive(_robot(_fault("all_wheel_slip", floor="oil")), (1.5, 1.5, 1.5, 1.5), 0.5)
    for i in range(1, 5):
        assert abs(truth[f"traction_force_{i}"]).max() <= 0.04 * truth[f"normal_force_{i}"][0] + 1e-9


def test_a_patch_acts_on_the_wheels_that_stand_on_it():
    under_left = Patch("oil", center=(0.4, 0.25), size=(0.6, 0.2))
    _, truth = _drive(_robot(patches=(under_left,)), (0.0, -1.0, 0.0, 1.0), 0.9)
    # wheel 4 rides at (x, 0.25) while the robot does not turn
    before, after = truth["x"] < 0.09, (truth["x"] > 0.12) & (truth["x"] < 0.3)
    assert truth["slip_velocity_4"][before].max() < 1.05 * abs(truth["slip_velocity_2"][before]).max()
    assert truth["slip_velocity_4"][after].max() > 2.0 * abs(truth["slip_velocity_2"][after]).max()


def test_a_turned_patch_and_a_later_one_on_top():
    below = Patch("oil", center=(0.0, 0.25), size=(0.3, 0.3), yaw=0.3)
    on_top = Patch("pvc", center=(0.1, 0.28), size=(1.0, 0.02), yaw=0.3)  # its line passes under wheel 4
    untouched = Patch("pvc", center=(0.1, 0.28), size=(1.0, 0.02), yaw=-0.3)
    runs = {
        key: _drive(_robot(patches=patches), TURN, 0.01)[1]["traction_force_4"]
        for key, patches in {
            "oil": (below,),
            "pvc": (on_top,),
            "pvc on oil": (below, on_top),
            "oil on pvc": (on_top, below),
            "pvc beside": (untouched,),
            "bare": (),
        }.items()
    }
    assert_array_equal(runs["pvc on oil"], runs["pvc"])
    assert_array_equal(runs["oil on pvc"], runs["oil"])
    assert_array_equal(runs["pvc beside"], runs["bare"])
    assert len({runs[key][-1] for key in ("oil", "pvc", "bare")}) == 3


def test_a_fault_by_floor_lies_on_top_of_a_patch():
    patch = Patch("pvc", center=(0.0, 0.0), size=(4.0, 4.0))
    _, a = _drive(_robot(_fault("slip", wheel=1, floor="nylon"), patches=(patch,)), TURN, 0.2)
    _, b = _drive(_robot(_fault("slip", wheel=1, floor="nylon"), floor="pvc"), TURN, 0.2)
    for name in a:
        assert_array_equal(a[name], b[name])


def test_a_misaligned_axle_makes_the_robot_drift():
    faults = [_fault("misalignment", wheel=w, angle=0.05) for w in (2, 4)]
    _, truth = _drive(_robot(*faults), AHEAD, 1.0)
    _, sound = _drive(_robot(), AHEAD, 1.0)
    assert abs(sound["y"][-1]) < 1e-9
    assert abs(truth["y"][-1]) > 1e-3


def test_a_larger_wheel_goes_farther_per_turn():
    scaled = [_fault("wheel_radius", wheel=w, scale=1.1) for w in (2, 4)]
    for faults, radius in ((scaled, 0.055), ([], 0.050)):
        measured, truth = _drive(_robot(*faults), AHEAD, 1.0)
        rim = radius * measured[-1].wheel_speed[3]
        assert rim - truth["twist_x"][-1] == pytest.approx(truth["slip_velocity_4"][-1], abs=2e-3)


def test_a_payload_loads_the_wheels_beneath_it():
    _, truth = _drive(_robot(_fault("payload", onset=0.1, mass=4.0, x=0.1, y=0.0)), (0.0,) * 4, 0.2)
    assert truth["normal_force_1"][50] == pytest.approx(ROBOT.body.mass * 9.81 / 4)
    total = sum(truth[f"normal_force_{i}"][-1] for i in range(1, 5))
    assert total == pytest.approx((ROBOT.body.mass + 4.0) * 9.81)
    assert truth["normal_force_1"][-1] - truth["normal_force_3"][-1] == pytest.approx(4.0 * 9.81 * 0.1 / 0.25)


def test_published_drives_itself_without_current():
    for published in (False, True):
        _, truth = _drive(_robot(published=published), (0.0,) * 4, 1.0)
        assert bool(truth["twist_yaw"][-1] > 0.1) is published


def _rig(*faults, floor="natural_stone", **options):
    return PlanarRig(RIG, floor, faults=faults, ideal_sensors=True, **options)


@pytest.mark.parametrize("lateral", [0.0, 0.35, -0.65])
def test_the_rig_follows_the_independent_reference(lateral):
    measured, truth = _drive(_rig(lateral_speed=lateral, mass=2.9593), (0.9,), 1.0)
    _, speed, wheel_speed = integrate(RIG, FLOORS["natural_stone"], 2.9593, 0.9, 1.0, lateral)
    assert np.sqrt(np.mean((truth["true_carriage_speed"] - speed) ** 2)) < 5e-4
    assert np.sqrt(np.mean((np.array([m.wheel_speed for m in measured]) - wheel_speed) ** 2)) < 0.02
    assert truth["lateral_position"][-1] == pytest.approx(lateral * 1.0)
    assert truth["carriage_position"][-1] == pytest.approx(np.trapezoid(speed, dx=1e-3), abs=1e-3)
    assert np.all(truth["lateral_force_1"] * lateral <= 0.0)
    assert measured[0].lateral_speed == lateral


def test_a_rig_that_begins_in_motion_has_its_speeds():
    plant = PlanarRig(RIG, "pvc", ideal_sensors=True)
    plant.reset()
    plant.set_speeds(0.5, 10.0)
    measured, truth = (
        plant.step(CurrentCommand(np.zeros(1))),
        dict(zip(plant.truth_names, plant.truth(), strict=True)),
    )
    assert measured.carriage_speed == truth["true_carriage_speed"] == pytest.approx(0.5, abs=0.02)
    assert 5.0 < measured.wheel_speed < 10.0  # the floor and the motor's friction take it down


def test_the_rig_slips_on_oil_by_fault():
    _, truth = _drive(_rig(_fault("slip", wheel=1, onset=0.3, floor="oil")), (1.5,), 0.6)
    assert truth["traction_force_1"][310:].max() <= 0.04 * truth["normal_force_1"][0] + 1e-9
    assert truth["traction_force_1"][:290].max() > 10.0


def test_the_rig_repeats_bit_for_bit():
    plant = PlanarRig(RIG, "pvc", seed=5)
    first, _ = _drive(plant, (0.6,), 0.2)
    again, _ = _drive(plant, (0.6,), 0.2)
    assert first == again


def test_closing_twice_is_fine():
    for plant in (_robot(), _rig()):
        plant.close()
        plant.close()


@pytest.mark.parametrize(
    ("build", "words"),
    [
        (lambda: _robot(floor="sand"), "floor: unknown floor 'sand'.*choices: dry_asphalt"),
        (
            lambda: _robot(patches=(Patch("sand", (0.0, 0.0), (1.0, 1.0)),)),
            r"patches\.0\.floor: unknown floor",
        ),
        (lambda: _robot(_fault("slip", wheel=1, floor="sand")), "faults: floor: unknown floor 'sand'"),
        (lambda: _robot(_fault("payload", mass=60.0, x=0.9, y=0.0)), "payload: .*lifts wheel 3"),
        (lambda: _robot(start=(0.0, math.nan, 0.0)), "start: found .*three finite numbers"),
        (lambda: _rig(floor="sand"), "floor: unknown floor 'sand'"),
        (lambda: _rig(mass=0.0), "mass: found 0.0; must be above 0"),
        (lambda: _rig(mass=math.nan), "mass: found nan"),
        (lambda: _rig(lateral_speed=math.inf), "lateral_speed: found inf"),
        (
            lambda: _rig(_fault("slope", angle=0.1, direction=0.0)),
            r"faults\.0\.kind: unknown .*'slope'.*choices",
        ),
    ],
)
def test_bad_input_is_refused_with_its_name(build, words):
    with pytest.raises(InputError, match=words):
        build()


def test_a_command_of_the_wrong_length_is_refused():
    for plant, current in ((_robot(), np.zeros(1)), (_rig(), np.zeros(4))):
        plant.reset()
        with pytest.raises(InputError, match="command: found"):
            plant.step(CurrentCommand(current))


def test_an_unknown_floor_is_a_lookup_error_too():
    with pytest.raises(UnknownNameError):
        _robot(floor="sand")
