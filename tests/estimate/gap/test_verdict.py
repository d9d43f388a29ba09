"""The next experiment is the run in which the rivals' predictions differ most."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest

from omnimj.errors import InputError, UnknownNameError
from omnimj.estimate.gap import verdict as judging
from omnimj.estimate.gap.plants import PLANTS, find_plant, read_machine
from omnimj.estimate.gap.verdict import channel_sizes, judge_search, next_experiment, share_at_bounds
from omnimj.estimate.replay.interface import BaseParameter, Experiment
from omnimj.estimate.replay.problem import Fit, Problem

RUNS = tuple(Experiment(f"run_{k}", f"run {k}", {"gain": float(k)}) for k in range(4))


class Linear:
    """Predictions proportional to the gain of a run and the first parameter of a model."""

    base = ()

    def candidate_experiments(self):
        return RUNS

    def predict(self, settings, experiment):
        return [np.full((5, 1), setting.base[0] * experiment.run["gain"]) for setting in settings]


def problem(replay) -> Problem:
    split = SimpleNamespace(
        replay=replay, noise=np.array([0.5]), split=lambda x, effects: (SimpleNamespace(base=x), 0.0)
    )
    return cast(Problem, cast(Any, split))


def fitted(value: float) -> Fit:
    return Fit((), np.array([value]), np.zeros((5, 1)), np.zeros((5, 0)), 0.0)


def test_the_run_with_the_largest_difference_is_chosen():
    found = next_experiment(problem(Linear()), fitted(1.0), [("rival", fitted(2.0))])
    assert found is not None
    assert found["run"] == {"gain": 3.0}
    assert found["parting"] == {"rival": pytest.approx(6.0)}
    assert found["separates"] == ["rival"]


def test_rivals_with_equal_predictions_are_not_separated():
    found = next_experiment(problem(Linear()), fitted(1.0), [("twin", fitted(1.0)), ("rival", fitted(0.0))])
    assert found is not None and found["separates"] == ["rival"]


def test_without_rivals_there_is_no_experiment():
    assert next_experiment(problem(Linear()), fitted(1.0), []) is None


def test_a_plant_reads_its_own_model_files_only():
    for name, plant in PLANTS.items():
        if plant.model is None:
            continue
        one, other = read_machine(name, None), plant.read(None)
        assert getattr(one, "values", one) == getattr(other, "values", other)
    with pytest.raises(InputError, match="plant: found 'quarter_rig'"):
        read_machine("uto_robot", read_machine("quarter_rig", None).file)
    with pytest.raises(UnknownNameError, match="quarter_rig"):
        find_plant("hovercraft")


def search_result(base, final, residual=None, after=None):
    """Result of a search on four blocks, the last two held out, that names one effect."""
    replay = SimpleNamespace(base=tuple(base), measured=np.zeros((4, 2)))
    last = SimpleNamespace(x=np.array(final), residual=residual if after is None else after)
    fits = {"base": SimpleNamespace(residual=residual), "final": last, "outside": None}
    used = np.array([True, True, False, False])
    return cast(Any, SimpleNamespace(problem=SimpleNamespace(replay=replay), used=used, **fits))


def test_a_parameter_that_ends_at_zero_is_absent_and_any_other_bound_counts():
    friction, mass = BaseParameter("b", "1", 0.01, 0.0, 0.04), BaseParameter("m", "kg", 1.0, 0.5, 1.5)
    for values, share in (([0.0, 1.0], 0.0), ([0.04, 1.0], 0.5), ([0.0, 0.5], 0.5), ([0.04, 1.5], 1.0)):
        assert share_at_bounds(search_result([friction, mass], values)) == share


def test_a_mismatch_within_the_noise_of_every_channel_is_no_gap():
    quiet = np.array([[9.0, 9.0], [9.0, 9.0], [0.9, -0.2], [-0.9, 0.2]])
    assert channel_sizes(*of_base(quiet)) == pytest.approx([0.9, 0.2])
    loud = quiet * [1.0, 6.0]  # the mean over both channels is still within the noise
    assert np.mean(loud[2:] ** 2) < 1.2 and max(channel_sizes(*of_base(loud))) > 1.0
    masked, base = of_base(loud)
    masked.problem.replay.measured[:, 1] = np.nan
    assert channel_sizes(masked, base) == pytest.approx([0.9])
    verdict = judge_search(with_spring(masked))
    assert verdict.kind == "no_gap" and "spring gains 10 %" in verdict.reason


def of_base(residual):
    found = search_result([], [], residual)
    return found, found.base


def with_spring(found, gain=0.1):
    found.named = (
        SimpleNamespace(gain=SimpleNamespace(value=gain), candidate=SimpleNamespace(label="spring")),
    )
    found.curves = None
    return found


def test_a_faint_effect_must_remove_half_of_what_single_channels_show_above_the_noise():
    before = np.array([[9.0, 9.0], [9.0, 9.0], [0.6, -1.3], [-0.6, 1.3]])
    for left, is_faint in ((1.29, True), (1.2, True), (1.1, False), (0.9, False)):
        after = before.copy()
        after[2:, 1] *= left / 1.3
        found = search_result([], [], before, after)
        assert judging._is_faint(with_spring(found)) == is_faint
        assert not judging._is_faint(with_spring(found, gain=0.3))
    # beyond the noise as a whole, the verdict weighs what all channels show
    assert not judging._is_faint(with_spring(search_result([], [], 2.0 * before, 1.9 * before)))


@pytest.mark.parametrize(
    ("was", "loudest", "kind"), [(1.1, 1.6, "no_gap"), (1.1, 2.5, "unexplained"), (1.6, 1.6, "unexplained")]
)
def test_what_effects_explain_too_little_of_is_no_gap_at_the_level_of_noise(monkeypatch, was, loudest, kind):
    achieved = judging._Achieved(
        explained=0.5, above=0.5, was=was, rest=1.0, stretched=0.0, varies="", by="the effects"
    )
    monkeypatch.setattr(judging, "_measure_achieved", lambda found: (achieved, {"speed": 0.3}))
    monkeypatch.setattr(judging, "_is_faint", lambda found: False)
    monkeypatch.setattr(judging, "channel_sizes", lambda found, model: np.array([0.5, loudest]))
    found = cast(Any, SimpleNamespace(named=(SimpleNamespace(),), base=None, outside=None))
    verdict = judge_search(found)
    assert verdict.kind == kind and verdict.remains == was
    assert (f"{was:.2g} × its noise" in verdict.reason) == (kind == "no_gap")
