"""The benchmark's numbers from the scores of its cases, every rate with its Wilson 95 % bounds."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass

from omnimj.gap.benchmark_cases import SIZES
from omnimj.gap.benchmark_scoring import CaseScore, MethodScore
from omnimj.trials.rates import Rate, median, rate

HELD_OUT_GOAL = 1.15
"""Held-out gap over that of the true model that is good enough."""


@dataclass(frozen=True)
class MethodSummary:
    """One method over all cases."""

    method: str
    covered_where_named: Rate
    """Hidden effects in a reported set, of the cases in which something is named."""
    covered_visible: Rate
    """The same of all cases in which the effect shows in the data."""
    first_where_named: Rate
    first_visible: Rate
    mean_set: float | None
    wrong_names: float | None
    """Reported sets (of a baseline: names) without a hidden effect, per case with hidden effects."""
    false_on_null: Rate
    false_outside: Rate
    good_heldout: Rate
    """Held-out gap at most `HELD_OUT_GOAL` × that of the true model, of cases with hidden effects; of the
    workflow those in which it names."""
    median_heldout: float | None


@dataclass(frozen=True)
class GroupSummary:
    """The workflow on one group of cases: one size, one effect."""

    name: str
    cases: int
    visibility: float | None
    """Median."""
    covered: Rate
    """Of all hidden effects of the group; an abstention covers nothing."""
    first: Rate
    no_gap: int
    unexplained: int
    inside: Rate
    """Parameters of rightly named effects in their 90 % intervals."""
    error: float | None
    """Median parameter error relative to the size."""
    instead: str
    """What was named most often in the effect's place."""


@dataclass(frozen=True)
class Summary:
    """All that the benchmark reports."""

    methods: tuple[MethodSummary, ...]
    """The workflow first."""
    abstained_visible: Rate
    inside: Rate
    """All parameters of rightly named effects, relative to the nominal model."""
    inside_planted: Rate
    """The same against the numbers as they were planted."""
    error: float | None
    seconds: tuple[float, float] | None
    """Median and longest time of the workflow [s]."""
    sizes: tuple[GroupSummary, ...]
    effects: tuple[GroupSummary, ...]
    kinds: tuple[GroupSummary, ...]
    """null, single, pair, triple, and the kinds outside of the library."""


def summarise(scores: Sequence[CaseScore]) -> Summary:
    """The numbers of all cases."""
    inside = [p for s in scores for p in s.parameters]
    baselines = dict.fromkeys(name for s in scores for name in s.baselines)
    methods = [_method("omnimj gap", scores, lambda s: s.workflow)]
    methods += [_method(name, scores, lambda s, n=name: s.baselines.get(n)) for name in baselines]
    inner = [s for s in scores if s.kind in ("single", "pair", "triple")]
    singles = [s for s in inner if s.kind == "single"]
    names = sorted({label.partition(" (")[0] for s in singles for label in s.hidden})
    kinds = [("null", "null"), ("single", "single"), ("pair", "pair"), ("triple", "triple")]
    outside = sorted({s.hidden[0] for s in scores if s.kind == "outside"})
    return Summary(
        tuple(methods),
        rate(not s.workflow.named for s in inner if s.is_visible),
        rate(p.inside for p in inside if p.inside is not None),
        rate(_inside_planted(scores)),
        median(p.error for p in inside if p.error is not None),
        _seconds(scores),
        tuple(_group(size, [s for s in singles if s.sizes == (size,)]) for size in SIZES),
        tuple(_group(n, [s for s in singles if s.hidden[0].partition(" (")[0] == n]) for n in names),
        (
            *(_group(words, [s for s in scores if s.kind == kind]) for kind, words in kinds),
            *(_group(k, [s for s in scores if s.kind == "outside" and s.hidden[0] == k]) for k in outside),
        ),
    )


def _inside_planted(scores: Sequence[CaseScore]) -> Iterable[bool]:
    for score in scores:
        for p in score.parameters:
            if p.inside is not None and p.low is not None and p.high is not None:
                yield p.low <= p.planted <= p.high


def _seconds(scores: Sequence[CaseScore]) -> tuple[float, float] | None:
    found = sorted(s.seconds for s in scores)
    return (median(found) or 0.0, found[-1]) if found else None


def _method(
    name: str, scores: Sequence[CaseScore], of: Callable[[CaseScore], MethodScore | None]
) -> MethodSummary:
    pairs = [(s, m) for s in scores if (m := of(s)) is not None]
    inner = [(s, m) for s, m in pairs if s.kind in ("single", "pair", "triple")]
    sets = [size for _, m in inner for size in m.set_sizes]
    ratios = [m.ratio for _, m in inner if m.ratio is not None]
    return MethodSummary(
        name,
        rate(c for _, m in inner if m.named for c in m.covered),
        rate(c for s, m in inner if s.is_visible for c in m.covered),
        rate(c for _, m in inner if m.named for c in m.first),
        rate(c for s, m in inner if s.is_visible for c in m.first),
        sum(sets) / len(sets) if sets else None,
        sum(m.wrong for _, m in inner) / len(inner) if inner else None,
        rate(bool(m.named) for s, m in pairs if s.kind == "null"),
        rate(bool(m.named) for s, m in pairs if s.kind == "outside"),
        rate(r <= HELD_OUT_GOAL for r in ratios),
        median(ratios),
    )


def _group(name: str, scores: Sequence[CaseScore]) -> GroupSummary:
    parameters = [p for s in scores for p in s.parameters]
    instead = Counter(n for s in scores for n in s.workflow.named if n not in s.hidden)
    return GroupSummary(
        name,
        len(scores),
        median(s.visibility for s in scores),
        rate(c for s in scores for c in s.workflow.covered),
        rate(c for s in scores for c in s.workflow.first),
        sum(s.verdict == "no_gap" for s in scores),
        sum(s.verdict == "unexplained" for s in scores),
        rate(p.inside for p in parameters if p.inside is not None),
        median(p.error for p in parameters if p.error is not None),
        instead.most_common(1)[0][0] if instead else "",
    )
