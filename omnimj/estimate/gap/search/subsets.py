"""Look-ahead: pairs and triples of effects that explain much together although none explains much alone."""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from omnimj.effects import Interval
from omnimj.estimate.gap.search.candidates import TrainingSplit, group_losses
from omnimj.estimate.gap.search.cross_validation import heldout_gain
from omnimj.estimate.gap.search.screening import ScreenedCandidate, trial_points, vanished_point
from omnimj.estimate.least_squares import bounded_step, normal_equations
from omnimj.estimate.replay.interface import CandidateEffect
from omnimj.estimate.replay.problem import Fit, Problem, fit, huber_weights
from omnimj.signals import Array

_MOST_CANDIDATES = 40  # candidates that are combined
_PROMISING = 12  # subsets of each size whose bounded share is computed
_FITTED = 3  # subsets of each size that are fitted
_LARGER = 0.9  # share of what a pair leaves below which a triple must get to be fitted


@dataclass(frozen=True)
class FittedSubset:
    """Candidates fitted together."""

    candidates: tuple[CandidateEffect, ...]
    fit: Fit
    losses: Array
    """Held-out loss per group, shape (groups,)."""
    gain: Interval
    """Gain over the model without them."""


@dataclass(frozen=True)
class _PromisingSubset:
    """Candidates with their share of the squared mismatch, to first order and inside the bounds."""

    candidates: tuple[CandidateEffect, ...]
    share: float
    start: Array
    """Starting values of the model and of these effects, shape (parameters + own,)."""


@dataclass(frozen=True)
class _Columns:
    """Candidate in its best shape, switched on a little."""

    candidate: CandidateEffect
    at: Array
    """Its parameters with vanishing amplitudes, shape (own,)."""
    steps: list[tuple[int, float]]
    """Trial steps (index, change) from there."""
    place: slice
    """Its columns in the normal equations."""


def best_subset(
    problem: Problem,
    current: Fit,
    screened: Sequence[ScreenedCandidate],
    split: TrainingSplit,
    room: int,
) -> FittedSubset | None:
    """Pair or triple of candidates with the smallest held-out loss; None with fewer than two candidates.

    To first order all subsets follow from one set of sensitivities, so that only the most promising are
    fitted; triples only if they leave clearly less than the best pair.

    Args:
      problem: The data and the scale.
      current: The model so far, fitted.
      screened: Candidates after the screening, whose starting points give their shapes.
      split: Training blocks, groups and folds.
      room: Largest number of effects to add.
    """
    before = group_losses(problem, current, split)
    promising = _promising_subsets(problem, current, screened, split.used)
    fitted = []
    for one in (p for p in promising if len(p.candidates) <= room):
        effects = (*current.effects, *one.candidates)
        found = fit(problem, effects, one.start, split.used, 2, current.jacobian)
        losses = group_losses(problem, found, split)
        fitted.append(FittedSubset(one.candidates, found, losses, heldout_gain(before, losses)))
    return min(fitted, key=lambda subset: float(subset.losses.sum()), default=None)


def _promising_subsets(
    problem: Problem, current: Fit, screened: Sequence[ScreenedCandidate], used: NDArray[np.bool_]
) -> list[_PromisingSubset]:
    """Pairs, and the triples that leave clearly less than every pair."""
    columns, sums = _pooled_normal_equations(problem, current, screened[:_MOST_CANDIDATES], used)
    projected = _projected(problem, current, sums)
    pairs = _best_bounded(problem, current, sums, _best_combinations(columns, projected, 2, len(current.x)))
    triples = _best_bounded(problem, current, sums, _best_combinations(columns, projected, 3, len(current.x)))
    least = _LARGER * (1.0 - pairs[0].share) if pairs else 0.0
    return [*pairs, *(t for t in triples if 1.0 - t.share < least)]


def _projected(problem: Problem, current: Fit, sums: Array) -> Array:
    """Normal equations of the candidates and the residual after the model's own parameters."""
    n = len(current.x)
    precision, _ = problem.prior(current.x, current.effects)
    ground = sums[:n, :n] + np.diag(precision + 1e-9 * max(float(sums.diagonal()[:n].max()), 1e-30))
    return sums[n:, n:] - sums[n:, :n] @ np.linalg.solve(ground, sums[:n, n:])


def _best_combinations(
    columns: Sequence[_Columns], projected: Array, size: int, own_parameters: int
) -> list[tuple[_Columns, ...]]:
    """Combinations that explain most of the mismatch to first order, the largest share first."""
    shares = []
    for combination in itertools.combinations(columns, size):
        own = np.concatenate([np.r_[one.place] for one in combination]) - own_parameters
        gram = projected[np.ix_(own, own)]
        # also regular where candidates change nothing or the same
        gram = gram + 1e-9 * max(float(gram.diagonal().max()), 1e-30) * np.eye(len(own))
        slope = projected[own, -1]
        shares.append((float(slope @ np.linalg.solve(gram, slope)), combination))
    shares.sort(key=lambda entry: -entry[0])
    return [combination for _, combination in shares[:_PROMISING]]


def _best_bounded(
    problem: Problem, current: Fit, sums: Array, combinations: Sequence[tuple[_Columns, ...]]
) -> list[_PromisingSubset]:
    """Combinations with the largest share inside the bounds, the largest first."""
    prior = problem.prior(current.x, current.effects)
    found = [_bounded_share(problem, current, one, sums, prior) for one in combinations]
    return sorted(found, key=lambda subset: -subset.share)[:_FITTED]


def _pooled_normal_equations(
    problem: Problem, current: Fit, screened: Sequence[ScreenedCandidate], used: NDArray[np.bool_]
) -> tuple[list[_Columns], Array]:
    """Candidates with their places in the normal equations [J, candidates, r]ᵀ W² [J, candidates, r]."""
    n, parts, columns = len(current.x), [current.jacobian], []
    at = n
    for one in screened:
        own = one.start[n:]
        shape = {k: own[k] for k, s in enumerate(one.candidate.parameters) if s.null_value is None}
        origin, steps = vanished_point(one.candidate, shape)
        effects = (*current.effects, one.candidate)
        moved = problem.residuals(trial_points(current.x, origin, steps), effects)
        parts.append(np.stack([(r - current.residual).ravel() for r in moved], axis=1))
        columns.append(_Columns(one.candidate, origin, steps, slice(at, at + len(steps))))
        at += len(steps)
    weight = huber_weights(problem, current.residual, used)
    return columns, normal_equations(np.hstack(parts), current.residual, weight)


def _bounded_share(
    problem: Problem,
    current: Fit,
    subset: tuple[_Columns, ...],
    sums: Array,
    prior: tuple[Array, Array],
) -> _PromisingSubset:
    """Share of the squared mismatch that a subset explains inside the bounds, and its starting point."""
    n, scales = len(current.x), problem.scales(current.effects)
    low, high = problem.bounds(current.effects)
    ends = [(low - current.x) / scales], [(high - current.x) / scales]
    for one in subset:
        parameters = one.candidate.parameters
        reach = np.array(
            [
                sorted(((parameters[k].low - one.at[k]) / s, (parameters[k].high - one.at[k]) / s))
                for k, s in one.steps
            ]
        )
        ends[0].append(reach[:, 0])
        ends[1].append(reach[:, 1])
    own = np.concatenate([np.arange(n), *(np.r_[one.place] for one in subset), [len(sums) - 1]])
    small, none = sums[np.ix_(own, own)], np.zeros(len(own) - n - 1)
    both = np.concatenate([prior[0], none]), np.concatenate([prior[1], none])
    step = bounded_step(small, (np.concatenate(ends[0]), np.concatenate(ends[1])), both, 1e-6)
    full, start = np.append(step, 1.0), [current.x + scales * step[:n]]
    at = n
    for one in subset:
        values = one.at.copy()
        for k, size in one.steps:
            values[k] += size * step[at]
            at += 1
        start.append(values)
    share = 1.0 - float(full @ small @ full) / max(float(small[-1, -1]), 1e-30)
    return _PromisingSubset(tuple(one.candidate for one in subset), share, np.concatenate(start))
