"""Identification of a robot from a dataset of healthy driving."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from omnimj.errors import InputError
from omnimj.estimate.intervals import channel_rms
from omnimj.estimate.robot.balance import predicted_accelerations
from omnimj.estimate.robot.blocks import RunRows, robot_rows
from omnimj.estimate.robot.creep import identify_creep
from omnimj.estimate.robot.current_errors import without_aliasing, without_noise
from omnimj.estimate.robot.excitation import unexcited
from omnimj.estimate.robot.fit import RobotFit, fit_robot, readings, residuals
from omnimj.estimate.robot.measured_pose import delay_behind_torques
from omnimj.estimate.robot.pose_check import require_like_motion
from omnimj.estimate.robot.quantities import estimates
from omnimj.estimate.robot.records import RobotIdentification
from omnimj.estimate.robot.uncertainty import doubt_by_wheel_inertia, doubt_of
from omnimj.estimate.robot.unknowns import Unknowns, unknowns
from omnimj.estimate.threads import Progress
from omnimj.parameters import Robot
from omnimj.recording.dataset import Dataset
from omnimj.signals import Array

LEAST_MOTION = 20.0
"""Shortest motion from which a robot is identified [s]."""
_FEW_RUNS = 4
_SLOWER = 1.5  # samples of the controller per sample of a log
_MUCH_ALIASING = 0.03  # doubt of the yaw inertia by aliasing from which it is noted, relative


def identify_robot(dataset: Dataset, robot: Robot, progress: Progress | None = None) -> RobotIdentification:
    """Identify motors, losses, masses, sensors and floors of a robot from healthy driving.

    The estimate is the maximum a posteriori under the force balance; intervals cover 90 % and come from
    leaving out whole runs. What the drive does not excite keeps its prior and is listed with the manoeuvre
    that would excite it.

    Args:
      dataset: Runs without any fault, checked by `sound_dataset`.

    Raises:
      InputError: Not a robot, another number of wheels, a channel is missing, runs of different mass, or
        too little motion.
    """
    done = progress or (lambda _now, _all: None)
    robot, known = _with_stated_mass(dataset, require_robot(dataset, robot))
    done(0, 3)
    rows = robot_rows(dataset, robot)
    _require_motion(dataset, rows)
    start = unknowns(robot, known)
    if _is_slower(dataset, robot):
        start = start.of_slow_logs()
    if dataset.pose_measured:
        require_like_motion(dataset.path, rows, start.nominal.robot)
        start = start.of_pose(_pose_delay(start, rows))
        rows = robot_rows(dataset, robot, start.pose_delay)
    done(1, 3)
    fit, aliasing = without_aliasing(without_noise(fit_robot(start, rows), rows), rows)
    done(2, 3)
    found = estimates(doubt_of(fit, (aliasing, doubt_by_wheel_inertia(fit, rows))))
    floors, without = identify_creep(fit, rows)
    notes = list(dataset.notes)
    if float(np.linalg.norm(aliasing)) > _MUCH_ALIASING:
        notes.append("currents ripple faster than the log samples: the yaw inertia is uncertain, log faster")
    if len(rows) < _FEW_RUNS:
        notes.append(
            f"{len(rows)} runs: intervals that leave out whole runs need at least {_FEW_RUNS} of them"
        )
    result = RobotIdentification(
        dataset.path,
        robot,
        fit,
        tuple(estimate for _, estimate in found),
        unexcited(fit, found),
        floors,
        without,
        _noise(fit, rows),
        sum(run.duration for run in rows),
        _misfit(fit, rows),
        tuple(notes),
    )
    done(3, 3)
    return result


def _is_slower(dataset: Dataset, robot: Robot) -> bool:
    """Whether the logs have fewer samples than the controller."""
    period = float(np.median([np.median(np.diff(run.time)) for run in dataset.runs]))
    return period * robot.sensors.sample_rate > _SLOWER


def _pose_delay(nominal: Unknowns, rows: Sequence[RunRows]) -> float:
    """Delay of the measured pose behind the torques, median over the runs [s]."""
    found, x = [], np.zeros(len(nominal.each))
    for run in rows:
        predicted = predicted_accelerations(nominal.constants(x), nominal.errors(x), run)
        for number in np.unique(run.stretch):
            part = run.stretch == number
            found.append(delay_behind_torques(run.time[part], predicted[part], readings(run)[part]))
    return float(np.median(found)) + (rows[0].pose_delay or 0.0)


def require_robot(dataset: Dataset, robot: Robot) -> Robot:
    """Check that a dataset is one of this robot, and return the robot.

    Raises:
      InputError: It is not.
    """
    if dataset.plant != "uto_robot":
        rule = "a robot is identified from its own logs"
        raise InputError(f"{dataset.path}: plant", f"found {dataset.plant!r}", rule, ("uto_robot",))
    n = len(robot.wheels)
    if n != dataset.wheels:
        rule = f"the logs of {dataset.path} have {dataset.wheels}: pass --model, e.g. three_wheel"
        raise InputError(robot.file, f"has {n} [[wheels]]", rule)
    return robot


def _with_stated_mass(dataset: Dataset, robot: Robot) -> tuple[Robot, bool]:
    """The robot with the mass that the runs state, and whether they do."""
    stated = {run.conditions.get("mass") for run in dataset.runs}
    if stated == {None}:
        return robot, False
    if len(stated) > 1:
        found = ", ".join("none" if mass is None else f"{float(mass):g} kg" for mass in stated)
        rule = "all runs must state the same mass; identify each mass separately"
        raise InputError(f"{dataset.path}: mass", f"found {found}", rule)
    mass = float(stated.pop() or robot.body.mass)
    return replace(robot, body=replace(robot.body, mass=mass)), True


def _require_motion(dataset: Dataset, rows: Sequence[RunRows]) -> None:
    moved = sum(float(np.mean(run.good & ~run.still)) * run.duration for run in rows)
    turning = sum(float(np.mean((run.slowest > 1.5).any(axis=1))) * run.duration for run in rows)
    if min(moved, turning) < LEAST_MOTION:
        rule = f"at least {LEAST_MOTION:g} s with turning wheels are needed"
        raise InputError(dataset.path, f"has {turning:.3g} s of motion", rule)


def _misfit(fit: RobotFit, rows: Sequence[RunRows]) -> Array:
    parts = []
    for one, run in zip(fit.runs, rows, strict=True):
        rest = residuals(fit.unknowns, fit.x, run)
        rest[:, :2] += one.bias
        parts.append(rest[run.good & ~run.still & (run.slowest > 1.5).all(axis=1)])
    return channel_rms(np.concatenate(parts))


def _noise(fit: RobotFit, rows: Sequence[RunRows]) -> Mapping[str, float]:
    """Noise and biases of the sensors, means over the runs."""
    noise = np.mean([run.noise for run in rows], axis=0)
    currents = float(noise[: len(fit.unknowns.nominal.axle)].mean())
    if fit.unknowns.pose_delay is not None:
        return {
            "position_noise": float(noise[-3:-1].mean()),
            "heading_noise": float(noise[-1]),
            "current_noise": currents,
        }
    biases = np.array([run.bias for run in fit.runs])
    return {
        "acceleration_x_bias": float(biases[:, 0].mean()),
        "acceleration_y_bias": float(biases[:, 1].mean()),
        "yaw_rate_bias": float(np.mean([run.yaw_rate_bias for run in rows])),
        "acceleration_noise": float(noise[-3]),
        "yaw_rate_noise": float(noise[-1]),
        "current_noise": currents,
    }
