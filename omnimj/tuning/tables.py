"""What a tuning found, as rows of words for people."""

from __future__ import annotations

from omnimj.tuning.cost import TERMS, Score
from omnimj.tuning.tuning import Outcome, Verdict


def judged_rows(verdict: Verdict) -> list[tuple[str, str, str]]:
    """Before and after on the judging seeds: cost and its terms, and what the limits are on."""
    before, after = verdict.before, verdict.after
    rows = [("cost", _number(before.cost), _number(after.cost))]
    for name, term in TERMS.items():
        label = f"{name.replace('_', ' ')} ({term.group}, weight {term.weight:g})"
        rows.append((label, _number(before.terms[name]), _number(after.terms[name])))
    for label, of in (
        ("false alarms", lambda s: str(s.false_alarms)),
        ("faults not found", lambda s: str(s.missed)),
        ("longest at the largest current", lambda s: f"{s.saturation:.3f} s"),
        ("least phase margin", lambda s: f"{s.loops.phase:.1f}°"),
        ("largest overshoot", lambda s: f"{100.0 * s.loops.overshoot:.0f} %"),
        ("runs that broke down", lambda s: str(s.broke)),
    ):
        rows.append((label, of(before), of(after)))
    return rows


def verdict_words(outcome: Outcome) -> str:
    """One sentence: whether it is better, and where it is not."""
    if outcome.is_better:
        return "better than the gains before on the judging seeds"
    if all(axis.start == value for axis, value in zip(outcome.axes, outcome.values, strict=True)):
        return "NOT BETTER than the gains before: nothing better was found, they are as they were"
    places = [f"{v.plant} ({_why(v.before, v.after)})" for v in outcome.verdicts if not v.is_better]
    return f"NOT BETTER than the gains before on the judging seeds: {', '.join(places)}"


def _why(before: Score, after: Score) -> str:
    if after.violation > before.violation:
        return "it breaks limits that they keep" if before.violation == 0.0 else "it breaks limits by more"
    return f"it costs {after.cost:.4g} instead of {before.cost:.4g}"


def _number(value: float) -> str:
    return f"{value:.4f}"
