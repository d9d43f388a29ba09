"""Truth of an edge by the camera, and scores of labels against it."""

import math
from types import MappingProxyType

import numpy as np
import pytest

from omnimj.diagnosis.floor_labels.edge import EdgeLine, SeenRun, contacts, place_line
from omnimj.diagnosis.floor_labels.scores import (
    LabelledTruth,
    edge_scores,
    found_crossings,
    shifted,
    true_crossings,
    unchanged,
)
from omnimj.errors import InputError
from omnimj.parameters import read_robot
from omnimj.recording.dataset import Run

TIME = np.arange(0.0, 20.0, 0.25)


def drifting(speed=-0.02, begin=0.1):
    """One wheel that drifts over the line, one that stays far beyond it, one before it."""
    far = np.full_like(TIME, 0.2)
    return np.column_stack([begin + speed * TIME, far, -far])


def truth(labels=None):
    distance = drifting()
    return LabelledTruth(TIME, (distance > 0.0).astype(int) if labels is None else labels, distance)


def test_a_contact_crosses_when_it_has_passed_the_band():
    (one,) = true_crossings(TIME, drifting())
    assert (one.wheel, one.floor) == (1, 0)
    assert 4.0 < one.first <= 4.5 and 5.5 <= one.last < 6.0
    touching = drifting(0.0, 0.005)
    assert true_crossings(TIME, touching) == []


def test_labels_that_follow_the_truth_have_full_scores():
    found = edge_scores([truth()])
    assert (found.crossings, found.found, found.on_time, found.false) == (1, 1, 1, 0)
    assert found.accuracy == 1.0
    assert found.labels < 3 * len(TIME)  # those within the band do not count


@pytest.mark.parametrize(("late", "hit", "soon"), [(0.5, 1, 1), (2.0, 1, 0), (6.0, 0, 0)])
def test_a_late_crossing_is_on_time_within_a_second_only(late, hit, soon):
    labels = truth().labels.copy()
    labels[TIME - late < 5.7, 0] = 1
    found = edge_scores([truth(labels)])
    assert (found.found, found.on_time, found.false) == (hit, soon, 1 - hit)


def test_the_wrong_wheel_is_no_crossing_found():
    labels = np.tile([1, 1, 0], (len(TIME), 1))
    labels[TIME > 5.0, 1] = 0
    found = edge_scores([truth(labels)])
    assert (found.crossings, found.found, found.false) == (1, 0, 1)
    assert [(c.wheel, c.floor) for c in found_crossings(TIME, labels)] == [(2, 0)]


def test_no_change_finds_nothing_and_shifted_truth_is_missed():
    none = edge_scores([unchanged(truth(), (1, 1, 0))])
    assert (none.found, none.false) == (0, 0)
    assert 0.5 < none.accuracy < 1.0
    moved = edge_scores([shifted(truth(), 0.25)])
    assert (moved.crossings, moved.found, moved.false) == (1, 0, 1)


def test_contacts_turn_with_the_robot():
    robot = read_robot("robotino")
    time = np.array([0.0, 1.0, 2.0])
    pose = {"x": [1.0, 1.1, 1.2], "y": [0.5, 0.5, 0.5], "heading": [math.pi - 0.1, math.pi, -math.pi + 0.1]}
    columns = {"time": time, **{name: np.array(values) for name, values in pose.items()}}
    run = Run("turning", MappingProxyType(columns), MappingProxyType({}), MappingProxyType({}))
    found = contacts(run, robot, time)
    assert found[1] == pytest.approx(np.array([1.1, 0.5]) - robot.wheel_positions, abs=1e-12)
    # a wrapped heading does not turn the robot around
    halfway = contacts(run, robot, np.array([1.5]))[0]
    assert halfway == pytest.approx(found[1:].mean(axis=0), abs=1e-3)


def seen_run(line, random, kind=2):
    """Contacts of two wheels, and misfits that tell the floors beyond a line."""
    contact = random.uniform(-0.3, 0.3, (60, 2, 2)) + np.array([0.7, -0.4])
    own = (line.beyond(contact) > 0.0) @ [2, 1]
    return SeenRun(contact, 5.0 * (np.arange(4)[:, None] != own) if kind == 2 else np.zeros((4, 60)))


def test_currents_place_the_line_between_two_floors():
    random, line = np.random.default_rng(1), EdgeLine(0.55, math.radians(-20.0))
    found = place_line([seen_run(line, random) for _ in range(10)])
    assert math.degrees(found.angle) == pytest.approx(-20.0, abs=1.0)
    middle = np.array([0.7, -0.4])
    assert found.beyond(middle) == pytest.approx(line.beyond(middle), abs=0.005)
    assert found.offset_range is not None
    low, high = found.offset_range
    assert low <= found.offset <= high and high - low < 0.02


def test_currents_that_tell_nothing_place_no_line():
    random = np.random.default_rng(1)
    with pytest.raises(InputError, match="one floor under all wheels explains as well"):
        place_line([seen_run(EdgeLine(0.5), random, kind=1)])
