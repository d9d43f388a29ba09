"""Wheel speeds for a wanted steady twist, against the equilibrium that they lead to."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.optimize import minimize
from steady_driving import steady_wheel_speeds

from omnimj.effects import apply_effects
from omnimj.parameters import read_robot
from omnimj.parameters.floor import all_floors
from omnimj.physics.effect_terms import zero_terms
from omnimj.physics.equilibrium import steady_twist
from omnimj.physics.inverse_equilibrium import approach_rims
from omnimj.physics.kinematics import rolling_matrix
from omnimj.physics.motor import motor_parameters
from omnimj.physics.planar import PlanarModel, planar_constants
from omnimj.physics.wheel import packed
from omnimj.resources import models_folder

FLOORS = all_floors(models_folder() / "robotino" / "soft_floors.toml")
ROBOTS = {"three wheels": models_folder() / "robotino" / "identified.toml", "four wheels": None}
NO_CURVE = np.zeros(0)
TWISTS = np.random.default_rng(5).uniform((-0.3, -0.3, -1.0), (0.3, 0.3, 1.0), (25, 3))


def model_of(robot, floor):
    changed = apply_effects(read_robot(robot))
    machine, n = changed.machine, changed.machine.wheel_count
    made = planar_constants(machine, 0.0, 1.0, 1.0, changed.payload)
    motors = np.array([packed(motor_parameters(machine.motor))] * n)
    return PlanarModel(made.body, made.wheels, motors, np.tile(floor.row, (n, 1)), zero_terms(n), False)


def rolling(robot, twist):
    robot = read_robot(robot)
    matrix = rolling_matrix(robot.wheel_positions, robot.rolling_directions)
    return matrix @ twist / robot.wheel.radius


def solved(model, twist):
    speeds = np.zeros(len(model.wheels))
    assert steady_wheel_speeds(model, np.asarray(twist, float), speeds)
    return speeds


@pytest.mark.parametrize("robot", ROBOTS.values(), ids=ROBOTS)
@pytest.mark.parametrize("floor", ["gray", "green", "natural_stone", "soft_mat"])
def test_at_the_wheel_speeds_found_the_wanted_twist_is_the_steady_one(robot, floor):
    model = model_of(robot, FLOORS[floor])
    for twist in TWISTS:
        found = 0.9 * twist
        if steady_twist(model, solved(model, twist), NO_CURVE, found):
            assert np.allclose(found, twist, atol=1e-5)
        else:  # the forward solution does not settle on some creep ratios
            assert floor == "soft_mat"


@pytest.mark.parametrize("floor", ["gray", "green"])
def test_three_wheels_get_back_the_speeds_that_led_to_a_twist(floor):
    model = model_of(ROBOTS["three wheels"], FLOORS[floor])
    for twist in TWISTS:
        speeds = rolling(ROBOTS["three wheels"], twist)
        led_to = 0.5 * twist
        assert steady_twist(model, speeds, NO_CURVE, led_to)
        assert np.allclose(solved(model, led_to), speeds, atol=2e-4)


@pytest.mark.slow
def test_of_four_wheels_the_speeds_closest_to_rolling_are_taken():
    model, radius = model_of(None, FLOORS["gray"]), read_robot().wheel.radius
    for twist in TWISTS[:3]:
        speeds = solved(model, twist)

        def away(others, twist=twist):
            return float(np.sum((radius * (others - rolling(None, twist))) ** 2))

        def unbalanced(others, twist=twist):
            found = twist.copy()
            steady_twist(model, others, NO_CURVE, found)
            return found - twist

        balance = {"type": "eq", "fun": unbalanced}
        start = speeds + np.array([0.3, -0.2, 0.1, 0.2])
        best = minimize(away, start, constraints=balance, method="SLSQP", options={"ftol": 1e-12})
        assert away(speeds) <= away(best.x) * (1.0 + 1e-3)
        assert not np.allclose(speeds, rolling(None, twist), rtol=0.05)


@pytest.mark.parametrize("robot", ROBOTS.values(), ids=ROBOTS)
def test_on_a_floor_that_hardly_creeps_the_wheels_roll(robot):
    model = model_of(robot, FLOORS["natural_stone"])
    for twist in TWISTS:
        assert np.allclose(solved(model, twist), rolling(robot, twist), atol=0.02)


def test_without_motion_the_wheels_stand():
    model = model_of(ROBOTS["three wheels"], FLOORS["green"])
    assert np.allclose(solved(model, np.zeros(3)), 0.0, atol=1e-6)


def test_a_twist_that_traction_cannot_keep_up_is_reported_and_its_wheels_roll():
    numbers = {**FLOORS["gray"].numbers, "mu_c": 0.05, "mu_s": 0.05, "sigma_2": 1e-6, "turnover": 0.0}
    model = model_of(ROBOTS["three wheels"], replace(FLOORS["gray"], numbers=numbers))
    for twist in TWISTS:
        speeds = np.full(3, np.nan)
        assert not steady_wheel_speeds(model, twist, speeds)
        assert np.allclose(speeds, rolling(ROBOTS["three wheels"], twist))


@pytest.mark.slow
def test_warm_started_steps_follow_a_twist_that_changes_slowly():
    model = model_of(ROBOTS["three wheels"], FLOORS["gray"])
    radius = read_robot(ROBOTS["three wheels"]).wheel.radius
    rims = np.zeros(3)
    for k in range(1, 1001):  # a second of speeding up at 0.25 m/s², then of turning the direction
        twist = 0.25 * min(k / 500, 1.0) * np.array([np.cos(k / 500), np.sin(k / 500), 0.0])
        approach_rims(model, twist, 0.0002, 2, rims)
    assert np.allclose(rims / radius, solved(model, twist), atol=0.01)
