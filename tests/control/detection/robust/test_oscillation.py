"""Loops that oscillate: their doubt about forces and slip, and what of it counts as the noise of a sensor."""

from __future__ import annotations

import dataclasses
import math

import numpy as np
import pytest

from omnimj.control.detection.robust.blocks import BLOCK, Block, count_repeats, initial_samples, roughness
from omnimj.control.detection.robust.evidence import initial_evidence, robust_parameters
from omnimj.control.detection.robust.force_balance import (
    TIMING,
    oscillation_swing,
    update_oscillation,
)
from omnimj.control.detection.robust.wheel_monitors import (
    Traction,
    initial_monitors,
    update_wheel_monitors,
)
from omnimj.control.gains import Gains
from omnimj.control.robot_constants import robot_constants
from omnimj.parameters import read_robot
from omnimj.simulate.detectors import make_detector
from omnimj.simulate.scenario.scenario import with_gains
from omnimj.studies.evaluation.cases import CasePopulation, draw_cases, nominal_scenario
from omnimj.studies.evaluation.trial import make_true_plant
from omnimj.studies.random_truth import drive_on_plant

ROBOT = read_robot()
N = 4
RATE = 1000.0


def oscillation_of(values):
    """Mean square oscillation after a sequence of blocks."""
    memory = np.zeros((3, 1))
    for value in values:
        update_oscillation(memory, np.array([value]))
    return float(memory[2, 0])


@pytest.mark.parametrize("frequency", [36.0, 42.0, 46.0])
def test_an_oscillation_counts_with_the_mean_product_of_its_alternating_changes(frequency):
    """−Δ_k Δ_{k−1} of a sine has the mean −2 A² sin²(θ/2) cos θ, θ its turn in a block."""
    turn = 2.0 * math.pi * frequency * BLOCK
    found = [oscillation_of(3.0 * np.sin(turn * np.arange(200 + k))) for k in range(50)]
    expected = -2.0 * 9.0 * math.sin(0.5 * turn) ** 2 * math.cos(turn)
    assert np.mean(found) == pytest.approx(expected, rel=0.2)


@pytest.mark.parametrize("change", ["jump", "ramp", "slow"])
def test_a_change_that_lasts_is_no_oscillation(change):
    k = np.arange(300.0)
    values = {"jump": np.where(k < 100, 0.0, 8.0), "ramp": 0.5 * k, "slow": 8.0 * np.sin(0.4 * k)}[change]
    assert oscillation_of(values) < 0.01 * 8.0**2  # at most where a slow one turns round


def test_a_force_is_as_uncertain_as_the_root_of_its_mean_square_oscillation():
    assert TIMING * oscillation_swing(0.0, 9.0) == pytest.approx(3.0)
    assert oscillation_swing(2.0, 0.0) == pytest.approx(2.0)


def _mean_square(values, channel):
    """Mean square that a channel's noise counts with after a second of samples."""
    steps, row = initial_samples(N).steps, np.zeros(2 * N + 3)
    for value in values:
        row[channel] = value
        count_repeats(steps, row, True)
    return float(steps[2, channel])


def test_white_noise_counts_with_the_mean_square_of_its_steps():
    noise = 0.3 * np.random.default_rng(4).standard_normal(2000)
    found = np.mean([_mean_square(noise[: 1000 + 100 * k], N) for k in range(11)])
    assert found == pytest.approx(np.mean(np.square(np.diff(noise))), rel=0.1)


def test_a_shaking_wheel_is_no_noisy_encoder_though_its_steps_are_as_large():
    shake = 3.5 * np.sin(2.0 * math.pi * 40.0 / RATE * np.arange(1000))
    assert np.mean(np.square(np.diff(shake))) > roughness(N, N) ** 2
    assert _mean_square(shake, N) < 0.05 * roughness(N, N) ** 2


def _slipped(oscillation, slip):
    """Way slipped by wheel 1 after one block, at a slip and a mean square oscillation of its rim."""
    parameters, monitors = robust_parameters(ROBOT, 0.001), initial_monitors(N)
    constants, evidence = robot_constants(ROBOT), initial_evidence(N)
    force, creep = np.full(N, 1.0), np.zeros((N, 2))
    traction = Traction(
        constants.load,
        force,
        np.zeros(N),
        np.full(N, oscillation),
        creep,
        np.zeros(N),
        True,
        np.zeros(N, bool),
    )
    speed = np.full(N, slip / constants.radius[0])
    block = _block(speed)
    state, cov = np.zeros(4), evidence.velocity_cov[0] * 1e-6
    update_wheel_monitors(parameters, block, np.ones(N, bool), traction, state, cov, monitors, 0)
    return float(monitors.excess[0])


def _block(speed):
    zero = np.zeros(N)
    return Block(zero, speed, np.zeros(2), 0.0, zero, 0.0, zero, BLOCK)


def test_slip_counts_only_beyond_the_oscillation_of_the_wheel():
    """Two deviations of half the root of the mean square: one amplitude or a little more."""
    shaken = 0.04
    assert _slipped(0.0, 0.3) - _slipped(shaken**2, 0.3) == pytest.approx(shaken, rel=0.05)


@pytest.mark.slow
@pytest.mark.parametrize("number", [14, 9, 33, 52, 58, 70])
def test_a_twin_whose_yaw_loop_oscillates_drives_a_mission_without_an_alarm(number):
    """Sensors are late and the gain for fast errors is 6, so that the loop oscillates at 33 to 51 Hz."""
    drawn = CasePopulation(seed=9001, plants=("twin",), faults=("none",), structure="drawn")
    (case,) = draw_cases(drawn, (number,))
    scenario = nominal_scenario(case)
    stiff = dataclasses.replace(ROBOT.control, yaw_rate_proportional=6.0076, yaw_rate_lag=1.0)
    scenario = with_gains(scenario, Gains(stiff))
    trace = drive_on_plant(scenario, make_true_plant(case, scenario, ()), make_detector("robust", scenario))
    assert trace.about["diagnoses"] == []
    assert case.structure is not None
    prompt = dataclasses.replace(case.structure, delays=dict.fromkeys(case.structure.delays, 0.0))
    calm = dataclasses.replace(case, structure=prompt)
    quiet = drive_on_plant(scenario, make_true_plant(calm, scenario, ()), make_detector("robust", scenario))
    assert _shake(quiet) < 0.6 * _shake(trace)


def _shake(trace):
    """Root mean square step of the wheel speeds [rad/s]."""
    return float(np.sqrt(np.mean(np.square(np.diff(trace.wheels("wheel_speed"), axis=0)))))
