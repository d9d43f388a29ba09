"""Inverse kinematics B: rolling speeds of the wheels for a body twist, V = B·twist.

Corrected: B = A of `physics.kinematics.rolling_matrix`, the only rolling speeds without slip on a rigid base.
Published: B = W⁻¹Jᵀ(J W⁻¹ Jᵀ)⁻¹ with the printed J, Eqs. 3.10-3.15, which drives at half the linear and a
quarter of the demanded angular speed.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from omnimj.errors import InputError
from omnimj.physics.kinematics import rolling_matrix
from omnimj.physics.native import kernel
from omnimj.signals import Array

SCALES = ("corrected", "published")


def published_map(positions: ArrayLike, directions: ArrayLike) -> Array:
    """J of Eq. 3.5 in the body frame, twist = J V, with columns (u_x, u_y, (p × u)/|p|²), shape (3, n).

    For the robot of the text this is the printed matrix at θ = 0; written for wheels at any place.
    """
    a = rolling_matrix(positions, directions)
    a[:, 2] /= np.sum(np.square(np.asarray(positions, float)), axis=1)
    return a.T


def checked_weights(weights: ArrayLike | None, wheels: int) -> Array:
    """W_i as an array, shape (n,); ones when None.

    Raises:
      InputError: Not n positive finite numbers.
    """
    w = np.ones(wheels) if weights is None else np.asarray(weights, float)
    if w.shape != (wheels,) or not np.all(np.isfinite(w)) or np.any(w <= 0.0):
        raise InputError(
            "weights", f"found {w.tolist()!r}", f"must be {wheels} positive numbers, one per wheel"
        )
    return w


@kernel
def wheel_speed_target(speed_per_twist, wheel, twist_x, twist_y, yaw_rate):
    """φ̇_i = B_i·twist/r [rad/s].

    Args:
      speed_per_twist: B/r, shape (n, 3).
      wheel: 0 … n−1.
      twist_x: Body twist [m/s].
      twist_y: Body twist [m/s].
      yaw_rate: Body twist [rad/s].
    """
    row = speed_per_twist[wheel]
    return row[0] * twist_x + row[1] * twist_y + row[2] * yaw_rate
