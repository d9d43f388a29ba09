"""A method diagnoses in a log what it diagnosed on the robot, wherever the log begins or breaks."""

from __future__ import annotations

import dataclasses
import json
from functools import cache
from pathlib import Path

import numpy as np
import pytest
from driven_missions import ONSET, as_dataset, as_run, driven
from nightly import latin, representative

from omnimj.control.detection.robust import RobustDetector
from omnimj.control.detection.robust.blocks import BLOCK
from omnimj.control.detection.robust.thresholds import Thresholds
from omnimj.control.gains import ObserverGains
from omnimj.diagnosis.files import diagnoses_json
from omnimj.diagnosis.logs import make_detector, read_machine
from omnimj.diagnosis.replay import DiagnosisConfig, first_bias, replay, sample_run
from omnimj.parameters import read_floors, read_robot
from omnimj.recording.dataset import Dataset, Run

FLOORS = read_floors()


def diagnose(run: Run, method: str = "robust"):
    machine = read_machine(as_dataset(run))
    detector = make_detector(method, machine, run, FLOORS[str(run.conditions["floor"])])
    return replay(run, sample_run(run, machine), machine, detector)


def without(run: Run, first: int, count: int) -> Run:
    """The log with rows missing."""
    keep = np.r_[0:first, first + count : len(run.time)]
    return dataclasses.replace(run, columns={name: values[keep] for name, values in run.columns.items()})


class Stepped(RobustDetector):
    """Called for every sample, since it has a step of its own."""

    def step(self, *given, **options):
        return super().step(*given, **options)


def uneven(run: Run) -> Run:
    """The log with a short and a long gap, and a gyro that is frozen at the end."""
    rate = run.columns["yaw_rate"].copy()
    rate[9000:] = rate[9000]
    return without(
        without(dataclasses.replace(run, columns={**run.columns, "yaw_rate": rate}), 4000, 60), 7000, 900
    )


@pytest.mark.parametrize(
    "make",
    [
        lambda: as_run(driven(weak=True)),
        lambda: as_run(driven(weak=True), commands=False),
        lambda: as_run(driven(), rows=slice(first_fast_row(), None, 4)),
        lambda: uneven(as_run(driven(weak=True))),
    ],
    ids=["weak", "without commands", "slow, from the middle", "gaps and a frozen sensor"],
)
def test_the_compiled_loop_gives_what_the_detector_gives_sample_by_sample(make):
    run = make()
    machine = read_machine(as_dataset(run))
    done: dict[bool, list[int]] = {True: [], False: []}
    seen = {
        stepped: replay(
            run,
            sample_run(run, machine),
            machine,
            (Stepped if stepped else RobustDetector)(read_robot()),
            done[stepped].append,
        )
        for stepped in (True, False)
    }
    one, other = seen[True], seen[False]
    assert dataclasses.replace(one, trace=other.trace) == other
    assert list(one.trace.columns) == list(other.trace.columns)
    for name, column in one.trace.columns.items():
        assert np.array_equal(column, other.trace[name], equal_nan=True), name
    assert len(done[True]) > 3 and len(done[False]) > 3


@pytest.mark.slow
def test_a_watch_of_the_compiled_loop_sees_each_block_as_that_of_single_samples_does():
    run = uneven(as_run(driven(weak=True)))
    machine = read_machine(as_dataset(run))
    seen = []
    for kind in (Stepped, RobustDetector):
        blocks = []

        def watch(time, state, blocks=blocks):
            blocks.append((time, state.blocks, *state.statistics, *state.log))

        replay(run, sample_run(run, machine), machine, kind(read_robot()), watch=watch)
        seen.append(np.array(blocks))
    assert np.array_equal(*seen, equal_nan=True) and len(seen[0]) > 800
    assert np.all(np.diff(seen[0][:, 0]) > 0.0)


def is_weak(diagnosis) -> bool:
    return diagnosis.kind == "motor" and diagnosis.wheels == (2,) and not diagnosis.ambiguous_with


def test_a_replayed_log_has_the_diagnoses_of_the_drive():
    trace = driven(weak=True, watched=True)
    expected, (found,) = trace.about["diagnoses"], diagnose(as_run(trace)).diagnoses
    assert [one["kind"] for one in expected] == ["motor"] and is_weak(found)
    assert found.time == pytest.approx(expected[0]["time"], abs=0.05)
    assert found.effectiveness == pytest.approx(expected[0]["effectiveness"], abs=0.1)


def test_a_healthy_mission_raises_no_alarm_and_rest_cannot_be_judged():
    found = diagnose(as_run(driven()))
    assert not found.diagnoses and found.judged == pytest.approx(12.001, abs=0.01)
    rest = np.abs(driven().wheels("wheel_speed")).max(axis=1) < 0.5
    assert 0.8 * rest.sum() * 1e-3 < found.cannot_judge < found.judged / 2.0


@pytest.mark.parametrize("weak", [False, True])
def test_set_currents_change_no_diagnosis(weak):
    with_them, without_them = (diagnose(as_run(driven(weak=weak), commands=c)) for c in (True, False))
    assert [(d.kind, d.wheels) for d in with_them.diagnoses] == [
        (d.kind, d.wheels) for d in without_them.diagnoses
    ]
    assert len(with_them.diagnoses) == int(weak)


@pytest.mark.parametrize("rate", [100, 250])
def test_slower_logs_give_the_same_diagnoses(rate):
    every = slice(None, None, 1000 // rate)
    assert not diagnose(as_run(driven(), rows=every)).diagnoses
    assert [is_weak(d) for d in diagnose(as_run(driven(weak=True), rows=every)).diagnoses] == [True]


def first_fast_row() -> int:
    """A row in the middle of a motion."""
    speed = np.abs(driven().wheels("wheel_speed")).max(axis=1)
    return int(np.argmax(speed > 0.7 * speed.max()))


@pytest.mark.slow
def test_a_log_that_begins_in_the_middle_of_a_motion_raises_no_alarm():
    row = first_fast_row()
    for method in ("robust", "published"):
        found = diagnose(as_run(driven(), rows=slice(row, None)), method)
        assert not [d for d in found.diagnoses if d.time < driven()["time"][row] + 1.0]


@pytest.mark.parametrize("lost", representative(95, 400, 10, 50, keep=2))
def test_a_gap_in_the_middle_of_a_motion_raises_no_alarm(lost):
    run = without(as_run(driven()), first_fast_row(), lost)
    found = diagnose(run)
    assert not found.diagnoses
    assert any("restarted after" in note for note in found.notes) == (lost > 100)
    assert found.judged == pytest.approx(12.001, abs=2e-3)
    assert found.cannot_judge - diagnose(as_run(driven())).cannot_judge > lost * 1e-3 - BLOCK


def irregular(run: Run, seed: int) -> Run:
    """The log of a busy host: 16 % of the rows are missing, one by one, and every tenth of a second many."""
    draws = np.random.default_rng(seed)
    keep = draws.random(len(run.time)) > 0.16
    for row in range(50, len(run.time), 100):
        keep[row : row + draws.integers(6, 40)] = False
    return dataclasses.replace(run, columns={name: values[keep] for name, values in run.columns.items()})


@pytest.mark.parametrize("seed", representative(11, 12, 13))
def test_an_irregular_log_of_a_healthy_robot_raises_no_alarm_and_its_gaps_cannot_be_judged(seed):
    whole = as_run(driven(28.0, seed))
    run = irregular(whole, seed)
    found = diagnose(run)
    steps = np.diff(run.time)
    assert not found.diagnoses
    assert found.cannot_judge > steps[steps > 0.0055].sum() + diagnose(whole).cannot_judge * 0.5
    assert found.judged == pytest.approx(28.001, abs=0.05)


def test_an_irregular_log_still_shows_a_weak_motor():
    assert [is_weak(d) for d in diagnose(irregular(as_run(driven(weak=True)), 3)).diagnoses] == [True]


@cache
def diagnosed_whole():
    """What is diagnosed in the log without a gap."""
    return diagnose(as_run(driven(weak=True))).diagnoses


@pytest.mark.parametrize(("lost", "later"), latin((50, 150, 600), (100, 400, 1500)))
def test_what_was_diagnosed_before_a_gap_stays_listed_once(later, lost):
    run, (before,) = as_run(driven(weak=True)), diagnosed_whole()
    row = int(np.argmax(run.time > before.time)) + later
    (after,) = diagnose(without(run, row, lost)).diagnoses
    assert is_weak(after) and after.time == before.time and after.time > ONSET


def test_the_trace_is_the_log_with_the_methods_columns_beside_it():
    run = as_run(driven(weak=True), rows=slice(None, None, 3))
    found = diagnose(run)
    (weak,) = found.diagnoses
    for name, values in run.columns.items():
        assert np.array_equal(found.trace[name], values)
    late = run.time > weak.time + 2.0
    left = found.trace["effectiveness_2"]
    assert np.all(left[run.time < ONSET] > 0.8) and abs(left[late].mean() - 0.43) < 0.1
    over = found.trace["residual_motor_2"] > found.trace["threshold_motor_2"]
    assert run.time[over].size == 0 or run.time[over].min() > ONSET


def test_the_bias_of_the_gyro_is_what_it_reads_at_rest():
    still = np.zeros((2000, 4))
    moving = np.full((1000, 4), 5.0)
    gyro = np.concatenate((np.full(1000, 0.3), np.full(2000, 0.02)))
    rest = first_bias(np.concatenate((moving, still)), gyro, 1e-3)
    assert rest.bias == pytest.approx(0.02)
    assert first_bias(moving, gyro[:1000], 1e-3).bias == 0.0
    assert first_bias(still[:250], gyro[1000:1250], 1e-3).bias == 0.0
    assert first_bias(still, np.full(2000, 0.2), 1e-3).bias == 0.0


def test_a_biased_gyro_is_no_fault():
    run = as_run(driven())
    run = dataclasses.replace(run, columns={**run.columns, "yaw_rate": run.columns["yaw_rate"] + 0.04})
    assert not diagnose(run).diagnoses


def test_the_content_of_diagnoses_json_states_thresholds_observer_and_floors_where_they_were_given():
    dataset = Dataset(Path("logs"), "uto_robot", ())
    plain = DiagnosisConfig(dataset, read_machine(dataset), "robust", FLOORS)
    given = dataclasses.replace(
        plain,
        thresholds=Thresholds(motor=31.0),
        observer=ObserverGains(),
        expected_floors=frozenset({"pvc", "mat"}),
    )
    shipped, own = (json.loads(json.dumps(diagnoses_json(one, (), "", False))) for one in (plain, given))
    assert shipped["thresholds"] is None and shipped["observer"] is None
    assert own["thresholds"] == {**Thresholds()._asdict(), "motor": 31.0}
    assert own["observer"] == dataclasses.asdict(ObserverGains())
    assert shipped["expected_floors"] == [] and own["expected_floors"] == ["mat", "pvc"]


def test_the_robust_method_expects_the_floors_of_a_user_s_file_and_knows_nothing_of_others():
    run, dataset = as_run(driven()), Dataset(Path("logs"), "uto_robot", ())
    plain = DiagnosisConfig(dataset, read_machine(dataset), "robust", FLOORS)
    floor = str(run.conditions["floor"])
    for expected, stated in ((frozenset(), False), (frozenset({floor}), True), (frozenset({"ice"}), False)):
        detector = dataclasses.replace(plain, expected_floors=expected).detector_for(run)
        assert isinstance(detector, RobustDetector) and detector.constants.robot.floor.stated == stated
