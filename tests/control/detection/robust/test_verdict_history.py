"""What was taken back leaves the verdict: neither deciding nor memory grows with time."""

from __future__ import annotations

from omnimj.control.detection.robust.verdict import (
    HISTORY_LENGTH,
    LOOKBACK,
    Verdict,
    all_diagnoses,
    archive_cleared,
    with_diagnosis,
)
from omnimj.signals import Diagnosis

WEAK = Diagnosis(0.5, "motor", (2,), 0.99)


def hours_of_slips(count):
    """A slip each second, soon taken back, beside a weak motor: verdict, past and the longest verdict."""
    verdict, before, longest = Verdict((WEAK,)), (), 0
    for k in range(1, count + 1):
        slip = Diagnosis(float(k), "slip", (1 + k % 4,), 0.9, cleared=k + 0.5)
        verdict = Verdict((*verdict.diagnoses, slip))
        verdict, before = archive_cleared(verdict, before, k + 0.9)
        longest = max(longest, len(verdict.diagnoses))
    return verdict, before, longest


def test_verdicts_are_listed_in_the_order_in_which_they_were_decided():
    verdict, before, _ = hours_of_slips(100)
    diagnoses = all_diagnoses(verdict, before)
    assert diagnoses[0] is WEAK and [d.time for d in diagnoses[1:]] == [float(k) for k in range(1, 101)]


def test_the_history_for_decisions_keeps_recent_verdicts_only():
    verdict, _, longest = hours_of_slips(500)
    assert longest <= LOOKBACK + 2
    assert WEAK in verdict.diagnoses
    assert all(d.cleared is None or 500.9 - d.cleared <= LOOKBACK for d in verdict.diagnoses)


def test_of_very_many_verdicts_the_oldest_are_dropped_and_standing_ones_never():
    verdict, before, _ = hours_of_slips(HISTORY_LENGTH + 200)
    assert len(before) == HISTORY_LENGTH
    diagnoses = all_diagnoses(verdict, before)
    assert diagnoses[0] is WEAK and diagnoses[1].time > 100.0 and diagnoses[-1].time == HISTORY_LENGTH + 200


def test_nothing_changes_while_nothing_is_old():
    verdict = Verdict((WEAK, Diagnosis(3.0, "slip", (1,), 0.9, cleared=4.0)))
    assert archive_cleared(verdict, (), 4.0 + LOOKBACK) == (verdict, ())
    assert all_diagnoses(verdict, ()) is verdict.diagnoses


def test_two_sensors_of_one_wheel_stand_side_by_side():
    """Or else each would take back the other, block after block."""
    verdict = Verdict()
    for channel in ("wheel_speed_1", "current_1"):
        verdict = with_diagnosis(verdict, Diagnosis(1.0, "sensor", (1,), 0.9, channel=channel))
    assert verdict.has_sensor_fault("wheel_speed_1") and verdict.has_sensor_fault("current_1")
    assert len(verdict.diagnoses) == 2
