"""Levenberg-Marquardt for one floor; each run's own radius is eliminated and costs one more column."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from omnimj.identification.floor_problem import (
    EXPECTED_JACOBIAN,
    MU_C,
    MU_S,
    SHARED,
    V_S,
    FloorProblem,
    Jacobian,
    expected,
)
from omnimj.signals import Array

_LONGEST = 1.0  # step in a logarithm
_MOST_ROUNDS = 40
_FEW_ROUNDS = 8  # on a walk, where the next fit begins at the last one's end
_SETTLED = 1e-6  # relative change of the cost
_FIRST_DAMPING, _LEAST_DAMPING, _MOST_DAMPING = 1e-2, 1e-9, 1e8
_STARTS = (3e-3, 0.05, 0.5)  # [m/s] of V_s: the cost has more than one valley along it


@dataclass(frozen=True)
class Fit:
    """Where a fit ended."""

    problem: FloorProblem
    shared: Array
    """Shape (SHARED,)."""
    own: Array
    """Each run's deviation of the radius, shape (runs,)."""
    residuals: tuple[Array, ...]
    cost: float
    """Σ of squares, expectations included."""

    @property
    def data_cost(self) -> float:
        """Σ of squares of the runs alone."""
        return float(sum(r @ r for r in self.residuals))


def solve(
    problem: FloorProblem,
    start: Array,
    own: Array | None = None,
    basis: Array | None = None,
    rounds: int = _MOST_ROUNDS,
) -> Fit:
    """Fits from one start.

    Args:
      problem: The runs.
      start: Shape (SHARED,).
      own: Deviations of the radius to start from, shape (runs,); zero when None.
      basis: Directions along which the shared unknowns may move, shape (SHARED, p); all when None.
      rounds: Steps at most.
    """
    basis = np.eye(SHARED) if basis is None else basis
    fit = _at(problem, start, np.zeros(len(problem.runs)) if own is None else own)
    damping = _FIRST_DAMPING
    for _ in range(rounds):
        jacobians = problem.jacobians(fit.shared, fit.own)
        before = fit.cost
        while damping < _MOST_DAMPING:
            shared, own = _step(fit, jacobians, basis, damping)
            tried = _at(problem, shared, own)
            if tried.cost < before:
                fit, damping = tried, max(damping / 5.0, _LEAST_DAMPING)
                break
            damping *= 4.0
        if before - fit.cost < _SETTLED * before:
            break
    return fit


def solve_from_many(problem: FloorProblem, start: Array) -> Fit:
    """The best fit out of several starts in V_s."""
    fits = []
    for speed in _STARTS:
        begin = start.copy()
        begin[V_S] = np.log(speed)
        fits.append(solve(problem, begin))
    return min(fits, key=lambda fit: fit.cost)


def without_stribeck(fit: Fit) -> Fit:
    """The fit with μ_s = μ_c, V_s without effect."""
    start = fit.shared.copy()
    start[MU_S] = start[MU_C]
    basis = np.delete(np.eye(SHARED), (MU_S, V_S), axis=1)
    basis[MU_S, MU_C] = 1.0
    return solve(fit.problem, start, fit.own, basis)


def with_fixed(fit: Fit, index: int, value: float, start: Fit) -> Fit:
    """The fit with one of the shared unknowns held at a value, from where another one ended."""
    shared = start.shared.copy()
    shared[index] = value
    basis = np.delete(np.eye(SHARED), index, axis=1)
    return solve(fit.problem, shared, start.own, basis, _FEW_ROUNDS)


def _at(problem: FloorProblem, shared: Array, own: Array) -> Fit:
    residuals = tuple(problem.residuals(shared, own))
    away = expected(shared)
    cost = float(sum(r @ r for r in residuals) + away @ away)
    return Fit(problem, shared, own, residuals, cost if np.isfinite(cost) else np.inf)


def _step(fit: Fit, jacobians: Sequence[Jacobian], basis: Array, damping: float) -> tuple[Array, Array]:
    prior = EXPECTED_JACOBIAN @ basis
    normal, gradient = prior.T @ prior, prior.T @ expected(fit.shared)
    normal += damping * np.diag(np.diag(normal))
    kept = []
    for jacobian, residual in zip(jacobians, fit.residuals, strict=True):
        shared, own = jacobian.shared @ basis, jacobian.own
        weight, mixed, own_gradient = (1.0 + damping) * (own @ own), shared.T @ own, own @ residual
        normal += shared.T @ shared - np.outer(mixed, mixed) / weight
        normal += damping * np.diag((shared * shared).sum(axis=0))
        gradient += shared.T @ residual - mixed * own_gradient / weight
        kept.append((mixed, weight, own_gradient))
    step = np.clip(-np.linalg.solve(normal, gradient), -_LONGEST, _LONGEST)
    own_step = [-(slope + mixed @ step) / weight for mixed, weight, slope in kept]
    return fit.shared + basis @ step, fit.own + np.array(own_step)
