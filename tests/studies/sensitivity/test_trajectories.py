"""Trajectories: one parameter at a time, every place as often as any other."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from omnimj.studies.sensitivity.elementary_effects import LEVELS, STEP, trajectory


@given(st.integers(0, 2**62), st.integers(0, 10**4), st.integers(1, 60))
def test_every_parameter_moves_once_and_alone_by_one_step_between_places_of_its_range(seed, index, count):
    points = trajectory(seed, index, count)
    assert points.shape == (count + 1, count)
    moves = np.diff(points, axis=0)
    assert (np.count_nonzero(moves, axis=0) == 1).all() and (np.count_nonzero(moves, axis=1) == 1).all()
    assert np.abs(moves[moves != 0.0]) == pytest.approx(STEP)
    assert np.isin(points, np.arange(LEVELS) / (LEVELS - 1)).all()


def test_one_seed_draws_one_trajectory_and_another_number_another():
    assert (trajectory(3, 7, 20) == trajectory(3, 7, 20)).all()
    assert (trajectory(3, 7, 20) != trajectory(3, 8, 20)).any()
    assert (trajectory(3, 7, 20) != trajectory(4, 7, 20)).any()


def test_all_places_are_visited_equally_often():
    points = np.concatenate([trajectory(0, index, 6) for index in range(2000)])
    shares = [np.mean(points == level / (LEVELS - 1)) for level in range(LEVELS)]
    assert shares == pytest.approx([1.0 / LEVELS] * LEVELS, abs=0.01)
