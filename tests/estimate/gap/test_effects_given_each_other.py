"""Effects judged given each other: look-ahead, bounds, ambiguity under structural misfit."""

from __future__ import annotations

import dataclasses
from functools import cache

import numpy as np
import pytest
from toy import SIZE, STEP, Toy

from omnimj.effects import Interval
from omnimj.estimate.gap.find import DatasetSummary, analyse_replay
from omnimj.estimate.gap.search.candidates import has_shape_at_bound, pinned_amplitudes, without_amplitudes
from omnimj.estimate.gap.search.cross_validation import TrainingSplit, make_folds, make_groups
from omnimj.estimate.gap.search.judgement import SelectedEffect, is_distinguishable
from omnimj.estimate.gap.search.search import search
from omnimj.estimate.gap.sentences import headline, next_step, summarize_finding, summarize_given_up
from omnimj.estimate.replay.interface import CandidateEffect, CandidateParameter, average_blocks
from omnimj.estimate.replay.problem import Fit, Problem


def quiet(phrase: str, share: float) -> None:
    """Nobody watches."""


class Wavy(Toy):
    """The true machine has a force that waves with speed, which no candidate has."""

    def __init__(self, truth, wave: float, seed: int = 0):
        self._wave = wave
        super().__init__(truth, seed)

    def simulate(self, settings):
        if not hasattr(self, "measured"):
            table = self._wave * np.array([0, 1, -1, 1, -1, 1, -1, 0.0])
            settings = [dataclasses.replace(s, curve=("speed", table)) for s in settings]
        return super().simulate(settings)


class Masked(Toy):
    """Sensor drifts with large parts in common, which cancel: only a small sum shows.

    Of `drift_a` and `drift_b` the difference shows, of `drift_d`, `drift_e` and `drift_f` the sum.
    """

    def __init__(self, truth, seed: int = 0):
        shape = CandidateParameter("amplitude", "m/s", -3.0, 3.0, 0.5, 0.0)
        own = ("drift_a", "drift_b", "drift_c", "drift_d", "drift_e", "drift_f")
        self._drifts = tuple(CandidateEffect(name, name, name, (shape,), is_sensor=True) for name in own)
        super().__init__(truth, seed)
        self.candidates = self._drifts

    def simulate(self, settings):
        plain = [dataclasses.replace(s, effects={}) for s in settings]
        time = average_blocks(STEP * np.arange(1500.0, dtype=np.float64), SIZE)
        common = np.sin(9.0 * time)
        forms = {"drift_a": common + 0.05 * np.cos(5.0 * time), "drift_b": common - 0.05 * np.cos(5.0 * time)}
        forms["drift_c"] = np.sin(3.0 * time)
        first, second, shown = np.sin(11.0 * time), np.cos(14.0 * time), 0.05 * np.sin(6.0 * time)
        forms |= {"drift_d": first + shown, "drift_e": second + shown, "drift_f": shown - first - second}
        found = super().simulate(plain)
        for values, setting in zip(found, settings, strict=True):
            for name, (amplitude,) in setting.effects.items():
                values[:, 0] += amplitude * np.tile(forms[name], len(values) // len(time))
        return found


def test_two_effects_that_mask_each_other_are_found_together():
    toy = Masked({"drift_a": np.array([1.0]), "drift_b": np.array([-1.0])})
    found = search(toy, (), 0, quiet)
    alone = {t.candidate.label: t.gain.value for t in found.rounds[0].tried}
    assert max(alone.values(), default=0.0) < 0.1
    assert {n.candidate.label for n in found.named} == {"drift_a", "drift_b"}
    assert sorted(found.final.x[-2:]) == pytest.approx([-1.0, 1.0], abs=0.1)


def test_candidates_that_change_nothing_do_not_stop_the_look_ahead():
    """`silent` has no influence at all, so that its part of the normal equations is zero."""

    class Silent(Masked):
        def __init__(self, truth):
            super().__init__(truth)
            one, *_ = self.candidates
            silent = [dataclasses.replace(one, label=name, effect=name) for name in ("silent_a", "silent_b")]
            self.candidates = (*self.candidates, *silent)

        def simulate(self, settings):
            heard = [
                dataclasses.replace(s, effects={k: v for k, v in s.effects.items() if "silent" not in k})
                for s in settings
            ]
            return super().simulate(heard)

    found = search(Silent({"drift_a": np.array([1.0]), "drift_b": np.array([-1.0])}), (), 0, quiet)
    assert {n.candidate.label for n in found.named} == {"drift_a", "drift_b"}


def test_three_effects_that_mask_each_other_are_found_together():
    hidden = {"drift_d": np.array([1.0]), "drift_e": np.array([1.0]), "drift_f": np.array([1.0])}
    found = search(Masked(hidden), (), 0, quiet)
    assert max((t.gain.value for t in found.rounds[0].tried), default=0.0) < 0.1
    assert {n.candidate.label for n in found.named} == set(hidden)


def test_something_else_that_is_missing_is_said_first():
    finding = analyse_replay(Wavy({"air_drag": np.array([0.15])}, 0.1), DatasetSummary("toy"))
    assert [e.effect for e in finding.effects] == ["air_drag"]
    assert finding.remains is not None and finding.remains > 2.0
    assert finding.incomplete and "incomplete" in headline(finding)
    assert summarize_finding(finding).startswith("Incomplete. The model lacks air_drag")
    assert "a free curve over speed would remove" in summarize_finding(finding)


def test_a_complete_model_is_not_called_incomplete():
    finding = analyse_replay(Toy({"air_drag": np.array([0.15])}), DatasetSummary("toy"))
    assert finding.remains is not None and finding.remains < 1.5
    assert not finding.incomplete and "ncomplete" not in summarize_finding(finding)


@pytest.mark.slow
@pytest.mark.parametrize("seed", [10, 11, 12])
def test_a_structure_that_the_library_lacks_does_not_decide_between_two_names(seed):
    """A wrong mass and a wrong speed scale predict nearly the same; the wave in speed fits one better."""
    found = search(Wavy({"payload": np.array([0.05])}, 0.03, seed), (), seed, quiet)
    sets = [{n.candidate.label, *(r.candidate.label for r in n.rivals)} for n in found.named]
    assert {"payload", "velocity_scale"} in sets


@cache
def of_a_wavy_machine():
    """Finding that has a set, something given up and several rounds."""
    return analyse_replay(Wavy({"payload": np.array([0.05])}, 0.03), DatasetSummary("toy"))


def test_what_was_given_up_is_listed_with_its_gain_and_reason():
    finding = of_a_wavy_machine()
    sentences = summarize_given_up(finding)
    for one, sentence in zip(finding.given_up, sentences, strict=True):
        assert one.label in sentence and one.reason in sentence
        assert one.label not in {e.effect for e in finding.effects}


@pytest.mark.slow
@pytest.mark.parametrize("truth", [{}, {"payload": np.array([0.05])}, {"air_drag": np.array([0.15])}])
@pytest.mark.parametrize("wave", [0.0, 0.03, 0.1])
def test_no_further_effect_gains_when_the_finding_says_so(truth, wave):
    finding = analyse_replay(Wavy(truth, wave), DatasetSummary("toy"))
    last = finding.stages[-1].candidates if finding.stages else ()
    gaining = [c.label for c in last if c.gain and (c.gain.low or 0.0) > finding.stages[-1].margin]
    assert finding.ended
    if "no further effect in the library gains" in finding.ended:
        assert not gaining
    elif "did not hold" in finding.ended:
        assert gaining and finding.given_up
    if finding.effects:
        assert finding.ended in next_step(finding)


def made_problem(misfit: float, difference: float, seed: int = 0) -> tuple[Problem, Fit, Fit, TrainingSplit]:
    """Two fits whose predictions differ by a sine of this size, with white misfit of this size, in noise."""
    toy, random = Toy({}, seed), np.random.default_rng(seed)
    groups = make_groups(toy)
    train = np.ones(groups.count, bool)
    split = TrainingSplit(np.ones(len(toy.measured), bool), groups, make_folds(groups, train, 0), seed)
    problem = Problem(toy, np.array([1.0]), huber_scale=1e6)
    time = np.concatenate([p.time for p in toy.segments])[:, None]
    residual = misfit * random.standard_normal(toy.measured.shape)
    jacobian = np.ones((toy.measured.size, 2)) * [1.0, 0.0]
    best = Fit((), np.array([1.0, 0.5]), residual, jacobian, 0.0)
    other = dataclasses.replace(best, residual=residual + difference * np.sin(5.0 * time))
    return problem, best, other, split


@pytest.mark.parametrize("scale", [1.0, 30.0])
def test_models_are_told_apart_by_their_difference_relative_to_the_misfit(scale):
    """N = 1800 blocks: the sine's energy N d²/2 exceeds 2 · 1.64 · misfit · √(N d²/2) for d > 0.11 misfit."""
    apart = [is_distinguishable(*made_problem(scale, 0.2 * scale, seed)) for seed in range(5)]
    alike = [is_distinguishable(*made_problem(scale, 0.05 * scale, seed)) for seed in range(5)]
    assert apart == [True] * 5 and alike == [False] * 5


def test_a_misfit_that_repeats_in_every_run_hides_a_difference_that_white_misfit_does_not():
    problem, best, other, split = made_problem(1.0, 0.2)
    time = np.concatenate([p.time for p in problem.replay.segments])[:, None]
    structured = np.sin(5.0 * time)
    repeated = dataclasses.replace(best, residual=structured)
    same = dataclasses.replace(other, residual=structured + 0.2 * np.sin(5.0 * time))
    assert is_distinguishable(problem, best, other, split)
    assert not is_distinguishable(problem, repeated, same, split)


def parameter(low: float, high: float, null: float | None) -> CandidateParameter:
    return CandidateParameter("p", "1", low, high, 0.5, null)


def test_an_amplitude_at_a_bound_counts_only_where_the_bound_means_nothing():
    drag = CandidateEffect("drag", "drag", "", (parameter(0.0, 2.0, 0.0), parameter(-1.0, 1.0, 0.0)))
    assert pinned_amplitudes(drag, np.array([0.0, 0.3])) == []  # absent
    assert pinned_amplitudes(drag, np.array([2.0, 0.3])) == [0]
    assert pinned_amplitudes(drag, np.array([1.0, -1.0])) == [1]
    grip = CandidateEffect("grip", "grip", "", (parameter(0.0, 5.0, 1.0),))
    assert pinned_amplitudes(grip, np.array([0.0])) == []  # a floor without any grip is a floor
    assert pinned_amplitudes(grip, np.array([5.0])) == [0]


def test_a_shape_at_its_bound_makes_a_stand_in():
    place = CandidateEffect("place", "place", "", (parameter(0.0, 2.0, 0.0), parameter(0.01, 0.5, None)))
    assert has_shape_at_bound(place, np.array([1.0, 0.5]))
    assert not has_shape_at_bound(place, np.array([2.0, 0.2]))


def test_an_amplitude_that_is_fixed_keeps_its_null_value():
    drag = CandidateEffect("drag", "drag", "", (parameter(0.0, 2.0, 0.0), parameter(-1.0, 1.0, 0.0)))
    fixed = without_amplitudes(drag, [1]).parameters
    assert (fixed[0].low, fixed[0].high) == (0.0, 2.0) and (fixed[1].low, fixed[1].high) == (0.0, 0.0)


def test_the_rounds_call_a_rival_what_the_summary_calls_one():
    finding = of_a_wavy_machine()
    (sets,) = [{e.effect, *e.indistinguishable_from} for e in finding.effects]
    for stage in finding.stages:
        shown = {c.label for c in stage.candidates if c.verdict in ("named", "rival")}
        assert shown <= sets
    assert {c.label for c in finding.stages[0].candidates if c.verdict in ("named", "rival")} == sets


@pytest.mark.parametrize(
    ("without", "rest", "supported"), [(12.0, 1.2, True), (12.0, 2.0, False), (2.0, 1.2, False)]
)
def test_an_effect_that_leaves_nothing_but_noise_needs_no_comparison_with_random_curves(
    without, rest, supported
):
    """A random curve that hardly bends is as good as an offset, and any curve where little can be gained."""
    gain = Interval(0.8, 0.7, 0.9)
    candidate = Toy({}).candidates[0]
    assert SelectedEffect(candidate, (), gain, 0.4, without, rest).is_supported is supported
    assert SelectedEffect(candidate, (), gain, 0.01, without, rest).is_supported
