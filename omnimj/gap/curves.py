"""Free curves: a force over one variable. Random ones are decoys, fitted ones say what a library lacks.

All to first order: the sensitivities of the prediction to the force at each knot stand beside those of the
model's own parameters, whose boxes become a prior of the same width; held-out losses follow from sums over
the groups alone.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from omnimj.gap.fit import Fit, weights_of
from omnimj.gap.heldout import Groups
from omnimj.gap.problem import Problem
from omnimj.gap.replay import KNOTS
from omnimj.gap.sums import weighted_sums
from omnimj.signals import Array

_DECOYS = 100
_REACH = 1.5  # knots over which a random curve is alike


@dataclass(frozen=True)
class Sensitivities:
    """Weighted columns [parameters, knots of every variable, residual], ready for sums over groups."""

    columns: Array
    prior: Array
    """Precision of each parameter in units of its column, shape (parameters,)."""
    variables: tuple[str, ...]


def sensitivities(problem: Problem, current: Fit, used: NDArray[np.bool_]) -> Sensitivities:
    """Of the current model and of a free force at the knots of every variable of the plant."""
    weight = weights_of(problem, current.residual, used)
    names = tuple(problem.replay.curves)
    curves: list[tuple[str, Array] | None] = [
        (name, 0.1 * problem.replay.curves[name] * row) for name in names for row in np.eye(KNOTS)
    ]
    moved = problem.residuals([current.x] * len(curves), current.form, curves) if curves else []
    columns = [current.jacobian * weight[:, None]]
    columns += [((r - current.residual).ravel() * weight)[:, None] * 10.0 for r in moved]
    columns.append((current.residual.ravel() * weight)[:, None])
    low, high = problem.bounds(current.form)
    own = len(problem.replay.base) + problem.has_share
    prior = np.full(len(current.x), 1e-6)
    # a box of half-width a has the variance a²/3
    prior[:own] = 3.0 / np.maximum(0.5 * (high - low) / problem.scales(current.form), 1e-9)[:own] ** 2
    return Sensitivities(np.hstack(columns), prior, names)


def _sums(columns: Array, groups: Groups, channels: int) -> Array:
    """Aᵀ A of every group, shape (groups, columns, columns)."""
    of_row = np.repeat(groups.of_block, channels)
    ones = np.ones(len(columns))
    parts = [of_row == g for g in range(groups.count)]
    return np.stack([weighted_sums(columns[p, :-1], columns[p, -1], ones[p]) for p in parts])


def _heldout(sums: Array, own: int, penalty: Array, folds: list[NDArray[np.int_]]) -> Array:
    """Squared held-out residual per group of the linear model whose last column is the residual.

    Args:
      sums: Aᵀ A per group, shape (groups, columns + 1, columns + 1).
      own: Not used columns come after these; all columns but the last are fitted.
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
    """Groups that each fold leaves out."""
    return [np.unique(groups.of_block[out]) for out in folds]


@dataclass(frozen=True)
class CurveGains:
    """What curves gain on held-out groups."""

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
    """Held-out gains 1 − √(after/before) of random one-parameter curves and of free ones."""
    outs, n = groups_of_folds(groups, folds), len(found.prior)
    sums = _sums(found.columns, groups, len(problem.replay.channels))
    last = sums.shape[1] - 1

    def pick(transform: Array, penalty: Array) -> float:
        small = transform.T @ sums @ transform
        return float(_heldout(small, n, penalty, outs).sum())

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
