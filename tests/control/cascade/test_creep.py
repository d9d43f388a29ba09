"""Feed-forward of creep in the cascade: wheel targets for the plan on the floor that it assumes."""

import dataclasses

import numpy as np
import pytest
from steady_driving import steady_wheel_speeds

from omnimj.control import Controller, Target
from omnimj.control.cascade.creep import creep_parameters
from omnimj.effects import with_effects
from omnimj.errors import InputError
from omnimj.parameters import read_robot
from omnimj.parameters.floor import all_floors
from omnimj.physics.kinematics import rolling_matrix
from omnimj.resources import models_folder
from omnimj.signals import Measurement

ROBOT = read_robot(models_folder() / "robotino" / "identified.toml")
FLOORS = all_floors(models_folder() / "robotino" / "soft_floors.toml")


def targets(demand, floor=None, gyro=0.0, robot=ROBOT, steps=60):
    """Wheel-speed targets after periods of a constant demand (v_x, v_y, yaw rate), shape (n,) [rad/s]."""
    controller = Controller(robot, creep_floor=floor)
    n = len(robot.wheels)
    measured = Measurement(0.0, np.zeros(n), np.zeros(n), np.zeros(2), gyro, 0.0)
    state, wanted = controller.start(measured), Target(np.array(demand[:2]), demand[2], 0.0)
    for _ in range(steps):
        _, state = controller.step(state, measured, wanted)
    return np.array(state.log[5 : 5 + n])


def rolling(demand, robot=ROBOT):
    matrix = rolling_matrix(robot.wheel_positions, robot.rolling_directions)
    return matrix @ np.array(demand) / robot.wheel.radius


@pytest.mark.slow
@pytest.mark.parametrize("floor", ["gray", "green"])
@pytest.mark.parametrize("demand", [(0.2, 0.0, 0.0), (-0.1, 0.22, 0.0), (0.1, 0.1, 0.4), (0.0, 0.0, 0.5)])
def test_the_targets_are_the_wheel_speeds_at_which_the_plan_is_steady(floor, demand):
    steady = np.zeros(3)
    model = creep_parameters(ROBOT, FLOORS[floor]).model
    assert steady_wheel_speeds(model, np.array(demand), steady)
    found = targets(demand, FLOORS[floor], gyro=demand[2])
    # wheels that roll nearly straight have less drag by the blunter change of sign
    assert np.allclose(found, steady, atol=0.03 * np.abs(steady).max())
    assert np.abs(found - rolling(demand)).max() > 0.5 or not any(demand[:2])  # no rollers turn on the spot


def test_without_a_floor_or_on_one_that_hardly_creeps_the_targets_are_those_of_rolling():
    demand = (0.2, -0.1, 0.0)
    assert np.allclose(targets(demand), rolling(demand), rtol=1e-12)
    assert np.allclose(targets(demand, FLOORS["natural_stone"]), rolling(demand), atol=0.03)


def test_the_correction_of_the_yaw_rate_is_added_as_without_feed_forward():
    demand = (0.2, 0.0, 0.0)
    without = targets(demand, gyro=0.01, steps=1) - targets(demand, steps=1)
    fed = targets(demand, FLOORS["gray"], gyro=0.01, steps=1) - targets(demand, FLOORS["gray"], steps=1)
    # the heading moves on by 10 µrad, which turns the demand
    assert np.abs(without).min() > 0.1 and np.allclose(fed, without, atol=1e-3)


def test_a_robot_that_shall_stand_gets_no_targets():
    assert not targets((0.0, 0.0, 0.0), FLOORS["green"]).any()


def test_for_a_demand_that_no_traction_can_meet_the_wheels_roll():
    numbers = {**FLOORS["gray"].numbers, "mu_c": 0.05, "mu_s": 0.05, "sigma_2": 1e-6, "turnover": 0.0}
    slippery = dataclasses.replace(FLOORS["gray"], numbers=numbers)
    demand = (0.2, 0.1, 0.0)
    assert np.allclose(targets(demand, slippery, steps=2000), rolling(demand))


def test_a_floor_that_does_not_suit_the_effects_of_the_model_is_refused():
    robot = with_effects(ROBOT, {"creep_ratio": {"floor": "linoleum"}})
    with pytest.raises(InputError, match="linoleum"):
        Controller(robot, creep_floor=FLOORS["linoleum"])
