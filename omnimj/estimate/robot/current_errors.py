"""Bias of an estimate by errors of the measured currents, removed.

Noise in the predictors makes what they multiply seem too small: with errors of covariance Q of the filtered
currents it adds n = ½ ∂/∂x Σ_rows tr(S D Q Dᵀ) to the gradient of the sum of squares, D = M⁻¹ B ∂F/∂i the
accelerations per ampere and S a row's weight. Without it the estimate moves by δ = (H − N)⁻¹ n with N = ∂n/∂x
(Söderström, Errors-in-variables methods in system identification, Automatica 43, 2007).

Noise of the monitors is known from the model file, and all of δ is due. Without that the inertia of the
wheels, which little in a log shows, would come out far too small.

Aliasing: loops answer to noise of the sensors faster than a slow log samples. Such errors are common to all
motors, as the yaw loop's answer to the gyro is: they turn the body, and only the yaw inertia is changed,
which they make too large. How much of a ripple is an error can only be guessed from a log itself: the share
η of δ that is due has the prior N(1/2, 1/4), and the prior of the unknowns at x + η δ decides further.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from scipy.linalg import eigh

from omnimj.estimate.robot.balance import inertia_matrix, wheel_forces
from omnimj.estimate.robot.blocks import RunRows
from omnimj.estimate.robot.fit import RobotFit, newton_step, row_whitening, run_sums
from omnimj.estimate.robot.unknowns import Unknowns
from omnimj.signals import Array

_STEP = 1e-3  # of a prior's deviation, for derivatives
_AMPERE = 0.01  # [A] step for the derivative by the current
_ROUNDS = 3  # steps of Newton's method
_MOST = 0.8  # largest share of the information that errors of the currents may take out


def without_noise(fit: RobotFit, rows: Sequence[RunRows]) -> RobotFit:
    """Remove the bias by noise of the current monitors from a fit."""
    noise = fit.noise * np.sqrt(fit.memory)
    for _ in range(_ROUNDS):
        errors = [_sums_of(fit, run, run.current_noise) for run in rows]
        share = _removed(fit, [gram for gram, _ in errors])
        sums = tuple(
            replace(one, gram=one.gram - share * gram, slope=one.slope - share * slope)
            for one, (gram, slope) in zip(
                (run_sums(fit.unknowns, fit.x, noise, run) for run in rows), errors, strict=True
            )
        )
        fit = replace(fit, x=fit.x + newton_step(fit.unknowns, fit.x, sums), runs=sums)
    return fit


def without_aliasing(fit: RobotFit, rows: Sequence[RunRows]) -> tuple[RobotFit, Array]:
    """Remove the bias by aliasing of the currents from a fit as far as the prior favours it.

    Returns:
      The fit at x + η δ, and the deviation of η times δ, shape (p,).
    """
    errors = [_sums_of(fit, run, run.aliased) for run in rows]
    removed = _removed(fit, [gram for gram, _ in errors])
    gram, slope = (removed * np.sum(part, axis=0) for part in zip(*errors, strict=True))
    information = fit.information + np.diag(fit.precision)
    change = np.asarray(np.linalg.solve(information - gram, slope), float)
    change[[name != "yaw_inertia" for name in fit.unknowns.names]] = 0.0
    # the logs alone would say so; their prior then moves everything that goes along with the yaw inertia
    change = np.asarray(np.linalg.solve(information, fit.information @ change), float)
    pull = fit.precision * change
    certainty = 4.0 + float(pull @ change)
    share = (2.0 - float(pull @ fit.x)) / certainty
    return replace(fit, x=fit.x + share * change), change / math.sqrt(certainty)


def _removed(fit: RobotFit, grams: Sequence[Array]) -> float:
    """Share of the errors' N and n that is taken out: less than 1 where little information would be left."""
    information = fit.information + np.diag(fit.precision)
    largest = float(eigh(np.sum(grams, axis=0), information, eigvals_only=True)[-1])
    return min(1.0, _MOST / largest) if largest > 0.0 else 1.0


def _sums_of(fit: RobotFit, run: RunRows, covariance: Array) -> tuple[Array, Array]:
    """N and n of one run for currents with errors of some covariance, shapes (p, p) and (p,)."""
    whiten, root = row_whitening(fit, run), _root(covariance)

    def errors(x: Array) -> Array:
        return np.asarray(whiten @ _gain(fit.unknowns, x, run) @ root, float).ravel()

    here, changes = errors(fit.x), []
    for k, size in enumerate(_STEP * fit.unknowns.spread):
        step = np.zeros(len(fit.x))
        step[k] = size
        changes.append((errors(fit.x + step) - here) / size)
    table = np.array(changes)
    return table @ table.T, table @ here


def _root(covariance: Array) -> Array:
    """R with R Rᵀ = Q, shape (n, n)."""
    values, vectors = np.linalg.eigh(covariance)
    return np.asarray(vectors * np.sqrt(np.maximum(values, 0.0)), float)


def _gain(unknowns: Unknowns, x: Array, run: RunRows) -> Array:
    """Accelerations per ampere D = M⁻¹ B ∂F/∂i in each row, shape (m, 3, n); a driven gear amplifies."""
    constants, errors = unknowns.constants(x), unknowns.errors(x)
    c = constants.robot
    shifted = (errors._replace(current=errors.current + step) for step in (-_AMPERE, _AMPERE))
    higher, lower = (wheel_forces(constants, one, run) for one in shifted)
    slope = (higher - lower) / (2.0 * _AMPERE)
    return np.linalg.inv(inertia_matrix(c)) @ (c.forces * slope[:, None, :])
