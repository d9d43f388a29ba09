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

from omnimj.estimate.gap.search.cross_validation import Groups
from omnimj.estimate.least_squares import bounded_step, normal_equations, weighted_gram
from omnimj.estimate.replay.interface import KNOTS, CandidateEffect
from omnimj.estimate.replay.problem import Fit, Problem, huber_weights
from omnimj.signals import Array

TRIAL_STEP = 0.25
"""Trial step as a share of the typical size: beyond dead zones, small enough for a derivative. An effect with
a threshold is tried at its full size."""
_DECOYS = 100
_REACH = 1.5  # correlation length of a random curve, in knots


@dataclass(frozen=True)
class ScreenedCandidate:
    """Candidate, the share of the mismatch that it explains, and a starting point for its fit."""

    candidate: CandidateEffect
    share: float
    start: Array
    """Starting values of base, α, present effects and this effect, shape (parameters + own,)."""


def trial_shapes(candidate: CandidateEffect) -> list[dict[int, float]]:
    """All combinations of the trial values of the shape parameters, as index → value."""
    places = [k for k, s in enumerate(candidate.parameters) if s.null_value is None]
    values = [candidate.parameters[k].trials or (candidate.parameters[k].typical,) for k in places]
    shapes = [dict(zip(places, combination, strict=True)) for combination in itertools.product(*values)]
    names = [s.name for s in candidate.parameters]
    if "start" in names and "end" in names:
        begin, end = names.index("start"), names.index("end")
        shapes = [s for s in shapes if s[begin] < s[end]]
    return shapes


def vanished_point(
    candidate: CandidateEffect, shape: dict[int, float]
) -> tuple[Array, list[tuple[int, float]]]:
    """Parameters of an effect with zero amplitudes in one shape, and trial steps (index, change) of these."""
    at = np.array([shape.get(k, s.null_value or 0.0) for k, s in enumerate(candidate.parameters)])
    share = 1.0 if candidate.has_threshold else TRIAL_STEP
    steps = []
    for k, s in enumerate(candidate.parameters):
        if s.null_value is None:
            continue
        step = share * (s.typical - s.null_value)
        if not s.low <= s.null_value + step <= s.high:
            step = -step
        steps.append((k, step))
    return at, steps


def trial_points(x: Array, at: Array, steps: list[tuple[int, float]]) -> list[Array]:
    """Parameters of a model and of one more effect after each trial step of the effect.

    Args:
      x: Parameters of the model, shape (n,).
      at: Parameters of the effect, shape (own,).
      steps: Trial steps (index, change) from there.

    Returns:
      One point per step, shape (n + own,) each.
    """
    points = []
    for k, step in steps:
        own = at.copy()
        own[k] += step
        points.append(np.concatenate([x, own]))
    return points


def screen_candidates(
    problem: Problem, current: Fit, candidates: Sequence[CandidateEffect], used: NDArray[np.bool_]
) -> list[ScreenedCandidate]:
    """Screen every candidate in each of its shapes; best shape only, sorted by share.

    Args:
      problem: The data.
      current: The model so far, fitted.
      candidates: Candidates to add.
      used: Blocks that count, shape (blocks,).
    """
    weight = huber_weights(problem, current.residual, used)
    low, high = problem.bounds(current.effects)
    box = (
        (low - current.x) / problem.scales(current.effects),
        (high - current.x) / problem.scales(current.effects),
    )
    known = np.column_stack([current.jacobian, current.residual.ravel()]) * weight[:, None]
    sums = normal_equations(current.jacobian, current.residual, weight)
    ground = ScreeningBaseline(current, weight, box, known, sums)
    found = []
    for candidate in candidates:
        options = [_screen_shape(problem, ground, candidate, shape) for shape in trial_shapes(candidate)]
        found.append(max(options, key=lambda s: s.share))
    return sorted(found, key=lambda s: -s.share)


@dataclass(frozen=True)
class ScreeningBaseline:
    """Current model against which candidates are screened."""

    current: Fit
    weight: Array
    """Diagonal of the weight matrix W, shape (rows,)."""
    box: tuple[Array, Array]
    """Lowest and highest step of each parameter in its scale, both of shape (parameters,)."""
    known: Array
    """W [J r], shape (rows, parameters + 1)."""
    sums: Array
    """Normal equations of `known`, shape (parameters + 1, parameters + 1)."""


def _screen_shape(
    problem: Problem, ground: ScreeningBaseline, candidate: CandidateEffect, shape: dict[int, float]
) -> ScreenedCandidate:
    """Share of the squared mismatch that one candidate in one shape explains to first order."""
    current, n = ground.current, len(ground.current.x)
    at, steps = vanished_point(candidate, shape)
    residuals = problem.residuals(trial_points(current.x, at, steps), (*current.effects, candidate))
    new = np.stack([(r - current.residual).ravel() for r in residuals], axis=1) * ground.weight[:, None]
    m = new.shape[1]
    sums = np.zeros((n + m + 1, n + m + 1))
    old = np.r_[0:n, n + m]
    sums[np.ix_(old, old)] = ground.sums
    sums[n : n + m, n : n + m] = new.T @ new
    sums[n : n + m, old] = new.T @ ground.known
    sums[old, n : n + m] = sums[n : n + m, old].T
    ends = np.array(
        [[(getattr(candidate.parameters[k], e) - at[k]) / s for k, s in steps] for e in ("low", "high")]
    )
    bounds = np.sort(ends, axis=0)
    precision, distance = problem.prior(current.x, current.effects)
    none = np.zeros(m)
    both = (np.concatenate([precision, none]), np.concatenate([distance, none]))
    box = (np.concatenate([ground.box[0], bounds[0]]), np.concatenate([ground.box[1], bounds[1]]))
    d = bounded_step(sums, box, both, 1e-6)
    full = np.append(d, 1.0)
    own = at.copy()
    for (k, step), size in zip(steps, d[n:], strict=True):
        own[k] += step * size
    start = np.concatenate([current.x + problem.scales(current.effects) * d[:n], own])
    whole = max(float(ground.sums[-1, -1]), 1e-30)
    return ScreenedCandidate(candidate, 1.0 - float(full @ sums @ full) / whole, start)


@dataclass(frozen=True)
class Sensitivities:
    """Weighted sensitivities to parameters and free forces, with the residual."""

    columns: Array
    """Columns [parameters, knots of every variable, residual], shape (rows, columns)."""
    prior: Array
    """Precision of each parameter in units of its column, shape (parameters,)."""
    variables: tuple[str, ...]


def sensitivities(problem: Problem, current: Fit, used: NDArray[np.bool_]) -> Sensitivities:
    """Sensitivities to the model's parameters and to free forces at the knots of the plant's variables.

    Args:
      problem: The data and the scale.
      current: The fitted model.
      used: Blocks in use, shape (blocks,).
    """
    weight = huber_weights(problem, current.residual, used)
    names = tuple(problem.replay.curves)
    curves: list[tuple[str, Array] | None] = [
        (name, 0.1 * problem.replay.curves[name] * row) for name in names for row in np.eye(KNOTS)
    ]
    moved = problem.residuals([current.x] * len(curves), current.effects, curves) if curves else []
    columns = [current.jacobian * weight[:, None]]
    columns += [((r - current.residual).ravel() * weight)[:, None] * 10.0 for r in moved]
    columns.append((current.residual.ravel() * weight)[:, None])
    low, high = problem.bounds(current.effects)
    own = len(problem.replay.base) + problem.has_twin_share
    prior = np.full(len(current.x), 1e-6)
    # a box of half-width a has the variance a²/3
    prior[:own] = 3.0 / np.maximum(0.5 * (high - low) / problem.scales(current.effects), 1e-9)[:own] ** 2
    return Sensitivities(np.hstack(columns), prior, names)


def _group_sums(columns: Array, groups: Groups, channels: int) -> Array:
    """Aᵀ A of every group, shape (groups, columns, columns)."""
    of_row = np.repeat(groups.of_block, channels)
    ones = np.ones(len(columns))
    parts = [of_row == g for g in range(groups.count)]
    return np.stack([weighted_gram(columns[p, :-1], columns[p, -1], ones[p]) for p in parts])


def _heldout_squares(sums: Array, own: int, penalty: Array, folds: list[NDArray[np.int_]]) -> Array:
    """Squared held-out residual per group of the linear model whose last column is the residual.

    Args:
      sums: Aᵀ A per group, shape (groups, columns + 1, columns + 1).
      own: Number of columns that belong to the model.
      penalty: Precision of each column, shape (columns,).
      folds: Groups left out together.
    """
    left = np.zeros(len(sums))
    total = sums[np.concatenate(folds)].sum(axis=0)
    for out in folds:
        rest = total - sums[out].sum(axis=0)
        d = np.linalg.solve(rest[:-1, :-1] + np.diag(penalty), -rest[:-1, -1])
        full = np.append(d, 1.0)
        for g in out:
            left[g] = max(full @ sums[g] @ full, 0.0)
    return left


def groups_of_folds(groups: Groups, folds: list[NDArray[np.bool_]]) -> list[NDArray[np.int_]]:
    """Groups left out by each fold, given as masks of shape (blocks,)."""
    return [np.unique(groups.of_block[out]) for out in folds]


@dataclass(frozen=True)
class CurveGains:
    """Gains of curves on held-out groups."""

    decoys: Array
    """Gains of random curves, shape (decoys,)."""
    flexible: dict[str, float]
    """Variable → gain of a free curve over it."""


def curve_gains(
    problem: Problem,
    found: Sensitivities,
    groups: Groups,
    folds: list[NDArray[np.bool_]],
    seed: int,
) -> CurveGains:
    """Held-out gains 1 − √(after/before) of random one-parameter curves and of free ones.

    Args:
      problem: Gives the number of channels.
      found: Sensitivities of the model and of free forces.
      groups: Groups of blocks.
      folds: Blocks left out in each fold, shape (blocks,) each.
      seed: Seed of the random curves.
    """
    outs, n = groups_of_folds(groups, folds), len(found.prior)
    sums = _group_sums(found.columns, groups, len(problem.replay.channels))
    last = sums.shape[1] - 1

    def pick(transform: Array, penalty: Array) -> float:
        small = transform.T @ sums @ transform
        return float(_heldout_squares(small, n, penalty, outs).sum())

    plain = np.zeros((last + 1, n + 1))
    plain[:n, :n], plain[last, n] = np.eye(n), 1.0
    before = pick(plain, found.prior)
    generator = np.random.default_rng(seed + 2)
    distance = np.subtract.outer(np.arange(KNOTS), np.arange(KNOTS))
    root = np.linalg.cholesky(np.exp(-0.5 * (distance / _REACH) ** 2) + 1e-6 * np.eye(KNOTS))
    decoys, flexible = [], {}
    for k in range(_DECOYS if found.variables else 0):
        first = n + KNOTS * (k % len(found.variables))
        mix = np.zeros((last + 1, n + 2))
        mix[:n, :n], mix[last, n + 1] = np.eye(n), 1.0
        mix[first : first + KNOTS, n] = root @ generator.standard_normal(KNOTS)
        decoys.append(1.0 - np.sqrt(pick(mix, np.append(found.prior, 1e-9)) / before))
    for k, name in enumerate(found.variables):
        first = n + KNOTS * k
        free = np.zeros((last + 1, n + KNOTS + 1))
        free[:n, :n], free[last, -1] = np.eye(n), 1.0
        free[first : first + KNOTS, n : n + KNOTS] = np.eye(KNOTS)
        penalty = np.append(found.prior, np.full(KNOTS, 1.0))
        flexible[name] = float(1.0 - np.sqrt(pick(free, penalty) / before))
    return CurveGains(np.array(decoys), flexible)
