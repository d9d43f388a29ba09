"""Kinematics of n omni wheels: the law of rigid rolling and its weighted inverse.

A (n×3) maps the body twist (v_x, v_y, yaw rate) to rolling speeds: V = A·twist, Eqs. 3.50-3.53.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

Array = NDArray[np.float64]


def rolling_matrix(positions: ArrayLike, directions: ArrayLike) -> Array:
    """Rolling speed r φ̇ of each wheel per body twist: A with rows (d_x, d_y, x d_y − y d_x).

    Source: Eqs. 3.48-3.53, V_i = d_i · (v + ω × p_i), for wheels at any place. An omni wheel rolls along its
    driving direction, d = u. Where the rollers' axes a are turned (mecanum), the floor holds the wheel along
    them: a·(v + ω × p − r φ̇ u) = 0, and d = a/(a·u). Aᵀ takes the wheels' torques over r to force and moment.

    Args:
      positions: Wheel centres p_i, shape (n, 2) [m].
      directions: d_i, `Robot.rolling_directions`, shape (n, 2).

    Returns:
      A, shape (n, 3).
    """
    p, u = np.asarray(positions, float), np.asarray(directions, float)
    return np.column_stack([u, p[:, 0] * u[:, 1] - p[:, 1] * u[:, 0]])


def turned(vectors: Array, angle: Array | float) -> Array:
    """Vectors turned by an angle each or by the same one [rad], shape (k, 2) as before."""
    x, y = vectors.T
    cos, sin = np.cos(angle), np.sin(angle)
    return np.column_stack([cos * x - sin * y, sin * x + cos * y])


def weighted_inverse(jacobian: ArrayLike, weights: ArrayLike) -> Array:
    """Weighted inverse W⁻¹Jᵀ(J W⁻¹ Jᵀ)⁻¹ of Eq. 3.10: rolling speeds from a twist, shape (n, 3).

    Args:
      jacobian: Forward map, shape (3, n).
      weights: Diagonal of W, all positive, shape (n,).
    """
    j = np.asarray(jacobian, float)
    jw = j / np.asarray(weights, float)
    return jw.T @ np.linalg.inv(jw @ j.T)
