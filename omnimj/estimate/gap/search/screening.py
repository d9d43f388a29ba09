"""Screening to first order: gains of candidate effects, of random curves (decoys) and of free curves.

Every candidate is switched on a little; the change of the whitened prediction is its sensitivity. Together
with the base's own sensitivities, all inside their boxes, it explains some share of the squared mismatch.
Held-out gains of curves follow from sums over groups, with the boxes of the base as a prior of equal width.
"""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from omnimj.estimate.gap.search.cross_validation import FOLD_PRIOR, Groups, TrainingSplit
from omnimj.estimate.gap.search.sensitivities import (
    TRIAL_STEP,
    Sensitivities,
    TrialColumns,
    trial_shapes,
    trial_steps,
)
from omnimj.estimate.least_squares import bounded_step, normal_equations, weighted_gram
from omnimj.estimate.replay.interface import KNOTS, CandidateEffect
from omnimj.estimate.replay.problem import Fit, Problem, huber_weights
from omnimj.estimate.threads import map_in_threads
from omnimj.signals import Array

_DECOYS = 100
_REACH = 1.5  # correlation length of a random curve, in knots


@dataclass(frozen=True)
class ScreenedCandidate:
    """Candidate, the share of the mismatch that it explains, and a starting point for its fit."""

    candidate: CandidateEffect
    share: float
    start: Array
    """Starting values of base, α, present effects and this effect, shape (parameters + own,)."""
    step: float = TRIAL_STEP
    """Trial step that explains most, as a share of the typical size."""

    @property
    def shape(self) -> dict[int, float]:
        """Shape parameters at the start, as index → value."""
        own = self.start[-len(self.candidate.parameters) :]
        return {k: own[k] for k, s in enumerate(self.candidate.parameters) if s.null_value is None}


def screen_candidates(
    problem: Problem,
    current: Fit,
    candidates: Sequence[CandidateEffect],
    used: NDArray[np.bool_],
    sensitivities: Sensitivities | None = None,
) -> list[ScreenedCandidate]:
    """Screen every candidate in each of its shapes; best shape only, sorted by share.

    Args:
      used: Blocks that count, shape (blocks,).
    """
    near = Sensitivities() if sensitivities is None else sensitivities
    weight = huber_weights(problem, current.residual, used)
    known = np.column_stack([current.jacobian, current.residual.ravel()]) * weight[:, None]
    sums = normal_equations(current.jacobian, current.residual, weight)

    def screened(candidate: CandidateEffect) -> ScreenedCandidate:
        options = []
        for shape, step in itertools.product(trial_shapes(candidate), trial_steps(candidate)):
            trial = near.trial(problem, current, candidate, shape, step)
            both = _with_columns(sums, known, trial.columns * weight[:, None])
            options.append((*bounded_share(problem, current, [trial], both), step))
        return ScreenedCandidate(candidate, *max(options, key=lambda option: option[0]))

    return sorted(map_in_threads(screened, candidates), key=lambda s: -s.share)


def _with_columns(sums: Array, known: Array, new: Array) -> Array:
    """Normal equations of W [J r] with more columns before the residual."""
    n, m = len(sums) - 1, new.shape[1]
    found, old = np.zeros((n + m + 1, n + m + 1)), np.r_[0:n, n + m]
    found[np.ix_(old, old)] = sums
    found[n : n + m, n : n + m] = new.T @ new
    found[n : n + m, old] = new.T @ known
    found[old, n : n + m] = found[n : n + m, old].T
    return found


def bounded_share(
    problem: Problem, current: Fit, trials: Sequence[TrialColumns], sums: Array
) -> tuple[float, Array]:
    """Share of the squared mismatch that effects explain to first order inside their bounds.

    Args:
      sums: Normal equations of its columns, those of the effects, and the residual, shape (n + 1, n + 1).

    Returns:
      The share, and starting values of the model and of these effects, shape (n,).
    """
    n, scales = len(current.x), problem.scales(current.effects)
    ends = [problem.steps(current.x, current.effects)]
    for one in trials:
        own, at = one.candidate.parameters, one.at
        reach = [sorted(((own[k].low - at[k]) / step, (own[k].high - at[k]) / step)) for k, step in one.steps]
        ends.append(tuple(np.array(reach).T))
    low, high = (np.concatenate(parts) for parts in zip(*ends, strict=True))
    precision, distance = (
        np.append(part, np.zeros(len(low) - n)) for part in problem.prior(current.x, current.effects)
    )
    d = bounded_step(sums, (low, high), (precision, distance), 1e-6)
    start, taken = [current.x + scales * d[:n]], iter(d[n:])
    for one in trials:
        values = one.at.copy()
        for k, step in one.steps:
            values[k] += step * next(taken)
        start.append(values)
    full = np.append(d, 1.0)
    share = 1.0 - float(full @ sums @ full) / max(float(sums[-1, -1]), 1e-30)
    return share, np.concatenate(start)


def weighted_columns(
    problem: Problem, current: Fit, curves: Array, used: NDArray[np.bool_]
) -> tuple[Array, Array]:
    """Weighted sensitivities to a model's parameters and to the values of free curves.

    Args:
      curves: Change of the whitened mismatch by the value at each knot, shape (rows, knots).
      used: Blocks that count, shape (blocks,).

    Returns:
      Columns [parameters, knots, residual], shape (rows, columns), and the precision of each parameter in
      units of its column, shape (parameters,).
    """
    weight = huber_weights(problem, current.residual, used)
    columns = np.column_stack([current.jacobian, curves, current.residual.ravel()]) * weight[:, None]
    low, high = problem.bounds(current.effects)
    own = len(problem.replay.base) + problem.has_twin_share
    prior = np.full(len(current.x), 1e-6)
    # a box of half-width a has the variance a²/3
    prior[:own] = 3.0 / np.maximum(0.5 * (high - low) / problem.scales(current.effects), 1e-9)[:own] ** 2
    return columns, prior


def group_sums(columns: Array, groups: Groups, channels: int) -> Array:
    """Aᵀ A of every group, shape (groups, columns, columns)."""
    of_row = np.repeat(groups.of_block, channels)
    ones = np.ones(len(columns))
    parts = [of_row == g for g in range(groups.count)]
    return np.stack([weighted_gram(columns[p, :-1], columns[p, -1], ones[p]) for p in parts])


def heldout_squares(sums: Array, penalty: Array, folds: list[NDArray[np.int_]]) -> Array:
    """Squared held-out residual per group of the linear model whose last column is the residual.

    Args:
      sums: Aᵀ A of every group, shape (groups, columns, columns).
      penalty: Precision of every column but the last, shape (columns − 1,).
      folds: Groups of each fold, together all that are fitted to.

    Returns:
      Shape (groups,), 0 where a group is in no fold.
    """
    left = np.zeros(len(sums))
    total = sums[np.concatenate(folds)].sum(axis=0)
    for out in folds:
        rest = total - sums[out].sum(axis=0)
        held = penalty + FOLD_PRIOR * total.diagonal()[:-1]
        d = np.linalg.solve(rest[:-1, :-1] + np.diag(held), -rest[:-1, -1])
        full = np.append(d, 1.0)
        for g in out:
            left[g] = max(full @ sums[g] @ full, 0.0)
    return left


@dataclass(frozen=True)
class CurveGains:
    """Gains of curves on held-out groups."""

    decoys: Array
    """Gains of random curves, shape (decoys,)."""
    flexible: dict[str, float]
    """Variable → gain of a free curve over it."""


def curve_gains(
    problem: Problem, current: Fit, split: TrainingSplit, sensitivities: Sensitivities | None = None
) -> CurveGains:
    """Held-out gains 1 − √(after/before) of random one-parameter curves and of free ones beyond a model."""
    near = Sensitivities() if sensitivities is None else sensitivities
    columns, prior = weighted_columns(problem, current, near.curves(problem, current), split.used)
    variables, n = tuple(problem.replay.curves), len(prior)
    outs = [np.unique(split.groups.of_block[out]) for out in split.folds]
    sums = group_sums(columns, split.groups, len(problem.replay.channels))
    last = sums.shape[1] - 1

    def pick(transform: Array, penalty: Array) -> float:
        small = transform.T @ sums @ transform
        return float(heldout_squares(small, penalty, outs).sum())

    plain = np.zeros((last + 1, n + 1))
    plain[:n, :n], plain[last, n] = np.eye(n), 1.0
    before = pick(plain, prior)
    generator = np.random.default_rng(split.seed + 2)
    distance = np.subtract.outer(np.arange(KNOTS), np.arange(KNOTS))
    root = np.linalg.cholesky(np.exp(-0.5 * (distance / _REACH) ** 2) + 1e-6 * np.eye(KNOTS))
    decoys, flexible = [], {}
    for k in range(_DECOYS if variables else 0):
        first = n + KNOTS * (k % len(variables))
        mix = np.zeros((last + 1, n + 2))
        mix[:n, :n], mix[last, n + 1] = np.eye(n), 1.0
        mix[first : first + KNOTS, n] = root @ generator.standard_normal(KNOTS)
        decoys.append(1.0 - np.sqrt(pick(mix, np.append(prior, 1e-9)) / before))
    for k, name in enumerate(variables):
        first = n + KNOTS * k
        free = np.zeros((last + 1, n + KNOTS + 1))
        free[:n, :n], free[last, -1] = np.eye(n), 1.0
        free[first : first + KNOTS, n : n + KNOTS] = np.eye(KNOTS)
        penalty = np.append(prior, np.full(KNOTS, 1.0))
        flexible[name] = float(1.0 - np.sqrt(pick(free, penalty) / before))
    return CurveGains(np.array(decoys), flexible)
