"""Allocation in force space: how the wheels share the wrench that a motion needs, within grip and torque.

  f* = argmin ‖W_v (B f − w)‖² + γ ‖f‖²,  |f_i| ≤ most_i

w is the force and moment that the demanded motion needs. Wheel speeds stay kinematically consistent; f* only
says by how much each wheel will creep under its share, and that is added to its speed.
"""

from __future__ import annotations

import math

import numpy as np

from omnimj.control.robot_constants import CREEP_SLOPE
from omnimj.physics.native import kernel

REGULARISATION = 1e-3
"""γ: four wheels share a load that three could carry [1]."""
USUAL_GRIP = 0.09
"""μ of an ordinary floor [1]."""
_SIDEWAYS = 0.01  # [m/s] width of the sign of the rollers' dry friction


@kernel
def required_wrench(robot, twist, acceleration, available, traction):
    """Force and moment for a motion: M a, the rollers' drag, less the traction of unavailable wheels.

    Args:
      robot: `RobotConstants`.
      twist: Demanded v_x, v_y, yaw rate in the body frame, three numbers [m/s, m/s, rad/s].
      acceleration: Demanded acceleration of the same, three numbers [m/s², m/s², rad/s²].
      available: Mask of the wheels that are allocated, shape (n,).
      traction: Traction of the others, shape (n,) [N].

    Returns:
      w, shape (3,) [N, N, N.m].
    """
    w = np.empty(3)
    w[0], w[1] = robot.mass * acceleration[0], robot.mass * acceleration[1]
    w[2] = robot.yaw_inertia * acceleration[2]
    dry, viscous = robot.load * robot.roller_dry, robot.load * robot.roller_viscous
    side = robot.across @ np.array(twist)
    for i in range(available.size):
        drag = dry * np.tanh(side[i] / _SIDEWAYS) + viscous * side[i]
        for k in range(3):
            w[k] += robot.across[i, k] * drag
            if not available[i]:
                w[k] -= robot.forces[k, i] * traction[i]
    return w


@kernel
def allocate_forces(forces, arm, wrench, most, available):
    """Bounded least-squares shares f* of a wrench, shape (n,) [N]; 0 for unavailable wheels.

    Bounds are met one after the other: the wheel that exceeds its bound the most is held at it, and the
    others share what is left.

    Args:
      forces: B, shape (3, n).
      arm: Length that turns a moment into a force, for W_v = diag(1, 1, 1/arm) [m].
      wrench: w, shape (3,) [N, N, N.m].
      most: Largest |f_i|, shape (n,) [N].
      available: Mask of the wheels, shape (n,).
    """
    n = forces.shape[1]
    f, fixed = np.zeros(n), ~available
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


@kernel
def steady_creep(load, force):
    """Creep of an ordinary floor under a lasting traction, (|F|/F_N − μ)/σ sign F [m/s].

    Args:
      load: F_N [N].
      force: F [N].
    """
    return math.copysign(max(abs(force) / load - USUAL_GRIP, 0.0) / CREEP_SLOPE, force)
