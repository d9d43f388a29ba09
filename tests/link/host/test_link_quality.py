"""What a link counts for its record: losses since the beginning, pings that came back."""

from __future__ import annotations

from hypothesis import given
from hypothesis import strategies as st

from omnimj.link.quality import ClockOffset, LossCounter


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
