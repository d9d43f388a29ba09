"""Forward selection: one round fits the promising candidates, holds runs out and keeps the ambiguity set."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.stats import t as student

from omnimj.effects import Interval
from omnimj.estimate.gap.records import CandidateResult, Stage
from omnimj.estimate.gap.search.cross_validation import (
    Groups,
    heldout_gain,
    heldout_losses,
    paired_t,
    sum_by_group,
)
from omnimj.estimate.gap.search.screening import (
    CurveGains,
    ScreenedCandidate,
    curve_gains,
    screen_candidates,
    sensitivities,
)
from omnimj.estimate.intervals import effective_samples
from omnimj.estimate.replay.interface import CandidateEffect
from omnimj.estimate.replay.problem import Fit, Problem, fit
from omnimj.signals import Array

MARGIN = 0.02
"""Held-out gain whose lower bound an effect must exceed to be named."""
MAX_FALSE_RATE = 0.05
"""Largest share of decoys that may gain as much as a named effect."""
_MOST = 14  # candidates fitted after the screening
_HOPELESS = 0.1  # share of the best screened share below which a candidate is not fitted
_LEADERS = 4  # candidates of a round whose fits are completed
_CLEAR = 3.0  # smallest deficit in log-likelihood (effective samples) of a beaten rival
_SURE = 0.95  # one-sided level of the paired test over groups, which must be significant, too
Progress = Callable[[str, float], None]


def exceeds_margin(gained: Interval) -> bool:
    """True if the lower bound of a held-out gain is above the margin."""
    return gained.low is not None and gained.low > MARGIN


def decoy_p_value(decoys: Array, gained: Interval) -> float | None:
    """Share of decoys that gain at least as much, (1 + n)/(1 + N); None without decoys.

    Args:
      decoys: Held-out gains of the decoys, shape (N,).
      gained: Held-out gain of the candidate.
    """
    if not len(decoys):
        return None
    return (1 + int(np.count_nonzero(decoys >= gained.value))) / (1 + len(decoys))


@dataclass(frozen=True)
class TrainingSplit:
    """Training blocks, groups and folds shared by all rounds."""

    used: NDArray[np.bool_]
    """Blocks of the training groups, shape (blocks,)."""
    groups: Groups
    folds: list[NDArray[np.bool_]]
    """Masks of the blocks left out in each fold, shape (blocks,) each."""
    seed: int


@dataclass(frozen=True)
class FittedCandidate:
    """Candidate with its fit and its held-out losses."""

    candidate: CandidateEffect
    screened: float
    fit: Fit
    losses: Array
    """Held-out loss per group, shape (groups,)."""
    gain: Interval
    """Gain over the model without it."""


@dataclass(frozen=True)
class SelectionRound:
    """Outcome of one round, best candidate first."""

    tried: tuple[FittedCandidate, ...]
    screened_out: tuple[ScreenedCandidate, ...]
    rivals: tuple[FittedCandidate, ...]
    """Candidates that the best one does not beat clearly."""
    curves: CurveGains
    before: Array
    """Held-out loss per group without any candidate, shape (groups,)."""

    @property
    def best(self) -> FittedCandidate | None:
        """Leading candidate, if any was fitted."""
        return self.tried[0] if self.tried else None

    def stage(self, named: tuple[str, ...]) -> Stage:
        """The round as a record; `named` are the labels in the final model."""
        rivals = {r.candidate.label for r in self.rivals}
        rows = []
        for t in self.tried:
            if t.candidate.label in named:
                verdict = "named"
            elif t.gain.low is None or t.gain.low <= MARGIN:
                verdict = "below the margin"
            elif t is self.best:  # the leader, eliminated given the other effects
                verdict = "given up"
            else:
                verdict = "rival" if t.candidate.label in rivals else "beaten"
            rows.append(_row(t.candidate, t.screened, t.gain, verdict))
        rows += [_row(s.candidate, s.share, None, "screened out") for s in self.screened_out]
        return Stage(tuple(rows), self.curves.decoys, MARGIN)


def _row(
    candidate: CandidateEffect, screened: float, gained: Interval | None, verdict: str
) -> CandidateResult:
    return CandidateResult(candidate.label, screened, gained, verdict, candidate.words, candidate.is_sensor)


def shortlist(screened: list[ScreenedCandidate]) -> tuple[list[ScreenedCandidate], list[ScreenedCandidate]]:
    """Split screened candidates into those to be fitted and the rest."""
    if not screened:
        return [], []
    limit = max(_HOPELESS * screened[0].share, 1e-4)
    go = [s for s in screened if s.share >= limit][:_MOST]
    return go, [s for s in screened if s not in go]


def fit_candidate(
    problem: Problem,
    screened: ScreenedCandidate,
    current: Fit,
    before: Array,
    split: TrainingSplit,
    again: Fit | None = None,
) -> FittedCandidate:
    """Fit the model with one more effect and cross-validate it.

    Args:
      problem: The data and the scale.
      screened: The candidate with its starting point.
      current: The model so far.
      before: Held-out losses per group without the candidate, shape (groups,).
      split: Training blocks, groups and folds.
      again: First fit of the candidate, to be completed; None for the first fit.
    """
    effects = (*current.effects, screened.candidate)
    if again is None:
        fitted = fit(problem, effects, screened.start, split.used, 1, current.jacobian)
    else:
        fitted = fit(problem, effects, again.x, split.used, 2)
    losses = sum_by_group(heldout_losses(problem, fitted, split.used, split.folds), split.groups)
    return FittedCandidate(screened.candidate, screened.share, fitted, losses, heldout_gain(before, losses))


def refine_leaders(
    problem: Problem,
    tried: list[FittedCandidate],
    screened: list[ScreenedCandidate],
    current: Fit,
    before: Array,
    split: TrainingSplit,
) -> list[FittedCandidate]:
    """Complete the fits of the leaders; the others keep their first fit.

    Args:
      problem: The data and the scale.
      tried: Candidates with their first fit.
      screened: The same candidates after the screening.
      current: The model so far.
      before: Held-out losses per group without a candidate, shape (groups,).
      split: Training blocks, groups and folds.
    """
    order = sorted(range(len(tried)), key=lambda k: float(tried[k].losses.sum()))
    done = list(tried)
    for k in order[:_LEADERS]:
        done[k] = fit_candidate(problem, screened[k], current, before, split, tried[k].fit)
    return done


def information_score(tried: FittedCandidate, effective_share: float) -> float:
    """Information criterion: half the held-out loss in effective samples plus one per parameter."""
    return 0.5 * float(tried.losses.sum()) * effective_share + len(tried.candidate.parameters)


def has_shape_at_bound(tried: FittedCandidate) -> bool:
    """True if a shape parameter is at a bound: a sticky place as wide as the guide is none."""
    shapes = tried.candidate.parameters
    for shape, value in zip(shapes, tried.fit.x[-len(shapes) :], strict=True):
        edge = 0.01 * (shape.high - shape.low)
        if shape.null_value is None and not shape.low + edge < value < shape.high - edge:
            return True
    return False


def has_amplitude_at_bound(candidate: CandidateEffect, values: Array) -> bool:
    """True if an amplitude is at the end of its physical range, as when it compensates for another effect.

    Args:
      candidate: The effect.
      values: Its parameters, shape (parameters,).
    """
    for shape, value in zip(candidate.parameters, values, strict=True):
        edge = 0.01 * (shape.high - shape.low)
        if shape.null_value is None or abs(value - shape.null_value) <= edge:
            continue
        if not shape.low + edge < value < shape.high - edge:
            return True
    return False


def ambiguity_set(tried: list[FittedCandidate], effective_share: float) -> tuple[FittedCandidate, ...]:
    """Candidates that the first does not beat clearly, in likelihood and in the paired test over groups."""
    best = tried[0]
    sure = float(student.ppf(_SURE, max(len(best.losses) - 1, 1)))
    rivals = []
    for other in tried[1:]:
        behind = information_score(other, effective_share) - information_score(best, effective_share)
        if behind > _CLEAR and paired_t(other.losses, best.losses) > sure:
            continue
        if behind > 0.0 and has_shape_at_bound(other):
            continue
        if other.gain.value > 0.0:
            rivals.append(other)
    return tuple(rivals)


def select_round(
    problem: Problem,
    current: Fit,
    candidates: list[CandidateEffect],
    split: TrainingSplit,
    report: Progress,
) -> SelectionRound:
    """Screen, fit, cross-validate and rank candidates.

    Args:
      problem: The data and the scale.
      current: The model so far, fitted on the training blocks.
      candidates: Candidates to add.
      split: Training blocks, groups and folds.
      report: Called with a phrase and the completed share.
    """
    before = sum_by_group(heldout_losses(problem, current, split.used, split.folds), split.groups)
    screened = screen_candidates(problem, current, candidates, split.used)
    go, behind = shortlist(screened)
    tried = []
    for k, one in enumerate(go):
        report(f"trying {one.candidate.label}", k / len(go))
        tried.append(fit_candidate(problem, one, current, before, split))
    report("fitting the leaders", 1.0)
    tried = refine_leaders(problem, tried, go, current, before, split)
    curves = curve_gains(
        problem,
        sensitivities(problem, current, split.used),
        split.groups,
        split.folds,
        split.seed,
    )
    count = float(np.isfinite(problem.replay.measured[split.used]).sum())
    leader = min(tried, key=lambda t: float(t.losses.sum())) if tried else None
    residual = (leader.fit if leader else current).residual * split.used[:, None]
    share = min(1.0, effective_samples(problem.replay, residual) / count)
    tried.sort(key=lambda t: information_score(t, share))
    rivals = ambiguity_set(tried, share) if tried else ()
    return SelectionRound(tuple(tried), tuple(behind), rivals, curves, before)
