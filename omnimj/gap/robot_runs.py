"""Measured missions on one clock: what drives the replay, and block means of what it is compared with."""

from __future__ import annotations

import itertools
import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import uniform_filter1d
from scipy.signal import lfilter

from omnimj.errors import InputError, UnknownNameError
from omnimj.gap.replay import Piece, blocks
from omnimj.gap.robot_kernels import ACCELERATION, SPEED, STRETCH, WHEELS, YAW, YAW_RATE, turns_in_windows
from omnimj.parameters import Floor, Robot
from omnimj.physics.kinematics import rolling_matrix
from omnimj.plant.channels import robot_channels
from omnimj.recording.dataset import Dataset, Run
from omnimj.signals import Array

STEP = 0.004
"""Step of the replay [s]."""
WINDOW = 1.0
"""Time that a window is left to itself [s]."""
NAMES = robot_channels(WHEELS)
_BLOCK = 5  # steps of a block at least
_MOST_BLOCKS = 6000
_SMOOTH = 1  # steps over which every channel is smoothed alike
_GAP = 0.02  # [s] and five periods: a longer time without samples ends a stretch
_GAP_PERIODS = 5.0
_SHORTEST = 0.5  # [s] of a stretch
_SETTLING = 0.4  # [s] in which the body finds its velocity where a stretch begins on the move
_REST_SPEED, _REST_YAW_RATE = 0.3, 0.03  # [rad/s] below which a robot stands


@dataclass(frozen=True)
class RobotRuns:
    """All stretches one behind the other; a step is the mean of the log over `STEP`."""

    size: int
    """Steps per block."""
    window: int
    """Steps per window, a multiple of `size`."""
    stretches: NDArray[np.int64]
    """See `robot_kernels.STRETCH`."""
    start: Array
    """Body twist at each start, shape (stretches, 3)."""
    times: Array
    """Since the run's start, shape (steps,) [s]."""
    current: Array
    """Shape (steps, 4) [A]."""
    speed: Array
    """Of the wheels, shape (steps, 4) [rad/s]."""
    yaw: Array
    """Unwrapped, shape (steps, 1) [rad]."""
    mass: Array
    """Declared, shape (stretches,) [kg]."""
    floor: tuple[str, ...]
    """Of each stretch."""
    measured: Array
    """Block means of `NAMES`, NaN where masked, the yaw less its mean over the window, shape (blocks, 12)."""
    pieces: tuple[Piece, ...]
    """One per stretch."""


@dataclass(frozen=True)
class _Stretch:
    """A part of a run without gaps."""

    run: Run
    times: Array
    steps: Array
    """Means of `NAMES`, masked samples bridged, shape (steps, 12)."""
    masked: NDArray[np.bool_]
    """Shape (steps, 12)."""
    twist: Array
    """At the start, shape (3,)."""


def robot_runs(dataset: Dataset, robot: Robot, floors: dict[str, Floor]) -> RobotRuns:
    """Cuts the runs at their gaps and takes means.

    Raises:
      InputError: A run without floor, or no run that is long enough.
      UnknownNameError: A floor that is not known.
    """
    rolling = rolling_matrix(robot.wheel_positions, robot.drive_directions)
    inverse: Array = np.asarray(robot.wheel.radius * np.linalg.pinv(rolling), float)
    chain = _chain(robot)
    parts = [s for run in dataset.runs for s in _stretches(run, inverse, chain)]
    if not parts:
        raise InputError(dataset.path, "no run is long enough", f"{_SHORTEST:g} s without a gap are needed")
    total = sum(len(part.times) for part in parts)
    size = max(_BLOCK, int(np.ceil(total / _MOST_BLOCKS)))
    table, pieces, measured, row, first = [], [], [], 0, 0
    for part in parts:
        count = len(part.times) // size
        table.append((first, first + count * size, row))
        time = blocks(part.times, size)
        pieces.append(Piece(part.run.name, part.run.condition, row, row + count, time))
        measured.append(blocks(np.where(part.masked, np.nan, part.steps), size))
        row, first = row + count, first + count * size
    steps = np.concatenate([p.steps[: len(p.steps) // size * size] for p in parts])
    window = size * max(2, round(WINDOW / (size * STEP)))
    stretches, said = np.array(table, np.int64).reshape(-1, STRETCH), np.concatenate(measured)
    turns_in_windows(stretches, window, size, said[:, YAW].copy(), said[:, YAW])
    return RobotRuns(
        size,
        window,
        stretches,
        np.stack([p.twist for p in parts]),
        np.concatenate([p.times[: len(p.times) // size * size] for p in parts]),
        np.ascontiguousarray(steps[:, :WHEELS]),
        np.ascontiguousarray(steps[:, WHEELS : 2 * WHEELS]),
        np.ascontiguousarray(steps[:, -1:]),
        np.array([float(p.run.conditions.get("mass", robot.body.mass)) for p in parts]),
        tuple(_floor(dataset, p.run, floors) for p in parts),
        said,
        tuple(pieces),
    )


def made_run(said: Array, floor: str, mass: float, like: RobotRuns) -> RobotRuns:
    """One run as if it had been measured.

    Args:
      said: Of every channel at each step, shape (steps, 12).
      floor: Its floor.
      mass: The declared mass [kg].
      like: Gives sizes of blocks and windows.
    """
    count = len(said) // like.size
    said = said[: count * like.size]
    times: Array = STEP * (np.arange(len(said), dtype=float) + 0.5)
    stretches, measured = np.array([[0, len(said), 0]], np.int64), blocks(said, like.size)
    turns_in_windows(stretches, like.window, like.size, measured[:, YAW].copy(), measured[:, YAW])
    return RobotRuns(
        like.size,
        like.window,
        stretches,
        np.zeros((1, 3)),
        times,
        np.ascontiguousarray(said[:, :WHEELS]),
        np.ascontiguousarray(said[:, WHEELS : 2 * WHEELS]),
        np.ascontiguousarray(said[:, -1:]),
        np.array([mass]),
        (floor,),
        measured,
        (Piece("made", "made", 0, count, blocks(times, like.size)),),
    )


def _floor(dataset: Dataset, run: Run, floors: dict[str, Floor]) -> str:
    name = run.conditions.get("floor")
    place = dataset.path / "dataset.toml"
    if name is None:
        raise InputError(f"{place}: runs.{run.name}", "'floor' is missing", "say which floor", floors)
    if name not in floors:
        raise UnknownNameError(f"{place}: runs.{run.name}.floor", "floor", name, floors)
    return str(name)


def _chain(robot: Robot) -> Array:
    """Time constants that make every channel as slow as the wheels' speed, shape (12,) [s].

    The equations are linear but for friction: filtered currents move wheels that read filtered speeds, where
    speeds set right by an advance would lack what the filter took away.
    """
    slowest, sensors = robot.sensors.speed_filter, robot.sensors
    chain = np.full(len(NAMES), slowest)
    chain[SPEED:ACCELERATION] = 0.0
    chain[ACCELERATION:YAW_RATE] -= 0.5 / (math.pi * sensors.accelerometer_bandwidth)
    chain[YAW_RATE] -= 0.5 / (math.pi * sensors.gyro_bandwidth)
    chain[YAW] -= 0.5 / sensors.yaw_update_rate
    return np.maximum(chain, 0.0)


def _slowed(time: Array, values: Array, constant: float) -> Array:
    """Behind a filter of the first order, exact for values that hold until the next sample."""
    if constant <= 0.0 or len(time) < 2:
        return values
    step = np.diff(time)
    if np.ptp(step) < 1e-3 * step.mean():
        a = math.exp(-float(step.mean()) / constant)
        return lfilter([1.0 - a], [1.0, -a], values, zi=[a * values[0]])[0]
    slowed, keep = np.empty(len(values)), np.exp(-step / constant)
    slowed[0] = values[0]
    for k in range(1, len(values)):
        slowed[k] = keep[k - 1] * slowed[k - 1] + (1.0 - keep[k - 1]) * values[k]
    return slowed


def _stretches(run: Run, inverse: Array, chain: Array) -> list[_Stretch]:
    """Parts of a run between its gaps that are long enough."""
    step = np.diff(run.time)
    longest = max(_GAP, _GAP_PERIODS * float(np.median(step)))
    cuts = [0, *(np.flatnonzero(step > longest) + 1).tolist(), len(run.time)]
    found = []
    for a, b in itertools.pairwise(cuts):
        if b - a > 2 and run.time[b - 1] - run.time[a] >= _SHORTEST:
            found.append(_stretch(run, slice(a, b), inverse, chain))
    return found


def _stretch(run: Run, part: slice, inverse: Array, chain: Array) -> _Stretch:
    time = run.time[part]
    edges = time[0] + STEP * np.arange(int((time[-1] - time[0]) / STEP * (1.0 + 1e-9)) + 1)
    count = len(edges) - 1
    steps, masked = np.empty((count, len(NAMES))), np.zeros((count, len(NAMES)), bool)
    for c, name in enumerate(NAMES):
        values = run.columns[name][part]
        if name == "yaw":
            values = np.unwrap(values)
        bad = run.masked.get(name)
        bad = None if bad is None else bad[part]
        steps[:, c], masked[:, c] = _means(time, values, bad, edges, float(chain[c]))
    steps = uniform_filter1d(steps, _SMOOTH, axis=0, mode="nearest")
    first = max(1, round(0.02 / STEP))
    wheels, yaw_rate = steps[:first, WHEELS : 2 * WHEELS].mean(axis=0), steps[:first, -2].mean()
    rests = bool((abs(wheels) < _REST_SPEED).all() and abs(yaw_rate) < _REST_YAW_RATE)
    if not rests:
        masked[: round(_SETTLING / STEP)] = True
    twist = np.zeros(3) if rests else inverse @ wheels
    return _Stretch(run, 0.5 * (edges[1:] + edges[:-1]) - run.time[0], steps, masked, twist)


def _means(
    time: Array, values: Array, bad: NDArray[np.bool_] | None, edges: Array, constant: float
) -> tuple[Array, NDArray[np.bool_]]:
    """Means between edges behind a filter, masked samples bridged; and between which edges any was masked."""
    masked = np.zeros(len(edges) - 1, bool)
    if bad is not None and bad.any() and not bad.all():
        place = np.clip(((time[bad] - edges[0]) / STEP).astype(int), 0, len(masked) - 1)
        masked[place] = True
        time, values = time[~bad], values[~bad]
    values = _slowed(time, values, constant)
    # the integral of straight lines between samples
    whole = np.concatenate(([0.0], np.cumsum(0.5 * np.diff(time) * (values[1:] + values[:-1]))))
    at = np.interp(edges, time, values)
    k = np.clip(np.searchsorted(time, edges, side="right") - 1, 0, len(time) - 1)
    integral = whole[k] + 0.5 * (edges - time[k]) * (values[k] + at)
    return np.diff(integral) / STEP, masked
