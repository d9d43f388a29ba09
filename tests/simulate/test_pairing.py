"""Truth beside diagnosis agrees with the judge, diagnosis by diagnosis."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from omnimj.simulate.judging import judge_diagnoses, match_diagnoses


def fault(kind, wheel, onset: float | None = 1.0, end=None, **own):
    return {"kind": kind, "wheel": wheel, "onset": onset, "end": end, **own}


def diagnosis(time, kind, *wheels, cleared=None, **own):
    return {"time": time, "kind": kind, "wheels": list(wheels), "cleared": cleared, **own}


def test_a_fault_has_its_diagnosis_beside_it_with_its_delay():
    (one,) = match_diagnoses([fault("motor", 3)], [diagnosis(1.25, "motor", 3)]).pairs
    assert [naming.delay for naming in one.groups] == [0.25]
    assert one.is_diagnosable and one.groups[0].cleared is None


def test_a_wrong_name_is_a_false_alarm_beside_the_right_one():
    found = match_diagnoses(
        [fault("motor", 3)], [diagnosis(1.1, "slip", 3, cleared=1.2), diagnosis(1.3, "motor", 3)]
    )
    assert [naming.first["kind"] for naming in found.pairs[0].groups] == ["motor"]
    assert [naming.first["kind"] for naming in found.false_alarms] == ["slip"]
    assert found.false_alarms[0].delay is None


def test_an_intermittent_diagnosis_is_listed_once_with_all_its_times():
    slips = [diagnosis(1.1, "slip", 2, cleared=1.2), diagnosis(1.5, "slip", 2, cleared=1.9)]
    (one,) = match_diagnoses([fault("slip", 2)], slips).pairs
    (naming,) = one.groups
    assert (naming.first["time"], naming.cleared, len(naming.diagnoses)) == (1.1, 1.9, 2)
    standing = match_diagnoses([fault("slip", 2)], [*slips, diagnosis(2.5, "slip", 2)]).pairs[0].groups[0]
    assert standing.cleared is None


def test_several_wheels_in_one_diagnosis_stand_beside_each_of_their_faults():
    found = match_diagnoses([fault("slip", 1), fault("slip", 3)], [diagnosis(1.4, "slip", 1, 3)])
    assert [len(one.groups) for one in found.pairs] == [1, 1] and not found.false_alarms
    each = [fault("slip", wheel) for wheel in (1, 2, 3, 4)]
    found = match_diagnoses(each, [diagnosis(1.4, "all_wheel_slip")])
    assert [len(one.groups) for one in found.pairs] == [1] * 4 and not found.false_alarms


def test_a_payload_cannot_be_named_and_a_fault_that_never_happened_was_not_missed():
    found = match_diagnoses(
        [fault("payload", None), fault("slip", 1, onset=None)], [diagnosis(2.0, "slip", 1)]
    )
    assert [one.is_diagnosable for one in found.pairs] == [False, False]
    assert len(found.false_alarms) == 1


def test_sensors_are_distinguished_by_their_channel():
    truth = [fault("sensor", None, channel="yaw_rate")]
    found = match_diagnoses(
        truth, [diagnosis(1.2, "sensor", channel="yaw_rate"), diagnosis(1.3, "sensor", channel="yaw")]
    )
    assert len(found.pairs[0].groups) == len(found.false_alarms) == 1


kinds = st.sampled_from(("slip", "motor", "free", "locked", "all_wheel_slip"))
wheel = st.integers(1, 4)


@st.composite
def faults(draw):
    kind, onset = draw(kinds), draw(st.floats(0.0, 5.0))
    end = draw(st.none() | st.floats(onset, 8.0))
    return fault(kind, None if kind == "all_wheel_slip" else draw(wheel), onset, end)


@st.composite
def diagnoses(draw):
    kind, time = draw(kinds), draw(st.floats(0.0, 8.0))
    wheels = () if kind == "all_wheel_slip" else draw(st.sets(wheel, min_size=1, max_size=3))
    also = draw(st.sampled_from(((), ("motor 3",), ("slip 1", "locked 2"))))
    return diagnosis(time, kind, *sorted(wheels), ambiguous_with=list(also))


@given(st.lists(faults(), max_size=4), st.lists(diagnoses(), max_size=6))
def test_false_alarms_are_as_many_as_the_judge_counts_and_nothing_is_lost(true, reported):
    found = match_diagnoses(true, reported)
    false = sum(len(naming.diagnoses) for naming in found.false_alarms)
    assert false == judge_diagnoses(true, reported).false_alarms
    beside = [d for one in found.pairs for naming in one.groups for d in naming.diagnoses]
    wrong = [d for naming in found.false_alarms for d in naming.diagnoses]
    assert all(any(d is other for other in (*beside, *wrong)) for d in reported)


@given(st.lists(faults(), min_size=1, max_size=3), st.lists(diagnoses(), max_size=5))
def test_the_judges_isolation_needs_a_diagnosis_beside_every_fault(true, reported):
    if judge_diagnoses(true, reported).isolated:
        assert all(one.groups for one in match_diagnoses(true, reported).pairs)


def test_a_diagnosis_that_still_stands_names_the_same_fault_when_it_comes_back():
    found = match_diagnoses([fault("slip", 2, 1.0, 3.0), fault("slip", 2, 8.0)], [diagnosis(1.2, "slip", 2)])
    assert all(one.groups for one in found.pairs) and not found.false_alarms


@pytest.mark.parametrize("time", [0.9, 3.6])
def test_before_the_onset_and_long_after_the_end_it_is_a_false_alarm(time):
    found = match_diagnoses([fault("slip", 2, 1.0, 3.0)], [diagnosis(time, "slip", 2)])
    assert not found.pairs[0].groups and len(found.false_alarms) == 1
