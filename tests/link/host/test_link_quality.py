"""What a link counts for its record: losses since the beginning, pings that came back."""

from __future__ import annotations

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from omnimj.link.quality import ClockOffset, LossCounter, TimeHistogram


@given(st.lists(st.integers(1, 60), max_size=40))
def test_lost_in_all_is_what_never_came_in_its_turn(sequences):
    arrivals = LossCounter()
    taken = [sequence for sequence in sequences if arrivals.take(sequence)]
    assert arrivals.total_lost == max(sequences, default=0) - len(taken)


def test_pings_that_came_back_are_counted_once_and_only_if_they_were_sent():
    clock, answers = ClockOffset(), []
    for nonce in (7, 8):
        clock.sent(nonce, 0.0)
    for nonce in (7, 7, 99, 8):
        answers.append(clock.answers)
        clock.answered(nonce, 0.001, 5.0)
    assert [*answers, clock.answers] == [0, 1, 1, 1, 2]


@given(st.lists(st.floats(1e-7, 99.0), min_size=1, max_size=60), st.floats(0.01, 1.0))
def test_quantiles_of_a_histogram_are_those_of_its_times_within_two_percent(times, share):
    """The quantile q of n times is the k-th smallest, k = ⌈q n⌉."""
    histogram = TimeHistogram()
    for time in times:
        histogram.add(time)
    exact = sorted(times)[math.ceil(share * len(times)) - 1]
    assert histogram.quantile(share) == pytest.approx(exact, rel=0.02)
    assert histogram.count == len(times)
    record = histogram.as_record()
    assert record["max"] == max(times) and record["p50"] <= record["p99"] <= record["max"]
    assert record["p50"] == histogram.quantile(0.5) and record["p99"] == histogram.quantile(0.99)


def test_times_beyond_the_bins_count_at_their_ends_and_an_empty_histogram_has_quantile_zero():
    histogram = TimeHistogram()
    assert histogram.as_record() == {"p50": 0.0, "p99": 0.0, "max": 0.0}
    histogram.add(0.0)
    assert histogram.quantile(1.0) == 0.0 and histogram.count == 1
    for _ in range(3):
        histogram.add(500.0)
    assert histogram.largest == 500.0 and 90.0 < histogram.quantile(0.99) < 110.0
