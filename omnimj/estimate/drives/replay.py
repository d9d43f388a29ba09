"""One measured drive again: wheels turn as measured, and floor and motors of the model do the rest."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from omnimj.effects import ChannelEffect, apply_effects
from omnimj.errors import InputError, SimulationError
from omnimj.estimate.drives.records import DrivenRun, Motion
from omnimj.parameters import Floor, Robot
from omnimj.physics.kinematics import rolling_matrix, turned
from omnimj.recording.dataset import Run
from omnimj.signals import Array, Trace
from omnimj.simulate.driving import follow_wheel_speeds
from omnimj.simulate.plants import make_simulated

ROLLING = "rolling"
"""Name of the baseline: the body moves as its wheels roll, without slip."""
START = 1.0
"""Time after the first motion of a wheel from which means are taken [s]."""
_SAMPLES = 6  # whose mean is a target: counts of encoders come in packets longer or shorter than a sample
_MOVING = 0.02  # [m/s] at the rim


class Drive(NamedTuple):
    """Inputs that a measured run gives its simulation."""

    run: Run
    floor: str
    targets: Array
    """Wheel speeds of every control period, shape (rows, n) [rad/s]."""
    start: tuple[float, float, float]
    """Measured x, y [m] and heading [rad] at the first sample."""


def wheel_names(channel: str, wheels: int) -> tuple[str, ...]:
    """Column names of a channel of every wheel."""
    return tuple(f"{channel}_{i}" for i in range(1, wheels + 1))


def measured_drive(run: Run, robot: Robot, floor: str) -> Drive:
    """Prepare a measured run.

    Masked samples are bridged by straight lines.

    Raises:
      InputError: A run whose pose or whose wheel speeds are masked throughout.
    """
    speeds = run.unmasked(wheel_names("wheel_speed", robot.wheel_count))
    pose = run.unmasked(("x", "y", "heading"))
    known = np.isfinite(pose).all(axis=1)
    if not known.any() or not np.isfinite(speeds).any(axis=0).all():
        raise InputError(
            f"run {run.name}", "pose or wheel speeds are unknown throughout", "leave this run out"
        )
    targets = _targets(run.time, speeds, 1.0 / robot.sensors.sample_rate)
    x, y, heading = pose[known][0].tolist()
    return Drive(run, floor, targets, (x, y, heading))


def _targets(time: Array, speeds: Array, period: float) -> Array:
    """Wheel speeds of every control period: means over some samples, so that wheels turn as far as measured.

    A sample is the mean since the sample before it, as counts over the time between them are.
    """
    length = np.diff(time, prepend=2.0 * time[0] - time[1])
    half = 0.5 * _SAMPLES * float(np.median(np.diff(time)))
    edges = np.concatenate(([time[0] - length[0]], time))
    now = np.arange(time[0], time[-1], period)
    early, late = np.clip(now - half, edges[0], None), np.clip(now + half, None, edges[-1])
    columns = []
    for own in speeds.T:
        known = np.isfinite(own)
        turned = np.concatenate(([0.0], np.cumsum(length * np.interp(time, time[known], own[known]))))
        columns.append((np.interp(late, edges, turned) - np.interp(early, edges, turned)) / (late - early))
    return np.column_stack(columns)


def _follow(plant: str, drive: Drive, robot: Robot, floors: dict[str, Floor]) -> Trace:
    options: dict[str, Any] = {"start": drive.start, "ideal_sensors": True}
    try:
        made = make_simulated(plant, robot, drive.floor, floors, **options)
        return follow_wheel_speeds(made, robot, drive.targets)
    except SimulationError as error:
        raise SimulationError(f"run {drive.run.name}, {plant}: {error}") from None


def replay_drive(plant: str, drive: Drive, robot: Robot, floors: dict[str, Floor]) -> DrivenRun:
    """Simulate a measured run on one plant: `twin`, `planar` or `rolling`.

    Raises:
      SimulationError: The simulation left finite numbers.
    """
    run, n = drive.run, robot.wheel_count
    changed = apply_effects(robot)
    now = drive.run.time[0] + np.arange(len(drive.targets)) / robot.sensors.sample_rate
    if plant == ROLLING:
        pose, currents = _rolled(drive, robot), np.full(drive.targets.shape, np.nan)
    else:
        trace = _follow(plant, drive, robot, floors)
        pose = np.column_stack([trace["x"], trace["y"], trace["heading"]])
        currents = trace.wheels("current")[:, :n]
    scale = changed.channels.get("x", ChannelEffect()).scale
    pose[:, :2] = drive.start[:2] + scale * (pose[:, :2] - drive.start[:2])
    measured = Motion(
        _unwrapped(run.unmasked(("x", "y", "heading"))), run.unmasked(wheel_names("current", n))
    )
    return DrivenRun(
        run=run.name,
        plant=plant,
        floor=drive.floor,
        time=run.time,
        wheel_speed=_sampled(run.time, now, drive.targets),
        measured=measured,
        simulated=Motion(_sampled(run.time, now, pose), _sampled(run.time, now, currents)),
        counted_from=_counted_from(now, drive.targets, robot.wheel.radius),
    )


def _rolled(drive: Drive, robot: Robot) -> Array:
    """Pose of a body that moves as its wheels roll, shape (rows, 3)."""
    inverse = np.linalg.pinv(rolling_matrix(robot.wheel_positions, robot.rolling_directions))
    twist = robot.wheel.radius * drive.targets @ inverse.T / robot.sensors.sample_rate
    x, y, heading = drive.start
    headings = heading + np.cumsum(twist[:, 2]) - 0.5 * twist[:, 2]
    moved = turned(twist[:, :2], headings)
    return np.column_stack([np.array([x, y]) + np.cumsum(moved, axis=0), headings])


def _counted_from(time: Array, speeds: Array, radius: float) -> float:
    """Time from which means are taken: `START` after the first motion; the end of a run at rest."""
    moving = np.flatnonzero(radius * np.abs(speeds).max(axis=1) > _MOVING)
    return float(time[moving[0]]) + START if len(moving) else float(time[-1])


def _unwrapped(pose: Array) -> Array:
    """Pose with its heading unwrapped over masked samples, shape (k, 3)."""
    known = np.isfinite(pose[:, 2])
    found = pose.copy()
    found[known, 2] = np.unwrap(pose[known, 2])
    return found


def _sampled(time: Array, now: Array, rows: Array) -> Array:
    return np.column_stack([np.interp(time, now, column) for column in rows.T])
