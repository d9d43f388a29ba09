"""The level that chance exceeds at a stated rate."""

from __future__ import annotations

import itertools
import math

import numpy as np
import pytest

from omnimj.diagnosis.calibration import fit_spread, fit_tail

STRETCH = 10.0
RATE = 0.1


def maxima(count: int, seed: int, blocks: int = 1000) -> np.ndarray:
    """Of `blocks` independent exponential numbers each."""
    return np.random.default_rng(seed).exponential(size=(count, blocks)).max(axis=1)


def true_level(rate: float, blocks: int = 1000) -> float:
    return math.log(blocks * 3600.0 / STRETCH / rate)


@pytest.mark.parametrize("count", [8, 40, 400])
def test_the_level_is_high_enough_nine_times_in_ten_however_few_the_data(count, measured):
    levels = np.array([fit_tail(maxima(count, seed), STRETCH).level(RATE) for seed in range(100)])
    short = float((levels < true_level(RATE) - 0.1).mean())
    measured(f"level too low, {count} stretches", short, 0.2)
    assert short <= 0.2


def test_more_data_bring_the_level_down_to_the_true_one():
    levels = [
        np.mean([fit_tail(maxima(n, s), STRETCH).level(RATE) for s in range(20)]) for n in (8, 64, 1024)
    ]
    assert levels[0] > levels[1] > levels[2] == pytest.approx(true_level(RATE), rel=0.06)


def test_the_level_rises_when_the_rate_falls():
    tail = fit_tail(maxima(60, 1), STRETCH)
    levels = [tail.level(rate) for rate in (100.0, 10.0, 1.0, 0.1, 0.01)]
    assert all(a < b for a, b in itertools.pairwise(levels))
    assert levels[4] - levels[3] == pytest.approx(tail.slope * math.log(10.0))


def test_a_constant_statistic_has_no_tail():
    tail = fit_tail(np.zeros(20), STRETCH)
    assert (tail.slope, tail.largest, tail.level(1e-6)) == (0.0, 0.0, 0.0)


def test_the_next_run_exceeds_the_calibrated_level_as_often_as_allowed():
    """Ten thousand calibrations with 12 runs each, all normal: the thirteenth is above in 5 % of them."""
    rng = np.random.default_rng(3)
    above = 0
    for _ in range(10_000):
        *runs, following = rng.normal(0.02, 0.01, 13)
        above += following > fit_spread(np.array(runs), hours=0.2).level(3.0)  # a run of 1 min, 3 per hour
    assert above == pytest.approx(500, abs=70)


def test_one_run_gives_no_information_on_the_next():
    assert fit_spread(np.array([0.02]), hours=1.0).level(0.1) == math.inf
