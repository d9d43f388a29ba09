"""Intervals count what the effects that are not in the model would change."""

from __future__ import annotations

import numpy as np
import pytest
from toy import Toy

from omnimj.estimate.gap.search.uncertainty import model_deviations, parameter_reach, undetermined
from omnimj.estimate.replay.problem import Problem, fit

LIBRARY = ("payload", "air_drag")


def fitted_toy(truth, names, replay=None):
    """Problem, fit with the named effects, and the blocks in use, of a toy with hidden effects.

    Its library: payload and air drag.
    """
    if replay is None:
        replay = Toy({name: np.array([value]) for name, value in truth.items()})
        replay.candidates = tuple(c for c in replay.candidates if c.effect in LIBRARY)
    effects = tuple(c for c in replay.candidates if c.effect in names)
    problem, used = Problem(replay, np.array([0.002])), np.ones(len(replay.measured), bool)
    start = [c.parameters[0].typical for c in effects]
    return problem, fit(problem, effects, np.append(problem.start(), start), used), used


def test_what_the_data_speak_for_moves_a_value_as_far_as_a_fit_with_it_does():
    problem, without, used = fitted_toy({"payload": 0.3, "air_drag": 0.015}, {"payload"})
    _, both, _ = fitted_toy({}, LIBRARY, problem.replay)
    friction = slice(0, 2)  # viscous and dry, which stand in for the drag
    moved = np.abs(both.x[friction] - without.x[friction])
    assert model_deviations(problem, without, used)[friction] == pytest.approx(moved, rel=0.15)
    reach = parameter_reach(problem, without, used)[friction]
    assert (np.abs(without.x[friction] - (1.05, 0.47)) < reach).all()


def test_where_the_model_is_right_the_library_widens_an_interval_little():
    problem, found, used = fitted_toy({"payload": 0.3}, {"payload"})
    other, wrong, _ = fitted_toy({"payload": 0.3, "air_drag": 0.015}, {"payload"})
    right = model_deviations(problem, found, used)[:2] / model_deviations(other, wrong, used)[:2]
    assert (right < 0.1).all()


def test_a_model_of_the_whole_library_has_no_other_effects_to_count():
    problem, found, used = fitted_toy({}, LIBRARY)
    assert not model_deviations(problem, found, used).any()


@pytest.mark.parametrize(("hidden", "open_ones"), [(0.0, {"payload"}), (0.3, set())])
def test_an_effect_is_undetermined_where_its_interval_includes_nothing(hidden, open_ones):
    problem, found, used = fitted_toy({"payload": hidden}, {"payload"})
    assert undetermined(problem, found, parameter_reach(problem, found, used)) == open_ones
