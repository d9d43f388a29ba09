"""What can still be done with what is left of the robot: the states of recovery."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from omnimj.control.detection.detector import FaultEstimate
from omnimj.signals import Array

NORMAL, COMPENSATING, CAPPING, SLOWING, PIVOTING, STOPPING, REVERTED = range(7)
"""Nothing to do · a motor's loss is made up for · a slipping wheel is capped · so many slip that
the others can not hold the robot, and time runs slower · the robot turns about a held wheel · it can not be
steered any more · help did not help."""
MODE_NAMES = (
    "as planned",
    "compensating",
    "slip capped",
    "slowed down",
    "turning about a wheel",
    "stopping",
    "help taken back",
)
"""The same for a person."""
MODE_CONSEQUENCES = (
    "",
    "nothing is given up while the currents reach: what is left makes up for what is lost",
    "the traction of what slips is given up; the wheels that grip hold place and heading",
    "the time plan is given up: the wheels that grip cannot hold the robot, so it drives slower",
    "the heading is given up; the centre still follows the path",
    "path and heading are given up: the robot cannot be steered any more",
    "help made following worse: the robot drives as if nothing were broken",
)
"""What cannot be held in a mode, in the order of `MODE_NAMES`."""

STEERABLE = 3
"""Degrees of freedom that a robot on a plane has."""
_LEAST_ARM = 0.1  # of a wheel's moment over the largest one: less can not be turned about


@dataclass(frozen=True)
class RecoveryAction:
    """What recovery has decided to do."""

    mode: int = NORMAL
    pivot: int = -1
    """Wheel 0…n−1 that the robot turns about; −1: none."""
    brake: tuple[int, ...] = ()
    """Wheels 1…n whose motors are shorted."""


def choose_action(fault_estimate: FaultEstimate, forces: Array, before: RecoveryAction) -> RecoveryAction:
    """What to do: drive with all that drives, turn about a held wheel, brake a dead one to have one, stop.

    With the driven wheels D alone the robot can be steered if their columns of B have rank 3. A held wheel b
    takes one freedom away, u_b·v + B_3b ω = 0, and the centre can still follow any path if D and b together
    have rank 3; heading is given up then. Where there is none, one dead motor is shorted to make it, and the
    others run free. A motor that runs away is always taken from its amplifier and shorted.

    Args:
      beliefs: Of the method.
      forces: B, shape (3, n).
      before: A choice among several possible ones is kept.
    """
    if fault_estimate.is_healthy:
        return RecoveryAction()
    driven, runaway = fault_estimate.available, np.flatnonzero(fault_estimate.runaway)
    held = np.flatnonzero(fault_estimate.held | fault_estimate.runaway)
    if len(held) == 0 and rank_of(forces, driven) == STEERABLE:
        return RecoveryAction(_mode_of(fault_estimate, forces, driven))
    if len(held) == 1:
        choices = held
    elif len(held) == 0:
        choices = np.flatnonzero(fault_estimate.dead)
    else:
        choices = np.array([], int)
    arms = np.abs(forces[2]) >= _LEAST_ARM * np.abs(forces[2]).max()
    possible = [
        int(b) for b in choices if arms[b] and rank_of(forces, _with_wheel(driven, int(b))) == STEERABLE
    ]
    if not possible:
        return RecoveryAction(
            STOPPING, -1, _wheel_numbers(np.flatnonzero(fault_estimate.dead | fault_estimate.runaway))
        )
    pivot = (
        before.pivot
        if before.pivot in possible
        else _trailing_wheel(possible, forces, fault_estimate.velocity)
    )
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


def _wheel_numbers(wheels: NDArray[np.int_]) -> tuple[int, ...]:
    return tuple(int(i) + 1 for i in wheels)


def _mode_of(fault_estimate: FaultEstimate, forces: Array, driven: NDArray[np.bool_]) -> int:
    if not fault_estimate.slipping.any():
        return NORMAL if fault_estimate.is_healthy else COMPENSATING
    grips = driven & ~fault_estimate.slipping
    return CAPPING if rank_of(forces, grips) == STEERABLE else SLOWING


def _with_wheel(driven: NDArray[np.bool_], wheel: int) -> NDArray[np.bool_]:
    more = driven.copy()
    more[wheel] = True
    return more


def rank_of(forces: Array, wheels: NDArray[np.bool_]) -> int:
    """Degrees of freedom that some of the wheels can push.

    Args:
      forces: B, shape (3, n).
      wheels: Which of them, shape (n,).
    """
    scaled = forces[:, wheels] / np.array([[1.0], [1.0], [np.abs(forces[2]).max()]])
    return int(np.linalg.matrix_rank(scaled, tol=1e-3)) if scaled.size else 0


def _trailing_wheel(wheels: list[int], forces: Array, velocity: Array) -> int:
    """Of the wheels that could be turned about the one that the motion drags behind: there it stays.

    The wheel sits at u turned back by a quarter for B_3 > 0, else at u turned on by one.
    """
    ahead = [
        float(np.sign(forces[2, b]) * (forces[1, b] * velocity[0] - forces[0, b] * velocity[1]))
        for b in wheels
    ]
    return wheels[int(np.argmin(ahead))]
