"""Section 6.1 of the source: what weights and the yaw-rate loop do where there are no forces."""

import functools

import numpy as np
import pytest
from published_map import published_jacobian, rotation
from scipy.integrate import solve_ivp

from omnimj.errors import InputError, UnknownNameError
from omnimj.parameters import read_robot
from omnimj.physics.kinematics import rolling_matrix, weighted_inverse
from omnimj.simulate.kinematic import KinematicCase, KinematicPlant, drive_kinematic
from omnimj.simulate.scenario.drive import read_drive
from omnimj.simulate.scenario.tables import read_kinematics

ROBOT = read_robot()
CIRCLE = {"kind": "circle", "diameter": 8.0, "start": [0.0, 4.0], "lap_time": 10.0}
SQUARE = {"kind": "square", "side": 6.0, "start": [3.0, -3.0], "lap_time": 24.0}
ANGLE = 0.00248
MISALIGNED = KinematicCase(misalignment=(ANGLE, 0.0, -ANGLE, 0.0))


def reference(table, duration, period=4e-3):
    return read_drive(table, "drive", duration, period).reference


def driven(reference, case, yaw_gain=0.0, heading_feedback=True):
    start = (*reference.position[0].tolist(), float(reference.heading[0]))
    plant = KinematicPlant(ROBOT, case, float(reference.time[1]), start, yaw_gain)
    return drive_kinematic(plant, reference, heading_feedback)


def largest_deviation(trace):
    """Largest distance between the robot and its planned position at that instant [m]."""
    return float(np.hypot(trace["x"] - trace["target_x"], trace["y"] - trace["target_y"]).max())


def circle_deviation(plant, weight, free=False):
    case = KinematicCase(plant, (weight, 1.0, 1.0, 1.0), 5.0, 1, 5.0, free)
    return largest_deviation(driven(reference(CIRCLE, 10.0), case))


@pytest.mark.slow
@pytest.mark.parametrize("plant", ["published", "corrected"])
@pytest.mark.parametrize("feedback", [True, False])
def test_a_healthy_robot_is_where_it_should_be(plant, feedback):
    for table, duration in ((CIRCLE, 10.0), (SQUARE, 24.0)):
        trace = driven(reference(table, duration), KinematicCase(plant), heading_feedback=feedback)
        assert largest_deviation(trace) < 1e-9
        assert np.abs(trace["heading"]).max() < 1e-12


@pytest.mark.parametrize(("weight", "deviation"), [(1.0, 0.499), (100.0, 0.180), (1000.0, 0.0164)])
def test_published_plant_strays_less_the_larger_the_weight_of_the_lost_wheel(weight, deviation):
    assert circle_deviation("published", weight) == pytest.approx(deviation, rel=0.01)


def test_published_plant_with_the_largest_weight_strays_three_millimetres_at_most():
    assert circle_deviation("published", 10000.0) <= 0.003


@pytest.mark.parametrize(
    ("weight", "deviation"), [(1.0, 0.992), (100.0, 0.172), (1000.0, 0.0161), (10000.0, 0.0016)]
)
def test_corrected_plant_strays_twice_as_far_unweighted_when_the_lost_wheel_drags(weight, deviation):
    assert circle_deviation("corrected", weight) == pytest.approx(deviation, rel=0.01)


def test_a_lost_wheel_that_turns_freely_needs_no_weights_and_they_only_harm():
    assert circle_deviation("corrected", 1.0, free=True) < 1e-9
    assert circle_deviation("corrected", 1000.0, free=True) > 0.9


def independent(weight):
    """The published plant with a lost wheel 1 as its own differential equation, in the world frame."""
    w = 2.0 * np.pi / 10.0
    weights = [weight, 1.0, 1.0, 1.0]

    def rate(t, q):
        demand = np.array([4.0 * w * np.cos(w * t), -4.0 * w * np.sin(w * t), 0.0])
        j = published_jacobian(q[2], 0.25)
        wheels = weighted_inverse(j, weights) @ demand
        wheels[0] = 0.0
        return j @ wheels

    return solve_ivp(rate, (5.0, 10.0), [0.0, -4.0, 0.0], rtol=1e-10, atol=1e-12).y[:, -1]


@pytest.mark.parametrize("weight", [1.0, 100.0])
def test_path_after_the_loss_is_that_of_an_independent_integration(weight):
    case = KinematicCase("published", (weight, 1.0, 1.0, 1.0), 5.0, 1, 5.0)
    trace = driven(reference(CIRCLE, 10.0), case)
    found = [trace[name][-1] for name in ("x", "y", "heading")]
    np.testing.assert_allclose(found, independent(weight), atol=1e-5)


@functools.cache
def square_deviation(gain, **options):
    return largest_deviation(driven(reference(SQUARE, 24.0), MISALIGNED, gain, **options))


def test_square_with_axles_off_strays_twenty_centimetres_open_loop_and_three_with_the_yaw_rate_loop():
    gain = ROBOT.control.yaw_rate_proportional
    assert square_deviation(0.0, heading_feedback=False) == pytest.approx(0.20, abs=0.002)
    assert square_deviation(gain, heading_feedback=False) <= 0.03


def test_yaw_rate_loop_leaves_one_part_in_one_plus_gain():
    open_loop = square_deviation(0.0, heading_feedback=False)
    for gain in (1.0, 3.0, 10.0):
        assert square_deviation(gain, heading_feedback=False) == pytest.approx(
            open_loop / (1.0 + gain), rel=0.01
        )


def test_rotating_by_the_measured_heading_removes_what_drift_does_to_the_path():
    assert square_deviation(0.0, heading_feedback=True) < 1e-3


def test_twist_columns_are_the_motion_and_wheel_speeds_the_demand():
    table = {"kind": "profile", "speed": 0.5, "yaw_rate": 0.4, "direction": 1.0, "heading": 0.3}
    trace = driven(reference(table, 3.0, 1e-3), KinematicCase(), yaw_gain=2.0)
    k = 2000
    twist = np.array([trace[f"twist_{axis}"][k] for axis in ("x", "y", "yaw")])
    step = (trace["x"][k + 1] - trace["x"][k], trace["y"][k + 1] - trace["y"][k])
    moved = rotation(trace["heading"][k]) @ twist * 1e-3
    np.testing.assert_allclose(moved, [*step, trace["heading"][k + 1] - trace["heading"][k]], atol=2e-7)
    rolling = rolling_matrix(ROBOT.wheel_positions, ROBOT.drive_directions) @ twist / ROBOT.wheel.radius
    np.testing.assert_allclose(trace.wheels("wheel_speed")[k], rolling, atol=1e-9)


def test_lost_wheel_stands_still_from_its_time_on():
    case = KinematicCase(lost_wheel=3, lost_from=2.0)
    speed = driven(reference(CIRCLE, 10.0), case)["wheel_speed_3"]
    assert np.all(speed[500:] == 0.0) and np.all(speed[1:499] != 0.0)


def test_finer_sampling_changes_the_deviation_by_less_than_a_millimetre():
    case = KinematicCase("published", lost_wheel=1, lost_from=5.0)
    found = [largest_deviation(driven(reference(CIRCLE, 10.0, h), case)) for h in (4e-3, 1e-3)]
    assert found[0] == pytest.approx(found[1], abs=1e-3)


@pytest.mark.parametrize(
    ("table", "kind", "message"),
    [
        ({"plant": "printed"}, UnknownNameError, "unknown kinematic plant 'printed'.*corrected, published"),
        ({"weights": [1.0, -1.0, 1.0, 1.0]}, InputError, r"weights\[1\]: found -1.0; must be at least 1e-09"),
        ({"lost_wheel": 5}, InputError, "lost_wheel: found 5; must be at least 1 and at most 4"),
        ({"misalignment": [0.1]}, InputError, "misalignment: .*4 numbers are needed, one per wheel"),
    ],
)
def test_a_case_that_does_not_fit_the_robot_is_refused(table, kind, message):
    with pytest.raises(kind, match=message):
        read_kinematics(table, "s.toml: kinematics", 4)
