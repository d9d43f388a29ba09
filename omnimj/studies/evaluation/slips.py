"""Slips by what they do without any method: those that slip, and the others, which should be harmless.

A wheel with less grip slips only where more traction is needed than it has left. A slip that never shows
cannot be found, and need not be if path and heading stay those of the healthy run.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

from omnimj.studies.evaluation.scoring import SLIPPING, CaseScore
from omnimj.studies.statistics import Rate, median, rate

_LITTLE_GRIP = 0.3


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
