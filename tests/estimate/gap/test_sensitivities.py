"""Sensitivities are simulated once and serve every model near the one of which they are."""

from __future__ import annotations

import numpy as np
import pytest
from toy import Toy

from omnimj.estimate.gap.search import search as searching
from omnimj.estimate.gap.search.search import search
from omnimj.estimate.gap.search.sensitivities import Sensitivities, trial_shapes, trial_steps
from omnimj.estimate.replay.interface import KNOTS
from omnimj.estimate.replay.problem import Problem, fit


class Counted(Toy):
    """Toy that counts its simulations."""

    count = 0

    def simulate(self, settings):
        self.count += len(settings)
        return super().simulate(settings)


def fitted(replay, *names):
    """Problem, and fit with the named effects."""
    problem, used = Problem(replay, np.array([0.002])), np.ones(len(replay.measured), bool)
    effects = tuple(c for c in replay.candidates if c.label in names)
    start = np.concatenate([problem.start(), *([s.typical for s in c.parameters] for c in effects)])
    return problem, fit(problem, effects, start, used)


def all_trials(replay):
    """Every candidate in each of its shapes, with its first trial step."""
    return [(c, shape, trial_steps(c)[0]) for c in replay.candidates for shape in trial_shapes(c)]


def test_a_column_is_the_change_of_the_residual_with_its_step():
    problem, base = fitted(Toy({"air_drag": np.array([0.05])}))
    near = Sensitivities()
    for candidate, shape, share in all_trials(problem.replay):
        trial = near.trial(problem, base, candidate, shape, share)
        for k, (place, step) in enumerate(trial.steps):
            own = trial.at.copy()
            own[place] += step
            (moved,) = problem.residuals([np.append(base.x, own)], (candidate,))
            assert trial.columns[:, k] == pytest.approx((moved - base.residual).ravel(), abs=1e-9)


def test_a_column_of_a_curve_is_the_change_of_the_residual_with_its_force():
    problem, base = fitted(Toy({}))
    (name, force), *_ = problem.replay.curves.items()
    (moved,) = problem.residuals([base.x], (), [(name, force * np.eye(KNOTS)[2])])
    change, found = (moved - base.residual).ravel(), Sensitivities().curves(problem, base)[:, 2]
    assert np.linalg.norm(found - change) < 0.1 * np.linalg.norm(change)  # to first order


def test_whatever_the_noise_becomes_the_columns_of_a_model_are_those_in_its_units():
    replay = Toy({"air_drag": np.array([0.05])})
    problem, base = fitted(replay)
    near, (one, *_) = Sensitivities(), all_trials(replay)
    near.trial(problem, base, *one)
    quieter = Problem(replay, np.array([0.001]))
    fresh = Sensitivities().trial(quieter, base, *one).columns
    assert near.trial(quieter, base, *one).columns == pytest.approx(fresh, abs=1e-9)


def test_a_model_with_one_more_effect_takes_them_without_another_simulation_and_nearly_the_same():
    replay = Counted({"air_drag": np.array([0.05]), "payload": np.array([0.1])})
    problem, base = fitted(replay)
    _, larger = fitted(replay, "air_drag")
    near = Sensitivities()
    trials = [one for one in all_trials(replay) if one[0].label != "air_drag"]
    for one in trials:
        near.trial(problem, base, *one)
    near.curves(problem, base)
    before = replay.count
    kept = [near.trial(problem, larger, *one).columns for one in trials]
    near.curves(problem, larger)
    assert replay.count == before
    for one, columns in zip(trials, kept, strict=True):
        fresh = Sensitivities().trial(problem, larger, *one).columns
        assert np.linalg.norm(columns - fresh) < 0.1 * np.linalg.norm(fresh)


@pytest.mark.slow
def test_a_search_names_the_same_as_one_that_simulates_them_at_every_model(monkeypatch):
    class Forgetful(Sensitivities):
        """Simulates every sensitivity at the model at hand."""

        def trial(self, *arguments):
            return Sensitivities().trial(*arguments)

        def curves(self, *arguments):
            return Sensitivities().curves(*arguments)

    hidden = {"air_drag": np.array([0.05]), "payload": np.array([0.1])}

    def searched():
        replay = Counted(hidden)
        found = search(replay, (), 0, lambda phrase, share: None)
        return replay.count, found

    few, kept = searched()
    monkeypatch.setattr(searching, "Sensitivities", Forgetful)
    many, forgotten = searched()
    assert few < 0.8 * many
    assert [n.candidate.label for n in kept.named] == [n.candidate.label for n in forgotten.named]
    assert kept.final.x == pytest.approx(forgotten.final.x, rel=1e-3)
