"""What counts of trials are worth."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.stats import poisson

from omnimj.studies.statistics import event_rate, median, quantile, wilson


def test_no_event_in_t_hours_bounds_the_rate_by_three_over_t():
    found = event_rate(0, 30.0)
    assert found.per_hour == 0.0 and found.upper == pytest.approx(2.996 / 30.0, rel=1e-3)
    assert event_rate(0, 0.0).upper is None


@given(st.integers(0, 50), st.floats(0.1, 1e3))
def test_at_the_bound_so_few_events_happen_one_time_in_twenty(events, hours):
    upper = event_rate(events, hours).upper
    assert upper is not None
    assert poisson.cdf(events, upper * hours) == pytest.approx(0.05, rel=1e-6)


@given(st.lists(st.floats(-1e3, 1e3), min_size=1, max_size=40), st.floats(0.0, 1.0))
def test_quantiles_are_those_of_numpy(values, share):
    assert quantile(values, share) == pytest.approx(float(np.quantile(values, share)), abs=1e-9)


def test_what_never_ended_is_infinite_in_median_and_quantile():
    assert median([0.1, math.inf, 0.2]) == 0.2
    assert median([0.1, math.inf, math.inf]) == math.inf
    assert quantile([0.1] * 10 + [math.inf], 0.95) == math.inf
    assert quantile([0.1] * 39 + [math.inf], 0.95) == pytest.approx(0.1)
    assert median([]) is None


@given(st.integers(0, 200), st.integers(1, 200))
def test_the_bounds_of_a_rate_solve_the_score_equation(hits, count):
    """At either bound p̂ − p = ∓z √(p(1 − p)/n), Wilson 1927."""
    hits = min(hits, count)
    found = wilson(hits, count)
    for bound in (found.low, found.high):
        if 0.0 < bound < 1.0:
            distance = abs(hits / count - bound)
            assert distance == pytest.approx(1.959964 * math.sqrt(bound * (1.0 - bound) / count), rel=1e-6)
    assert found.low <= hits / count <= found.high and wilson(0, 0).value is None
