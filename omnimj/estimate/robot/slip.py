"""Slip of the wheels in single drives, with the velocity over ground from pose or accelerometer.

A measured pose gives the velocity at any time. Without one, the accelerometer, turned by the integrated gyro,
is integrated from one rest to the next. The velocity is zero at both ends, which takes out a constant bias
and the floor's tilt. Slip of wheel i is r φ̇_i − A_i·twist.
"""

from __future__ import annotations

import itertools
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from omnimj.estimate.robot.balance import SLOW, felt_by_turning, wheel_forces
from omnimj.estimate.robot.blocks import PERIOD, RunRows
from omnimj.estimate.robot.fit import RobotFit
from omnimj.physics.kinematics import turned
from omnimj.signals import Array

LONGEST = 12.0
"""Longest drive whose velocity is integrated [s]: the error of its middle grows with the time."""
_SHORTEST = 0.6  # [s]
_EVERY = 3  # rows from one sample to the next: slip changes slowly


@dataclass(frozen=True)
class SlipSamples:
    """Samples of turning wheels."""

    slip: Array
    """At the nominal radius, shape (k,) [m/s]."""
    traction: Array
    """Traction over load, shape (k,) [1]."""
    rolling: Array
    """r φ̇, shape (k,) [m/s]."""
    wheel: NDArray[np.int_]
    """Index of the wheel, shape (k,)."""
    run: NDArray[np.int_]
    """Index of the run, shape (k,)."""
    moves: int
    """Number of drives."""


def slip_samples(fit: RobotFit, rows: Sequence[RunRows]) -> SlipSamples | None:
    """Samples of all runs; None if there is no drive of known velocity."""
    parts, moves = [], 0
    for number, run in enumerate(rows):
        for move in _moves(run):
            parts.append(_samples_of(fit, run, move, number))
            moves += 1
    if not parts:
        return None
    slip, traction, rolling, wheel, runs = (np.concatenate(part) for part in zip(*parts, strict=True))
    return SlipSamples(slip, traction, rolling, wheel.astype(int), runs.astype(int), moves)


def _moves(run: RunRows) -> Iterator[slice]:
    """Drives between two rests, without gaps and bad samples, from the middle of a rest's last rows on; with
    a measured pose any without bad samples."""
    if run.velocity is not None:
        yield from _good_stretches(run)
        return
    rests = np.flatnonzero(np.diff(np.concatenate(([0], run.still.astype(int), [0])))).reshape(-1, 2)
    for (_, first), (last, _) in itertools.pairwise(rests):
        a, b = first - 1, last + 1
        whole = run.good[a:b].all() and run.stretch[a] == run.stretch[b - 1]
        if whole and _SHORTEST <= (b - a) * PERIOD <= LONGEST:
            yield slice(a, b)


def _good_stretches(run: RunRows) -> Iterator[slice]:
    moving = run.good & ~run.still
    ends = np.flatnonzero((moving[1:] != moving[:-1]) | (np.diff(run.stretch) != 0)) + 1
    for a, b in itertools.pairwise([0, *ends.tolist(), len(moving)]):
        if moving[a] and (b - a) * PERIOD >= _SHORTEST:
            yield slice(a, b)


def ground_velocity(run: RunRows, move: slice, accelerometer: Array) -> Array:
    """Velocity of the origin in a drive from rest to rest, from the accelerometer, shape (k, 2) [m/s].

    Args:
      run: The run.
      move: Rows of the drive.
      accelerometer: Place of the accelerometer in the body frame, shape (2,) [m].
    """
    rate, heading = run.yaw_rate[move], _integral(run.yaw_rate[move])
    acceleration = run.acceleration[move] - felt_by_turning(accelerometer, rate, run.yaw_acceleration[move])
    velocity = np.column_stack([_integral(a) for a in turned(acceleration, heading).T])
    velocity -= np.linspace(0.0, 1.0, len(velocity))[:, None] * velocity[-1]
    return turned(velocity, -heading)


def _integral(values: Array) -> Array:
    """Integral over the rows by the trapezoid, 0 at the first."""
    return np.concatenate(([0.0], np.cumsum(0.5 * PERIOD * (values[1:] + values[:-1]))))


def _samples_of(fit: RobotFit, run: RunRows, move: slice, number: int) -> tuple[Array, ...]:
    constants, errors = fit.unknowns.constants(fit.x), fit.unknowns.errors(fit.x)
    c = constants.robot
    rolling = c.radius * run.wheel_speed[move]
    if run.velocity is None:
        velocity, spin = ground_velocity(run, move, c.accelerometer), run.yaw_rate[move]
    else:  # as it was when the pose was taken
        velocity = run.velocity[move] + errors.acceleration_delay * run.acceleration[move]
        spin = run.yaw_rate[move] + errors.yaw_rate_delay * run.yaw_acceleration[move]
    floor = velocity @ c.forces[:2] + np.outer(spin, c.forces[2])
    traction = wheel_forces(constants, errors, run)[move] / c.load
    used = run.slowest[move] > SLOW
    used[np.arange(len(used)) % _EVERY != 0] = False
    wheel = np.broadcast_to(np.arange(used.shape[1]), used.shape)[used]
    slip = np.asarray(rolling - floor, float)
    return slip[used], traction[used], rolling[used], wheel, np.full(len(wheel), number)
