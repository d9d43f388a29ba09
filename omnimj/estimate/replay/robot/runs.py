"""Measured missions on a common clock: inputs, block means, regimes and candidate experiments."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.signal import lfilter

from omnimj.errors import InputError
from omnimj.estimate.replay.base_parameters import floor_name
from omnimj.estimate.replay.interface import Experiment, Segment, average_blocks
from omnimj.estimate.replay.robot.kernels import (
    ACCELERATION,
    SPEED,
    STRETCH,
    WHEELS,
    YAW,
    YAW_RATE,
    Log,
    turns_in_windows,
)
from omnimj.estimate.replay.stretches import split_at_gaps
from omnimj.parameters import Floor, Robot
from omnimj.physics.kinematics import rolling_matrix, turned
from omnimj.plant.interface import robot_channels
from omnimj.recording.dataset import Dataset, Run
from omnimj.signals import Array

STEP = 0.004
"""Step of the replay [s]."""
WINDOW = 1.0
"""Length of a window of the heading [s]."""
NAMES = robot_channels(WHEELS)
_BLOCK = 5  # steps of a block at least
_MOST_BLOCKS = 6000
_GAP = 0.02  # [s] and five periods: a longer time without samples ends a stretch
_GAP_PERIODS = 5.0
_SHORTEST = 0.5  # [s] of a stretch
_SETTLING = 0.4  # [s] in which the body's velocity settles where a stretch begins in motion
_REST_SPEED, _REST_YAW_RATE = 0.3, 0.03  # [rad/s] below which a robot stands
_ACROSS = 1e-6  # [rad] off the right angle between driving direction and roller axis
_STANDING = 0.03  # [m/s]
_PAYLOAD = 2.0
"""Known mass placed at the centre of the robot [kg]."""
_SECONDS = 6.0
_LEGS = 1.5  # [s] of driving, coasting, driving back, coasting
_CURRENTS = {"slow": 0.3, "fast": 0.7}
"""Amplitude at the driving wheels [A]."""
_MOVES = {
    "ahead": ("straight ahead and back", (1.0, 0.0, 0.0)),
    "left": ("sideways to and fro", (0.0, 1.0, 0.0)),
    "diagonal": ("diagonally to and fro", (1.0, 1.0, 0.0)),
    "spin": ("turning on the spot, both ways", (0.0, 0.0, 0.5)),  # light: it soon turns fast
    "arc": ("ahead and back in a curve", (1.0, 0.0, 0.5)),
}


@dataclass(frozen=True)
class RobotRuns:
    """All stretches concatenated; each step holds the mean of the log over `STEP`."""

    size: int
    """Steps per block."""
    window: int
    """Steps per window, a multiple of `size`."""
    log: Log
    """The log for the kernels."""
    mass: Array
    """Declared mass, shape (stretches,) [kg]."""
    floor: tuple[str, ...]
    """Floor of each stretch."""
    measured: Array
    """Block means of `NAMES`, NaN where masked, the yaw less its mean over the window, shape (blocks, 12)."""
    segments: tuple[Segment, ...]
    """One per stretch."""


@dataclass(frozen=True)
class _Stretch:
    """Part of a run without gaps."""

    run: Run
    times: Array
    """Time since the start of the run, shape (steps,) [s]."""
    steps: Array
    """Means of `NAMES`, masked samples bridged, shape (steps, 12)."""
    masked: NDArray[np.bool_]
    """Mask of bad steps of each channel, shape (steps, 12)."""
    twist: Array
    """Body twist at the start, shape (3,)."""


def robot_runs(dataset: Dataset, robot: Robot, floors: dict[str, Floor]) -> RobotRuns:
    """Cut the runs at their gaps and take means.

    Raises:
      InputError: A run without floor, or no run that is long enough.
      UnknownNameError: Unknown floor.
    """
    rolling = rolling_matrix(robot.wheel_positions, robot.drive_directions)
    inverse: Array = np.asarray(robot.wheel.radius * np.linalg.pinv(rolling), float)
    chain = _filter_constants(robot)
    parts = [s for run in dataset.runs for s in _stretches(run, inverse, chain)]
    if not parts:
        raise InputError(dataset.path, "no run is long enough", f"{_SHORTEST:g} s without a gap are needed")
    total = sum(len(part.times) for part in parts)
    size = max(_BLOCK, int(np.ceil(total / _MOST_BLOCKS)))
    table, segments, measured, row, first = [], [], [], 0, 0
    for part in parts:
        count = len(part.times) // size
        table.append((first, first + count * size, row))
        time = average_blocks(part.times, size)
        segments.append(Segment(part.run.name, part.run.condition, row, row + count, time))
        measured.append(average_blocks(np.where(part.masked, np.nan, part.steps), size))
        row, first = row + count, first + count * size
    steps = np.concatenate([p.steps[: len(p.steps) // size * size] for p in parts])
    window = size * max(2, round(WINDOW / (size * STEP)))
    stretches, values = np.array(table, np.int64).reshape(-1, STRETCH), np.concatenate(measured)
    turns_in_windows(stretches, window, size, values[:, YAW].copy(), values[:, YAW])
    times = np.concatenate([p.times[: len(p.times) // size * size] for p in parts])
    return RobotRuns(
        size,
        window,
        _log(stretches, np.stack([p.twist for p in parts]), times, steps, values),
        np.array([float(p.run.conditions.get("mass", robot.body.mass)) for p in parts]),
        tuple(floor_name(dataset, p.run, floors) for p in parts),
        values,
        tuple(segments),
    )


def _log(stretches: NDArray[np.int64], start: Array, times: Array, steps: Array, blocks: Array) -> Log:
    """Columns of all stretches, with steps and block means of `NAMES`, for the kernels."""
    current, speed, yaw = (
        np.ascontiguousarray(steps[:, columns])
        for columns in (slice(SPEED), slice(SPEED, ACCELERATION), [YAW])
    )
    return Log(stretches, start, times, current, speed, yaw, blocks[:, YAW])


def synthetic_run(values: Array, floor: str, mass: float, like: RobotRuns) -> RobotRuns:
    """Simulated run in the form of measured ones.

    Args:
      values: Values of every channel at each step, shape (steps, 12).
      mass: Declared mass [kg].
      like: Gives sizes of blocks and windows.
    """
    count = len(values) // like.size
    values = values[: count * like.size]
    times: Array = STEP * (np.arange(len(values), dtype=float) + 0.5)
    stretches, measured = np.array([[0, len(values), 0]], np.int64), average_blocks(values, like.size)
    turns_in_windows(stretches, like.window, like.size, measured[:, YAW].copy(), measured[:, YAW])
    return RobotRuns(
        like.size,
        like.window,
        _log(stretches, np.zeros((1, 3)), times, values, measured),
        np.array([mass]),
        (floor,),
        measured,
        (Segment("made", "made", 0, count, average_blocks(times, like.size)),),
    )


def _filter_constants(robot: Robot) -> Array:
    """Time constants that make every channel as slow as the wheel speeds, shape (12,) [s].

    The equations are linear but for friction, so filtered currents move wheels that read filtered speeds.
    Advancing the speeds instead would not restore what the filter removed.
    """
    slowest, sensors = robot.sensors.speed_filter, robot.sensors
    chain = np.full(len(NAMES), slowest)
    chain[SPEED:ACCELERATION] = 0.0
    chain[ACCELERATION:YAW_RATE] -= 0.5 / (math.pi * sensors.accelerometer_bandwidth)
    chain[YAW_RATE] -= 0.5 / (math.pi * sensors.gyro_bandwidth)
    chain[YAW] -= 0.5 / sensors.yaw_update_rate
    return np.maximum(chain, 0.0)


def _low_passed(time: Array, values: Array, constant: float) -> Array:
    """Apply a first-order low-pass filter, exact for values held until the next sample."""
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
    """Split a run at its gaps into stretches that are long enough."""
    longest = max(_GAP, _GAP_PERIODS * float(np.median(np.diff(run.time))))
    parts = [(part, run.time[part]) for part in split_at_gaps(run.time, longest)]
    return [
        _stretch(run, part, inverse, chain)
        for part, time in parts
        if len(time) > 2 and time[-1] - time[0] >= _SHORTEST
    ]


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
    """Means between edges behind a filter, masked samples bridged, and the mask of affected intervals."""
    masked = np.zeros(len(edges) - 1, bool)
    if bad is not None and bad.any() and not bad.all():
        place = np.clip(((time[bad] - edges[0]) / STEP).astype(int), 0, len(masked) - 1)
        masked[place] = True
        time, values = time[~bad], values[~bad]
    values = _low_passed(time, values, constant)
    # integral of the linear interpolation between samples
    whole = np.concatenate(([0.0], np.cumsum(0.5 * np.diff(time) * (values[1:] + values[:-1]))))
    at = np.interp(edges, time, values)
    k = np.clip(np.searchsorted(time, edges, side="right") - 1, 0, len(time) - 1)
    integral = whole[k] + 0.5 * (edges - time[k]) * (values[k] + at)
    return np.diff(integral) / STEP, masked


def require_layout(dataset: Dataset, robot: Robot) -> None:
    """Refuse robots other than those with four wheels and rollers along the axle.

    Raises:
      InputError: The model or the dataset has another number of wheels, or a wheel has turned rollers.
    """
    rule = f"gaps are found for {WHEELS} wheels with rollers that roll along the axle"
    if len(robot.wheels) != WHEELS:
        raise InputError(f"{robot.file}: [[wheels]]", f"found {len(robot.wheels)} wheels", rule)
    for i, wheel in enumerate(robot.wheels, start=1):
        if abs(wheel.roller_angle - 0.5 * math.pi) > _ACROSS:
            place = f"{robot.file}: wheels.{i}.roller_angle"
            raise InputError(place, f"found {wheel.roller_angle:g} rad", rule)
    if dataset.wheels != WHEELS:
        raise InputError(dataset.path, f"has the columns of {dataset.wheels} wheels", rule)


def body_twist(runs: RobotRuns, robot: Robot) -> Array:
    """Twist of rigid rolling, least squares over the measured wheel speeds, shape (steps, 3)."""
    rolling = rolling_matrix(robot.wheel_positions, robot.drive_directions)
    return robot.wheel.radius * runs.log.speed @ np.linalg.pinv(rolling).T


def _along(runs: RobotRuns, rates: Array) -> Array:
    """Integrate rates over time, from 0 at the start of each stretch; same shape as the rates."""
    parts = [np.cumsum(rates[a:b], axis=0) * STEP for a, b, _ in runs.log.stretches]
    return np.concatenate(parts)


def _world(runs: RobotRuns, twist: Array) -> Array:
    """Rotate the body velocity into the world frame, shape (steps, 2) [m/s]."""
    return turned(twist[:, :2], runs.log.yaw[:, 0])


def variable_spans(runs: RobotRuns, robot: Robot) -> dict[str, tuple[float, float]]:
    """Lowest and highest value of each regime variable; speeds are those of a wheel's hub."""
    twist = body_twist(runs, robot)
    rim = robot.wheel.radius * runs.log.speed
    place = _along(runs, _world(runs, twist))[:, 0]
    reach = float(abs(robot.wheel_positions).max())
    ends = {
        "speed": (float(np.quantile(rim, 0.001)), float(np.quantile(rim, 0.999))),
        "position": (float(place.min()) - reach, float(place.max()) + reach),
        "time": (0.0, float(runs.log.times.max())),
        "lateral_speed": (float(twist[:, :2].min()), float(twist[:, :2].max())),
    }
    return {name: (low, max(high, low + 1e-3)) for name, (low, high) in ends.items()}


def regimes(runs: RobotRuns, robot: Robot) -> dict[str, tuple[str, Array]]:
    """Regime variables: name → unit and values, shape (blocks,); constant ones are left out."""
    steps = body_twist(runs, robot)
    size = runs.size
    twist = average_blocks(steps, size)
    speed = np.hypot(twist[:, 0], twist[:, 1])
    found = {
        "speed": ("m/s", speed),
        "speed_ahead": ("m/s", twist[:, 0]),
        "speed_left": ("m/s", twist[:, 1]),
        "yaw_rate": ("rad/s", twist[:, 2]),
        "acceleration": (
            "m/s2",
            np.hypot(*np.nan_to_num(runs.measured[:, ACCELERATION : ACCELERATION + 2]).T),
        ),
        "current": ("A", np.abs(average_blocks(runs.log.current, size)).mean(axis=1)),
        "position": ("m", average_blocks(_along(runs, _world(runs, steps)), size)[:, 0]),
        "heading": ("rad", average_blocks(runs.log.yaw, size)[:, 0]),
        "time": ("s", average_blocks(runs.log.times, size)),
    }
    angles = average_blocks(_along(runs, runs.log.speed), size)
    for i in range(WHEELS):
        found[f"wheel_angle_{i + 1}"] = ("rad", angles[:, i])
    rows = [(slice(p.first, p.last), p.time) for p in runs.segments]
    since = [_since_reversal(twist[own, :2], speed[own], time) for own, time in rows]
    found["reversal"] = ("s", np.concatenate(since))
    counts = np.array([p.last - p.first for p in runs.segments])
    if len(set(runs.floor)) > 1:
        found["floor"] = ("", np.repeat(np.array(runs.floor), counts))
    if len(set(runs.mass.tolist())) > 1:
        found["load"] = ("kg", np.repeat(runs.mass, counts))
    return {n: (unit, v) for n, (unit, v) in found.items() if v.dtype.kind == "U" or np.ptp(v) > 0.0}


def _since_reversal(velocity: Array, speed: Array, time: Array) -> Array:
    """Time since the robot last reversed or started, shape (blocks,) [s]."""
    since, last, direction = np.empty(len(time)), float(time[0]), np.zeros(2)
    for k in range(len(time)):
        if speed[k] > _STANDING:
            ahead = velocity[k] / speed[k]
            if ahead @ direction <= 0.0:
                last, direction = float(time[k]), ahead
        since[k] = time[k] - last
    return since


def robot_experiments(floors: tuple[str, ...]) -> tuple[Experiment, ...]:
    """Candidate runs: moves × speeds × with and without a known mass on the robot × floors."""
    found = []
    for floor in dict.fromkeys((*floors, "natural_stone")):
        for move, (words, _) in _MOVES.items():
            for pace, current in _CURRENTS.items():
                for added in (0.0, _PAYLOAD):
                    text = f"{words}, {pace} ({current:g} A at most), on {floor.replace('_', ' ')}"
                    text += f", {added:g} kg put on" if added else ""
                    run = {"move": move, "current": current, "added_mass": added, "floor": floor}
                    name = f"{move}_{pace}_{added:g}_{floor}"
                    found.append(Experiment(name, text, run | {"duration": _SECONDS}))
    return tuple(found)


def experiment_currents(robot: Robot, experiment: Experiment) -> Array:
    """Currents of a candidate run: forward, off, backward, off; shape (steps, 4) [A]."""
    direction = np.array(_MOVES[str(experiment.run["move"])][1])
    rolling = rolling_matrix(robot.wheel_positions, robot.drive_directions)
    per_wheel = rolling @ (direction / np.array([1.0, 1.0, np.hypot(*robot.wheel_positions[0])]))
    per_wheel /= max(1.0, abs(per_wheel).max())
    leg: NDArray[np.int_] = (np.arange(round(_SECONDS / STEP)) * STEP / _LEGS).astype(int)
    size = np.array([1.0, 0.0, -1.0, 0.0])[np.minimum(leg, 3)]
    return float(experiment.run["current"]) * size[:, None] * per_wheel[None, :]
