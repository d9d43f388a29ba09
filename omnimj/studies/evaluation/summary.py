"""Summary of an evaluation from the scores of its cases, each number with its sample size.

Recovery must keep the heading in every case: the limit is on the ratio with over without recovery, or on what
is added where the heading hardly moves without it. Cases are counted apart whose heading is given up by
design, since too few wheels are left to hold it, provided that the faults were isolated.

Slips are told apart by what they do without any method. A wheel with less grip slips only where more traction
is needed than it has left; a slip that never shows cannot be found, and need not be if path and heading stay
those of the healthy run.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass

from omnimj.studies.evaluation.scoring import SLIPPING, CaseScore, confusion
from omnimj.studies.random_truth import ALL_CLASSES, NONE, PAIRS, TWO
from omnimj.studies.statistics import EventRate, Rate, event_rate, median, quantile, rate

HEAVIER, LIGHTER = "heavier", "lighter"
LARGE = math.radians(0.5)
"""Heading excursion without recovery from which the ratio is limited [rad]."""
MAX_RATIO = 1.05
"""Largest ratio of the excursion with recovery to that without."""
MAX_ADDED = math.radians(0.05)
"""Largest excursion that recovery may add below `LARGE` [rad]."""
_LITTLE_GRIP = 0.3


@dataclass(frozen=True)
class Delays:
    """Quantiles of times; a case without an alarm counts as ∞."""

    count: int
    median: float | None
    """Median [s]; ∞: at least half of the cases have no alarm."""
    p95: float | None
    """95 % quantile [s]."""


@dataclass(frozen=True)
class GroupSummary:
    """Cases with faults of one kind and size."""

    name: str
    cases: int
    unused: int
    """Number of cases whose faulty part was never in use; excluded from all other numbers of the group."""
    found: Rate
    """Share with any alarm during a fault."""
    isolated: Rate
    """Share with exactly the true faults diagnosed."""
    delay: Delays
    """Time from onset to the first alarm."""
    delay_in_use: Delays
    """Time from first use to the first alarm."""
    named_in_use: Delays
    """Time from first use to the diagnosis of the fault; per fault, not per case."""


@dataclass(frozen=True)
class Ratios:
    """Ratios of an excursion with recovery to that without."""

    count: int
    median: float | None
    p95: float | None
    worst: float | None
    worst_case: str
    """Name of the worst case; empty without any."""


@dataclass(frozen=True)
class PairSummary:
    """Cases with two faults at once, grouped by their kinds."""

    kinds: str
    """`motor + slip`, `motor + slip of one wheel`."""
    pairs: int
    """Number of possible pairs of these kinds among the eight faults."""
    driven: int
    """Number of these pairs that occur in the cases, in use or not."""
    missed: tuple[str, ...]
    """Pairs that were in use and not isolated in every case."""
    group: GroupSummary


@dataclass(frozen=True)
class Switches:
    """Number of diagnoses per slip."""

    count: int
    """Number of slips that were diagnosed at all."""
    mean: float | None
    worst: int | None


@dataclass(frozen=True)
class FactorSummary:
    """Cases with the same value of one factor."""

    factor: str
    """`floor`, `payload`, `plant`, `speed`."""
    value: str
    cases: int
    alarms: EventRate
    """False alarms in fault-free cases."""
    isolated: Rate
    """Share of isolated faults among cases whose faulty part was in use."""
    delay_in_use: Delays
    heading: Ratios


@dataclass(frozen=True)
class Summary:
    """All numbers that an evaluation reports."""

    cases: int
    hours: float
    """Simulated time, without the comparison runs of each case [h]."""
    confusion: Mapping[str, Mapping[str, int]]
    """Truth → diagnosed → cases."""
    alarms: EventRate
    """False alarms in fault-free cases."""
    quiet: Mapping[str, EventRate]
    """False alarms in fault-free cases by plant."""
    slipping_alarms: EventRate
    """Those of them that diagnose the slip of a wheel that did slip: the floor had less grip than needed."""
    alarms_before: EventRate
    """False alarms in fault-free cases and before the first onset of the others."""
    cases_with_alarms: Rate
    """Fault-free cases with at least one false alarm."""
    classes: tuple[GroupSummary, ...]
    goals: tuple[GroupSummary, ...]
    """Groups with a goal."""
    pairs: tuple[PairSummary, ...]
    """Cases with two faults by their kinds; empty without any."""
    estimate: Delays
    """Absolute error of torque constants after 5 s of use, relative to the nominal one [1]."""
    estimates_asked: int
    """Number of weak motors for which an estimate is expected."""
    clearing: Delays
    """Time from the end of a slip to the end of its diagnosis."""
    switches: Switches
    slips: SlipSummary
    heading: Ratios
    path: Ratios
    heading_limits: HeadingLimits
    factors: tuple[FactorSummary, ...]


GOAL_GROUPS: Mapping[str, Callable[[CaseScore], bool]] = {
    "motor, loss ≥ 57 %": lambda s: s.fault == "motor" and (s.severity or 0.0) >= 0.57,
    "motor, loss ≥ 95 %": lambda s: s.fault == "motor" and (s.severity or 0.0) >= 0.95,
    "slip, grip ≤ 0.3": lambda s: s.fault == "slip" and _grip(s) <= 0.3,
    "the eight: loss ≥ 57 %, grip ≤ 0.3": lambda s: _is_one_of_eight(s, 0.57, 0.3),
    "the eight: loss ≥ 20 %, grip ≤ 0.5": lambda s: _is_one_of_eight(s, 0.20, 0.5),
    "two at once": lambda s: s.fault == "two",
}
"""Predicates of the groups with a goal: single motor and slip faults by size, and pairs of them."""


def _grip(score: CaseScore) -> float:
    return 1.0 if score.severity is None else score.severity


def _is_one_of_eight(score: CaseScore, loss: float, grip: float) -> bool:
    if score.fault == "slip":
        return _grip(score) <= grip
    return score.fault == "motor" and (score.severity or 0.0) >= loss


def summarize(scores: Sequence[CaseScore]) -> Summary:
    """Summarize the scores of all cases."""
    healthy = [s for s in scores if s.fault == NONE]
    broken = [s for s in scores if s.fault != NONE]
    estimated = [s for s in broken if s.fault == "motor" and s.severity is not None]
    errors = [abs(f.estimate_error) for s in estimated for f in s.faults if f.estimate_error is not None]
    kinds = [name for name in ALL_CLASSES if name != NONE and any(s.fault == name for s in broken)]
    return Summary(
        cases=len(scores),
        hours=sum(s.hours for s in scores),
        confusion=confusion(scores),
        alarms=_alarms(healthy),
        quiet={
            plant: _alarms([s for s in healthy if s.plant == plant])
            for plant in sorted({s.plant for s in healthy})
        },
        slipping_alarms=event_rate(sum(s.slipping_alarms for s in healthy), sum(s.hours for s in healthy)),
        alarms_before=event_rate(
            sum(s.false_alarms if s.fault == NONE else s.early_alarms for s in scores),
            sum(s.healthy_hours for s in scores),
        ),
        cases_with_alarms=rate(s.false_alarms > 0 for s in healthy),
        classes=tuple(_group(name, [s for s in broken if s.fault == name]) for name in kinds),
        goals=tuple(_group(name, [s for s in broken if holds(s)]) for name, holds in GOAL_GROUPS.items()),
        pairs=tuple(_pairs([s for s in broken if s.fault == TWO])),
        estimate=delay_quantiles(errors),
        estimates_asked=len(estimated),
        clearing=delay_quantiles(s.clearing for s in broken if s.clearing is not None),
        switches=_switches([s.switches for s in broken if s.switches is not None]),
        slips=summarize_slips(broken),
        heading=_ratios(broken, lambda s: s.heading_ratio),
        path=_ratios(broken, lambda s: s.path_ratio),
        heading_limits=summarize_heading(broken),
        factors=tuple(_factors(scores)),
    )


def _group(name: str, scores: Sequence[CaseScore]) -> GroupSummary:
    used = [s for s in scores if s.was_in_use]
    return GroupSummary(
        name,
        len(scores),
        len(scores) - len(used),
        rate(s.delay < float("inf") for s in used),
        rate(bool(s.isolated) for s in used),
        delay_quantiles(s.delay for s in used),
        delay_quantiles(s.delay_in_use for s in used if s.delay_in_use is not None),
        delay_quantiles(
            f.named_delay_in_use for s in used for f in s.faults if f.named_delay_in_use is not None
        ),
    )


def _alarms(healthy: Sequence[CaseScore]) -> EventRate:
    return event_rate(sum(s.false_alarms for s in healthy), sum(s.hours for s in healthy))


def _pairs(scores: Sequence[CaseScore]) -> Iterable[PairSummary]:
    """Group the cases with two faults by the kinds of both."""
    possible = Counter(_kinds([f"{kind} {wheel}" for kind, wheel in pair]) for pair in PAIRS)
    for kinds, count in sorted(possible.items()) if scores else ():
        own = [s for s in scores if _kinds([f.label for f in s.faults]) == kinds]
        wrong = {_pair(s) for s in own if s.was_in_use and not s.isolated}
        driven = len({_pair(s) for s in own})
        yield PairSummary(kinds, count, driven, tuple(sorted(wrong)), _group(kinds, own))


def _pair(score: CaseScore) -> str:
    return " + ".join(sorted(fault.label for fault in score.faults))


def _kinds(labels: Sequence[str]) -> str:
    kinds = " + ".join(sorted(label.partition(" ")[0] for label in labels))
    same = len({label.partition(" ")[2] for label in labels}) == 1
    return f"{kinds} of one wheel" if same else kinds


def _switches(found: Sequence[int]) -> Switches:
    mean = sum(found) / len(found) if found else None
    return Switches(len(found), mean, max(found, default=None))


def delay_quantiles(values: Iterable[float]) -> Delays:
    """Return median and 95 % quantile of times that may be ∞."""
    found = list(values)
    return Delays(len(found), median(found), quantile(found, 0.95))


def _ratios(scores: Sequence[CaseScore], of: Callable[[CaseScore], float | None]) -> Ratios:
    found = [(value, s.name) for s in scores if (value := of(s)) is not None]
    values = [value for value, _ in found]
    worst, name = max(found, default=(None, ""))
    return Ratios(len(found), median(values), quantile(values, 0.95), worst, name)


def _factors(scores: Sequence[CaseScore]) -> Iterable[FactorSummary]:
    ways: Mapping[str, Callable[[CaseScore], str]] = {
        "floor": lambda s: s.floor,
        "payload": lambda s: HEAVIER if s.payload > 0.0 else LIGHTER,
        "plant": lambda s: s.plant,
        "speed": lambda s: s.speed,
    }
    for factor, of in ways.items():
        for value in sorted({of(s) for s in scores}):
            yield _factor(factor, value, [s for s in scores if of(s) == value])


def _factor(factor: str, value: str, scores: Sequence[CaseScore]) -> FactorSummary:
    healthy = [s for s in scores if s.fault == NONE]
    used = [s for s in scores if s.was_in_use]
    return FactorSummary(
        factor,
        value,
        len(scores),
        _alarms(healthy),
        rate(bool(s.isolated) for s in used),
        delay_quantiles(s.delay_in_use for s in used if s.delay_in_use is not None),
        _ratios(scores, lambda s: s.heading_ratio),
    )


@dataclass(frozen=True)
class HeadingLimits:
    """Cases with faults whose heading the recovery should hold."""

    large: int
    """Number of cases with an excursion of `LARGE` or more without recovery."""
    worst_ratio: float | None
    """Largest ratio among them."""
    worst_ratio_case: str
    """Name of that case; empty without any."""
    small: int
    """Number of the other cases."""
    worst_added: float | None
    """Largest added excursion among them; negative if recovery reduces all [rad]."""
    worst_added_case: str
    beyond: tuple[str, ...]
    """Names of the cases beyond either limit."""
    given_up: int
    """Number of cases whose heading is given up by design, excluded from all other numbers."""


def summarize_heading(scores: Sequence[CaseScore]) -> HeadingLimits:
    """Compare the heading of every case with both excursions, with and without recovery, with its limit."""
    ratios, added, given_up = [], [], 0
    for s in scores:
        if s.heading is None or s.heading_off is None:
            continue
        if s.gave_up_heading:
            given_up += 1
        elif s.heading_off >= LARGE:
            ratios.append((s.heading / s.heading_off, s.name))
        else:
            added.append((s.heading - s.heading_off, s.name))
    beyond = [name for value, name in ratios if value > MAX_RATIO]
    beyond += [name for value, name in added if value > MAX_ADDED]
    most, where = max(ratios, default=(None, ""))
    more, place = max(added, default=(None, ""))
    return HeadingLimits(len(ratios), most, where, len(added), more, place, tuple(sorted(beyond)), given_up)


@dataclass(frozen=True)
class Changes:
    """Deviation of runs with a fault, driven without any method, from the same runs without the fault."""

    count: int
    median: float | None
    worst: float | None
    worst_case: str
    """Name of the worst case; empty without any."""


@dataclass(frozen=True)
class SlipSummary:
    """Cases whose only fault is a slip of one wheel, by the slip reached without any method."""

    slipping: Rate
    """Share of these cases whose wheel reaches `SLIPPING` without any method."""
    isolated: Rate
    """Share of isolated slips among those that reach it."""
    isolated_low_grip: Rate
    """The same for grip ≤ 0.3."""
    isolated_others: Rate
    """Share of isolated slips among the others."""
    heading: Changes
    """Largest change of the heading by the others [rad]."""
    path: Changes
    """Largest change of the position by the others [m]."""


def summarize_slips(scores: Sequence[CaseScore]) -> SlipSummary:
    """Summarize the cases with a single slip."""
    slips = [(s, s.slip) for s in scores if s.slip is not None]
    shown = [s for s, reached in slips if reached >= SLIPPING]
    others = [s for s, reached in slips if reached < SLIPPING]
    low_grip = [s for s in shown if s.severity is not None and s.severity <= _LITTLE_GRIP]
    return SlipSummary(
        rate(reached >= SLIPPING for _, reached in slips),
        rate(bool(s.isolated) for s in shown),
        rate(bool(s.isolated) for s in low_grip),
        rate(bool(s.isolated) for s in others),
        _changes(others, lambda s: s.heading_change),
        _changes(others, lambda s: s.path_change),
    )


def _changes(scores: Sequence[CaseScore], of: Callable[[CaseScore], float | None]) -> Changes:
    found = [(value, s.name) for s in scores if (value := of(s)) is not None]
    worst, name = max(found, default=(None, ""))
    return Changes(len(found), median([value for value, _ in found]), worst, name)
