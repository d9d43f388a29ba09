"""Whatever happens on a link, current flows only while a fresh command of the host asks for it."""

from __future__ import annotations

from collections import Counter

import pytest
from soak import soak

from omnimj.link.check.fuzz import fuzz


def check(outcomes) -> None:
    assert max(one.unasked for one in outcomes) <= 0.0
    happened = Counter(name for one in outcomes for name in one.events)
    assert all(one.steps > 20 for one in outcomes), "the robot is driven"
    assert sum(bool(one.reason) for one in outcomes) > 0.3 * len(outcomes), "what happens matters"
    assert len(happened) >= 6


@pytest.mark.slow
def test_random_schedules_never_let_current_flow_that_no_fresh_command_asks_for():
    check(soak(range(20)))


@pytest.mark.slow
def test_a_device_that_does_not_look_at_the_age_of_commands_is_found_out(monkeypatch):
    monkeypatch.setattr("omnimj.link.device.limits.check_command_age", lambda age, valid_for: None)
    assert max(one.unasked for one in soak(range(4))) > 0.01


@pytest.mark.slow
def test_a_thousand_random_schedules():
    check(soak(range(1000, 2000)))


@pytest.mark.slow
def test_ten_million_frames_over_bad_wires():
    report = fuzz(10_000_000, 10_000_000, 77)
    assert report.passed and report.frames == 10_000_000 and report.whole > 1_000_000
