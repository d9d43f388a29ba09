"""The search on a small plant whose truth is known."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
from toy import Toy

from omnimj.estimate.gap.find import DatasetSummary, analyse_replay
from omnimj.estimate.gap.search.cross_validation import choose_heldout, heldout_gain, make_folds, make_groups
from omnimj.estimate.gap.search.screening import heldout_squares
from omnimj.estimate.gap.search.search import search
from omnimj.estimate.gap.verdict import judge_search
from omnimj.estimate.intervals import (
    block_noise,
    effective_samples,
    jackknife_deviations,
    neighbour_noise,
    repeatability,
)
from omnimj.estimate.replay.problem import Fit, Problem, fit, huber_weights


def quiet(phrase: str, share: float) -> None:
    """Nobody watches."""


def names(found) -> list[set[str]]:
    """Every named effect with its rivals."""
    return [{n.candidate.label, *(r.candidate.label for r in n.rivals)} for n in found.named]


def verdict_of(found) -> str:
    return judge_search(found).kind


@pytest.mark.parametrize("seed", [0, 1, 2])
def test_nothing_is_named_where_only_the_base_is_off(seed):
    found = search(Toy({}, seed), (), seed, quiet)
    assert found.named == ()
    assert verdict_of(found) == "no_gap"


def test_a_hidden_effect_is_named_with_its_size():
    found = search(Toy({"air_drag": np.array([0.05])}), (), 0, quiet)
    assert names(found) == [{"air_drag"}]
    assert found.final.x[-1] == pytest.approx(0.05, rel=0.02)
    assert verdict_of(found) == "named"


def test_what_no_data_of_this_kind_can_split_is_reported_as_rivals():
    """m v̇ = u − c v − F: a heavier mass under a free c and F is the same as a smaller speed scale."""
    found = search(Toy({"payload": np.array([0.05])}), (), 0, quiet)
    assert names(found) == [{"payload", "velocity_scale"}]
    assert verdict_of(found) == "ambiguous"


def test_two_hidden_effects_come_out_as_two_names():
    found = search(Toy({"air_drag": np.array([0.05]), "payload": np.array([0.1])}), (), 0, quiet)
    assert len(found.named) == 2
    assert {"air_drag"} in names(found)
    assert any("payload" in n for n in names(found))


def test_an_effect_outside_of_the_library_is_not_called_by_a_name_from_it():
    class Wavy(Toy):
        """A force that waves with speed: no candidate has it."""

        def simulate(self, settings):
            if not hasattr(self, "measured"):
                table = 0.3 * np.array([0, 1, -1, 1, -1, 1, -1, 0.0])
                settings = [dataclasses.replace(s, curve=("speed", table)) for s in settings]
            return super().simulate(settings)

    found = search(Wavy({}), (), 0, quiet)
    assert verdict_of(found) in ("unexplained", "no_gap")


def test_held_out_runs_leave_no_trace_in_the_fit():
    toy = Toy({"air_drag": np.array([0.05])})
    first = search(toy, ("c1", "c4"), 0, quiet)
    rows = ~first.used
    assert rows.any()
    other = Toy({"air_drag": np.array([0.05])})
    # another speed in the held-out runs, with the same noise from block to block
    other.measured[rows] += 1e-3
    second = search(other, ("c1", "c4"), 0, quiet)
    np.testing.assert_allclose(second.final.x, first.final.x, rtol=1e-3)


def test_an_interrupted_search_keeps_what_it_found():
    calls = []

    def impatient(phrase: str, share: float) -> None:
        calls.append(phrase)
        if phrase.startswith("judging"):
            raise KeyboardInterrupt

    finding = analyse_replay(Toy({"air_drag": np.array([0.05])}), DatasetSummary("toy"), report=impatient)
    assert finding.failure == "interrupted"
    assert [e.effect for e in finding.effects] == ["air_drag"]


def test_the_interval_of_an_effect_covers_it_and_is_not_endless():
    toy = Toy({"air_drag": np.array([0.05])})
    found = search(toy, (), 0, quiet)
    spread, factor = jackknife_deviations(found.problem, found.final, found.used)
    assert abs(found.final.x[-1] - 0.05) < spread[-1] * factor < 0.02


def test_scatter_of_white_noise_is_its_standard_deviation():
    toy = Toy({})
    mismatch = 0.01 * np.random.default_rng(3).standard_normal(toy.measured.shape)
    floor = repeatability(toy, mismatch)
    assert floor[0] == pytest.approx(0.01, rel=0.05)
    assert block_noise(toy, mismatch)[0] == pytest.approx(np.hypot(0.01, 0.002 * toy.measured.std()), rel=0.2)


@pytest.mark.parametrize("rest", [0.0, 0.4, 0.8])
def test_blocks_in_which_friction_holds_a_joint_do_not_lower_the_noise(rest):
    toy = Toy({})
    mismatch = 0.01 * np.random.default_rng(3).standard_normal(toy.measured.shape)
    for segment in toy.segments:
        mismatch[segment.first : segment.first + round(rest * (segment.last - segment.first))] = 0.0
    assert neighbour_noise(toy, mismatch)[0] == pytest.approx(0.01, rel=0.1)
    assert neighbour_noise(toy, np.zeros(mismatch.shape))[0] == 0.0


@pytest.mark.parametrize("memory", [0.0, 0.5, 0.8])
def test_coloured_noise_is_worth_fewer_samples(memory):
    """AR(1) with coefficient a: N_eff/N = (1 − a)/(1 + a)."""
    toy, random = Toy({}), np.random.default_rng(5)
    series = np.zeros(toy.measured.shape)
    for segment in toy.segments:
        for k in range(segment.first, segment.last):
            before = series[k - 1] if k > segment.first else 0.0
            series[k] = memory * before + random.standard_normal(1)
    share = effective_samples(toy, series) / series.size
    assert share == pytest.approx((1.0 - memory) / (1.0 + memory), rel=0.25)


def test_folds_and_held_out_groups_never_share_a_block():
    toy = Toy({})
    groups = make_groups(toy)
    heldout = choose_heldout(groups, 0)
    folds = make_folds(groups, ~heldout, 0)
    counts = np.sum(folds, axis=0) + heldout[groups.of_block]
    assert (counts == 1).all()


def test_repeats_stay_together():
    toy = Toy({})
    groups = make_groups(toy)
    for segment in toy.segments:
        assert {groups.names[g] for g in groups.of_block[segment.first : segment.last]} == {segment.condition}


@pytest.mark.parametrize("seed", range(5))
def test_what_a_single_run_determines_is_not_made_up_from_the_noise_of_the_others(seed):
    random, groups, rows = np.random.default_rng(seed), 6, 40
    column = 1e-3 * random.standard_normal((groups, rows))
    column[0] = 1.0 + random.random(rows)
    residual = random.standard_normal((groups, rows))
    residual -= column * (column * residual).sum() / (column**2).sum()  # the fit of all runs
    sums = np.array([c.T @ c for c in np.stack([column, residual], axis=2)])
    left = heldout_squares(sums, np.full(1, 1e-6), [np.array([g]) for g in range(groups)])
    assert left == pytest.approx((residual**2).sum(axis=1), rel=0.3)


def test_gain_of_the_same_model_is_zero_and_of_a_perfect_one_is_one():
    losses = np.array([3.0, 5.0, 8.0, 2.0])
    assert heldout_gain(losses, losses).value == 0.0
    assert heldout_gain(losses, 1e-12 * losses).value == pytest.approx(1.0, abs=1e-5)


def test_the_fit_is_a_stationary_point_inside_its_box():
    """At the optimum the weighted slope vanishes for every parameter that is not at a bound."""
    toy = Toy({"coulomb": np.array([0.2])})
    used = np.ones(len(toy.measured), bool)
    problem = Problem(toy, np.array([0.003]))
    effects = (toy.candidates[0],)
    done = fit(problem, effects, np.array([1.0, 0.5, 0.0]), used, rounds=6)
    jacobian = problem.jacobian(done.x, effects)
    weight = huber_weights(problem, done.residual, used)
    precision, distance = problem.prior(done.x, effects)
    slope = jacobian.T @ (done.residual.ravel() * weight**2) + precision * distance
    size = np.sqrt((jacobian**2).sum(axis=0) * (done.residual**2).sum())
    low, high = problem.bounds(effects)
    inside = (done.x > low + 1e-6) & (done.x < high - 1e-6)
    assert (np.abs(slope) < 0.02 * size)[inside].all()


def test_intervals_by_whole_conditions_cover_under_noise_alone_and_under_a_misfit_of_whole_runs():
    """z = (estimate − truth)/deviation of a linear problem: within Student's 90 % factor in 80 to 100 %."""
    toy = Toy({})
    time = np.concatenate([p.time for p in toy.segments])[:, None]
    used = np.ones(len(time), bool)
    form = np.stack([np.sin(2.0 * time[:, 0]), np.cos(3.0 * time[:, 0])], axis=1)
    owners = np.concatenate([np.full(p.last - p.first, k) for k, p in enumerate(toy.segments)])
    problem = Problem(toy, np.array([1.0]), huber_scale=1e6)
    for shared in (0.0, 1.0):
        inside = []
        for seed in range(60):
            random = np.random.default_rng(seed)
            common = shared * random.standard_normal(12)[owners] * np.sin(5.0 * time[:, 0])
            noise = random.standard_normal(len(time)) + common
            error = -np.linalg.lstsq(form, noise)[0]
            residual = (noise + form @ error)[:, None]
            fitted = Fit((), np.array([1.0, 0.5]), residual, form, 0.0)
            spread, factor = jackknife_deviations(problem, fitted, used)
            inside += (np.abs(error * problem.scales(())) <= factor * spread).tolist()
        assert 0.8 <= np.mean(inside) <= 1.0, shared


@pytest.mark.parametrize(("has_impacts", "step"), [(False, 0.02), (True, 0.1)])
def test_the_derivative_by_an_effect_of_impacts_is_a_secant_over_a_tenth_of_its_size(has_impacts, step):
    replay = Toy({"air_drag": np.array([0.05])})
    drag = next(c for c in replay.candidates if c.label == "air_drag")
    effects = (dataclasses.replace(drag, has_impacts=has_impacts),)
    problem = Problem(replay, np.array([0.002]))
    x = np.array([1.0, 0.5, 0.06])
    moved = x + step * problem.scales(effects) * [0.0, 0.0, 1.0]
    here, there = problem.residuals([x, moved], effects)
    secant = (there - here).ravel() / step
    assert np.allclose(problem.jacobian(x, effects, [2])[:, 0], secant)
    assert np.allclose(problem.jacobian(x, effects)[:, 2], secant)
