"""What a case counts as, and what it counts for."""

from __future__ import annotations

import dataclasses
from math import inf

import pytest

from omnimj.plant.faults import Fault
from omnimj.studies.evaluation.cases import Case, CasePopulation, draw_cases
from omnimj.studies.evaluation.scoring import HEADING_FLOOR, CaseScore, confusion, diagnosed_label, score_case
from omnimj.studies.evaluation.summary import summarize

EMPTY = draw_cases(CasePopulation("missions", 100, faults=("none",)), [0])[0]
MOTOR = Fault("motor", 10.0, wheel=3, numbers={"loss": 0.6})
SLIP = Fault("slip", 10.0, 14.0, 2, {"grip": 0.1})


def case(kind: str, *faults: Fault) -> Case:
    return dataclasses.replace(EMPTY, fault=kind, faults=faults)


def diagnosis(time: float, kind: str, *wheels: int, cleared: float | None = None, **more) -> dict:
    return {"time": time, "kind": kind, "wheels": list(wheels), "cleared": cleared, **more}


def scored(one: Case, *diagnoses: dict, first: float | None = 10.4, off: dict | None = None) -> CaseScore:
    method = {"diagnoses": list(diagnoses), "heading": 0.02, "path": 0.1}
    use = [{"first": first, "after_long_use": None, "effectiveness": 0.5} for _ in one.faults]
    return score_case(one, {"method": method, "off": off, "use": use})


@pytest.mark.parametrize(
    ("diagnoses", "label"),
    [
        ([], "none"),
        ([diagnosis(10.5, "motor", 3)], "motor 3"),
        ([diagnosis(10.5, "motor", 1)], "motor 1"),
        ([diagnosis(10.5, "slip", 3, ambiguous_with=["motor 3"])], "ambiguous"),
        ([diagnosis(10.5, "slip", 3, ambiguous_with=["motor 3"]), diagnosis(11.0, "motor", 3)], "motor 3"),
        ([diagnosis(10.5, "slip", 3, cleared=10.8), diagnosis(11.0, "motor", 3)], "motor 3"),
        ([diagnosis(10.5, "slip", 3, cleared=12.0), diagnosis(11.0, "motor", 3)], "several"),
        ([diagnosis(10.5, "sensor", channel="yaw_rate")], "sensor yaw_rate"),
        ([diagnosis(5.0, "motor", 1, cleared=6.0)], "none"),
    ],
)
def test_a_case_is_taken_for_what_lasted_since_the_onset(diagnoses, label):
    assert diagnosed_label(case("motor", MOTOR), diagnoses) == label


def test_without_a_fault_every_alarm_counts_however_short():
    fleeting = diagnosis(5.0, "slip", 1, cleared=5.1)
    assert diagnosed_label(EMPTY, []) == "none"
    assert diagnosed_label(EMPTY, [fleeting]) == "slip 1"
    score = scored(EMPTY, fleeting)
    assert (score.false_alarms, score.isolated, score.delay) == (1, None, inf)
    assert score.healthy_hours == score.hours


def test_an_alarm_of_slip_without_a_fault_counts_apart_where_the_wheel_did_slip():
    alarms = [diagnosis(5.0, "slip", 1), diagnosis(6.0, "motor", 2), diagnosis(7.0, "slip", 3)]
    method = {"diagnoses": alarms, "heading": None, "path": None, "slips": [0.05, None, 0.049]}
    score = score_case(EMPTY, {"method": method, "off": None, "use": []})
    assert (score.false_alarms, score.slipping_alarms) == (3, 1)


def test_delays_count_from_onset_and_from_first_use():
    score = scored(
        case("motor", MOTOR), diagnosis(10.5, "slip", 3, cleared=10.9), diagnosis(10.7, "motor", 3)
    )
    assert score.delay == pytest.approx(0.5) and score.delay_in_use == pytest.approx(0.1)
    (fault,) = score.faults
    assert fault.named_delay == pytest.approx(0.7) and fault.named_delay_in_use == pytest.approx(0.3)
    assert score.isolated and score.severity == 0.6
    early = scored(case("motor", MOTOR), diagnosis(10.2, "motor", 3))
    assert early.delay_in_use == 0.0
    assert scored(case("motor", MOTOR), diagnosis(10.2, "motor", 3), first=None).delay_in_use is None
    never = scored(case("motor", MOTOR))
    assert never.delay == never.delay_in_use == inf and never.isolated is False


def test_an_alarm_before_the_onset_is_an_early_one():
    score = scored(case("motor", MOTOR), diagnosis(5.0, "slip", 1, cleared=6.0), diagnosis(10.5, "motor", 3))
    assert (score.false_alarms, score.early_alarms) == (1, 1)
    assert score.healthy_hours == pytest.approx(10.0 / 3600.0)
    assert score.isolated  # what was said before has been taken back


def test_the_estimate_is_judged_against_what_is_left_of_the_nominal_torque_constant():
    one = case("motor", MOTOR)
    (fault,) = scored(one).faults
    assert fault.estimate_error == pytest.approx(0.5 - 0.4 * one.errors.torque_constants[2])


def test_a_diagnosis_clears_some_time_after_the_slip_has_ended_or_never():
    one = case("slip", SLIP)
    assert scored(one, diagnosis(10.5, "slip", 2, cleared=14.2)).clearing == pytest.approx(0.2)
    assert scored(one, diagnosis(10.5, "slip", 2, cleared=12.0)).clearing == 0.0
    assert scored(one, diagnosis(10.5, "slip", 2)).clearing == inf
    assert scored(one).clearing is None
    assert scored(case("motor", MOTOR), diagnosis(10.5, "motor", 3)).clearing is None


def test_ratios_are_of_excursions_that_are_large_enough_to_measure():
    one = case("motor", MOTOR)
    score = scored(one, off={"heading": 0.04, "path": 0.05})
    assert score.heading_ratio == pytest.approx(0.5) and score.path_ratio == pytest.approx(2.0)
    tiny = scored(one, off={"heading": 1e-6, "path": 1e-6})
    assert tiny.heading_ratio == pytest.approx(0.02 / HEADING_FLOOR)
    assert scored(one).heading_ratio is None


def test_a_heading_is_given_up_by_design_only_for_faults_that_were_isolated():
    one = case("motor", MOTOR)
    method = {"heading": 1.0, "path": 0.1, "gave_up_heading": True}
    use = [{"first": 10.4, "after_long_use": None, "effectiveness": None, "slip": None}]
    for wheel, by_design in ((3, True), (1, False)):
        said = {"diagnoses": [diagnosis(10.5, "motor", wheel)]}
        result = {"method": method | said, "off": None, "use": use}
        assert score_case(one, result).gave_up_heading is by_design


def test_two_faults_are_right_only_together():
    both = case("two", MOTOR, dataclasses.replace(SLIP, end=None))
    one, two = diagnosis(10.5, "motor", 3), diagnosis(10.6, "slip", 2)
    assert scored(both, one, two).diagnosed == "two"
    assert scored(both, one).diagnosed == "motor 3" and not scored(both, one).isolated
    assert confusion([scored(both, one, two), scored(both, one)]) == {"two": {"motor 3": 1, "two": 1}}


def test_groups_take_cases_by_size_and_leave_out_what_was_never_in_use():
    weak = dataclasses.replace(MOTOR, numbers={"loss": 0.3})
    right = diagnosis(10.5, "motor", 3)
    scores = [
        scored(case("motor", MOTOR), right),
        scored(case("motor", weak)),
        scored(case("motor", MOTOR), first=None),
        scored(case("slip", SLIP), diagnosis(10.6, "slip", 2, cleared=14.1)),
        scored(EMPTY),
    ]
    goals = {group.name: group for group in summarize(scores).goals}
    strong = goals["motor, loss ≥ 57 %"]
    assert (strong.cases, strong.unused, strong.isolated.hits, strong.isolated.count) == (2, 1, 1, 1)
    assert goals["the eight: loss ≥ 57 %, grip ≤ 0.3"].isolated.count == 2
    assert goals["the eight: loss ≥ 20 %, grip ≤ 0.5"].isolated.value == pytest.approx(2 / 3)
    assert goals["motor, loss ≥ 95 %"].cases == 0
