"""Comparison of the measured figures of a method with its goals: measure, goal, measured, n, met.

A goal is met or missed by the measured figure; a remark states whether its confidence interval agrees. A goal
for a time without a statistic applies to both the median and the 95 % quantile.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from math import degrees, inf

from omnimj.studies.evaluation.scoring import HEADING_FLOOR, PATH_FLOOR
from omnimj.studies.evaluation.summary import MAX_ADDED, MAX_RATIO, Delays, GroupSummary, Ratios, Summary
from omnimj.studies.statistics import EventRate, Rate

QUIET_HOURS = {"planar": 30.0, "twin": 3.0}
"""Fault-free time without any false alarm that the goal requires, per plant [h]."""
MAX_FALSE_ALARMS_PER_HOUR = 0.1


@dataclass(frozen=True)
class GoalResult:
    """Measured figure with its goal, if it has one."""

    measure: str
    unit: str
    goal: str
    """The goal in words; empty without one."""
    value: float | None
    """Measured figure; None without a case. Rates are shares, 0 … 1."""
    low: float | None
    """Lower 95 % bound, if there is one."""
    high: float | None
    count: float
    """Sample size: number of cases or faults, or hours."""
    counted: str
    """Unit of the sample size."""
    met: bool | None
    """True if the goal is met; None without a goal or a figure."""
    sure: bool
    """True if the confidence bounds lie on the same side of the goal as the figure."""
    remark: str = ""


def judge_goals(summary: Summary) -> tuple[GoalResult, ...]:
    """Return every measure of an evaluation, also those without a case."""
    group = {one.name: one for one in summary.goals}
    weak, dead, slips, large, small, two = (group[name] for name in group)
    return (
        *_alarms(summary),
        *_time("motor −57 % and more, delay in use", weak.delay_in_use, 0.12, 0.3),
        *_time("motor −95 % and more, delay in use", dead.delay_in_use, 0.10, 0.10),
        *_time("slip, grip ≤ 0.3, delay in use", slips.delay_in_use, 0.15, 0.15),
        _share("isolated of the eight: loss ≥ 57 %, grip ≤ 0.3", large, 0.99),
        _share("isolated of the eight: loss ≥ 20 %, grip ≤ 0.5", small, 0.95),
        *_slips(summary),
        *_torque_constant(summary),
        *_ratios("heading excursion, with over without", summary.heading, 0.5, MAX_RATIO),
        *_heading_limits(summary),
        *_ratios("path excursion, with over without", summary.path, None, None),
        _share("two at once, exact set", two, 0.95),
        *(_share(f"… {one.kinds}", one.group, 0.95) for one in summary.pairs),
        *_time("a slip's end to the end of its diagnosis", summary.clearing, 0.3, 0.3),
        _switches(summary),
    )


def _alarms(summary: Summary) -> Iterator[GoalResult]:
    """Yield the false-alarm rates per plant, since the required hours differ."""
    if not summary.quiet:
        goal = f"≤ {MAX_FALSE_ALARMS_PER_HOUR:g}/h"
        yield _events("false alarms, fault-free", goal, summary.alarms, None, True)
    for plant, found in summary.quiet.items():
        hours = QUIET_HOURS.get(plant, inf)
        goal = f"≤ {MAX_FALSE_ALARMS_PER_HOUR:g}/h: none in {hours:g} h"
        bounded = found.upper is not None and found.upper <= MAX_FALSE_ALARMS_PER_HOUR
        met = bounded or found.events == 0  # 0 in 30 h bounds it by 0.1/h
        sure = bounded or not met or found.hours >= hours - 1e-6
        yield _events(f"false alarms, fault-free, {plant}", goal, found, met, sure)
    slipped = summary.slipping_alarms
    yield _events("… of which slips of wheels that slip at 5 cm/s or more", "", slipped, None, True)
    before = summary.alarms_before
    yield _events("… with the time before onsets", "", before, None, True)
    cases = summary.cases_with_alarms
    yield _rate("fault-free cases with a false alarm", cases)


def _events(measure: str, goal: str, found: EventRate, met: bool | None, sure: bool) -> GoalResult:
    low = None if found.per_hour is None else 0.0
    remark = f"{found.events} in all"
    value, high = found.per_hour, found.upper
    return GoalResult(measure, "/h", goal, value, low, high, found.hours, "h", met, sure, remark)


def _rate(measure: str, found: Rate, goal: str = "", least: float | None = None) -> GoalResult:
    known = found.value is not None
    met = None if least is None or found.value is None else found.value >= least
    bound = found.low if met else found.high
    sure = least is None or (bound >= least) == met
    low, high = (found.low, found.high) if known else (None, None)
    return GoalResult(measure, "", goal, found.value, low, high, found.count, "cases", met, sure)


def _share(measure: str, group: GroupSummary, least: float) -> GoalResult:
    return _rate(measure, group.isolated, f"≥ {100 * least:.0f} %", least)


def _time(measure: str, found: Delays, median: float, p95: float) -> Iterator[GoalResult]:
    for name, value, most in (("median", found.median, median), ("95 %", found.p95, p95)):
        yield _at_most(f"{measure}, {name}", value, most, found.count, unit=" s")


def _at_most(
    measure: str,
    value: float | None,
    most: float | None,
    count: int,
    counted: str = "cases",
    unit: str = "",
    remark: str = "",
) -> GoalResult:
    met = None if value is None or most is None else value <= most
    goal = "" if most is None else f"≤ {most:.3g}{unit}"
    return GoalResult(measure, unit, goal, value, None, None, count, counted, met, True, remark)


def _torque_constant(summary: Summary) -> Iterator[GoalResult]:
    found, words = summary.estimate, "torque constant after 5 s in use, |error|"
    remark = f"of {summary.estimates_asked} weak motors"
    for name, value in (("median", found.median), ("95 %", found.p95)):
        yield _at_most(f"{words}, {name}", value, 0.03, found.count, "motors", remark=remark)


def _ratios(measure: str, found: Ratios, median: float | None, worst: float | None) -> Iterator[GoalResult]:
    yield _at_most(f"{measure}, median", found.median, median, found.count)
    yield _at_most(f"{measure}, 95 %", found.p95, None, found.count)
    case = f"in {found.worst_case}" if found.worst_case else ""
    yield _at_most(f"{measure}, worst", found.worst, worst, found.count, remark=case)


def _slips(summary: Summary) -> Iterator[GoalResult]:
    """Yield isolation of slips by the slip reached without any method, and what the others change.

    The others are harmless if they change less than what counts as an excursion at all.
    """
    found = summary.slips
    yield _rate("slips that reach 5 cm/s without the method", found.slipping)
    yield _rate("… isolated of these", found.isolated, "≥ 95 %", 0.95)
    yield _rate("… isolated of these, grip ≤ 0.3", found.isolated_low_grip, "≥ 99 %", 0.99)
    yield _rate("other slips, isolated", found.isolated_others)
    for name, change, unit, scale, most in (
        ("heading", found.heading, "°", degrees(1.0), degrees(HEADING_FLOOR)),
        ("path", found.path, " m", 1.0, PATH_FLOOR),
    ):
        worst = None if change.worst is None else scale * change.worst
        where = f"in {change.worst_case}" if change.worst_case else ""
        words = f"other slips, {name} off the healthy run, worst"
        yield _at_most(words, worst, most, change.count, unit=unit, remark=where)


def _heading_limits(summary: Summary) -> Iterator[GoalResult]:
    """Yield the limit of the heading in every case: on the ratio, or on what is added to little."""
    found = summary.heading_limits
    where = f"in {found.worst_ratio_case}" if found.worst_ratio_case else ""
    words = "heading with over without, 0.5° or more without, worst"
    yield _at_most(words, found.worst_ratio, MAX_RATIO, found.large, remark=where)
    where = f"in {found.worst_added_case}" if found.worst_added_case else ""
    added = None if found.worst_added is None else degrees(found.worst_added)
    words, most = "heading added, less than 0.5° without, worst", degrees(MAX_ADDED)
    yield _at_most(words, added, most, found.small, unit="°", remark=where)
    count = found.large + found.small
    beyond = float(len(found.beyond)) if count else None
    yield _at_most("cases beyond either limit of the heading", beyond, 0.0, count)
    given_up = float(found.given_up) if count + found.given_up else None
    words = "cases with the heading given up by design, left out of the limits"
    yield _at_most(words, given_up, None, count + found.given_up)


def _switches(summary: Summary) -> GoalResult:
    found = summary.switches
    mean = "" if found.mean is None else f"mean {found.mean:.2f}"
    return _at_most("diagnoses per slip, worst", found.worst, 1.0, found.count, "slips", remark=mean)


def format_goal(one: GoalResult) -> tuple[str, str, str, str, str]:
    """Format a row of the table of goals: measure, goal, measured, n, met."""
    return one.measure, one.goal, _measured(one), _count(one), _met(one)


def _measured(one: GoalResult) -> str:
    if one.value is None:
        return "–"
    share = one.counted == "cases" and one.low is not None
    if one.value == inf:
        value = "never"
    elif share:
        value = f"{100 * one.value:.0f} %"
    else:
        value = f"{one.value:.3g}{one.unit}"
    bounds = ""
    if share and one.low is not None and one.high is not None:
        bounds = f" ({100 * one.low:.0f}–{100 * one.high:.0f})"
    elif one.high is not None:
        bounds = f" (≤ {one.high:.3g})"
    return f"{value}{bounds}{', ' if one.remark else ''}{one.remark}"


def _count(one: GoalResult) -> str:
    return f"{one.count:.3g} {one.counted}"


def _met(one: GoalResult) -> str:
    if one.met is None:
        return "–" if one.goal else ""
    return ("yes" if one.met else "no") + ("" if one.sure else ", too few to be sure")
