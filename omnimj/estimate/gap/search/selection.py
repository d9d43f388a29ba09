"""Forward selection: one round screens, fits and cross-validates the candidates for the next effect."""

from __future__ import annotations

from collections.abc import Callable, Collection, Sequence
from dataclasses import dataclass

import numpy as np

from omnimj.effects import Interval
from omnimj.estimate.gap.records import CandidateResult, Stage
from omnimj.estimate.gap.search.candidates import (
    MARGIN,
    CurrentModel,
    FittedCandidate,
    fit_candidate,
    information_score,
    refine_leaders,
)
from omnimj.estimate.gap.search.cross_validation import TrainingSplit
from omnimj.estimate.gap.search.screening import CurveGains, ScreenedCandidate, curve_gains, screen_candidates
from omnimj.estimate.gap.search.sensitivities import Sensitivities
from omnimj.estimate.intervals import effective_samples
from omnimj.estimate.replay.interface import CandidateEffect
from omnimj.estimate.replay.problem import Fit, Problem
from omnimj.estimate.threads import map_in_threads
from omnimj.signals import Array

MAX_FALSE_RATE = 0.05
"""Largest share of decoys that may gain as much as a named effect."""
_MOST = 14  # candidates fitted after the screening
_HOPELESS = 0.1  # share of the best screened share below which a candidate is not fitted
Progress = Callable[[str, float], None]


def decoy_p_value(decoys: Array, gained: Interval) -> float | None:
    """Share of the N decoys, shape (N,), that gain at least as much, (1 + n)/(1 + N); None without decoys."""
    if not len(decoys):
        return None
    return (1 + int(np.count_nonzero(decoys >= gained.value))) / (1 + len(decoys))


@dataclass(frozen=True)
class SelectionRound:
    """Outcome of one round, best candidate first."""

    tried: tuple[FittedCandidate, ...]
    screened: tuple[ScreenedCandidate, ...]
    """All candidates after the screening, the largest share first."""
    curves: CurveGains

    def stage(self, named: Collection[str], rivals: Collection[str], outcome: str) -> Stage:
        """The round as a record, with the verdicts of the finished search.

        Args:
          rivals: Labels that the data cannot distinguish from those.
          outcome: What the round added, or why it added nothing.
        """
        rows = []
        for t in self.tried:
            if t.candidate.label in named:
                verdict = "named"
            elif t.candidate.label in rivals:
                verdict = "rival"
            elif t.gain.low is None or t.gain.low <= MARGIN:
                verdict = "below the margin"
            elif t is self.tried[0]:  # the leader, eliminated given the other effects
                verdict = "given up"
            else:
                verdict = "beaten"
            rows.append(_row(t.candidate, t.screened, t.gain, verdict))
        fitted = {t.candidate.label for t in self.tried}
        out = [s for s in self.screened if s.candidate.label not in fitted]
        rows += [_row(s.candidate, s.share, None, "screened out") for s in out]
        return Stage(tuple(rows), self.curves.decoys, MARGIN, outcome)


def _row(
    candidate: CandidateEffect, screened: float, gained: Interval | None, verdict: str
) -> CandidateResult:
    return CandidateResult(candidate.label, screened, gained, verdict, candidate.words, candidate.is_sensor)


def shortlist(screened: list[ScreenedCandidate]) -> list[ScreenedCandidate]:
    """Screened candidates that are worth a fit."""
    if not screened:
        return []
    limit = max(_HOPELESS * screened[0].share, 1e-4)
    return [s for s in screened if s.share >= limit][:_MOST]


def effective_share(problem: Problem, fitted: Fit, split: TrainingSplit) -> float:
    """Independent samples over all samples in the training data, from the residual of a model."""
    count = float(np.isfinite(problem.replay.measured[split.used]).sum())
    return min(effective_samples(problem.replay, fitted.residual * split.used[:, None]) / count, 1.0)


def select_round(
    problem: Problem,
    current: Fit,
    candidates: Sequence[CandidateEffect],
    split: TrainingSplit,
    sensitivities: Sensitivities,
    report: Progress,
) -> SelectionRound:
    """Screen, fit, cross-validate and rank candidates."""
    model = CurrentModel(problem, current, split)
    screened = screen_candidates(problem, current, candidates, split.used, sensitivities)
    go = shortlist(screened)

    def fitted(k: int) -> FittedCandidate:
        report(f"trying {go[k].candidate.label}", k / len(go))
        return fit_candidate(model, go[k])

    tried = map_in_threads(fitted, range(len(go)))
    report("fitting the leaders", 1.0)
    tried = refine_leaders(model, tried, go)
    leader = min(tried, key=lambda t: float(t.losses.sum())) if tried else None
    share = effective_share(problem, leader.fit if leader else current, split)
    tried.sort(key=lambda t: information_score(t, share))
    return SelectionRound(tuple(tried), tuple(screened), curve_gains(problem, current, split, sensitivities))
