"""Bounded, damped Gauss-Newton solver for the search for a gap and for the identification of floors.

A problem supplies residuals, their Jacobian and the normal equations; the solver never reads the Jacobian
itself, so a problem may store it in any sparse form. In each round a few steps share one Jacobian.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Generic, Protocol, TypeVar

import numpy as np
from scipy.optimize import lsq_linear

from omnimj.physics.native import kernel
from omnimj.signals import Array

_STEPS_PER_JACOBIAN = 4
_STEP_LENGTHS = (1.0, 0.35)  # step lengths relative to the Gauss-Newton step, evaluated together
_FIRST_DAMPING, _LEAST_DAMPING = 1e-4, 1e-6

J = TypeVar("J")


class LeastSquares(Protocol[J]):
    """Least-squares problem in n parameters."""

    def bounds(self) -> tuple[Array, Array]:
        """Return the lowest and the highest value of each parameter, both of shape (n,)."""
        ...

    def scales(self) -> Array:
        """Return the natural size of a change of each parameter, shape (n,)."""
        ...

    def prior(self, x: Array) -> tuple[Array, Array]:
        """Return the precision of each parameter and its distance from nominal.

        Args:
          x: Parameters, shape (n,).

        Returns:
          Precision and distance, both in the scale of the parameter and of shape (n,).
        """
        ...

    def residuals(self, points: Sequence[Array]) -> list[Array]:
        """Compute the weighted or whitened residuals at several points.

        Args:
          points: Parameters of each point, shape (n,) each.

        Returns:
          One array per point, in a shape that the problem chooses.
        """
        ...

    def loss(self, x: Array, residual: Array) -> float:
        """Compute the value to be minimised, prior included.

        Args:
          x: Parameters, shape (n,).
          residual: Residual at x, as `residuals` returns it.
        """
        ...

    def jacobian(self, x: Array, known: J | None) -> J:
        """Compute d(residual)/d(x/scale).

        Args:
          x: Parameters, shape (n,).
          known: Leading columns that are already computed; None without any.
        """
        ...

    def update(self, jacobian: J, residual: Array, moved: Array, step: Array) -> J:
        """Update the Jacobian after a step, or return the old one.

        Args:
          jacobian: Jacobian before the step.
          residual: Residual before the step, as `residuals` returns it.
          moved: Residual after the step.
          step: Change of the parameters in units of `scales`, shape (n,).
        """
        ...

    def normal_equations(self, jacobian: J, residual: Array) -> Array:
        """Form the normal equations [J r]ᵀ W² [J r].

        Args:
          jacobian: Jacobian J of the residual.
          residual: Residual r, as `residuals` returns it.

        Returns:
          Shape (n + 1, n + 1), for n parameters.
        """
        ...


@dataclass(frozen=True)
class Minimum(Generic[J]):
    """Point at which a minimisation ended."""

    x: Array
    """Parameters, shape (n,)."""
    residual: Array
    """Weighted or whitened residual at x, as the problem returns it."""
    jacobian: J
    loss: float


def minimise(
    problem: LeastSquares[J],
    start: Array,
    *,
    rounds: int = 3,
    known: J | None = None,
    tolerance: float = 2e-3,
    longest: float = np.inf,
    ridge: float = 1e-9,
) -> Minimum[J]:
    """Minimise the loss of a problem from a point of shape (n,).

    Args:
      rounds: Largest number of Jacobians.
      known: Jacobian of the leading parameters near the start, if already computed.
      tolerance: Relative decrease of the loss below which the minimisation ends.
      longest: Longest step of a parameter.
      ridge: Share of the largest squared column added to all; keeps singular problems solvable.

    Returns:
      The point with the smallest loss found.

    Raises:
      ValueError: `rounds` is 0.
    """
    low, high = problem.bounds()
    x = np.clip(start, low, high)
    (residual,) = problem.residuals([x])
    loss = problem.loss(x, residual)
    jacobian = known
    for turn in range(rounds):
        jacobian = problem.jacobian(x, jacobian if turn == 0 else None)
        before = loss
        x, residual, loss, jacobian = _descend(
            problem, Minimum(x, residual, jacobian, loss), tolerance, longest, ridge
        )
        if before - loss < tolerance * before:
            break
    if jacobian is None:
        raise ValueError("at least one round is needed")
    return Minimum(x, residual, jacobian, loss)


def _descend(
    problem: LeastSquares[J], at: Minimum[J], tolerance: float, longest: float, ridge: float
) -> tuple[Array, Array, float, J]:
    """Take steps with one Jacobian until they gain little; return x, residual, loss and Jacobian."""
    low, high = problem.bounds()
    scales, damping = problem.scales(), _FIRST_DAMPING
    x, residual, jacobian, loss = at.x, at.residual, at.jacobian, at.loss
    for _ in range(_STEPS_PER_JACOBIAN):
        box = np.maximum(low - x, -longest) / scales, np.minimum(high - x, longest) / scales
        sums = problem.normal_equations(jacobian, residual)
        step = bounded_step(sums, box, problem.prior(x), damping, ridge)
        points = [np.clip(x + length * scales * step, low, high) for length in _STEP_LENGTHS]
        found = problem.residuals(points)
        losses = [problem.loss(*pair) for pair in zip(points, found, strict=True)]
        best = int(np.argmin(losses))
        jacobian = problem.update(jacobian, residual, found[best], (points[best] - x) / scales)
        if losses[best] >= loss:
            damping *= 100.0
            continue
        gained = (loss - losses[best]) / loss
        x, residual, loss = points[best], found[best], losses[best]
        damping = max(damping / 10.0, _LEAST_DAMPING)
        if gained < tolerance:
            break
    return x, residual, loss, jacobian


def bounded_step(
    sums: Array,
    bounds: tuple[Array, Array],
    prior: tuple[Array, Array],
    damping: float,
    ridge: float = 1e-9,
) -> Array:
    """Step d that minimises |W (r + J d)|² + p (d + e)² + damping Σ |W J_k|² d_k² inside the bounds.

    Args:
      sums: Normal equations [J r]ᵀ W² [J r], shape (n + 1, n + 1).
      bounds: Lowest and highest d, both of shape (n,).
      prior: Precision p and distance e from the nominal value, both of shape (n,).
      damping: Levenberg-Marquardt damping relative to the squared columns.
      ridge: Share of the largest squared column added to all.

    Returns:
      d, shape (n,).
    """
    low, high = bounds
    gram, slope = sums[:-1, :-1].copy(), sums[:-1, -1] + prior[0] * prior[1]
    diagonal = gram.diagonal() + prior[0]
    gram[np.diag_indices_from(gram)] = diagonal * (1.0 + damping) + ridge * max(diagonal.max(), 1e-30)
    free = np.asarray(np.linalg.solve(gram, -slope), float)
    if (free >= low).all() and (free <= high).all():
        return free
    root = np.linalg.cholesky(gram).T
    target = np.linalg.solve(root.T, -slope)
    tiny = 1e-12
    return lsq_linear(root, target, bounds=(low - tiny, high + tiny), method="bvls").x


def normal_equations(jacobian: Array, residual: Array, weight: Array) -> Array:
    """Normal equations [J r]ᵀ W² [J r], shape (n + 1, n + 1).

    Args:
      jacobian: J, shape (rows, n).
      residual: r, any shape with as many entries as rows.
      weight: Diagonal of W, shape (rows,).
    """
    return weighted_gram(np.ascontiguousarray(jacobian), residual.ravel(), weight)


@kernel
def weighted_gram(jacobian, residual, weight):
    """`normal_equations`; for tall, narrow matrices faster than a multithreaded BLAS."""
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
