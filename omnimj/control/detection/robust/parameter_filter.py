"""What is learnt of a healthy robot over minutes: θ of the force channel, block by block.

A Kalman filter of a slow random walk; its prior is what parts and payload of a healthy robot may be.
"""

from __future__ import annotations

import numpy as np

from omnimj.physics.native import kernel
from omnimj.signals import Array

LOSS, FRICTION, BIAS, ROLLERS, LOADED, INERTIA = 0.02, 0.13, 0.02, 0.15, 0.12, 0.1
"""Standard deviations in health: δ, ν, β [m/s²], λ, μ, ι."""
INFORMATIVE = 0.9
"""Share of the prior deviation of δ below which a drive has told something of it."""
SIGNIFICANT = 4.0
"""Standard deviations by which a learnt loss must differ from none: most of what wanders is below them."""
STICTION = 0.6
"""The same of h and k: anything between −1 and 1."""
STICTION_LEARNING = 6.0
"""The same while learning: what stands holds the same for seconds, and nothing may be learnt from that."""
LOSS_VARIES, FRICTION_VARIES = 0.01, 0.1
"""Standard deviations of δ and ν from one window to the next."""
FAULTY_LOSS_VARIES, FAULTY_FRICTION_VARIES = 0.05, 0.5
"""The same of a motor that is known to be broken."""
FAULTY_LOSS_WALK = 0.1
"""By which δ of a motor that is known to be broken may wander in a minute, as standard deviation."""


def significant_losses(theta: Array, cov: Array, wheels: int) -> Array:
    """δ of the motors of which the drive has told enough, shape (n,); 0 of the others.

    A steady drive tells nothing: mass, friction and torque constants trade with each other, and δ wanders
    while its deviation grows. Only what is known better than before anything was known counts, and only a
    loss beyond `SIGNIFICANT` of its standard deviations: the rest may be what no law of the robot tells, like
    twisted axles, taken for the next best thing.
    """
    own = np.arange(wheels)
    variance, loss = cov[own, own], theta[:wheels]
    told = variance < (INFORMATIVE * LOSS) ** 2
    return np.where(told & (loss > 0.0) & (loss**2 > SIGNIFICANT**2 * variance), loss, 0.0)


def prior_deviation(wheels: int) -> Array:
    """Standard deviations of θ before anything is known, shape (p,)."""
    each = [LOSS] * wheels + [FRICTION] * wheels
    return np.array([*each, BIAS, BIAS, ROLLERS, LOADED, INERTIA, *([STICTION] * (2 * wheels))])


def short_term_deviation(wheels: int) -> Array:
    """Standard deviations of what θ is off for a second or two, whatever was learnt before, shape (p,).

    Friction is not the same at every speed and load, nor is the gear's efficiency; what a law with constant
    numbers leaves of that lasts as long as a manoeuvre, and no window may take it for a fault.
    """
    each = [LOSS_VARIES] * wheels + [FRICTION_VARIES] * wheels
    return np.array([*each, 0.01, 0.01, 0.05, 0.03, 0.05, *([0.0] * (2 * wheels))])


@kernel
def update_parameters(theta, cov, walk, lasts, x, rho):
    """One block into mean θ, shape (p,), and covariance, shape (p, p), both changed in place.

    Args:
      theta: Mean.
      cov: Covariance.
      walk: Variance that every number gains per block, shape (p,).
      lasts: How many of the numbers last; the others are forgotten after the block.
      x: Whitened columns, shape (3, p).
      rho: Whitened ρ, shape (3,).
    """
    p = theta.size
    gain = np.empty(p)
    for j in range(p):
        cov[j, j] = cov[j, j] + walk[j] if j < lasts else STICTION_LEARNING * STICTION_LEARNING
    for k in range(3):
        size, away = 1.0, rho[k]
        for j in range(p):
            total = 0.0
            for q in range(p):
                total += cov[j, q] * x[k, q]
            gain[j] = total
            size += x[k, j] * total
            away -= x[k, j] * theta[j]
        for j in range(p):
            theta[j] += gain[j] * away / size
            for q in range(j + 1):
                cov[j, q] -= gain[j] * gain[q] / size
                cov[q, j] = cov[j, q]
    for j in range(lasts, p):
        theta[j] = 0.0
        for q in range(p):
            cov[j, q] = cov[q, j] = 0.0
        cov[j, j] = STICTION * STICTION
