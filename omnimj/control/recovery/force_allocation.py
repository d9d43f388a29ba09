"""Allocation in force space: which wheel is to pull how much, within grip and torque.

  f* = argmin ‖W_v (B f − w)‖² + γ ‖f‖²,  |f_i| ≤ most_i

w is the force and moment that the demanded motion needs. Wheel speeds stay kinematically consistent; f* only
says by how much each wheel will creep under its share, and that is added to its speed.
"""

from __future__ import annotations

import numpy as np

from omnimj.physics.native import kernel

REGULARISATION = 1e-3
"""γ: four wheels share a load that three could carry [1]."""


@kernel
def required_wrench(mass, yaw_inertia, friction, forces, across, used, force, acceleration, spin, side):
    """w of a motion: M a, what the rollers take, less what wheels that do not obey give, shape (3,).

    Args:
      mass: [kg].
      yaw_inertia: [kg.m²].
      friction: Of a wheel's rollers: dry [N] and viscous [N.s/m].
      forces: B, shape (3, n).
      across: Speeds along the axles per twist, shape (n, 3).
      used: Wheels that obey, shape (n,).
      force: Traction that the others give, shape (n,) [N].
      acceleration: Demanded, body frame, shape (2,) [m/s²].
      spin: Demanded [rad/s²].
      side: Speeds along the axles, shape (n,) [m/s].
    """
    w = np.empty(3)
    w[0], w[1], w[2] = mass * acceleration[0], mass * acceleration[1], yaw_inertia * spin
    for i in range(used.size):
        drag = friction[0] * np.tanh(side[i] / 0.01) + friction[1] * side[i]
        for k in range(3):
            w[k] += across[i, k] * drag
            if not used[i]:
                w[k] -= forces[k, i] * force[i]
    return w


@kernel
def allocate_forces(forces, arm, wrench, most, used):
    """f*, shape (n,) [N]; 0 of wheels that are not used.

    Bounds one after the other: the worst offender is held at its bound, the rest share what is left.

    Args:
      forces: B, shape (3, n).
      arm: Length that turns a moment into a force, for W_v = diag(1, 1, 1/arm) [m].
      wrench: w, shape (3,).
      most: Largest |f_i|, shape (n,) [N].
      used: Shape (n,).
    """
    n = forces.shape[1]
    f, fixed = np.zeros(n), ~used
    scale = np.array((1.0, 1.0, 1.0 / arm))
    for _ in range(n):
        left = wrench.copy()
        for i in range(n):
            if fixed[i]:
                for k in range(3):
                    left[k] -= forces[k, i] * f[i]
        gram, pull = np.zeros((n, n)), np.zeros(n)
        for i in range(n):
            if fixed[i]:
                gram[i, i] = 1.0
                continue
            for k in range(3):
                pull[i] += forces[k, i] * scale[k] * scale[k] * left[k]
            for j in range(n):
                if not fixed[j]:
                    for k in range(3):
                        gram[i, j] += forces[k, i] * scale[k] * scale[k] * forces[k, j]
            gram[i, i] += REGULARISATION
        found = np.linalg.solve(gram, pull)
        worst, over = -1, 1e-9
        for i in range(n):
            if not fixed[i]:
                f[i] = found[i]
                if abs(f[i]) - most[i] > over:
                    worst, over = i, abs(f[i]) - most[i]
        if worst < 0:
            return f
        f[worst] = min(max(f[worst], -most[worst]), most[worst])
        fixed[worst] = True
    return f
