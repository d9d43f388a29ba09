"""What the measurement says of every block of a mission: speed, direction, turning, place, time, …"""

from __future__ import annotations

import numpy as np

from omnimj.gap.robot_kernels import ACCELERATION, WHEELS
from omnimj.gap.robot_runs import STEP, RobotRuns
from omnimj.parameters import Robot
from omnimj.physics.kinematics import rolling_matrix
from omnimj.signals import Array

_STANDING = 0.03  # [m/s]


def body_twist(runs: RobotRuns, robot: Robot) -> Array:
    """Twist of rigid rolling, least squares over the measured wheel speeds, per step, shape (steps, 3)."""
    rolling = rolling_matrix(robot.wheel_positions, robot.drive_directions)
    return robot.wheel.radius * runs.speed @ np.linalg.pinv(rolling).T


def _per_block(runs: RobotRuns, values: Array) -> Array:
    return values.reshape(-1, runs.size, *values.shape[1:]).mean(axis=1)


def _along(runs: RobotRuns, rates: Array) -> Array:
    """Integrals from 0 at each stretch's start."""
    parts = [np.cumsum(rates[a:b], axis=0) * STEP for a, b, _ in runs.stretches]
    return np.concatenate(parts)


def _world(runs: RobotRuns, twist: Array) -> Array:
    """Velocity in the world, shape (steps, 2) [m/s]."""
    c, s = np.cos(runs.yaw[:, 0]), np.sin(runs.yaw[:, 0])
    return np.stack([c * twist[:, 0] - s * twist[:, 1], s * twist[:, 0] + c * twist[:, 1]], axis=1)


def spans(runs: RobotRuns, robot: Robot) -> dict[str, tuple[float, float]]:
    """Variable → lowest and highest value that the runs cover; speeds are those of a wheel's hub."""
    twist = body_twist(runs, robot)
    rim = robot.wheel.radius * runs.speed
    place = _along(runs, _world(runs, twist))[:, 0]
    reach = float(abs(robot.wheel_positions).max())
    ends = {
        "speed": (float(np.quantile(rim, 0.001)), float(np.quantile(rim, 0.999))),
        "position": (float(place.min()) - reach, float(place.max()) + reach),
        "time": (0.0, float(runs.times.max())),
        "lateral_speed": (float(twist[:, :2].min()), float(twist[:, :2].max())),
    }
    return {name: (low, max(high, low + 1e-3)) for name, (low, high) in ends.items()}


def regimes(runs: RobotRuns, robot: Robot) -> dict[str, tuple[str, Array]]:
    """Variable → unit and value per block; those that do not vary are left out."""
    steps = body_twist(runs, robot)
    twist = _per_block(runs, steps)
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
        "current": ("A", np.abs(_per_block(runs, runs.current)).mean(axis=1)),
        "position": ("m", _per_block(runs, _along(runs, _world(runs, steps)))[:, 0]),
        "heading": ("rad", _per_block(runs, runs.yaw)[:, 0]),
        "time": ("s", _per_block(runs, runs.times)),
    }
    turned = _per_block(runs, _along(runs, runs.speed))
    for i in range(WHEELS):
        found[f"wheel_angle_{i + 1}"] = ("rad", turned[:, i])
    since = [_since_reversal(twist[a:b, :2], speed[a:b], p.time) for a, b, p in _rows(runs)]
    found["reversal"] = ("s", np.concatenate(since))
    size = np.array([p.last - p.first for p in runs.pieces])
    if len(set(runs.floor)) > 1:
        found["floor"] = ("", np.repeat(np.array(runs.floor), size))
    if len(set(runs.mass.tolist())) > 1:
        found["load"] = ("kg", np.repeat(runs.mass, size))
    return {n: (unit, v) for n, (unit, v) in found.items() if v.dtype.kind == "U" or np.ptp(v) > 0.0}


def _rows(runs: RobotRuns):
    return [(p.first, p.last, p) for p in runs.pieces]


def _since_reversal(velocity: Array, speed: Array, time: Array) -> Array:
    """Time since the robot last turned back or set off [s]."""
    since, last, direction = np.empty(len(time)), float(time[0]), np.zeros(2)
    for k in range(len(time)):
        if speed[k] > _STANDING:
            ahead = velocity[k] / speed[k]
            if ahead @ direction <= 0.0:
                last, direction = float(time[k]), ahead
        since[k] = time[k] - last
    return since
