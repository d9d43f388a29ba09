"""Modes of recovery: what a robot with faulty wheels can still do is a matter of rank."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from omnimj.control.detection.detector import FaultEstimate
from omnimj.signals import Array

NORMAL, COMPENSATING, CAPPING, SLOWING, PIVOTING, STOPPING, REVERTED = range(7)
"""No fault · a loss of torque is compensated · the speed of a slipping wheel is bounded · too many wheels
slip for the others to hold the robot, so the plan is slowed down · the robot turns about a held wheel · it
cannot be steered any more and stops · recovery made tracking worse and is reverted."""
MODE_NAMES = (
    "as planned",
    "compensating",
    "slip capped",
    "slowed down",
    "turning about a wheel",
    "stopping",
    "recovery reverted",
)
"""Modes in words."""
MODE_CONSEQUENCES = (
    "",
    "nothing is lost while the currents suffice: the healthy parts make up for the faulty ones",
    "the traction of slipping wheels is lost; the wheels that grip hold place and heading",
    "the time plan is lost: the wheels that grip cannot hold the robot, so it drives more slowly",
    "the heading is lost; the centre still follows the path",
    "path and heading are lost: the robot cannot be steered any more",
    "recovery made tracking worse: the robot drives as if without a fault",
)
"""Part of the plan that cannot be held in a mode, in the order of `MODE_NAMES`."""

STEERABLE = 3
"""Degrees of freedom of a robot on a plane."""
_LEAST_ARM = 0.1  # of a wheel's moment over the largest one: a robot cannot turn about a wheel with less


@dataclass(frozen=True)
class RecoveryAction:
    """Decision of the recovery."""

    mode: int = NORMAL
    pivot: int = -1
    """Wheel 0…n−1 that the robot turns about; −1: none."""
    brake: tuple[int, ...] = ()
    """Wheels 1…n whose motors are shorted."""


NO_ACTION = RecoveryAction()
"""Decision for a healthy robot."""


def choose_action(estimate: FaultEstimate, forces: Array, before: RecoveryAction) -> RecoveryAction:
    """Choose between driving with the available wheels, turning about a held or braked one, and stopping.

    With the available wheels D alone the robot can be steered if their columns of B have rank 3. A held wheel
    b takes one freedom away, u_b·v + B_3b ω = 0, and the centre can still follow any path if D and b together
    have rank 3; the heading is lost then. Without a held wheel, one dead motor is shorted to make one, and
    the others run free. A motor that runs away is always disconnected from its amplifier and shorted.

    Args:
      estimate: From the detector.
      forces: B, shape (3, n).
      before: Present action; its pivot is kept among several possible ones.
    """
    if estimate.is_healthy:
        return NO_ACTION
    available, runaway = estimate.available, np.flatnonzero(estimate.runaway)
    held = np.flatnonzero(estimate.held | estimate.runaway)
    if len(held) == 0 and rank_of(forces, available) == STEERABLE:
        return RecoveryAction(_steerable_mode(estimate, forces, available))
    if len(held) == 1:
        choices = held
    elif len(held) == 0:
        choices = np.flatnonzero(estimate.dead)
    else:
        choices = np.array([], int)
    arms = np.abs(forces[2]) >= _LEAST_ARM * np.abs(forces[2]).max()
    possible = [
        int(b) for b in choices if arms[b] and rank_of(forces, _with_wheel(available, int(b))) == STEERABLE
    ]
    if not possible:
        return RecoveryAction(STOPPING, -1, _wheel_numbers(np.flatnonzero(estimate.dead | estimate.runaway)))
    kept = before.pivot in possible
    pivot = before.pivot if kept else _trailing_wheel(possible, forces, estimate.velocity)
    return RecoveryAction(PIVOTING, pivot, _wheel_numbers(runaway) if len(held) else (pivot + 1,))


def indispensable(forces: Array) -> tuple[int, ...]:
    """Wheels 1…n without which the robot cannot be steered and turned at will: the others have rank < 3.

    Args:
      forces: B, shape (3, n).
    """
    n = forces.shape[1]
    return _wheel_numbers(
        np.flatnonzero([rank_of(forces, np.arange(n) != i) < STEERABLE for i in range(n)]).astype(int)
    )


def rank_of(forces: Array, wheels: NDArray[np.bool_]) -> int:
    """Degrees of freedom that some of the wheels can drive.

    Args:
      forces: B, shape (3, n).
      wheels: Mask of the wheels, shape (n,).
    """
    scaled = forces[:, wheels] / np.array([[1.0], [1.0], [np.abs(forces[2]).max()]])
    return int(np.linalg.matrix_rank(scaled, tol=1e-3)) if scaled.size else 0


def _wheel_numbers(wheels: NDArray[np.int_]) -> tuple[int, ...]:
    return tuple(int(i) + 1 for i in wheels)


def _steerable_mode(estimate: FaultEstimate, forces: Array, available: NDArray[np.bool_]) -> int:
    if not estimate.slipping.any():
        return NORMAL if estimate.is_healthy else COMPENSATING
    grips = available & ~estimate.slipping
    return CAPPING if rank_of(forces, grips) == STEERABLE else SLOWING


def _with_wheel(mask: NDArray[np.bool_], wheel: int) -> NDArray[np.bool_]:
    more = mask.copy()
    more[wheel] = True
    return more


def _trailing_wheel(wheels: list[int], forces: Array, velocity: Array) -> int:
    """Wheel that the motion drags behind: a robot that turns about it stays stable.

    The wheel sits at u turned back by a quarter for B_3 > 0, else at u turned on by one.
    """
    ahead = [
        float(np.sign(forces[2, b]) * (forces[1, b] * velocity[0] - forces[0, b] * velocity[1]))
        for b in wheels
    ]
    return wheels[int(np.argmin(ahead))]
