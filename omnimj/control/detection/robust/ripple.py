"""Ripple of passing rollers: a force that turns with the wheel, learnt and taken out of the force balance.

A wheel with N rollers pushes the body with a sin Nφ + b cos Nφ along its drive. At 0.2 m/s a period lasts as
long as a short window of the likelihood ratios, and half a period of 2 N looks like a weak motor. The phase
is known from the encoder up to a constant, so that a and b follow from the residual by least mean squares
(B. Widrow et al., Adaptive noise cancelling, Proc. IEEE 63, 1975); what does not turn with the wheel, like a
lost torque constant, has no part in them.

In the kernels `forces` is `RobotConstants.forces`, shape (3, n), `block` `Block`, `ripple` `Evidence.ripple`,
changed in place, and `basis` what `turn_wheels` fills, shape (2, n).
"""

from __future__ import annotations

import math

import numpy as np

from omnimj.control.detection.robust.force_balance import NOISE, SLOW
from omnimj.physics.native import kernel
from omnimj.signals import Array

PHASE, SINE, COSINE, LEARNT = range(4)
"""Rows of `Evidence.ripple`: Nφ at the end of the last block [rad], a and b [N], blocks learnt from."""
FASTEST = 10.0
"""Wheel speed from which the ripple is left in [rad/s]: 25 Hz and more average out over the shortest window,
and the channels differ by milliseconds, a radian of its phase."""
DOUBT = 25.0
"""Blocks that "no ripple" is worth at the start."""
MEMORY = 600.0
"""Blocks over which a and b are averaged: encoders lose the phase slowly, wheels wear."""
LARGEST = 0.1
"""Amplitude up to which a ripple is taken out, as a share of a wheel's load: with more of it the model does
not fit, which must not be hidden from the judgement of the fit."""


def initial_ripple(wheels: int) -> Array:
    """No ripple is known, shape (4, n)."""
    return np.zeros((4, wheels))


@kernel
def turn_wheels(order, block, ripple, basis):
    """Advance the phases by one block, in place, and fill the block's means of sin Nφ and cos Nφ.

    Args:
      order: N, rollers that pass per turn.
      basis: Output; 0 for wheels that turn too fast.
    """
    for i in range(basis.shape[1]):
        half = 0.5 * order * block.wheel_speed[i] * block.duration
        middle = ripple[PHASE, i] + half
        ripple[PHASE, i] = (middle + half) % (2.0 * math.pi)
        fade = 1.0 if abs(half) < 1e-6 else math.sin(half) / half
        if abs(block.wheel_speed[i]) > FASTEST:
            fade = 0.0
        basis[0, i], basis[1, i] = fade * math.sin(middle), fade * math.cos(middle)


@kernel
def subtract_ripple(forces, ripple, basis, largest, rho):
    """Take the ripple, as it is known, out of the force balance, in place.

    Args:
      largest: Amplitude beyond which a wheel's ripple is left in [N].
      rho: ρ, shape (3,), changed in place [N, N, N.m].
    """
    for i in range(basis.shape[1]):
        if math.hypot(ripple[SINE, i], ripple[COSINE, i]) > largest:
            continue
        force = ripple[SINE, i] * basis[0, i] + ripple[COSINE, i] * basis[1, i]
        for k in range(3):
            rho[k] -= forces[k, i] * force


@kernel
def learn_ripple(forces, block, basis, left, ripple):
    """Correct a and b of the wheels by what is left of one block, in place; slow wheels hold any friction.

    a⁺ = a + 2/(t + t₀) sin(Nφ) (B_iᵀ W r)/(B_iᵀ W B_i), b likewise, with t blocks learnt from.

    Args:
      left: r = ρ − X θ without the known ripple, shape (3,) [N, N, N.m].
    """
    for i in range(basis.shape[1]):
        if not SLOW < abs(block.wheel_speed[i]) < FASTEST:
            continue
        pull = weight = 0.0
        for k in range(3):
            share = forces[k, i] / (NOISE[k] * NOISE[k])
            pull, weight = pull + share * left[k], weight + share * forces[k, i]
        step = 2.0 / (ripple[LEARNT, i] + DOUBT) * pull / weight
        ripple[SINE, i] += step * basis[0, i]
        ripple[COSINE, i] += step * basis[1, i]
        ripple[LEARNT, i] = min(ripple[LEARNT, i] + 1.0, MEMORY)
