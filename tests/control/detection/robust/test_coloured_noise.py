"""Ripple of rollers and gears is not white noise: it may make no alarm, and a fault is still found."""

from __future__ import annotations

import numpy as np
import pytest
from nightly import representative

from omnimj.control.detection.robust.glr import (
    USUAL,
    USUAL_BLOCKS,
    USUAL_WEIGHT,
    coloured_variance,
    update_usual_level,
)
from omnimj.control.detection.robust.parameter_filter import update_parameters
from omnimj.diagnosis.logs import read_machine
from omnimj.diagnosis.replay import DiagnosisConfig, RunDiagnosis, diagnose
from omnimj.parameters.floor import all_floors
from omnimj.recording.read_dataset import read_dataset
from omnimj.simulate.suites.catalogue import find_suite
from omnimj.simulate.suites.recording import RecordingConfig, record_suite


def level_after(likelihoods) -> float:
    usual = np.array([USUAL, 0.0])
    for likelihood in likelihoods:
        update_usual_level(usual, likelihood)
    return float(usual[0])


def test_the_usual_level_begins_at_that_of_white_noise_and_tends_to_the_mean():
    seen = np.random.default_rng(0).exponential(4.0, 500)
    expected = (USUAL_WEIGHT * USUAL + seen.sum()) / (USUAL_WEIGHT + len(seen))
    assert level_after(seen) == pytest.approx(expected, rel=1e-9)
    assert level_after(np.full(20 * int(USUAL_BLOCKS), 4.0)) == pytest.approx(4.0, rel=1e-3)


def test_noise_below_the_white_level_makes_no_test_more_sensitive():
    assert coloured_variance(np.array([0.2 * USUAL, 100.0])) == 1.0
    assert coloured_variance(np.array([3.0 * USUAL, 100.0])) == pytest.approx(3.0)


def test_noise_of_four_times_the_variance_is_learnt_from_like_rows_of_half_the_size():
    rng = np.random.default_rng(1)
    x, rho = rng.standard_normal((3, 5)), rng.standard_normal(3)
    by_noise, by_rows = (np.zeros(5), np.eye(5)), (np.zeros(5), np.eye(5))
    update_parameters(*by_noise, np.zeros(5), 5, 4.0, x, rho)
    update_parameters(*by_rows, np.zeros(5), 5, 1.0, 0.5 * x, 0.5 * rho)
    assert by_noise[0] == pytest.approx(by_rows[0]) and by_noise[1] == pytest.approx(by_rows[1])


def diagnosed(folder, effects, mission) -> RunDiagnosis:
    """Diagnosis of a mission of a robot with effects that its model lacks."""
    config = RecordingConfig(folder, seed=3, plant="planar", effects=effects)
    record_suite(find_suite("robot_missions"), config, choose=lambda runs: runs[mission : mission + 1])
    dataset = read_dataset(folder)
    (run,) = diagnose(DiagnosisConfig(dataset, read_machine(dataset), "robust", all_floors(None)))
    return run


@pytest.mark.slow
@pytest.mark.parametrize("mission", [0, 1])
def test_healthy_wheels_that_ripple_by_two_newtons_raise_no_alarm(tmp_path, mission):
    run = diagnosed(tmp_path, {"roller_ripple": {"amplitude": 2.0}}, mission)
    assert run.diagnoses == () and run.withheld == ()


@pytest.mark.parametrize("mission", representative(0, 1))
def test_a_weak_motor_is_found_in_spite_of_ripple(tmp_path, mission):
    weak = {"torque_constant": {"wheel": 2, "scale": 0.5}, "roller_ripple": {"amplitude": 1.0}}
    run = diagnosed(tmp_path, weak, mission)
    assert {(d.kind, d.wheels) for d in run.diagnoses} == {("motor", (2,))}
