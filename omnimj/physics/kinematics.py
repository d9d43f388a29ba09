"""Kinematics of n omni wheels: the law of rigid rolling and the published matrix.

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


def published_jacobian(yaw: float, wheel_distance: float) -> Array:
    """Published forward map J of Eq. 3.5, shape (3, 4): world twist = J V.

    The true forward map is diag(½, ½, ¼)·J: as printed, the robot drives at half the linear and a quarter
    of the commanded angular speed.
    """
    s, c, k = np.sin(yaw), np.cos(yaw), -1.0 / wheel_distance
    return np.array([[s, -c, -s, c], [-c, -s, c, s], [k, k, k, k]])


def weighted_inverse(jacobian: ArrayLike, weights: ArrayLike) -> Array:
    """Weighted inverse W⁻¹Jᵀ(J W⁻¹ Jᵀ)⁻¹ of Eq. 3.10: rolling speeds from a twist, shape (n, 3).

    Args:
      jacobian: Forward map, shape (3, n).
      weights: Diagonal of W, all positive, shape (n,).
    """
    j = np.asarray(jacobian, float)
    jw = j / np.asarray(weights, float)
    return jw.T @ np.linalg.inv(jw @ j.T)


def rotation(yaw: float) -> Array:
    """Rotation of a twist from the body frame to the world, shape (3, 3)."""
    s, c = np.sin(yaw), np.cos(yaw)
    return np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])
