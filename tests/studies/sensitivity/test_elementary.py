"""Elementary effects against closed forms, and what noise alone makes of them."""

from __future__ import annotations

import itertools
import math

import numpy as np
import pytest
from scipy.stats import sobol_indices, uniform

from omnimj.studies.sensitivity.elementary_effects import (
    BELOW,
    LEVELS,
    NONE,
    RANKED,
    STEP,
    UNKNOWN,
    UNSURE,
    EffectStatistics,
    ResultSensitivity,
    bootstrap_mu_star,
    classify_effect,
    effect_statistics,
    elementary_effects,
    noise_floor,
    rank_all,
    trajectory,
)

A = np.array([0.0, 1.0, 4.5, 9.0, 99.0])  # of the g-function: the smaller, the more its parameter matters


def g_function(x):
    """Π (|4x_i − 2| + a_i)/(1 + a_i) on the unit cube, Saltelli and Sobol' 1995."""
    return np.prod((np.abs(4.0 * x - 2.0) + A) / (1.0 + A), axis=-1)


def ishigami(x):
    """sin x1 + 7 sin² x2 + 0.1 x3⁴ sin x1 with x in [−π, π] (Ishigami and Homma 1990)."""
    one, two, three = np.moveaxis(math.pi * (2.0 * x - 1.0), -1, 0)
    return np.sin(one) + 7.0 * np.sin(two) ** 2 + 0.1 * three**4 * np.sin(one)


def effects_of(function, parameters, trajectories, seed=0):
    rows = []
    for index in range(trajectories):
        points = trajectory(seed, index, parameters)
        rows.append(elementary_effects(points, function(points)))
    return np.array(rows)


def measured_of(effects):
    return effect_statistics(effects, bootstrap_mu_star(effects, 1))


def test_of_a_linear_function_every_effect_is_its_slope():
    slopes = np.array([3.0, -0.5, 0.0, 1e-3])
    found = measured_of(effects_of(lambda x: 7.0 + x @ slopes, 4, 5))
    for one, slope in zip(found, slopes, strict=True):
        assert one.mu == pytest.approx(slope, abs=1e-12)
        assert (one.mu_star, one.low, one.high) == pytest.approx((abs(slope),) * 3, abs=1e-12)
        assert one.sigma == pytest.approx(0.0, abs=1e-12) and one.count == 5


@pytest.mark.slow
def test_of_the_g_function_mu_star_is_its_closed_form():
    # on the four places |4x − 2| is 2, 2/3, 2/3, 2: every step changes it by 4/3, its mean is 4/3
    own = (4.0 / 3.0) / STEP / (1.0 + A)
    mean = (4.0 / 3.0 + A) / (1.0 + A)
    expected = [own[i] * np.prod(np.delete(mean, i)) for i in range(len(A))]
    found = measured_of(effects_of(g_function, len(A), 4000))
    assert [one.mu_star for one in found] == pytest.approx(expected, rel=0.02)
    assert all(one.low < value < one.high for one, value in zip(found, expected, strict=True))
    # up and down are equally likely, whatever the others are
    assert [one.mu / one.mu_star for one in found] == pytest.approx([0.0] * len(A), abs=0.05)


@pytest.mark.slow
def test_of_ishigami_s_function_mu_star_and_sigma_are_those_of_the_whole_grid():
    places = np.arange(LEVELS) / (LEVELS - 1)
    found = measured_of(effects_of(ishigami, 3, 6000))
    for i in range(3):
        others = list(itertools.product(places, repeat=2))
        every = []
        for low in places[: LEVELS // 2]:
            for rest in others:
                a, b = np.insert(rest, i, low), np.insert(rest, i, low + STEP)
                every.append((ishigami(b) - ishigami(a)) / STEP)
        assert found[i].mu == pytest.approx(np.mean(every), abs=0.15)
        assert found[i].mu_star == pytest.approx(np.mean(np.abs(every)), rel=0.03)
        assert found[i].sigma == pytest.approx(np.std(every), rel=0.03, abs=1e-9)


def test_mu_star_ranks_as_sobol_s_total_indices_do():
    random = np.random.default_rng(0)
    total = sobol_indices(func=lambda x: g_function(x.T), n=2**12, dists=[uniform()] * len(A), rng=random)
    found = measured_of(effects_of(g_function, len(A), 200))
    assert np.argsort([-one.mu_star for one in found]).tolist() == np.argsort(-total.total_order).tolist()


def test_where_a_run_is_missing_so_are_its_two_effects_and_no_others():
    points = trajectory(0, 0, 6)
    results = points @ np.arange(1.0, 7.0)
    results[3] = np.nan
    found = elementary_effects(points, results)
    lost = [int(np.flatnonzero(points[k + 1] - points[k])[0]) for k in (2, 3)]
    assert sorted(np.flatnonzero(np.isnan(found)).tolist()) == sorted(lost)
    kept = [i for i in range(6) if i not in lost]
    assert found[kept] == pytest.approx(np.arange(1.0, 7.0)[kept])


def test_a_parameter_that_was_rounded_back_to_where_it_was_has_no_elementary_effect():
    points = np.array([[0.0, 0.0], [0.0, 0.5], [0.0, 0.5]])
    assert np.isnan(elementary_effects(points, np.array([1.0, 2.0, 2.0]))).tolist() == [True, False]


def test_a_parameter_without_any_effect_has_no_measure():
    found = measured_of(np.array([[np.nan, 1.0], [np.nan, 3.0]]))
    assert found[0].count == 0 and math.isnan(found[0].mu_star) and classify_effect(found[0], 0.0) == UNKNOWN
    assert found[1].count == 2 and found[1].mu_star == 2.0


@pytest.mark.slow
def test_intervals_hold_the_truth_about_as_often_as_their_level():
    random, held = np.random.default_rng(3), 0
    for _ in range(300):
        effects = random.exponential(1.0, (30, 1))
        one = measured_of(effects)[0]
        held += one.low <= 1.0 <= one.high
    assert 0.88 <= held / 300 <= 0.98  # a bootstrap of thirty is a little narrow


def test_noise_alone_is_hardly_ever_ranked():
    random, tables, parameters, wrong = np.random.default_rng(5), 60, 30, 0
    for table in range(tables):
        repeats = random.standard_normal(20)
        effects = (random.standard_normal((10, parameters)) - random.standard_normal((10, parameters))) / STEP
        floor = noise_floor(repeats, 10, parameters, table)
        found = measured_of(effects)
        wrong += any(classify_effect(one, floor) == RANKED for one in found)
    assert wrong <= 3  # of 60


def test_noise_that_changes_nothing_has_no_floor_and_one_run_gives_no_estimate():
    assert noise_floor([2.0] * 20, 10, 40, 0) == 0.0
    assert math.isnan(noise_floor([2.0, math.nan], 10, 40, 0))


def test_the_floor_grows_with_the_noise_and_falls_with_more_trajectories():
    repeats = np.random.default_rng(0).standard_normal(20)
    few, many = noise_floor(repeats, 5, 40, 0), noise_floor(repeats, 50, 40, 0)
    assert few > many > np.mean(np.abs(np.subtract.outer(repeats, repeats))) / STEP
    assert noise_floor(3.0 * repeats, 5, 40, 0) == pytest.approx(3.0 * few)


@pytest.mark.parametrize(
    ("mu_star", "low", "floor", "expected"),
    [
        (2.0, 1.5, 1.0, RANKED),
        (2.0, 0.5, 1.0, UNSURE),
        (0.9, 0.8, 1.0, BELOW),
        (0.0, 0.0, 1.0, NONE),
        (0.0, 0.0, math.nan, NONE),
        (2.0, 1.5, math.nan, UNKNOWN),
        (0.3, 0.0, 0.0, UNSURE),
    ],
)
def test_a_parameter_is_described_by_its_rank_its_interval_and_the_floor(mu_star, low, floor, expected):
    assert classify_effect(EffectStatistics(mu_star, mu_star, low, 3.0, 0.1, 10), floor) == expected


def study_of(name, effects, floor=0.0):
    draws = bootstrap_mu_star(effects, 1)
    return ResultSensitivity(name, "m", 0.0, floor, floor, effect_statistics(effects, draws), draws)


def test_a_number_that_acts_in_a_few_trajectories_is_shown_with_an_interval_down_to_nothing():
    effects = np.ones((10, 2))
    effects[2:, 1] = 0.0
    first, second = rank_all([study_of("alarms", effects)])
    assert (first.parameter, first.sure) == (0, True) and (second.parameter, second.sure) == (1, False)
    assert second.share == pytest.approx(0.2 / 1.2) and second.low == 0.0 and second.high > 0.25


def test_two_studies_of_rare_effects_do_not_contradict_each_other():
    """Intervals of shares hold the truth, also where an effect is there in one trajectory of four."""
    random, held = np.random.default_rng(11), 0
    for _ in range(100):
        rare = (random.random((10, 1)) < 0.25) * 4.0
        ranks = rank_all([study_of("alarms", np.hstack([np.ones((10, 1)), rare]))])
        shares = {rank.parameter: (rank.low, rank.high) for rank in ranks}
        low, high = shares.get(1, (0.0, 0.0))
        held += low <= 0.5 <= high
    assert held >= 80  # a bootstrap of ten is too narrow, but not by much


def test_shares_are_of_all_that_changes_a_result_and_what_is_below_the_floor_has_none():
    random = np.random.default_rng(0)
    first = study_of("first", random.uniform(0.9, 1.1, (10, 3)) * [3.0, 1.0, 0.0])
    second = study_of("second", random.uniform(0.9, 1.1, (10, 3)) * [0.0, 0.009, 0.001], floor=0.003)
    silent = study_of("silent", random.uniform(0.9, 1.1, (10, 3)), floor=5.0)
    ranks = rank_all([first, second, silent])
    assert [rank.parameter for rank in ranks] == [1, 0] and silent.ranked == ()
    assert [rank.share for rank in ranks] == pytest.approx([(0.25 + 0.9) / 2.0, 0.75 / 2.0], abs=0.02)
    assert [rank.most for rank in ranks] == ["second", "first"]
    assert all(rank.low <= rank.share <= rank.high for rank in ranks)
    assert rank_all([silent]) == ()
