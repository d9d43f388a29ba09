"""A stated floor in the detector: creep from traction, drag in the force balance, bristles that yield."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
from steady_driving import steady_wheel_speeds

from omnimj.control.cascade.creep import creep_parameters
from omnimj.control.detection.robust.accommodation import accommodation_for, no_known_faults
from omnimj.control.detection.robust.blocks import Block
from omnimj.control.detection.robust.detector import RobustDetector
from omnimj.control.detection.robust.force_balance import SLOW, SLOW_SIDEWAYS, balance, columns, roller_speeds
from omnimj.control.detection.robust.thresholds import Thresholds
from omnimj.control.expected_floor import (
    creep_under,
    effective_load,
    expected_floor,
    largest_drag,
    yielded_way,
)
from omnimj.control.robot_constants import robot_constants
from omnimj.parameters import read_robot
from omnimj.parameters.floor import read_floors
from omnimj.physics.equilibrium import steady_current
from omnimj.physics.motor import motor_parameters
from omnimj.physics.planar import driven_wheel
from omnimj.physics.traction import exact_step, force_ratio, mean_deflection, relaxation_rate
from omnimj.physics.wheel import packed
from omnimj.resources import models_folder

FOLDER = models_folder() / "robotino"
ROBOT = read_robot(FOLDER / "identified.toml")
FLOORS = read_floors(FOLDER / "soft_floors.toml") | {
    name: floor for name, floor in read_floors().items() if name in ("natural_stone", "linoleum")
}
T, N = 0.01, 3
MOTIONS = [(0.2, 0.2, 0.0), (0.2, 0.2, 0.2), (-0.12, 0.15, -0.2)]
"""Twists at which no wheel and no roller is slow [m/s, m/s, rad/s]."""


@pytest.mark.parametrize("name", FLOORS)
def test_creep_under_a_traction_is_the_slip_that_gave_it(name):
    floor, z, back, rolling = FLOORS[name].traction, 0.0, 0.0, 0.2
    for k in range(60):
        slip = 0.06 * np.sin(0.1 * k)
        rate = relaxation_rate(floor, slip, rolling)
        mean = mean_deflection(z, exact_step(z, slip, rate, T), slip, rate, T)
        share = force_ratio(floor, mean, slip, rate)
        z = exact_step(z, slip, rate, T)
        found, back = creep_under(floor, share, rolling, 0.0, back, T)
        assert found == pytest.approx(slip, abs=1e-6)


@pytest.mark.parametrize("damping", [0.0, 2.5])
@pytest.mark.parametrize("speed", [0.1, 0.3])
def test_steady_creep_is_in_proportion_to_the_rolling_speed_however_late_traction_follows(speed, damping):
    floor, z, creep = FLOORS["gray"].traction, 0.0, 0.0
    for _ in range(2000):
        creep, z = creep_under(floor, 0.2, speed, damping, z, T)
    ratio = floor.turnover / floor.sigma_0 * 0.2
    assert creep == pytest.approx(ratio * speed, rel=0.1)


def steady_balance(twist, floor, stated):
    """ρ of a robot that drives steadily on a floor, with or without that floor stated to the detector."""
    motors = np.array([packed(motor_parameters(ROBOT.motor))] * N)
    model = creep_parameters(ROBOT, floor).model._replace(motors=motors)
    speed, force = np.empty(N), np.empty(4)
    assert steady_wheel_speeds(model, np.array(twist), speed)
    current = np.array(
        [steady_current(driven_wheel(model, i), speed[i], np.array(twist), force) for i in range(N)]
    )
    constants = robot_constants(ROBOT, floor if stated else None)
    spin = np.array([-twist[2] * twist[1], twist[2] * twist[0]])  # the accelerometer reads ω × v
    block = Block(current, speed, spin, twist[2], np.zeros(N), 0.0, current, T)
    x, rho, found, side = np.zeros((3, columns(N))), np.zeros(3), np.zeros(N), np.zeros(N)
    known = accommodation_for(no_known_faults(N), np.zeros(N), False)
    roller_speeds(constants, block, np.array(twist[:2]), side)
    assert np.abs(speed).min() > SLOW and np.abs(side).min() > SLOW_SIDEWAYS
    balance(constants, block, np.zeros(columns(N)), known, side, x, rho, found)
    return rho


@pytest.mark.parametrize("name", ["gray", "green"])
@pytest.mark.parametrize("twist", MOTIONS)
def test_the_drag_of_a_stated_floor_closes_the_force_balance_of_steady_driving(name, twist):
    left, missing = (steady_balance(twist, FLOORS[name], stated) for stated in (True, False))
    assert np.abs(left[:2]).max() < 1.0 and np.abs(missing[:2]).max() > 4.0


def test_loads_are_those_of_the_centre_of_mass_and_bristles_yield_by_the_law():
    floor = expected_floor(ROBOT, FLOORS["gray"])
    assert floor.loads[1] > 1.3 * floor.loads[0] and floor.loads[0] == pytest.approx(floor.loads[2], rel=0.05)
    assert floor.loads.sum() == pytest.approx(9.81 * ROBOT.body.mass, rel=1e-3)
    for i in range(N):
        yields = 1.0 / (FLOORS["gray"].traction.sigma_0 * effective_load(floor, i, 1.0))
        assert floor.yields[i] == pytest.approx(yields)


def test_bristles_yield_no_further_than_full_sliding_takes_them():
    """A floor whose traction is all slip speed has a bristle of 1 mm that hardly counts, however soft."""
    numbers = {"mu_c": 1e-3, "mu_s": 1e-3, "V_s": 1.0, "sigma_0": 1.0, "sigma_1": 0.0, "sigma_2": 2.5}
    floor = expected_floor(ROBOT, dataclasses.replace(FLOORS["gray"], law="lugre", numbers=numbers))
    assert floor.stroke == pytest.approx(1e-3) and floor.yields[0] > 0.01
    assert yielded_way(floor, 0, 0.7) == pytest.approx(2e-3)
    stiff = expected_floor(ROBOT, FLOORS["gray"])
    assert yielded_way(stiff, 0, 0.7) == pytest.approx(1.4 * stiff.yields[0])
    assert yielded_way(stiff, 0, 0.7) < 2.0 * stiff.stroke


def test_a_detector_without_a_stated_floor_knows_nothing_of_it():
    plain, stated = RobustDetector(ROBOT), RobustDetector(ROBOT, floor=FLOORS["gray"])
    assert plain.thresholds == Thresholds() and not plain.constants.robot.floor.stated
    assert stated.constants.robot.floor.stated
    assert stated.thresholds.bias == pytest.approx(largest_drag(ROBOT, FLOORS["gray"]) / ROBOT.body.mass)
    assert stated.thresholds._replace(bias=0.0) == Thresholds()
