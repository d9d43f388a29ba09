"""Bounded Gauss-Newton with pseudo-Huber weights: output-error fits of base and effects together."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import lsq_linear

from omnimj.estimate.replay.problem import ModelEffects, Problem
from omnimj.physics.native import kernel
from omnimj.signals import Array

# Sums of products over many rows, compiled: a library's threads only wait for each other on these.


@kernel
def weighted_gram(jacobian, residual, weight):
    """[J r]ᵀ W² [J r].

    Args:
      jacobian: J, shape (rows, parameters).
      residual: r, shape (rows,).
      weight: Diagonal of W, shape (rows,).

    Returns:
      Shape (parameters + 1, parameters + 1).
    """
    rows, n = jacobian.shape
    sums = np.zeros((n + 1, n + 1))
    row = np.empty(n + 1)
    for k in range(rows):
        w = weight[k]
        if w == 0.0:
            continue
        for i in range(n):
            row[i] = w * jacobian[k, i]
        row[n] = w * residual[k]
        for i in range(n + 1):
            value = row[i]
            for j in range(n + 1):
                sums[i, j] += value * row[j]
    return sums


_STEPS_PER_JACOBIAN = 4  # with one Jacobian
_STEP_LENGTHS = (1.0, 0.35)  # of the step, tried at once
_LEAST_DECREASE = 2e-3  # relative decrease of the loss below which a fit ends


@dataclass(frozen=True)
class Fit:
    """A fitted model."""

    effects: ModelEffects
    x: Array
    residual: Array
    """Whitened, shape (blocks, channels)."""
    jacobian: Array
    """d(residual)/d(x/scale) at (or one small step from) x, shape (blocks × channels, parameters)."""
    loss: float
    """Over the blocks that it was fitted to."""


def huber_weights(problem: Problem, residual: Array, used: NDArray[np.bool_]) -> Array:
    """Square roots of the weights of iteratively reweighted least squares, 0 on blocks that are not used."""
    w = (1.0 + (residual / problem.huber_scale) ** 2) ** -0.25
    return (w * used[:, None]).ravel()


def normal_equations(jacobian: Array, residual: Array, weight: Array) -> Array:
    """[J r]ᵀ W² [J r], shape (parameters + 1, parameters + 1)."""
    return weighted_gram(np.ascontiguousarray(jacobian), residual.ravel(), weight)


def bounded_step(
    sums: Array, bounds: tuple[Array, Array], prior: tuple[Array, Array], damping: float
) -> Array:
    """argmin |W (r + J d)|² + p (d + e)² + damping Σ |W J_k|² d_k² inside the bounds, shape (parameters,).

    Args:
      sums: `normal_equations`.
      bounds: Lowest and highest d.
      prior: Precision p and distance e from the nominal value.
      damping: Relative to the squared columns.
    """
    low, high = bounds
    gram, slope = sums[:-1, :-1].copy(), sums[:-1, -1] + prior[0] * prior[1]
    diagonal = gram.diagonal() + prior[0]
    gram[np.diag_indices_from(gram)] = diagonal * (1.0 + damping) + 1e-9 * max(diagonal.max(), 1e-30)
    free = np.asarray(np.linalg.solve(gram, -slope), float)
    if (free >= low).all() and (free <= high).all():
        return free
    root = np.linalg.cholesky(gram).T
    target = np.linalg.solve(root.T, -slope)
    tiny = 1e-12
    return lsq_linear(root, target, bounds=(low - tiny, high + tiny), method="bvls").x


def _objective(
    problem: Problem, effects: ModelEffects, x: Array, residual: Array, used: NDArray[np.bool_]
) -> float:
    precision, distance = problem.prior(x, effects)
    return float(problem.losses(residual)[used].sum() + (precision * distance**2).sum())


def fit(
    problem: Problem,
    effects: ModelEffects,
    start: Array,
    used: NDArray[np.bool_],
    rounds: int = 3,
    known: Array | None = None,
) -> Fit:
    """Fits every parameter to the blocks in use.

    In each round a few steps share one Jacobian, kept up by Broyden's update J += (Δr − J Δd) Δdᵀ/|Δd|².

    Args:
      problem: The data and the scale.
      effects: The effects in the model.
      start: Where to begin, shape (parameters,).
      used: Which blocks count, shape (blocks,).
      rounds: How often the Jacobian is made anew.
      known: Jacobian of the first parameters near the start, shape (rows, some); spares the first round's.
    """
    low, high = problem.bounds(effects)
    x = np.clip(start, low, high)
    (residual,) = problem.residuals([x], effects)
    loss = _objective(problem, effects, x, residual, used)
    jacobian = np.zeros((residual.size, 0)) if known is None else known
    for turn in range(rounds):
        first = jacobian.shape[1] if turn == 0 else 0
        own = problem.jacobian(x, effects, range(first, len(x)))
        jacobian = np.hstack([jacobian[:, :first], own])
        before = loss
        x, residual, loss, jacobian = _descend(problem, effects, x, residual, loss, jacobian, used)
        if before - loss < _LEAST_DECREASE * before:
            break
    return Fit(effects, x, residual, jacobian, loss)


def _descend(
    problem: Problem,
    effects: ModelEffects,
    x: Array,
    residual: Array,
    loss: float,
    jacobian: Array,
    used: NDArray[np.bool_],
) -> tuple[Array, Array, float, Array]:
    """Steps with one Jacobian until they gain little: x, residual, loss, Jacobian."""
    low, high = problem.bounds(effects)
    scales, damping = problem.scales(effects), 1e-4
    for _ in range(_STEPS_PER_JACOBIAN):
        weight = huber_weights(problem, residual, used)
        box = (low - x) / scales, (high - x) / scales
        sums = normal_equations(jacobian, residual, weight)
        step = bounded_step(sums, box, problem.prior(x, effects), damping)
        trials = [np.clip(x + length * scales * step, low, high) for length in _STEP_LENGTHS]
        tried = problem.residuals(trials, effects)
        losses = [_objective(problem, effects, *pair, used) for pair in zip(trials, tried, strict=True)]
        best = int(np.argmin(losses))
        moved = (trials[best] - x) / scales
        length = float(moved @ moved)
        if length > 0.0:
            surprise = (tried[best] - residual).ravel() - jacobian @ moved
            jacobian = jacobian + np.outer(surprise, moved / length)
        if losses[best] >= loss:
            damping *= 100.0
            continue
        gained = (loss - losses[best]) / loss
        x, residual, loss, damping = trials[best], tried[best], losses[best], max(damping / 10.0, 1e-6)
        if gained < _LEAST_DECREASE:
            break
    return x, residual, loss, jacobian


def reevaluate(fitted: Fit, problem: Problem) -> Fit:
    """The same fit seen by a problem with another noise or offset: residual and Jacobian made anew."""
    (residual,) = problem.residuals([fitted.x], fitted.effects)
    return replace(fitted, residual=residual, jacobian=problem.jacobian(fitted.x, fitted.effects))
