"""Units and signs of a robot's log that has a measured pose: wheels and pose must move alike.

The correlation of each wheel with what the pose makes of it shows its sign and its place. By the wheels the
robot turns at ω_w and moves at |v_w|, by the pose at ω and |v|; slopes ω_w/ω and |v_w|/|v| are 1 up to slip.
If both are off alike the wheel speeds are, otherwise heading or position.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from omnimj.control.robot_constants import RobotConstants
from omnimj.errors import InputError
from omnimj.estimate.robot.blocks import RunRows
from omnimj.signals import Array

_WRONG = 2.5  # factor from which on slip, up to half on soft floor, and radius explain a slope no longer
_ALIKE = 1.15  # factor within which two slopes are the same
_ONE_MOTION = 0.9  # correlation of yaw rates or speeds below which slip, not a unit, makes them differ
_LEAST = 0.02  # [m/s, rad/s] RMS of a motion from which a slope is judged
_UNITS = {
    "wheel speeds": ((9.5493, "rev/min"), (57.2958, "deg/s"), (0.159155, "rev/s")),
    "heading": ((0.0174533, "deg"),),
    "x and y": ((0.001, "mm"), (0.01, "cm")),
}
"""Slope that a quantity in another unit than rad/s, rad and m makes."""


def require_like_motion(dataset: Path, rows: Sequence[RunRows], c: RobotConstants) -> None:
    """Check that wheels and pose describe one motion.

    Raises:
      InputError: They do not: a unit, a sign or the order of the wheels is wrong.
    """
    moving = [run.good & ~run.still for run in rows]
    speed = np.concatenate([run.wheel_speed[used] for run, used in zip(rows, moving, strict=True)])
    twist = np.concatenate([_twist(run)[used] for run, used in zip(rows, moving, strict=True)])
    rolling = c.radius * speed
    _require_wheels(dataset, rolling, twist @ c.forces)  # a factor changes no correlation
    by_wheels = rolling @ np.linalg.pinv(c.forces)
    turning = _slope(twist[:, 2], by_wheels[:, 2])
    moved = _slope(np.hypot(*twist[:, :2].T), np.hypot(*by_wheels[:, :2].T))
    for name, slope in _wrong_scales(turning, moved):
        known = [unit for factor, unit in _UNITS[name] if _near(slope, factor, _ALIKE)]
        guess = f"; they may be in {known[0]}" if known else ""
        rule = f"wheels and pose must agree in rad/s, rad and m{guess}"
        raise InputError(
            f"{dataset}: {name}", f"found {slope:.3g} times the motion of the pose by the wheels", rule
        )


def _twist(run: RunRows) -> Array:
    velocity = np.empty((len(run.time), 0)) if run.velocity is None else run.velocity
    return np.column_stack([velocity, run.yaw_rate])


def _slope(by_pose: Array, by_wheels: Array) -> float | None:
    """Least-squares slope of the motion by the wheels over that by the pose; None without a common one."""
    energy, other = float(np.mean(by_pose**2)), float(np.mean(by_wheels**2))
    together = float(np.mean(by_wheels * by_pose))
    if max(energy, other) < _LEAST**2 or together**2 <= _ONE_MOTION**2 * energy * other:
        return None
    return together / energy


def _near(slope: float, factor: float, within: float) -> bool:
    return slope > 0.0 and abs(np.log(slope / factor)) < np.log(within)


def _wrong_scales(turning: float | None, moved: float | None) -> list[tuple[str, float]]:
    """Quantities whose scale is wrong, with the slope of the wheels over the pose."""
    wrong = {
        name: slope
        for name, slope in (("heading", turning), ("x and y", moved))
        if slope is not None and not _near(abs(slope), 1.0, _WRONG)
    }
    if turning is None or moved is None or (len(wrong) == 2 and _near(turning / moved, 1.0, _ALIKE)):
        return [("wheel speeds", slope) for slope in wrong.values()][:1]
    return list(wrong.items())


def _require_wheels(dataset: Path, rolling: Array, expected: Array) -> None:
    """Check the sign and the place of each wheel.

    Raises:
      InputError: A wheel turns against the pose, or like another one.
    """
    match = np.corrcoef(rolling.T, expected.T)[: rolling.shape[1], rolling.shape[1] :]
    for i, row in enumerate(match):
        best = int(np.argmax(np.abs(row)))
        place = f"{dataset}: wheel_speed_{i + 1}"
        if row[i] < -0.5:
            rule = "positive speed pushes the robot along drives_along of its wheel"
            raise InputError(place, f"turns against the pose, correlation {row[i]:.2f}", rule)
        if best != i and row[i] < 0.5 < abs(row[best]) - 0.2:
            rule = f"it moves like wheel {best + 1}, correlation {row[best]:.2f}: order the columns"
            raise InputError(place, f"correlates with the pose by {row[i]:.2f}", rule)
