"""Chapter 6: the torque constant of a faulty motor, weights of the wheels, and the kinematics they make."""

from __future__ import annotations

import numpy as np

from omnimj.control.cascade.allocation import published_map
from omnimj.control.cascade.controller import Reconfiguration, nominal_reconfiguration
from omnimj.parameters import Robot
from omnimj.physics.kinematics import rolling_matrix, weighted_inverse
from omnimj.signals import Array

LARGEST_LOSS = 0.9
"""Largest loss of torque constant that the repaired Eq. 6.2 gives (erratum 10)."""
SMALLEST_SLIP_WEIGHT = 1.0
"""Smallest weight that the repaired Eq. 6.4 gives: that of a wheel without a fault."""


def torque_constant_loss(height: float, printed: bool) -> float:
    """1 − K_tm/K_t = 0.004 H³ − 0.0619 H² + 0.3579 H, Eq. 6.2.

    A line through two measured points and the origin. As printed it passes 1 at H = 8.34 N, and the torque
    constant turns negative; repaired it stays within 0 … `LARGEST_LOSS`.

    Args:
      height: H = max(R7 or R8) − threshold, Eq. 6.1 [N].
      printed: Without bounds.
    """
    share = ((0.004 * height - 0.0619) * height + 0.3579) * height
    return share if printed else min(max(share, 0.0), LARGEST_LOSS)


def motor_weights(shares: Array) -> Array:
    """W_faulty = K_t/K_tm and 1 for healthy motors, Eq. 6.3, shape (n,).

    Args:
      shares: K_tm/K_t, shape (n,); as printed it may be 0 or negative.
    """
    with np.errstate(divide="ignore"):
        return 1.0 / shares


def slip_weights(residuals: Array, printed: bool) -> Array:
    """W_i = 100 r_{i+2}/Σr, Eq. 6.4, shape (n,).

    As printed, residuals of mixed sign give negative weights or a sum of zero. Repaired: |r|, and no weight
    below `SMALLEST_SLIP_WEIGHT` (erratum 9).

    Args:
      residuals: r3 … r6, shape (n,) [rad/s].
      printed: With the signs of r.
    """
    with np.errstate(divide="ignore", invalid="ignore"):
        if printed:
            return 100.0 * residuals / np.sum(residuals)
        size = np.abs(residuals)
        return np.maximum(100.0 * size / np.sum(size), SMALLEST_SLIP_WEIGHT)


class WeightedKinematics:
    """Eq. 3.10 with weights, for the cascade.

    Printed: the forward map is J of Eq. 3.5, so that the robot drives at half the linear and a quarter of the
    demanded angular speed (erratum 1), with or without a fault. Repaired: the true map, diag(½, ½, ¼)·J.
    """

    def __init__(self, robot: Robot, printed: bool):
        positions, directions = robot.wheel_positions, robot.drive_directions
        self._radius = robot.wheel.radius
        if printed:
            self._forward = published_map(positions, directions)
        else:
            self._forward = np.linalg.pinv(rolling_matrix(positions, directions))
        self.healthy = nominal_reconfiguration(self._inverse(np.ones(len(robot.wheels))))

    def reconfiguration(self, weights: Array, before: Reconfiguration) -> Reconfiguration:
        """Inverse kinematics with these weights; the previous one where the printed weights are singular.

        Args:
          weights: Weight of each wheel, shape (n,).
          before: Reconfiguration of the previous step.
        """
        try:
            with np.errstate(all="ignore"):
                inverse = self._inverse(weights)
        except np.linalg.LinAlgError:
            return before
        return nominal_reconfiguration(inverse) if np.all(np.isfinite(inverse)) else before

    def _inverse(self, weights: Array) -> Array:
        return np.ascontiguousarray(weighted_inverse(self._forward, weights) / self._radius)
