"""Parameters of the force channel learnt over minutes: a Kalman filter of θ under a random walk.

The prior is the spread of parts and payload of healthy robots.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from omnimj.control.detection.robust.glr import inverted
from omnimj.physics.native import kernel
from omnimj.signals import Array

LOSS, FRICTION, BIAS, ROLLERS, LOADED, INERTIA = 0.02, 0.13, 0.02, 0.15, 0.12, 0.1
"""Standard deviations in health: δ, ν, β [m/s²], λ, μ, ι."""
GEAR, VISCOUS, CENTRE = 0.4, 1.0, 0.01
"""The same: γ, κ, c [m]."""
STICTION = 0.6
"""Standard deviation of h and k: anything between −1 and 1."""
STICTION_LEARNING = 6.0
"""The same while learning: a wheel at rest holds the same friction for seconds, from which nothing may be
learnt."""
INFORMATIVE = 0.9
"""Share of the prior deviation of δ below which a drive has been informative about it."""
SIGNIFICANT = 4.0
"""Standard deviations by which a learnt loss must differ from 0: most wandering estimates are below them."""
LOSS_VARIES, FRICTION_VARIES = 0.01, 0.1
"""Standard deviations of δ and ν from one window to the next."""
FAULTY_LOSS_VARIES, FAULTY_FRICTION_VARIES = 0.05, 0.5
"""The same of a motor that is known to be degraded."""
FAULTY_LOSS_WALK = 0.1
"""Random walk of δ of a motor that is known to be degraded in a minute, as standard deviation."""


class ParameterModel(NamedTuple):
    """Random walk of θ and the sizes of its jumps."""

    walk: Array
    """Variance that θ gains per block, shape (p,)."""
    short_term: Array
    """Variance of θ from window to window, shape (p,)."""
    smallest: Array
    """Smallest jump per hypothesis δ, ν, β, shape (2n+2,)."""
    largest: Array
    """Largest jump per hypothesis, shape (2n+2,)."""


def parameter_model(wheels: int, period: float, memory: float) -> ParameterModel:
    """Model of a healthy robot.

    Args:
      wheels: n.
      period: Duration of a block [s].
      memory: Time in which a parameter may wander by its own prior deviation [s].
    """
    return ParameterModel(
        walk=prior_deviation(wheels) ** 2 * (period / memory),
        short_term=short_term_deviation(wheels) ** 2,
        smallest=np.array([0.03] * wheels + [0.3] * wheels + [-5.0] * 2),
        largest=np.array([1.0] * wheels + [40.0] * wheels + [5.0] * 2),
    )


@kernel
def with_degraded_motors(model, degraded, period):
    """Model in which the laws of degraded motors are known less well and change faster; losses may come back.

    Args:
      model: `ParameterModel` of the healthy robot.
      degraded: Mask of the degraded motors, shape (n,).
      period: Duration of a block [s].
    """
    n = degraded.size
    walk, short_term, smallest = model.walk.copy(), model.short_term.copy(), model.smallest.copy()
    for i in range(n):
        if degraded[i]:
            walk[i] += FAULTY_LOSS_WALK**2 * period / 60.0
            short_term[i] += FAULTY_LOSS_VARIES**2
            short_term[n + i] += FAULTY_FRICTION_VARIES**2
            smallest[i] = -1.0
    return ParameterModel(walk, short_term, smallest, model.largest)


@kernel
def significant_losses(theta, cov, wheels):
    """Losses δ of the motors about which the drive has been informative, shape (n,); 0 for the others.

    A steady drive is not informative: mass, friction and torque constants trade with each other, and δ
    wanders while its deviation grows. Only an estimate that is better than the prior counts, and only a loss
    beyond `SIGNIFICANT` standard deviations: anything smaller may be a misfit of the robot, like twisted
    axles, that the law explains by the next best parameter.

    Args:
      theta: θ, shape (p,).
      cov: Its covariance, shape (p, p).
      wheels: n.
    """
    found = np.zeros(wheels)
    for i in range(wheels):
        loss, variance = theta[i], cov[i, i]
        informative = variance < (INFORMATIVE * LOSS) ** 2
        if informative and loss > 0.0 and loss**2 > SIGNIFICANT**2 * variance:
            found[i] = loss
    return found


def prior_deviation(wheels: int) -> Array:
    """Standard deviations of θ before the first drive, shape (p,)."""
    each = [LOSS] * wheels + [FRICTION] * wheels
    common = [BIAS, BIAS, ROLLERS, LOADED, INERTIA, GEAR, VISCOUS, CENTRE, CENTRE]
    return np.array([*each, *common, *([STICTION] * (2 * wheels))])


def short_term_deviation(wheels: int) -> Array:
    """Standard deviations of θ over a second or two, however well it was learnt before, shape (p,).

    Friction is not the same at every speed and load, nor is the gear's efficiency; the misfit of a law with
    constant parameters lasts as long as a manoeuvre, and no window may take it for a fault.
    """
    each = [LOSS_VARIES] * wheels + [FRICTION_VARIES] * wheels
    common = [0.01, 0.01, 0.05, 0.03, 0.05, 0.05, 0.1, 0.002, 0.002]
    return np.array([*each, *common, *([0.0] * (2 * wheels))])


@kernel
def short_term_precision(cov, short_term, lasts):
    """Inverse of the covariance that θ has from window to window, shape (p, p).

    Args:
      cov: Covariance as learnt, shape (p, p); of those that do not last it is diagonal.
      short_term: Variance that comes to it, shape (p,).
      lasts: Number of the leading parameters that last.
    """
    p = short_term.size
    precision = np.zeros((p, p))
    precision[:lasts, :lasts] = inverted(cov[:lasts, :lasts] + np.diag(short_term[:lasts]))
    for j in range(lasts, p):
        precision[j, j] = 1.0 / (cov[j, j] + short_term[j])
    return precision


@kernel
def update_parameters(theta, cov, walk, lasts, noise, x, rho):
    """Kalman update of mean and covariance of θ by one block, in place.

    Args:
      theta: Mean, shape (p,).
      cov: Covariance, shape (p, p).
      walk: Variance that every parameter gains per block, shape (p,).
      lasts: Number of the leading parameters that last; the others are reset after the block.
      noise: Variance of the whitened noise: 1, and more where it is coloured.
      x: Whitened regressors, shape (3, p).
      rho: Whitened ρ, shape (3,).
    """
    p = theta.size
    gain = np.empty(p)
    for j in range(p):
        cov[j, j] = cov[j, j] + walk[j] if j < lasts else STICTION_LEARNING * STICTION_LEARNING
    for k in range(3):
        innovation_variance, innovation = noise, rho[k]
        for j in range(p):
            total = 0.0
            for q in range(p):
                total += cov[j, q] * x[k, q]
            gain[j] = total
            innovation_variance += x[k, j] * total
            innovation -= x[k, j] * theta[j]
        for j in range(p):
            theta[j] += gain[j] * innovation / innovation_variance
            for q in range(j + 1):
                cov[j, q] -= gain[j] * gain[q] / innovation_variance
                cov[q, j] = cov[j, q]
    for j in range(lasts, p):
        theta[j] = 0.0
        for q in range(p):
            cov[j, q] = cov[q, j] = 0.0
        cov[j, j] = STICTION * STICTION
