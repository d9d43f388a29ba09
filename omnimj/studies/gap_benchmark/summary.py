"""Summary of the benchmark and its tables; every rate has Wilson 95 % bounds."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass

from omnimj.studies.gap_benchmark.cases import SIZES, TUNING_SEEDS
from omnimj.studies.gap_benchmark.scoring import VISIBLE, CaseScore, MethodScore
from omnimj.studies.gap_benchmark.unmodelled import STRUCTURES
from omnimj.studies.statistics import Rate, Table, format_number, format_rate, median, rate, wilson

HELD_OUT_GOAL = 1.15
"""Largest acceptable ratio of the held-out gap to that of the true model."""


_WITH_EFFECTS = ("single", "absent", "pair", "triple")
"""Kinds of cases in which an effect of the library is hidden."""


@dataclass(frozen=True)
class MethodSummary:
    """Summary of one method over all cases."""

    method: str
    covered_where_named: Rate
    """Share of hidden effects in a reported set, among cases in which an effect is named."""
    covered_visible: Rate
    """Share of visible effects that are in a reported set; an abstention covers none."""
    covered_of_gaps: Rate
    """Share of hidden effects in a reported set, among cases whose data show a gap; an effect need not show
    beside the others."""
    first_where_named: Rate
    first_visible: Rate
    mean_set: float | None
    largest_set: int | None
    exclusive_wrong: Rate
    """Share of reported sets that are a single wrong name, among cases with hidden effects."""
    wrong_names: float | None
    """Reported sets (of a baseline: names) without a hidden effect, per case with hidden effects."""
    false_on_null: Rate
    false_outside: Rate
    good_heldout: Rate
    """Share with a held-out gap of at most `HELD_OUT_GOAL` × that of the true model, among cases with hidden
    effects; for the workflow among those in which it names an effect."""
    median_heldout: float | None


@dataclass(frozen=True)
class GroupSummary:
    """Summary of the workflow on one group of cases: one size, one effect."""

    name: str
    cases: int
    visibility: float | None
    """Median visibility."""
    covered: Rate
    """Share of hidden effects in a reported set; an abstention covers none."""
    first: Rate
    no_gap: int
    unexplained: int
    inside: Rate
    """Share of parameters of correctly named effects in their 90 % intervals."""
    error: float | None
    """Median parameter error relative to the size."""
    instead: str
    """Effect that was named most often in place of the hidden one."""


@dataclass(frozen=True)
class Summary:
    """All numbers that the benchmark reports."""

    methods: tuple[MethodSummary, ...]
    """Summaries of the workflow, first, and of the baselines."""
    abstained_visible: Rate
    inside: Rate
    """Share of parameters of correctly named effects in their intervals, relative to the nominal model."""
    inside_planted: Rate
    """Share of these parameters in their intervals, compared with the hidden values."""
    error: float | None
    seconds: tuple[float, float] | None
    """Median and longest time of the workflow [s]."""
    sizes: tuple[GroupSummary, ...]
    effects: tuple[GroupSummary, ...]
    kinds: tuple[GroupSummary, ...]
    """Summaries by kind of case: null (machines that obey the equations, then each deviation), single,
    absent, pair, triple, and the kinds outside the library."""
    structures: tuple[GroupSummary, ...]
    """Summaries of the machines that obey the equations, and of those that deviate, by kind of deviation."""


def summarize(scores: Sequence[CaseScore]) -> Summary:
    """Summarize the scores of all cases."""
    inside = [p for s in scores for p in s.parameters]
    baselines = dict.fromkeys(name for s in scores for name in s.baselines)
    methods = [_method("omnimj gap", scores, lambda s: s.workflow)]
    methods += [_method(name, scores, lambda s, n=name: s.baselines.get(n)) for name in baselines]
    inner = [s for s in scores if s.kind in _WITH_EFFECTS]
    singles = [s for s in inner if s.kind == "single"]
    names = sorted({label.partition(" (")[0] for s in singles for label in s.hidden})
    empty = [s for s in scores if s.kind == "null"]
    outside = sorted({s.hidden[0] for s in scores if s.kind == "outside"})
    return Summary(
        tuple(methods),
        rate(not s.workflow.named for s in inner if s.shows_gap),
        rate(p.inside for p in inside if p.inside is not None),
        rate(_inside_planted(scores)),
        median(p.error for p in inside if p.error is not None),
        _seconds(scores),
        tuple(_group(size, [s for s in singles if s.sizes == (size,)]) for size in SIZES),
        tuple(_group(n, [s for s in singles if s.hidden[0].partition(" (")[0] == n]) for n in names),
        (
            _group("null", [s for s in empty if not s.structure]),
            *(_group(f"null, {k}", [s for s in empty if s.structure == k]) for k in STRUCTURES),
            *(_group(kind, [s for s in scores if s.kind == kind]) for kind in _WITH_EFFECTS),
            *(_group(k, [s for s in scores if s.kind == "outside" and s.hidden[0] == k]) for k in outside),
        ),
        tuple(_group(k or "none", [s for s in inner if s.structure == k]) for k in ("", *STRUCTURES)),
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
    inner = [(s, m) for s, m in pairs if s.kind in _WITH_EFFECTS]
    sets = [size for _, m in inner for size in m.set_sizes]
    ratios = [m.ratio for _, m in inner if m.ratio is not None]
    return MethodSummary(
        name,
        rate(c for _, m in inner if m.named for c in m.covered),
        rate(c for s, m in inner for c, shows in zip(m.covered, s.visible, strict=True) if shows),
        rate(c for s, m in inner if s.shows_gap for c in m.covered),
        rate(c for _, m in inner if m.named for c in m.first),
        rate(c for s, m in inner for c, shows in zip(m.first, s.visible, strict=True) if shows),
        sum(sets) / len(sets) if sets else None,
        max(sets, default=None),
        wilson(sum(m.exclusive_wrong for _, m in inner), len(sets)),
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


HEADING = "Blind benchmark of `omnimj gap`"

_METHODS = {
    "base": "refit of the base",
    "sparse": "sparse regression",
    "bic": "forward selection, BIC",
}


def result_tables(summary: Summary) -> list[Table]:
    """Return the tables: methods and goals, then the workflow by size, by effect and by kind of case."""
    head = ("size", "cases", "mismatch", "covered", "top-1", "no_gap", "unexplained", "in interval", "error")
    named = ("effect", *head[1:], "named instead")
    return [
        _methods(summary),
        Table("By size (one hidden effect)", head, tuple(_cells(g) for g in summary.sizes if g.cases)),
        Table(
            "By effect (one hidden effect, all sizes)",
            named,
            tuple((*_cells(g), g.instead or "–") for g in summary.effects),
        ),
        Table(
            "By deviation of the machine from the equations of the library (one or more hidden effects)",
            ("deviation", *head[1:]),
            tuple(_cells(g) for g in summary.structures if g.cases),
        ),
        Table(
            "By kind of case; below `triple` effects outside the library",
            ("kind", "cases", "mismatch", "no_gap", "unexplained", "names an effect", "most often"),
            tuple(
                (
                    g.name,
                    str(g.cases),
                    format_number(g.visibility),
                    str(g.no_gap),
                    str(g.unexplained),
                    str(g.cases - g.no_gap - g.unexplained),
                    g.instead or "–",
                )
                for g in summary.kinds
                if g.cases
            ),
        ),
    ]


def _methods(summary: Summary) -> Table:
    methods = summary.methods
    names = tuple(_METHODS.get(m.method, m.method) for m in methods)
    none = ("–",) * (len(methods) - 1)
    rows = [
        ("coverage, where it names", "≥ 95 %", *(format_rate(m.covered_where_named) for m in methods)),
        ("coverage, all visible", "≥ 85 %", *(format_rate(m.covered_visible) for m in methods)),
        ("coverage, all in data with a gap", "", *(format_rate(m.covered_of_gaps) for m in methods)),
        ("top-1, where it names", "≥ 80 %", *(format_rate(m.first_where_named) for m in methods)),
        ("top-1, all visible", "", *(format_rate(m.first_visible) for m in methods)),
        ("mean set", "≤ 1.6", *(format_number(m.mean_set) for m in methods)),
        ("largest set", "", *("–" if m.largest_set is None else str(m.largest_set) for m in methods)),
        ("single wrong names", "≤ 3 %", *(format_rate(m.exclusive_wrong) for m in methods)),
        ("wrong names per case", "", *(format_number(m.wrong_names) for m in methods)),
        ("false naming, nothing hidden", "≤ 5 %", *(format_rate(m.false_on_null) for m in methods)),
        ("false naming, out of library", "≤ 5 %", *(format_rate(m.false_outside) for m in methods)),
        ("abstains on a visible effect", "", format_rate(summary.abstained_visible), *none),
        (
            "held-out gap over true model's: median",
            f"≤ {HELD_OUT_GOAL}",
            *(format_number(m.median_heldout) for m in methods),
        ),
        (f"… at most {HELD_OUT_GOAL}", "", *(format_rate(m.good_heldout) for m in methods)),
        ("parameters in their 90 % interval", "≥ 85 %", format_rate(summary.inside), *none),
        ("… of the planted numbers", "", format_rate(summary.inside_planted), *none),
        ("parameter error over size, median", "", format_number(summary.error), *none),
        ("time per dataset, median and longest", "", _format_seconds(summary), *none),
    ]
    return Table("Against the goals", ("", "goal", *names), tuple(rows))


def _cells(group: GroupSummary) -> tuple[str, ...]:
    return (
        group.name,
        str(group.cases),
        format_number(group.visibility),
        format_rate(group.covered),
        format_rate(group.first),
        str(group.no_gap),
        str(group.unexplained),
        format_rate(group.inside),
        format_number(group.error),
    )


def case_table(scores: Sequence[CaseScore]) -> Table:
    """Return a table of all cases: truth, verdict, reported sets, parameters in their intervals."""
    truth = ("case", "kind", "hidden", "deviation", "mismatch")
    head = (*truth, "verdict", "reported", "covered", "in interval")
    return Table("All cases", head, tuple(_case_cells(score) for score in scores))


def _case_cells(score: CaseScore) -> tuple[str, ...]:
    hidden = [f"{name} ({size})" for name, size in zip(score.hidden, score.sizes, strict=False)]
    sets = zip(score.workflow.named, score.workflow.set_sizes, strict=True)
    reported = [name if size == 1 else f"{name} or {size - 1} more" for name, size in sets]
    inside = [p.inside for p in score.parameters if p.inside is not None]
    return (
        score.name,
        score.kind,
        ", ".join(hidden) or "–",
        score.structure or "–",
        format_number(score.visibility),
        score.verdict,
        ", ".join(reported) or "–",
        f"{sum(score.workflow.covered)} of {len(score.workflow.covered)}" if score.hidden else "–",
        f"{sum(inside)} of {len(inside)}" if inside else "–",
    )


def _format_seconds(summary: Summary) -> str:
    return "–" if summary.seconds is None else f"{summary.seconds[0]:.0f} s, {summary.seconds[1]:.0f} s"


def summary_sentences(seed: int, origin: str, scored: int, planned: int, failed: int) -> list[str]:
    """Return sentences on the origin of the numbers; `origin` says what made the datasets."""
    judged = (
        f"Seed {seed} was used to tune the method (0–9): **these numbers do not judge it**."
        if seed in TUNING_SEEDS
        else f"Seed {seed} was not used while the method was tuned (0–9 were)."
    )
    lines = [
        judged,
        f"{scored} of {planned} datasets, made by {origin}, its parameters within the stated uncertainty of "
        "their nominal values.",
        "Rates with Wilson 95 % bounds and sample size. Mismatch: that of the refitted base, in units of "
        f"noise. An effect is visible if without it, the others being known, the mismatch is {VISIBLE} times "
        "that of the true model.",
    ]
    if failed:
        lines.append(f"{failed} searches or fits failed and are left out: `errors` in benchmark.json.")
    return lines
