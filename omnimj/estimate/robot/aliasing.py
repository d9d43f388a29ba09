"""What aliasing of the currents may have done to an estimate.

Loops answer to noise of the sensors faster than a slow log samples. Noise in the predictors makes what they
multiply seem too small: with errors of covariance Q of the filtered currents it adds
n = ½ ∂/∂x tr(S D Q Dᵀ) to the gradient of the sum of squares, D = M⁻¹ B K the accelerations per ampere and S
the rows' weights. Without it the estimate would move by δ = (H − N)⁻¹ n with N = ∂n/∂x (Söderström,
Errors-in-variables methods in system identification, Automatica 43, 2007).

Such noise is common to all motors, as the yaw loop's answer to the gyro is: it turns the body, and only the
yaw inertia is changed, which it makes too large. How much of a ripple is an error can only be guessed from a
log itself: the share η of δ that is due has the prior N(1/2, 1/4), and the prior of the unknowns at x + η δ
decides further.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from scipy.linalg import eigh

from omnimj.estimate.robot.balance import inertia_matrix
from omnimj.estimate.robot.blocks import RunRows
from omnimj.estimate.robot.fit import RobotFit, row_weights
from omnimj.signals import Array

_STEP = 1e-3  # of a prior's deviation, for derivatives
_MOST = 0.8  # largest share of the information that errors of the currents may take out


def without_aliasing(fit: RobotFit, rows: Sequence[RunRows]) -> tuple[RobotFit, Array]:
    """The fit with what aliasing of the currents may have done taken out as far as the prior favours it.

    Args:
      fit: The fitted robot.
      rows: Rows of its runs.

    Returns:
      The fit at x + η δ, and the deviation of η times δ, shape (p,).
    """
    change = _change(fit, rows)
    pull = fit.precision * change
    certainty = 4.0 + float(pull @ change)
    share = (2.0 - float(pull @ fit.x)) / certainty
    return replace(fit, x=fit.x + share * change), change / math.sqrt(certainty)


def _change(fit: RobotFit, rows: Sequence[RunRows]) -> Array:
    """Change δ of the yaw inertia, were the currents' errors by aliasing taken out, shape (p,)."""
    noise = [_sums_of_noise(fit, run) for run in rows]
    gram, slope = (np.sum(part, axis=0) for part in zip(*noise, strict=True))
    information = fit.information + np.diag(fit.precision)
    largest = float(eigh(gram, information, eigvals_only=True)[-1])
    share = min(1.0, _MOST / largest) if largest > 0.0 else 1.0
    change = share * np.linalg.solve(information - share * gram, slope)
    change[[name != "yaw_inertia" for name in fit.unknowns.names]] = 0.0
    return np.asarray(change, float)


def _sums_of_noise(fit: RobotFit, run: RunRows) -> tuple[Array, Array]:
    """N and n of one run, shapes (p, p) and (p,)."""
    weight = row_weights(fit, run)

    def gain(x: Array) -> Array:
        c = fit.unknowns.constants(x).robot
        return np.linalg.inv(inertia_matrix(c)) @ (c.forces * c.torque)

    here, changes = gain(fit.x), []
    for k, size in enumerate(_STEP * fit.unknowns.spread):
        step = np.zeros(len(fit.x))
        step[k] = size
        changes.append((gain(fit.x + step) - here) / size)
    weighted = np.array([weight @ change @ run.aliased for change in changes])
    return np.einsum("kij,lij->kl", weighted, np.array(changes)), np.einsum("kij,ij->k", weighted, here)
