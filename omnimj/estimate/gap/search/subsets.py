"""Look-ahead: pairs of effects that explain much together although neither explains much alone."""

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
_PROMISING = 12  # pairs whose bounded share is computed
_FITTED = 3  # pairs that are fitted


@dataclass(frozen=True)
class FittedPair:
    """Two candidates fitted together."""

    candidates: tuple[CandidateEffect, CandidateEffect]
    fit: Fit
    losses: Array
    """Held-out loss per group, shape (groups,)."""
    gain: Interval
    """Gain over the model without both."""


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


def best_pair(
    problem: Problem, current: Fit, screened: Sequence[ScreenedCandidate], split: TrainingSplit
) -> FittedPair | None:
    """Pair of candidates with the smallest held-out loss; None with fewer than two candidates.

    To first order all pairs follow from one set of sensitivities, so that only the most promising are fitted.

    Args:
      problem: The data and the scale.
      current: The model so far, fitted.
      screened: Candidates after the screening, whose starting points give their shapes.
      split: Training blocks, groups and folds.
    """
    before = group_losses(problem, current, split)
    fitted = []
    for first, second, start in _promising_pairs(problem, current, screened, split.used)[:_FITTED]:
        effects = (*current.effects, first, second)
        found = fit(problem, effects, start, split.used, 2, current.jacobian)
        losses = group_losses(problem, found, split)
        fitted.append(FittedPair((first, second), found, losses, heldout_gain(before, losses)))
    return min(fitted, key=lambda pair: float(pair.losses.sum()), default=None)


def _promising_pairs(
    problem: Problem, current: Fit, screened: Sequence[ScreenedCandidate], used: NDArray[np.bool_]
) -> list[tuple[CandidateEffect, CandidateEffect, Array]]:
    """Pairs and their starting points, the largest share to first order and inside the bounds first."""
    columns, sums = _pooled_normal_equations(problem, current, screened[:_MOST_CANDIDATES], used)
    n = len(current.x)
    precision, distance = problem.prior(current.x, current.effects)
    ground = sums[:n, :n] + np.diag(precision + 1e-9 * max(float(sums.diagonal()[:n].max()), 1e-30))
    # what is left of the candidates' columns and of the residual after the model's own parameters
    projected = sums[n:, n:] - sums[n:, :n] @ np.linalg.solve(ground, sums[:n, n:])
    shares = {}
    for one, other in itertools.combinations(columns, 2):
        own = np.r_[one.place, other.place] - n
        gram = projected[np.ix_(own, own)] + 1e-9 * projected.diagonal()[own].max() * np.eye(len(own))
        slope = projected[own, -1]
        shares[one.candidate.label, other.candidate.label] = float(slope @ np.linalg.lstsq(gram, slope)[0])
    by_label = {c.candidate.label: c for c in columns}
    best = sorted(shares, key=lambda pair: -shares[pair])[:_PROMISING]
    found = []
    for pair in best:
        one, other = (by_label[label] for label in pair)
        share, start = _bounded_share(problem, current, (one, other), sums, (precision, distance))
        found.append((share, one.candidate, other.candidate, start))
    found.sort(key=lambda entry: -entry[0])
    return [entry[1:] for entry in found]


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
    pair: tuple[_Columns, _Columns],
    sums: Array,
    prior: tuple[Array, Array],
) -> tuple[float, Array]:
    """Share of the squared mismatch that a pair explains inside the bounds, and its starting point."""
    n, scales = len(current.x), problem.scales(current.effects)
    low, high = problem.bounds(current.effects)
    ends = [(low - current.x) / scales], [(high - current.x) / scales]
    for one in pair:
        parameters = one.candidate.parameters
        reach = np.array(
            [
                sorted(((parameters[k].low - one.at[k]) / s, (parameters[k].high - one.at[k]) / s))
                for k, s in one.steps
            ]
        )
        ends[0].append(reach[:, 0])
        ends[1].append(reach[:, 1])
    own = np.r_[0:n, pair[0].place, pair[1].place, len(sums) - 1]
    small, none = sums[np.ix_(own, own)], np.zeros(len(own) - n - 1)
    both = np.concatenate([prior[0], none]), np.concatenate([prior[1], none])
    step = bounded_step(small, (np.concatenate(ends[0]), np.concatenate(ends[1])), both, 1e-6)
    full, start = np.append(step, 1.0), [current.x + scales * step[:n]]
    at = n
    for one in pair:
        values = one.at.copy()
        for k, size in one.steps:
            values[k] += size * step[at]
            at += 1
        start.append(values)
    return 1.0 - float(full @ small @ full) / max(float(small[-1, -1]), 1e-30), np.concatenate(start)
