"""Which wheel stands on which floor: currents of mixed floors, labels over time, calibration."""

import itertools
from dataclasses import replace
from types import MappingProxyType

import numpy as np
import pytest
from made_floor_logs import dataset, floor, log, one_floor_logs, plan

from omnimj.diagnosis.floor_labels.calibration import calibrate_labels
from omnimj.diagnosis.floor_labels.currents import FloorPlan, expected_currents
from omnimj.diagnosis.floor_labels.labelling import (
    CurrentNoise,
    Evidence,
    label_path,
    label_probabilities,
    neighbours,
)
from omnimj.diagnosis.floor_labels.runs import label_runs, prepare_runs, start_labels
from omnimj.errors import InputError, UnknownNameError
from omnimj.parameters import read_robot

SOFT, HARD = 0, 1


@pytest.fixture(scope="module")
def three():
    made = plan()
    return made, calibrate_labels(made, [one_floor_logs(made)])


def labelled(made, calibration, runs):
    logs = dataset(made, runs)
    return list(label_runs(made, logs, prepare_runs(made, logs), calibration, {}))


def test_drag_across_one_wheel_is_borne_by_the_motors_of_the_others():
    across = replace(
        floor("hard"), numbers=MappingProxyType({**floor("hard").numbers, "rolling_resistance": 0.0})
    )
    more = {"roller_resistance": 0.2}
    rough = replace(across, name="rough", numbers=MappingProxyType({**across.numbers, **more}))
    made = FloorPlan(read_robot("robotino"), (rough, across))
    found = expected_currents(made, np.array([[2.0, -3.0, 1.0]]))[:, 0]
    moved = found[made.index((1, 0, 1))] - found[made.all_on("hard")]
    assert abs(moved[1]) < 0.01
    assert np.abs(moved[[0, 2]]).min() > 0.03


@pytest.mark.slow
@pytest.mark.parametrize("direction", [0.4, 3.3, 1.9, 5.0])
def test_wheels_that_change_their_floor_are_found_with_their_times(three, direction):
    made, calibration = three
    changes = [(0.0, (HARD, HARD, SOFT)), (5.0, (HARD, SOFT, SOFT)), (9.0, (SOFT, SOFT, SOFT))]
    run = log(made, "edge", direction, changes, 3, conditions={"start_floors": "hard, hard, soft"})
    (found,) = labelled(made, calibration, [run])
    assert [(c.wheel, c.floor) for c in found.crossings] == [(2, SOFT), (1, SOFT)]
    assert [c.time for c in found.crossings] == pytest.approx([5.0, 9.0], abs=0.5)
    sure = found.probability.max(axis=-1)
    assert np.median(sure) > 0.99
    assert (found.probability.argmax(axis=-1) == found.labels).mean() > 0.99


@pytest.mark.slow
def test_a_robot_on_one_floor_reports_no_crossing(three):
    made, calibration = three
    others = one_floor_logs(made, first=1, many=10)
    found = list(label_runs(made, others, prepare_runs(made, others), calibration, {}))
    assert len(found) == 20
    assert [run.crossings for run in found] == [[]] * 20


@pytest.mark.slow
def test_four_wheels_are_told_apart():
    made = plan("uto_robot")
    calibration = calibrate_labels(made, [one_floor_logs(made)])
    changes = [(0.0, (HARD, HARD, SOFT, SOFT)), (6.0, (HARD, HARD, HARD, SOFT))]
    run = log(made, "edge", 0.5, changes, 4, conditions={"start_floors": "hard, hard, soft, soft"})
    (found,) = labelled(made, calibration, [run])
    assert [(c.wheel, c.floor) for c in found.crossings] == [(3, HARD)]
    assert found.crossings[0].time == pytest.approx(6.0, abs=0.5)


@pytest.mark.slow
def test_a_run_that_stands_still_has_no_label(three):
    made, calibration = three
    run = log(made, "still", 0.0, [(0.0, (SOFT,) * 3)], conditions={"floor": "soft"}, speed=0.0)
    (found,) = labelled(made, calibration, [run])
    assert len(found.time) == 0 and found.crossings == []


def all_paths(evidence, one_wheel, start, price):
    """Every sequence of assignments with its score; a segment is a stretch of equal assignments."""
    w, count = evidence.windows, evidence.assignments
    for path in itertools.product(range(count), repeat=w):
        whole = (start, *path)
        steps = [(a, b) for a, b in itertools.pairwise(whole) if a != b]
        if not all(one_wheel[a, b] for a, b in steps):
            continue
        edges = [0, *(k for k in range(1, w) if path[k] != path[k - 1]), w]
        score = sum(evidence.until(a, b)[path[a]] for a, b in itertools.pairwise(edges))
        yield path, float(score) - price * len(steps)


def test_path_and_probabilities_are_those_of_the_sum_over_all_paths():
    rng = np.random.default_rng(2)
    assignments = np.array([(0, 0), (0, 1), (1, 0), (1, 1)])
    measured, expected = rng.normal(0.0, 1.0, (5, 2)), rng.normal(0.0, 1.0, (4, 5, 2))
    measured[2, 1] = np.nan
    evidence, one_wheel = Evidence(measured, expected, CurrentNoise(0.7, 0.5)), neighbours(assignments)
    paths = dict(all_paths(evidence, one_wheel, 1, 1.3))
    found = label_path(evidence, one_wheel, 1, 1.3)
    assert tuple(found.index) == max(paths, key=paths.__getitem__)
    weight = np.exp(np.array(list(paths.values())))
    share = np.array([[weight[[p[t] == a for p in paths]].sum() for a in range(4)] for t in range(5)])
    exact = share / weight.sum()
    assert label_probabilities(evidence, one_wheel, 1, 1.3) == pytest.approx(exact, rel=1e-9)


def test_a_difference_that_lasts_counts_once():
    noise, expected = CurrentNoise(0.05, 0.04), np.zeros((2, 400, 1))
    expected[1] = 0.08
    evidence = Evidence(np.zeros((400, 1)), expected, noise)
    gains = [np.subtract(*evidence.until(0, many)) for many in (1, 10, 100, 400)]
    assert np.all(np.diff(gains) > 0.0)
    assert gains[-1] < 0.5 * (0.08 / 0.04) ** 2


@pytest.mark.slow
@pytest.mark.parametrize("error", [0.15, 0.0])
def test_the_error_of_the_model_is_told_from_noise(error):
    made, runs = plan(), []
    for k, run in enumerate(one_floor_logs(made).runs):
        own = [one.name for one in made.floors].index(str(run.conditions["floor"]))
        runs.append(log(made, run.name, 0.3 + k, [(0.0, (own,) * 3)], k, error, run.conditions))
    noise = calibrate_labels(made, [dataset(made, runs)]).noise
    # about ten samples of 0.1 A in each window
    assert noise.white == pytest.approx(0.1 / np.sqrt(9.6), rel=0.1)
    assert noise.bias == pytest.approx(max(error, 0.005), rel=0.3, abs=0.01)


@pytest.mark.slow
def test_a_calibration_run_that_is_harder_than_the_others_sets_the_threshold(three):
    made, easy = three
    patch = [(0.0, (HARD,) * 3), (6.0, (HARD, SOFT, HARD)), (7.0, (HARD,) * 3)]
    hard = log(made, "patched", 1.0, patch, 8, conditions={"floor": "hard"})
    logs = dataset(made, [*one_floor_logs(made).runs, hard])
    found = calibrate_labels(made, [logs])
    assert found.hardest == "patched"
    assert found.price == pytest.approx(1.5 * found.needed)
    assert found.price > 1.5 * easy.price
    (again,) = labelled(made, found, [hard])
    assert again.crossings == []


@pytest.mark.slow
@pytest.mark.parametrize(
    ("conditions", "kind", "words"),
    [
        ({"start_floors": "hard, soft"}, InputError, "found 2 floors; one for each of 3 wheels is needed"),
        ({"start_floors": "hard, moon, soft"}, UnknownNameError, "unknown floor label 'moon'"),
        ({"floor": "moon"}, UnknownNameError, "unknown floor label 'moon'"),
    ],
)
def test_unsuitable_floors_of_a_run_are_refused(three, conditions, kind, words):
    made, _ = three
    run = log(made, "edge", 0.4, [(0.0, (SOFT,) * 3)], conditions=conditions)
    with pytest.raises(kind, match=words):
        start_labels(made, dataset(made, [run]), run, None)


def test_floors_that_cannot_be_compared_are_refused():
    robot = read_robot("robotino")
    with pytest.raises(InputError, match="two or more floors are needed"):
        FloorPlan(robot, (floor("soft"), floor("soft")))
    many = tuple(replace(floor("soft"), name=f"soft_{k}") for k in range(7))
    with pytest.raises(InputError, match="found 7 floors for 3 wheels; at most 256 assignments"):
        FloorPlan(robot, many)


@pytest.mark.slow
def test_too_few_runs_are_no_calibration(three):
    made, _ = three
    logs = one_floor_logs(made, many=1)
    with pytest.raises(InputError, match="2 runs of steady driving; at least 4 runs"):
        calibrate_labels(made, [logs])
