"""Healthy robots whose gear brakes otherwise than the model says: what is learnt of it, and no alarm."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from omnimj.control.detection.robust.accommodation import Accommodation
from omnimj.control.detection.robust.blocks import Block, failed_channels, roughness
from omnimj.control.detection.robust.evidence import initial_evidence, robust_parameters, update_evidence
from omnimj.control.detection.robust.force_balance import (
    LEARNT_FROM,
    LEARNT_FULLY,
    NOISE,
    TIMING,
    Recent,
    balance,
    columns,
    gear_column,
    instructive_gear,
    least_gear_share,
    mass_column,
    roller_speeds,
    whiten,
)
from omnimj.control.robot_constants import robot_constants
from omnimj.parameters import read_robot
from omnimj.simulate.detectors import make_detector
from omnimj.studies.evaluation.cases import CasePopulation, draw_cases, nominal_scenario
from omnimj.studies.evaluation.trial import make_true_plant
from omnimj.studies.random_truth import drive_on_plant

ROBOT = read_robot()
N, P = 4, columns(4)
C = robot_constants(ROBOT)
NONE = np.zeros(N, bool)
HEALTHY = Accommodation(~NONE, NONE, np.zeros(2, bool), NONE, np.zeros(N), False)
SPEED = np.array([8.0, -5.0, -7.0, 9.0])
FIRST = np.array([1.0, 0.0, 0.0, 0.0])


def block(current, acceleration=(0.0, 0.0), spin=0.0) -> Block:
    """Block of steady wheel speeds."""
    return Block(current, SPEED, np.array(acceleration), 0.0, np.zeros(N), spin, current, 0.01)


def gear_columns(current):
    """γ's column of X, and that from which γ is learnt."""
    x, rho, force, side, lesson = np.zeros((3, P)), np.zeros(3), np.zeros(N), np.zeros(N), np.zeros(3)
    now = block(current)
    roller_speeds(C, now, np.zeros(2), side)
    balance(C, now, np.zeros(P), HEALTHY, side, x, rho, force)
    instructive_gear(C, now, np.zeros(P), HEALTHY, lesson)
    return x[:, gear_column(N)], lesson


def currents_for(shaft):
    """Currents at which the floor drives every wheel with a traction before the gear of `shaft` [N]."""
    ahead = np.sign(SPEED)
    return ((C.dry - shaft) * ahead + C.viscous * SPEED) / C.torque


def test_wheels_that_coast_teach_nothing_about_the_gear():
    column, lesson = gear_columns(currents_for(0.9 * LEARNT_FROM))
    assert np.abs(column).max() > 0.1 and lesson.tolist() == [0.0] * 3


def test_wheels_that_brake_teach_all_that_the_balance_says_of_the_gear():
    column, lesson = gear_columns(currents_for(1.1 * LEARNT_FULLY))
    assert lesson == pytest.approx(column)


@pytest.mark.slow
def test_noise_of_coasting_wheels_does_not_move_the_gears_share():
    """γ stays at its prior mean, although the same noise is in both sides of the balance."""
    rng, evidence = np.random.default_rng(3), initial_evidence(N)
    parameters = robust_parameters(ROBOT, 1e-3)
    for _ in range(1500):
        real = currents_for(rng.uniform(0.0, 0.3))
        x, rho, force, side = np.zeros((3, P)), np.zeros(3), np.zeros(N), np.zeros(N)
        roller_speeds(C, block(real), np.zeros(2), side)
        balance(C, block(real), np.zeros(P), HEALTHY, side, x, rho, force)
        noisy = real + 0.02 * rng.standard_normal(N)
        moved = block(noisy, rho[:2] / C.mass, rho[2] / C.yaw_inertia)
        update_evidence(parameters, moved, HEALTHY, evidence, 0.0)
    assert abs(evidence.theta[gear_column(N)]) < 0.05


def test_the_least_share_is_that_of_a_gear_which_multiplies_in_both_directions():
    motor = dataclasses.replace(ROBOT.motor, back_driving_efficiency=1.0 / ROBOT.motor.gear_efficiency)
    both = robot_constants(dataclasses.replace(ROBOT, motor=motor))
    assert (1.0 + least_gear_share(C)) * C.driven == pytest.approx(both.driven)
    assert least_gear_share(both) == pytest.approx(0.0)


def test_a_force_that_swings_is_uncertain_along_its_wheel_by_its_change_in_the_time_error():
    swing, current, fast = 10.0 * FIRST, np.zeros(N), np.full(N, 9.0)
    x, rho = np.zeros((3, P)), np.zeros(3)
    free = slice(mass_column(N), mass_column(N) + 3)
    x[:, free] = np.eye(3)
    whiten(C, np.zeros(P), current, Recent(fast, np.ones(N), swing), HEALTHY, x, rho)
    low = np.linalg.inv(x[:, free])
    along = C.forces[:, 0]
    assert low @ low.T == pytest.approx(
        np.diag(np.square(NOISE)) + np.outer(along, along) * (10.0 * TIMING) ** 2
    )


@pytest.mark.slow
@pytest.mark.parametrize(("rough", "fails"), [((0,), True), ((0, 1), True), ((0, 1, 2, 3), False)])
def test_a_wheel_is_too_noisy_unless_most_wheels_shake(rough, fails):
    steps, failed = np.zeros((3, 2 * N + 3)), np.zeros(2 * N + 3, bool)
    for wheel in rough:
        steps[2, N + wheel] = 1.5 * roughness(N + wheel, N) ** 2
    failed_channels(steps, SPEED, failed)
    assert failed[[N + wheel for wheel in rough]].tolist() == [fails] * len(rough)


@pytest.mark.slow
@pytest.mark.parametrize("number", [11, 60, 119, 141, 165, 169])
def test_a_healthy_robot_of_another_structure_drives_a_mission_without_an_alarm(number):
    """Missions with alarms where the gear's share is learnt from all wheels; E_b is 0.43 to 0.51 in five."""
    (case,) = draw_cases(CasePopulation(seed=8000, faults=("none",), structure="drawn"), (number,))
    scenario = nominal_scenario(case)
    trace = drive_on_plant(scenario, make_true_plant(case, scenario, ()), make_detector("robust", scenario))
    assert trace.about["diagnoses"] == []
