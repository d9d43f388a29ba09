"""The published forward map of Eq. 3.5, and rotations of twists."""

from __future__ import annotations

import numpy as np


def published_jacobian(yaw: float, wheel_distance: float) -> np.ndarray:
    """J of Eq. 3.5, shape (3, 4): world twist = J V.

    The true forward map is diag(½, ½, ¼)·J: as printed, the robot drives at half the linear and a quarter
    of the commanded angular speed.
    """
    s, c, k = np.sin(yaw), np.cos(yaw), -1.0 / wheel_distance
    return np.array([[s, -c, -s, c], [-c, -s, c, s], [k, k, k, k]])


def rotation(yaw: float) -> np.ndarray:
    """Rotation of a twist from the body frame to the world, shape (3, 3)."""
    s, c = np.sin(yaw), np.cos(yaw)
    return np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])
