"""Numbers of measured and simulated drives: means of runs, groups by floor and speed, the marker's angle."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from omnimj.estimate.drives.records import DrivenRun, Group, Motion, RunNumbers
from omnimj.estimate.intervals import finite_rms
from omnimj.parameters import Robot
from omnimj.physics.kinematics import rolling_matrix, turned
from omnimj.signals import Array

FEWEST_RUNS = 4
"""Fewest runs on a floor that determine the marker's angle: a single one would hide its own error in it."""
_MOVING = 0.02  # [m/s] slower runs turn on the spot
_TURNS = 0.2  # [rad/s] slower wheels' friction has no known sign
_GAP = 1.25  # ratio of neighbouring speeds at which a new group begins
_HALF_WINDOW = 0.25  # [s] of a velocity over time
_PATH_STEP = 0.5  # [s] between points of a path: noise of each picture would lengthen it


def marker_angle(runs: Sequence[DrivenRun]) -> float | None:
    """Angle by which the marker is turned on the robot, mean over the runs on one floor [rad].

    It is the angle between measured and simulated velocity that leaves the least squares of their difference.
    None with fewer than `FEWEST_RUNS` that drive.
    """
    pairs = [(mean_velocity(run, run.measured), mean_velocity(run, run.simulated)) for run in runs]
    moving = [
        (m, s)
        for m, s in pairs
        if np.isfinite([m, s]).all() and min(np.hypot(*m[:2]), np.hypot(*s[:2])) > _MOVING
    ]
    if len(moving) < FEWEST_RUNS:
        return None
    total = sum(complex(*m[:2]) * complex(*s[:2]).conjugate() for m, s in moving)
    return float(-np.angle(total))


def with_marker(run: DrivenRun, angle: float) -> DrivenRun:
    """The run with its simulated path as the camera sees it if the heading reads too high by an angle.

    Args:
      run: A run whose simulation began at the measured heading.
      angle: By which the marker is turned on the robot [rad].
    """
    start, pose = run.simulated.pose[0, :2], run.simulated.pose.copy()
    pose[:, :2] = start + turned(pose[:, :2] - start, -angle)
    return replace(run, simulated=Motion(pose, run.simulated.currents))


def mean_velocity(run: DrivenRun, motion: Motion) -> Array:
    """Mean velocity in the body frame [m/s] and yaw rate [rad/s], shape (3,); NaN where too little is known.

    Samples are those at which the pose was measured, for measurement and simulation alike.
    """
    keep = (run.time >= run.counted_from) & np.isfinite(run.measured.pose).all(axis=1)
    if keep.sum() < 2:
        return np.full(3, np.nan)
    time, moved = run.time[keep], body_steps(motion.pose[keep])
    rotation = motion.pose[keep][-1, 2] - motion.pose[keep][0, 2]
    return np.array([*moved.sum(axis=0), rotation]) / (time[-1] - time[0])


def velocity_course(run: DrivenRun, motion: Motion) -> Array:
    """Body velocity over half a second at every sample, shape (k, 2) [m/s]; NaN where unknown."""
    known = np.isfinite(run.measured.pose).all(axis=1)
    course = np.full((len(run.time), 2), np.nan)
    if known.sum() < 2:
        return course
    time, place = run.time[known], np.zeros((int(known.sum()), 2))
    place[1:] = np.cumsum(body_steps(motion.pose[known]), axis=0)
    early = np.clip(run.time[known] - _HALF_WINDOW, time[0], None)
    late = np.clip(run.time[known] + _HALF_WINDOW, None, time[-1])
    for k, column in enumerate(place.T):
        course[known, k] = (np.interp(late, time, column) - np.interp(early, time, column)) / (late - early)
    return course


def body_steps(pose: Array) -> Array:
    """Displacements from pose to pose in the body frame, shape (k − 1, 2) [m]."""
    middle = 0.5 * (pose[1:, 2] + pose[:-1, 2])
    return turned(np.diff(pose[:, :2], axis=0), -middle)


def run_numbers(run: DrivenRun, robot: Robot) -> RunNumbers:
    """Means and ends of a run."""
    counted = run.time >= run.counted_from
    inverse = np.linalg.pinv(rolling_matrix(robot.wheel_positions, robot.rolling_directions))
    wheels = run.wheel_speed[counted].mean(axis=0) if counted.any() else run.wheel_speed.mean(axis=0)
    rolling = robot.wheel.radius * inverse @ wheels
    known = np.isfinite(run.measured.pose).all(axis=1)
    measured, simulated = run.measured.pose[known], run.simulated.pose[known]
    along = _dead_reckoned(measured, simulated)
    means = _mean_currents(run, counted, np.abs(wheels) > _TURNS)
    return RunNumbers(
        run=run.run,
        plant=run.plant,
        floor=run.floor,
        wheel_rolling=float(np.hypot(rolling[0], rolling[1])),
        measured=mean_velocity(run, run.measured),
        simulated=mean_velocity(run, run.simulated),
        measured_currents=means[0],
        simulated_currents=means[1],
        path=_length(run.time[known], measured),
        end_by_measured_heading=float(np.hypot(*(along - measured[-1, :2]))),
        end_by_own_heading=float(np.hypot(*(simulated[-1, :2] - measured[-1, :2]))),
    )


def _dead_reckoned(measured: Array, simulated: Array) -> Array:
    """End of a path of the simulated velocities along the measured heading, shape (2,) [m]."""
    middle = 0.5 * (measured[1:, 2] + measured[:-1, 2])
    moved = turned(body_steps(simulated), middle)
    return measured[0, :2] + np.array([np.sum(column) for column in moved.T])


def _length(time: Array, pose: Array) -> float:
    points = np.arange(time[0], time[-1] + _PATH_STEP, _PATH_STEP)
    x, y = (np.interp(points, time, column) for column in pose[:, :2].T)
    return float(np.hypot(np.diff(x), np.diff(y)).sum())


def _mean_currents(
    run: DrivenRun, counted: NDArray[np.bool_], turns: NDArray[np.bool_]
) -> tuple[Array, Array]:
    """Means of measured and simulated currents over the same samples, shape (n,) each."""
    n = run.measured.currents.shape[1]
    means = np.full((2, n), np.nan)
    for i in range(n):
        keep = counted & np.isfinite(run.measured.currents[:, i])
        if turns[i] and keep.any():
            means[:, i] = [motion.currents[keep, i].mean() for motion in (run.measured, run.simulated)]
    return means[0], means[1]


def speed_groups(numbers: Iterable[RunNumbers]) -> tuple[Group, ...]:
    """Groups of runs by floor and speed, in the order of the floors, slow ones first, plant by plant.

    Where the wheels' speeds of neighbouring runs differ by a quarter, another group begins.
    """
    groups = []
    everything = list(numbers)
    for floor in dict.fromkeys(one.floor for one in everything):
        own = [one for one in everything if one.floor == floor]
        speeds: dict[str, float] = {one.run: one.wheel_rolling for one in own}
        for names in _clusters(speeds):
            for plant in dict.fromkeys(one.plant for one in own):
                chosen = [one for one in own if one.plant == plant and one.run in names]
                if chosen:
                    groups.append(_group(chosen))
    return tuple(groups)


def _clusters(speeds: dict[str, float]) -> list[set[str]]:
    """Names of runs of about the same speed, slow ones first."""
    clusters: list[set[str]] = []
    last = -1.0
    for name in sorted(speeds, key=lambda name: speeds[name]):
        speed = speeds[name]
        if last < 0.0 or speed > max(_GAP * last, _MOVING) >= last:
            clusters.append(set())
        clusters[-1].add(name)
        last = speed
    return clusters


def _group(runs: Sequence[RunNumbers]) -> Group:
    measured, simulated = (
        np.array([getattr(one, name) for one in runs]) for name in ("measured", "simulated")
    )
    currents, drawn = (
        np.array([getattr(one, name) for one in runs]) for name in ("measured_currents", "simulated_currents")
    )
    speed = float(np.nanmean(np.hypot(measured[:, 0], measured[:, 1])))
    errors = simulated - measured
    ends = np.array([(one.end_by_measured_heading, one.end_by_own_heading) for one in runs])
    paths = np.array([one.path for one in runs])
    far = np.median(ends / paths[:, None], axis=0) if speed > _MOVING else (np.nan, np.nan)
    return Group(
        floor=runs[0].floor,
        plant=runs[0].plant,
        runs=tuple(one.run for one in runs),
        wheel_rolling=float(np.mean([one.wheel_rolling for one in runs])),
        measured_speed=speed,
        simulated_speed=float(np.nanmean(np.hypot(simulated[:, 0], simulated[:, 1]))),
        velocity_error=float(finite_rms(np.hypot(errors[:, 0], errors[:, 1])) / speed)
        if speed > _MOVING
        else np.nan,
        current_error=np.array([finite_rms(column) for column in (drawn - currents).T]),
        measured_current=np.array([finite_rms(column) for column in currents.T]),
        measured_yaw_rate=finite_rms(measured[:, 2]),
        yaw_rate_error=finite_rms(errors[:, 2]),
        end_by_measured_heading=float(far[0]),
        end_by_own_heading=float(far[1]),
    )
