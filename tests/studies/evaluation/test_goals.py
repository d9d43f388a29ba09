"""What is asked beside what was measured."""

from __future__ import annotations

import dataclasses
import json
import math
from math import inf

import pytest

from omnimj.recording.json_files import to_jsonable
from omnimj.studies.evaluation.cases import CasePopulation, draw_cases
from omnimj.studies.evaluation.goals import GoalResult, format_goal, judge_goals
from omnimj.studies.evaluation.scoring import CaseScore, FaultScore, score_case
from omnimj.studies.evaluation.summary import summarize
from omnimj.studies.evaluation.tables import result_tables
from omnimj.studies.random_truth import PAIRS

HEALTHY: CaseScore = score_case(
    draw_cases(CasePopulation("missions", 100, faults=("none",)), [0])[0],
    {"method": {"diagnoses": [], "heading": None, "path": None}, "off": None, "use": []},
)


def found(*scores: CaseScore) -> dict[str, GoalResult]:
    return {one.measure: one for one in judge_goals(summarize(scores))}


def broken(fault: str, *labels: str, **changes) -> CaseScore:
    """A case that was diagnosed rightly 0.05 s after first use."""
    faults = tuple(FaultScore(label, 1.0, True, 0.05, 0.05, 0.0) for label in labels)
    usual = {"severity": 0.6 if fault == "motor" else 0.1, "isolated": True, "delay": 0.05}
    usual |= {"delay_in_use": 0.05, "heading": 0.01, "heading_off": 0.03, "path": 0.1, "path_off": 0.1}
    return dataclasses.replace(HEALTHY, fault=fault, faults=faults, **(usual | changes))


def quiet(hours: float, plant: str = "planar", alarms: int = 0) -> CaseScore:
    return dataclasses.replace(HEALTHY, hours=hours, plant=plant, false_alarms=alarms)


@pytest.mark.parametrize(
    ("score", "met", "sure"),
    [
        (quiet(1.0), True, False),
        (quiet(30.0), True, True),
        (quiet(3.0, "twin"), True, True),
        (quiet(2.9, "twin"), True, False),
        (quiet(30.0, alarms=1), False, True),
        (quiet(100.0, alarms=1), True, True),
        (quiet(1.0, alarms=2), False, True),
    ],
)
def test_no_false_alarm_may_come_in_thirty_hours_or_three_on_the_twin(score, met, sure):
    one = found(score)[f"false alarms, fault-free, {score.plant}"]
    assert (one.met, one.sure, one.count) == (met, sure, score.hours)
    rate = score.false_alarms / score.hours
    assert one.value == rate and one.high is not None and one.high > rate


@pytest.mark.parametrize(
    ("measure", "good", "bad"),
    [
        (
            "motor −57 % and more, delay in use, median",
            broken("motor", "motor 1", delay_in_use=0.12),
            broken("motor", "motor 1", delay_in_use=0.121),
        ),
        (
            "motor −57 % and more, delay in use, 95 %",
            broken("motor", "motor 1", delay_in_use=0.3),
            broken("motor", "motor 1", delay_in_use=inf),
        ),
        (
            "motor −95 % and more, delay in use, median",
            broken("motor", "motor 1", severity=1.0, delay_in_use=0.1),
            broken("motor", "motor 1", severity=1.0, delay_in_use=0.11),
        ),
        (
            "slip, grip ≤ 0.3, delay in use, median",
            broken("slip", "slip 1", delay_in_use=0.15),
            broken("slip", "slip 1", delay_in_use=0.16),
        ),
        (
            "isolated of the eight: loss ≥ 57 %, grip ≤ 0.3",
            broken("slip", "slip 1"),
            broken("slip", "slip 1", isolated=False),
        ),
        (
            "heading excursion, with over without, median",
            broken("slip", "slip 1", heading=0.015),
            broken("slip", "slip 1", heading=0.016),
        ),
        (
            "heading excursion, with over without, worst",
            broken("slip", "slip 1", heading=0.0314),
            broken("slip", "slip 1", heading=0.0316),
        ),
        (
            "two at once, exact set",
            broken("two", "motor 1", "slip 2"),
            broken("two", "motor 1", "slip 2", isolated=False),
        ),
        (
            "a slip's end to the end of its diagnosis, median",
            broken("slip", "slip 1", clearing=0.3),
            broken("slip", "slip 1", clearing=inf),
        ),
        (
            "diagnoses per slip, worst",
            broken("slip", "slip 1", switches=1),
            broken("slip", "slip 1", switches=2),
        ),
    ],
)
def test_a_goal_is_met_on_its_own_side_of_the_limit_and_open_without_cases(measure, good, bad):
    assert found(good)[measure].met is True
    assert found(bad)[measure].met is False
    assert found(good)["false alarms, fault-free"].met is None
    nothing = found(HEALTHY)[measure]
    assert (
        nothing.met is None
        and nothing.count == 0
        and format_goal(nothing)[2:] == ("–", f"0 {nothing.counted}", "–")
    )


def slip(reached: float, **changes) -> CaseScore:
    return broken("slip", "slip 1", slip=reached, **({"heading_change": 0.01, "path_change": 0.02} | changes))


def test_slips_are_judged_apart_by_the_slip_that_they_reach_without_the_method():
    missed = {"isolated": False, "diagnosed": "none"}
    scores = [slip(0.05), slip(0.4, severity=0.4, **missed), slip(0.049, **missed)]
    rows = found(*scores, slip(0.0, heading_change=0.001, path_change=0.03))
    share, isolated = rows["slips that reach 5 cm/s without the method"], rows["… isolated of these"]
    assert (share.value, share.count, share.met) == (0.5, 4, None)
    assert (isolated.value, isolated.count, isolated.met) == (0.5, 2, False)
    low_grip = rows["… isolated of these, grip ≤ 0.3"]
    assert (low_grip.value, low_grip.count, low_grip.met) == (1.0, 1, True)
    others = rows["other slips, isolated"]
    assert (others.value, others.count, others.met) == (0.5, 2, None)
    heading = rows["other slips, heading off the healthy run, worst"]
    path = rows["other slips, path off the healthy run, worst"]
    assert heading.value == pytest.approx(math.degrees(0.01)) and path.value == 0.03
    assert heading.met is False and path.met is False
    harmless = found(slip(0.0, heading_change=0.0014, path_change=0.0049))
    assert harmless["other slips, heading off the healthy run, worst"].met is True
    assert harmless["other slips, path off the healthy run, worst"].met is True


def headed(off: float, over: float, **changes) -> CaseScore:
    """A slip with given heading excursions without recovery and with it [°]."""
    heading = {"heading_off": math.radians(off), "heading": math.radians(over)}
    return broken("slip", "slip 1", **heading, **changes)


@pytest.mark.parametrize(
    ("off", "over", "met"),
    [(0.51, 0.53, True), (0.51, 0.54, False), (0.49, 0.535, True), (0.49, 0.545, False), (0.0, 0.049, True)],
)
def test_the_heading_has_a_limit_on_its_ratio_or_where_it_is_small_on_what_is_added(off, over, met):
    rows = found(headed(off, over), headed(2.0, 0.1))
    beyond = rows["cases beyond either limit of the heading"]
    assert (beyond.met, beyond.value, beyond.count) == (met, 0.0 if met else 1.0, 2)
    large = rows["heading with over without, 0.5° or more without, worst"]
    added = rows["heading added, less than 0.5° without, worst"]
    assert large.count + added.count == 2 and (large if off > 0.5 else added).met is met


def test_a_heading_given_up_by_design_is_counted_apart_from_its_limits():
    rows = found(headed(1.0, 90.0, gave_up_heading=True), headed(1.0, 0.5))
    assert rows["cases beyond either limit of the heading"].value == 0.0
    assert rows["cases beyond either limit of the heading"].count == 1
    apart = rows["cases with the heading given up by design, left out of the limits"]
    assert (apart.value, apart.count, apart.met) == (1.0, 2, None)


def test_a_torque_constant_is_judged_by_its_error_after_long_use():
    for error, met in ((0.03, True), (-0.031, False)):
        (fault,) = broken("motor", "motor 1").faults
        score = broken("motor", "motor 1")
        score = dataclasses.replace(score, faults=(dataclasses.replace(fault, estimate_error=error),))
        assert found(score)["torque constant after 5 s in use, |error|, 95 %"].met is met


def test_a_rate_of_few_cases_is_met_but_not_sure():
    few, many = (found(*([broken("slip", "slip 1")] * n)) for n in (5, 400))
    name = "isolated of the eight: loss ≥ 57 %, grip ≤ 0.3"
    assert (few[name].met, few[name].sure) == (True, False) and "too few" in format_goal(few[name])[-1]
    assert (many[name].met, many[name].sure) == (True, True) and format_goal(many[name])[-1] == "yes"


def test_pairs_are_listed_by_kinds_and_the_missed_ones_by_name():
    scores = [
        broken("two", *(f"{kind} {wheel}" for kind, wheel in pair), isolated=k != 20)
        for k, pair in enumerate(PAIRS)
    ]
    summary = summarize(scores)
    counts = {one.kinds: (one.pairs, one.driven, one.group.cases) for one in summary.pairs}
    both = {"motor + slip": (12, 12, 12), "motor + slip of one wheel": (4, 4, 4)}
    assert counts == {"motor + motor": (6, 6, 6), **both, "slip + slip": (6, 6, 6)}
    (missed,) = (name for one in summary.pairs for name in one.missed)
    assert missed == " + ".join(sorted(f"{kind} {wheel}" for kind, wheel in PAIRS[20]))
    (table,) = (t for t in result_tables(summary) if t.title.startswith("Two at once"))
    assert any(missed in row for row in table.rows)
    assert {row[1] for row in table.rows} == {"6 of 6", "12 of 12", "4 of 4"}


def test_goals_travel_to_json():
    rows = [
        to_jsonable(dataclasses.asdict(one))
        for one in judge_goals(summarize([broken("slip", "slip 1"), quiet(1.0)]))
    ]
    again = json.loads(json.dumps(rows, allow_nan=False))
    assert {row["measure"] for row in again if row["met"] is False} == set()
    assert sum(row["met"] is True for row in again) >= 5
