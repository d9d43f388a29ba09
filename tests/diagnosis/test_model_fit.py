"""Where the model does not fit a run, no hardware is blamed for it."""

from __future__ import annotations

import numpy as np
import pytest

from omnimj.control.detection.robust.thresholds import Thresholds
from omnimj.diagnosis.driving_regimes import MISFIT, MOST_LEFT, describe_misfit, judge_fit
from omnimj.diagnosis.logs import read_machine
from omnimj.diagnosis.replay import DiagnosisConfig, diagnose
from omnimj.parameters import read_robot
from omnimj.parameters.floor import all_floors
from omnimj.recording.read_dataset import read_dataset
from omnimj.signals import Diagnosis, Trace
from omnimj.simulate.suites.catalogue import find_suite
from omnimj.simulate.suites.recording import RecordingConfig, record_suite

ROBOT = read_robot()


def trace_of(left, seconds=6.0) -> Trace:
    """A drive that speeds up along x, rolls and brakes, with a residual per third."""
    time = np.arange(0.0, seconds, 0.01)
    third = np.minimum((3.0 * time / seconds).astype(int), 2)
    speed = np.where(third == 0, time, np.where(third == 1, seconds / 3.0, seconds - time)) / (seconds / 3.0)
    columns = {"time": time, MISFIT: np.asarray(left, float)[third]}
    for i, (u_x, _) in enumerate(ROBOT.drive_directions, start=1):
        columns[f"wheel_speed_{i}"] = u_x * speed / ROBOT.wheel.radius
    return Trace(columns)


def test_a_residual_of_the_size_of_the_noise_fits():
    assert judge_fit(trace_of((1.0, 1.0, MOST_LEFT)), ROBOT, ()) is None


@pytest.mark.parametrize(("third", "regime"), [(0, "accelerating"), (1, "steady"), (2, "braking")])
def test_the_regime_of_the_largest_residual_is_named_with_its_size(third, regime):
    left = np.full(3, 1.0)
    left[third] = 3.0
    found = judge_fit(trace_of(left, 12.0), ROBOT, ())
    assert found is not None and (found.regime, found.size) == (regime, 3.0)
    assert found.seconds == pytest.approx(4.0, abs=0.3)
    assert "3 × the noise" in describe_misfit(found, ()) and regime in describe_misfit(found, ())


def test_what_is_left_after_a_diagnosis_may_be_the_fault_itself():
    fault = Diagnosis(8.0, "motor", (1,), 0.9)
    assert judge_fit(trace_of((1.0, 1.0, 3.0), 12.0), ROBOT, ()) is not None
    assert judge_fit(trace_of((1.0, 1.0, 3.0), 12.0), ROBOT, (fault,)) is None


@pytest.mark.slow
def test_a_robot_whose_wheels_ripple_far_beyond_its_model_is_not_said_to_have_weak_motors(tmp_path):
    effects = {"roller_ripple": {"amplitude": 8.0}}
    config = RecordingConfig(tmp_path / "logs", plant="planar", effects=effects)
    record_suite(find_suite("robot_missions"), config, choose=lambda runs: runs[:1])
    dataset = read_dataset(config.folder)
    machine = read_machine(dataset)
    settings = DiagnosisConfig(dataset, machine, "robust", all_floors(None), Thresholds())
    (run,) = diagnose(settings)
    assert run.does_not_fit is not None and run.does_not_fit.size > MOST_LEFT
    assert not run.diagnoses
