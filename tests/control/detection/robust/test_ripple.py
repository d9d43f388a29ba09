"""Ripple that turns with a wheel: learnt within seconds, without taking a fault for it."""

from __future__ import annotations

import numpy as np
import pytest

from omnimj.control.detection.robust.blocks import BLOCK, Block
from omnimj.control.detection.robust.ripple import (
    COSINE,
    FASTEST,
    LARGEST,
    PHASE,
    SINE,
    initial_ripple,
    learn_ripple,
    subtract_ripple,
    turn_wheels,
)
from omnimj.control.robot_constants import robot_constants
from omnimj.parameters import read_robot
from omnimj.simulate.detectors import make_detector
from omnimj.studies.evaluation.cases import CasePopulation, draw_cases, nominal_scenario
from omnimj.studies.evaluation.trial import make_true_plant
from omnimj.studies.random_truth import drive_on_plant

ROBOT = read_robot()
CONSTANTS = robot_constants(ROBOT)
N, ROLLERS = 4, CONSTANTS.rollers
SPEEDS = (3.0, -4.0, -5.0, 6.5)
FINE = 50  # parts of a block over which its mean is taken


def block(speeds) -> Block:
    zero = np.zeros(N)
    return Block(zero, np.asarray(speeds, float), np.zeros(2), 0.0, zero, 0.0, zero, BLOCK)


def driven(blocks, push, speeds=SPEEDS, seed=0):
    """Ripple as learnt, and its forces and those of the wheels in each block, shape (blocks, n).

    Args:
      blocks: Number of blocks.
      push: Force of each wheel from its angle, shape (FINE, n) → (FINE, n).
      speeds: Wheel speeds, shape (n,).
      seed: Of the noise of the balance, 1 N and 0.6 N.m.
    """
    ripple, basis, now = initial_ripple(N), np.zeros((2, N)), block(speeds)
    noise = np.random.default_rng(seed).standard_normal((blocks, 3)) * (1.0, 1.0, 0.6)
    known, true = np.empty((blocks, N)), np.empty((blocks, N))
    for k in range(blocks):
        turn_wheels(ROLLERS, now, ripple, basis)
        time = BLOCK * (k + (np.arange(FINE) + 0.5) / FINE)
        true[k] = push(np.outer(time, now.wheel_speed)).mean(axis=0)
        known[k] = ripple[SINE] * basis[0] + ripple[COSINE] * basis[1]
        rho = CONSTANTS.forces @ true[k] + noise[k]
        subtract_ripple(CONSTANTS.forces, ripple, basis, np.inf, rho)
        learn_ripple(CONSTANTS.forces, now, basis, rho, ripple)
    return ripple, known, true


def test_a_wheel_has_as_many_ripples_per_turn_as_rollers():
    assert ROLLERS == ROBOT.wheel.rows * ROBOT.wheel.rollers_per_row == 18


@pytest.mark.slow
def test_ripple_of_any_phase_is_learnt_within_three_seconds_at_each_wheel():
    phases = np.array([0.3, 2.0, -1.0, 3.0])
    _, known, true = driven(400, lambda angle: 2.0 * np.sin(ROLLERS * angle + phases))
    left = (known - true)[300:]
    assert np.sqrt(np.mean(left**2)) < 0.3 * np.sqrt(np.mean(true[300:] ** 2))


def test_a_force_that_does_not_turn_with_the_wheel_is_hardly_learnt():
    """A motor that lacks 5 N from the start on: at most a sixteenth of it."""
    ripple, _, _ = driven(300, lambda angle: np.full_like(angle, [5.0, 0.0, 0.0, 0.0]))
    assert np.hypot(ripple[SINE], ripple[COSINE]).max() < 5.0 / 16.0


@pytest.mark.parametrize("speed", [0.5, 1.01 * FASTEST])
def test_nothing_is_learnt_from_slow_wheels_nor_from_fast_ones(speed):
    ripple, _, _ = driven(200, lambda angle: 2.0 * np.sin(ROLLERS * angle), speeds=[speed] * N)
    assert not ripple[[SINE, COSINE]].any()


def test_ripple_beyond_a_tenth_of_the_load_is_left_in_for_the_judgement_of_the_fit():
    for share, left_in in ((0.9, 0.0), (1.1, 1.0)):
        ripple, basis = initial_ripple(N), np.zeros((2, N))
        ripple[COSINE] = force = share * LARGEST * CONSTANTS.load
        turn_wheels(ROLLERS, block([0.5, 0.0, 0.0, 0.0]), ripple, basis)
        rho = force * CONSTANTS.forces @ basis[1]
        before = rho.copy()
        subtract_ripple(CONSTANTS.forces, ripple, basis, LARGEST * CONSTANTS.load, rho)
        assert rho == pytest.approx(left_in * before, abs=1e-9)


def test_known_ripple_of_a_slow_wheel_is_taken_out_and_that_of_a_fast_one_is_not():
    for speed, share in ((0.5, 1.0), (1.01 * FASTEST, 0.0)):
        ripple, basis, rho = initial_ripple(N), np.zeros((2, N)), np.zeros(3)
        ripple[COSINE, 0] = 2.0
        turn_wheels(ROLLERS, block([speed, 0.0, 0.0, 0.0]), ripple, basis)
        subtract_ripple(CONSTANTS.forces, ripple, basis, np.inf, rho)
        assert rho == pytest.approx(-2.0 * share * CONSTANTS.forces[:, 0], abs=0.01)


def test_phase_follows_the_angle_through_reversals_and_stays_within_a_turn():
    ripple, basis, angle = initial_ripple(N), np.zeros((2, N)), 0.0
    for speed in [*[9.0] * 50, *[-4.0] * 200, *[1.0] * 30]:
        turn_wheels(ROLLERS, block([speed] * N), ripple, basis)
        angle += speed * BLOCK
    assert ripple[PHASE].min() >= 0.0 and ripple[PHASE].max() < 2.0 * np.pi
    assert np.exp(1j * ripple[PHASE]) == pytest.approx(np.exp(1j * ROLLERS * angle))


@pytest.mark.slow
@pytest.mark.parametrize(
    ("seed", "number"),
    [(9101, 967), (9101, 576), (9101, 984), (9103, 921), (9105, 100)],
)
def test_a_robot_that_ripples_by_two_newtons_drives_a_mission_without_an_alarm(seed, number):
    """Missions in which a healthy motor was named, with up to 31.7 nats at a threshold of 23.5."""
    (case,) = draw_cases(CasePopulation(seed=seed, faults=("none",), structure="drawn"), (number,))
    scenario = nominal_scenario(case)
    trace = drive_on_plant(scenario, make_true_plant(case, scenario, ()), make_detector("robust", scenario))
    assert trace.about["diagnoses"] == []
