"""Intervals of what is estimated of a robot: whole runs left out in turn, and the prior's own doubt.

  V = (k − 1)/k Σ_runs δ δᵀ + H⁻¹ P H⁻¹,   δ = (H − H_run)⁻¹ s_run
to first order, with H the information of data and prior, P that of the prior, H_run and s_run the parts of
one run. The misfit of a law repeats within a run, so that only whole runs count as independent (MacKinnon
and White 1985). What aliasing may have changed is added, and what another inertia of the wheels would change.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.stats import t as student

from omnimj.estimate.intervals import at_least
from omnimj.estimate.robot.blocks import RunRows
from omnimj.estimate.robot.fit import RobotFit, run_sums
from omnimj.signals import Array

LEVEL = 0.90
"""Probability of the intervals."""
WHEEL_INERTIA_SPREAD = 0.1
"""Relative standard deviation of the inertia of wheel, gear and rotor: data sheets seldom give all of it."""
_HELD = 0.005  # share of its information that a run keeps when it is left out
_STEP = 1e-4
_INERTIA_STEP = 1e-3

Quantity = Callable[[Array], float]
"""Number that follows from a vector of deviations."""


@dataclass(frozen=True)
class Doubt:
    """Uncertainty of a fitted robot."""

    fit: RobotFit
    covariance: Array
    """V, shape (p, p)."""
    factor: float
    """Half-width of an interval over its standard deviation: Student's t for as many runs."""

    def interval(self, quantity: Quantity) -> tuple[float, float, float]:
        """Value of a quantity, and the ends of its interval."""
        value, slope = quantity(self.fit.x), gradient(self.fit, quantity)
        half = self.factor * float(np.sqrt(slope @ self.covariance @ slope))
        return value, value - half, value + half

    def left_of_prior(self, quantity: Quantity) -> float:
        """Ratio of posterior to prior standard deviation of a quantity, 0 … 1."""
        slope = gradient(self.fit, quantity)
        before = float(np.sqrt(np.sum(slope**2 / self.fit.precision)))
        after = float(np.sqrt(slope @ self.fit.covariance @ slope))
        return after / before if before > 0.0 else 0.0


def gradient(fit: RobotFit, quantity: Quantity) -> Array:
    """Gradient of a quantity at the estimate by central differences, shape (p,)."""
    found = np.zeros(len(fit.x))
    for k, size in enumerate(_STEP * fit.unknowns.spread):
        step = np.zeros(len(found))
        step[k] = size
        found[k] = (quantity(fit.x + step) - quantity(fit.x - step)) / (2.0 * size)
    return found


def doubt_by_wheel_inertia(fit: RobotFit, rows: Sequence[RunRows]) -> Array:
    """Deviation of the estimate by that of the wheels' inertia, −H⁻¹ ∂²f/∂x∂(ln I) σ, shape (p,).

    The inertia is not estimated: errors of the small forces that it makes would spoil it.
    """
    unknowns, noise = fit.unknowns, fit.noise * np.sqrt(fit.memory)
    robot, size = unknowns.nominal.robot, 1.0 + _INERTIA_STEP
    heavier = unknowns.nominal._replace(
        robot=robot._replace(inertia=size * robot.inertia), rotor=size * unknowns.nominal.rotor
    )
    slopes = [
        np.sum([run_sums(one, fit.x, noise, run).slope for run in rows], axis=0)
        for one in (unknowns, replace(unknowns, nominal=heavier))
    ]
    hessian = fit.information + np.diag(fit.precision)
    moved = -np.linalg.solve(hessian, slopes[1] - slopes[0]) / _INERTIA_STEP
    return np.asarray(WHEEL_INERTIA_SPREAD * moved, float)


def doubt_of(fit: RobotFit, others: Sequence[Array]) -> Doubt:
    """Uncertainty of a fitted robot from the scatter between its runs.

    Args:
      others: Deviations of its numbers by what no scatter shows, each of shape (p,).
    """
    hessian, count = fit.information + np.diag(fit.precision), len(fit.runs)
    total = np.zeros_like(hessian)
    for run in fit.runs if count > 1 else ():
        # what only this run determines stays within reach of the fit of all
        moved = np.linalg.solve(hessian - (1.0 - _HELD) * run.gram, run.slope)
        total += np.outer(moved, moved)
    inverse = np.linalg.inv(hessian)
    between = total * (count - 1) / count + inverse @ np.diag(fit.precision) @ inverse
    covariance = at_least(between, np.asarray(inverse, float))  # what the residuals' own noise makes
    covariance += np.sum([np.outer(one, one) for one in others], axis=0)
    return Doubt(fit, covariance, float(student.ppf(0.5 * (1.0 + LEVEL), max(count - 1, 2))))
