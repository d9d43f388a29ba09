"""Logs with a measured pose as blocks of steady driving, and their directions as conditions.

A robot on soft floor slips by a tenth to a half of its speed. Where wheel speeds are constant, a pose
measured over a second gives the velocity to a per cent; loggers of some 30 samples per second hardly resolve
transients. Runs in neighbouring directions are nearly repeats of each other, so that whole sectors of
directions are one condition.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass

import numpy as np

from omnimj.errors import InputError
from omnimj.estimate.drives.compare import body_steps
from omnimj.estimate.replay.base_parameters import floor_name
from omnimj.estimate.replay.interface import Segment
from omnimj.parameters import Floor, Robot
from omnimj.physics.kinematics import rolling_matrix
from omnimj.recording.dataset import Dataset, Run
from omnimj.signals import Array

START = 1.0
"""Time after the first motion from which a run counts [s]."""
PIECE = 1.0
"""Length of a piece of a run that must be steady [s]; a run's block is the mean of its pieces."""
SECTOR = 30.0
"""Width of a sector of directions [deg]; the first is −5° to 25°."""
_FIRST = -5.0
_MOVING = 0.02  # [m/s] at the rim
_UNSTEADY = 0.15  # change of a wheel's speed between the halves of a block, over the fastest wheel's
_TURNS = 0.2  # [rad/s] slower wheels' friction has no known sign
_FEWEST = 5  # samples of a pose in a piece
_FEWEST_PIECES, _FEWEST_BLOCKS = 3, 8


@dataclass(frozen=True)
class SteadyRuns:
    """One block of each run."""

    segments: tuple[Segment, ...]
    floor: tuple[str, ...]
    """Floor of each segment."""
    wheel_speed: Array
    """Mean wheel speeds, shape (blocks, n) [rad/s]."""
    measured: Array
    """Velocity ahead and to the left [m/s], yaw rate [rad/s], currents [A], shape (blocks, 3 + n); NaN where
    unknown."""
    noise: Array
    """Standard deviation of a block by the scatter of its pieces, median over the runs, shape (3 + n,)."""


def direction_sectors(dataset: Dataset, robot: Robot) -> Dataset:
    """The dataset with the sector of each run's direction as its condition, unless it repeats another run."""
    inverse = np.linalg.pinv(rolling_matrix(robot.wheel_positions, robot.rolling_directions))
    sectors = [_sector(inverse @ _rim_speed(run, robot)) for run in dataset.runs]
    runs = [
        run if run.repeat_of else dataclasses.replace(run, repeat_of=sector)
        for run, sector in zip(dataset.runs, sectors, strict=True)
    ]
    return dataclasses.replace(dataset, runs=tuple(runs))


def _rim_speed(run: Run, robot: Robot) -> Array:
    """Mean r φ̇ of the wheels over a run, shape (n,) [m/s]."""
    names = [f"wheel_speed_{i + 1}" for i in range(len(robot.wheels))]
    return robot.wheel.radius * np.array([float(np.nanmean(run.columns[name])) for name in names])


def _sector(twist: Array) -> str:
    speed = math.hypot(twist[0], twist[1])
    if speed < _MOVING or speed < 0.1 * abs(twist[2]):
        return "turning on the spot"
    turned = math.degrees(math.atan2(twist[1], twist[0])) - _FIRST
    first = _FIRST + SECTOR * math.floor(turned % 360.0 / SECTOR)
    return f"directions {first:.0f} to {first + SECTOR:.0f} deg"


def steady_runs(dataset: Dataset, robot: Robot, floors: Mapping[str, Floor]) -> SteadyRuns:
    """Blocks of steady driving of all runs.

    Raises:
      InputError: A run without floor, or too little steady driving in all.
      UnknownNameError: Unknown floor.
    """
    segments, used, speeds, rows, noises = [], [], [], [], []
    for run in dataset.runs:
        floor = floor_name(dataset, run, floors)
        pieces = list(_pieces(run, len(robot.wheels), robot.wheel.radius))
        if len(pieces) < _FEWEST_PIECES:
            continue
        times, own, values = (np.array(column) for column in zip(*pieces, strict=True))
        k = len(rows)
        segments.append(Segment(run.name, run.condition, k, k + 1, times.mean(keepdims=True), False))
        used.append(floor)
        speeds.append(own.mean(axis=0))
        rows.append(_mean(values))
        noises.append(_scatter(values))
    if len(rows) < _FEWEST_BLOCKS:
        found = f"{len(rows)} runs of steady driving"
        rule = f"at least {_FEWEST_BLOCKS} with {_FEWEST_PIECES} s at constant wheel speeds are needed"
        raise InputError(dataset.path, found, rule)
    noise = np.nan_to_num(np.nanmedian(noises, axis=0))
    return SteadyRuns(tuple(segments), tuple(used), np.array(speeds), np.array(rows), noise)


def _mean(values: Array) -> Array:
    """Mean over the pieces; NaN where most are unknown, shape (3 + n,)."""
    known = np.isfinite(values)
    total = np.where(known, values, 0.0).sum(axis=0)
    return np.where(known.mean(axis=0) > 0.5, total / np.maximum(known.sum(axis=0), 1), np.nan)


def _scatter(values: Array) -> Array:
    """Standard deviation of the mean over the pieces by their differences in time, shape (3 + n,)."""
    steps = np.diff(values, axis=0)
    known = np.isfinite(steps).sum(axis=0)
    squares = np.where(np.isfinite(steps), steps**2, 0.0).sum(axis=0)
    return np.where(known > 0, np.sqrt(squares / (2.0 * np.maximum(known, 1)) / len(values)), np.nan)


def _pieces(run: Run, n: int, radius: float) -> Iterator[tuple[float, Array, Array]]:
    """Centre, mean wheel speeds and measured values of each steady piece of a run."""
    time = run.time
    wheels = run.unmasked([f"wheel_speed_{i + 1}" for i in range(n)])
    pose = run.unmasked(["x", "y", "heading"])
    currents = run.unmasked([f"current_{i + 1}" for i in range(n)])
    moving = np.flatnonzero(np.nan_to_num(np.abs(wheels)).max(axis=1) * radius > _MOVING)
    if not len(moving):
        return
    start = float(time[moving[0]]) + START
    for k in range(int((time[-1] - start) / PIECE + 0.05)):
        inside = np.flatnonzero((time >= start + k * PIECE) & (time < start + (k + 1) * PIECE))
        if len(inside) < _FEWEST or not _is_steady(wheels[inside]):
            continue
        speed = np.nanmean(wheels[inside], axis=0)
        drawn = np.full(n, np.nan)
        for i in np.flatnonzero((np.abs(speed) > _TURNS) & np.isfinite(currents[inside]).any(axis=0)):
            drawn[i] = np.nanmean(currents[inside, i])
        velocity = _velocity(time[inside], pose[inside])
        yield start + (k + 0.5) * PIECE, speed, np.concatenate([velocity, drawn])


def _is_steady(speeds: Array) -> bool:
    """Whether all wheels are measured, and turn as fast in the second half as in the first."""
    halves = np.array_split(speeds, 2)
    if any(not np.isfinite(half).any(axis=0).all() for half in halves):
        return False
    first, second = (np.nanmean(half, axis=0) for half in halves)
    return bool(np.abs(second - first).max() <= _UNSTEADY * max(np.abs([first, second]).max(), 1e-9))


def _velocity(time: Array, pose: Array) -> Array:
    """Mean velocity in the body frame and yaw rate, shape (3,); NaN with too few poses."""
    keep = np.isfinite(pose).all(axis=1)
    if keep.sum() < _FEWEST:
        return np.full(3, np.nan)
    known = pose[keep]
    known[:, 2] = np.unwrap(known[:, 2])
    moved = np.array([*body_steps(known).sum(axis=0), known[-1, 2] - known[0, 2]])
    return moved / (time[keep][-1] - time[keep][0])
