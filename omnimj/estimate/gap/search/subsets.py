"""Look-ahead: pairs and triples of effects that explain much together although none explains much alone."""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from omnimj.effects import Interval
from omnimj.estimate.gap.search.cross_validation import TrainingSplit, group_losses, heldout_gain
from omnimj.estimate.gap.search.screening import ScreenedCandidate, bounded_share
from omnimj.estimate.gap.search.sensitivities import Sensitivities, TrialColumns
from omnimj.estimate.least_squares import normal_equations
from omnimj.estimate.replay.interface import CandidateEffect
from omnimj.estimate.replay.problem import Fit, Problem, fit, huber_weights
from omnimj.signals import Array

_MOST_CANDIDATES = 40  # candidates that are combined
_PROMISING = 12  # subsets of each size whose bounded share is computed
_FITTED = 3  # subsets of each size that are fitted
_LARGER = 0.9  # share of what a pair leaves below which a triple must get to be fitted


@dataclass(frozen=True)
class _Subset:
    """Candidates with their share of the squared mismatch, to first order and inside the bounds."""

    candidates: tuple[CandidateEffect, ...]
    share: float
    start: Array
    """Starting values of the model and of these effects, shape (parameters + own,)."""


Combination = tuple[tuple[TrialColumns, slice], ...]
"""Candidates, and the places of their columns in the normal equations."""


def best_subset(
    problem: Problem,
    current: Fit,
    screened: Sequence[ScreenedCandidate],
    split: TrainingSplit,
    sensitivities: Sensitivities,
    room: int,
) -> tuple[Interval, Fit] | None:
    """Gain and fit of the pair or triple with the smallest held-out loss; None without two candidates.

    To first order all subsets follow from one set of sensitivities, so that only the most promising are
    fitted; triples only if they leave clearly less than the best pair.
    """
    before = group_losses(problem, current, split)
    fitted = []
    for one in _promising_subsets(problem, current, screened, split.used, sensitivities):
        if len(one.candidates) <= room:
            effects = (*current.effects, *one.candidates)
            found = fit(problem, effects, one.start, split.used, 2, current.jacobian)
            fitted.append((group_losses(problem, found, split), found))
    if not fitted:
        return None
    losses, found = min(fitted, key=lambda option: float(option[0].sum()))
    return heldout_gain(before, losses), found


def _promising_subsets(
    problem: Problem,
    current: Fit,
    screened: Sequence[ScreenedCandidate],
    used: NDArray[np.bool_],
    sensitivities: Sensitivities,
) -> list[_Subset]:
    """Pairs, and the triples that leave clearly less than every pair."""
    trials, ends = [], [len(current.x)]
    for one in screened[:_MOST_CANDIDATES]:
        trials.append(sensitivities.trial(problem, current, one.candidate, one.shape, one.step))
        ends.append(ends[-1] + len(trials[-1].steps))
    columns = np.hstack([current.jacobian, *(one.columns for one in trials)])
    sums = normal_equations(columns, current.residual, huber_weights(problem, current.residual, used))
    placed = list(zip(trials, itertools.starmap(slice, itertools.pairwise(ends)), strict=True))
    pairs, triples = (
        _best_bounded(problem, current, sums, list(itertools.combinations(placed, size))) for size in (2, 3)
    )
    least = _LARGER * (1.0 - pairs[0].share) if pairs else 0.0
    return [*pairs, *(t for t in triples if 1.0 - t.share < least)]


def _best_bounded(
    problem: Problem, current: Fit, sums: Array, combinations: Sequence[Combination]
) -> list[_Subset]:
    """Combinations with the largest share inside the bounds, of those that explain most without them."""
    n, found = len(current.x), []
    projected = _projected(problem, current, sums)
    shares = [_share(projected, np.concatenate([np.r_[p] for _, p in one]) - n) for one in combinations]
    for k in sorted(range(len(shares)), key=lambda k: -shares[k])[:_PROMISING]:
        own = np.concatenate([np.arange(n), *(np.r_[place] for _, place in combinations[k]), [len(sums) - 1]])
        chosen = [trial for trial, _ in combinations[k]]
        share, start = bounded_share(problem, current, chosen, sums[np.ix_(own, own)])
        found.append(_Subset(tuple(trial.candidate for trial in chosen), share, start))
    return sorted(found, key=lambda subset: -subset.share)[:_FITTED]


def _projected(problem: Problem, current: Fit, sums: Array) -> Array:
    """Normal equations of the candidates and the residual after the model's own parameters."""
    n = len(current.x)
    precision, _ = problem.prior(current.x, current.effects)
    ground = sums[:n, :n] + np.diag(precision + 1e-9 * max(float(sums.diagonal()[:n].max()), 1e-30))
    return sums[n:, n:] - sums[n:, :n] @ np.linalg.solve(ground, sums[:n, n:])


def _share(projected: Array, own: NDArray[np.int_]) -> float:
    """Squared mismatch that some columns explain to first order."""
    gram = projected[np.ix_(own, own)]
    # also regular where candidates change nothing or the same
    gram = gram + 1e-9 * max(float(gram.diagonal().max()), 1e-30) * np.eye(len(own))
    slope = projected[own, -1]
    return float(slope @ np.linalg.solve(gram, slope))
