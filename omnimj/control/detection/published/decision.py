"""Tables 5.1 and 5.2: from residuals that are above their thresholds to a fault."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from omnimj.control.detection.detector import DetectorOptions
from omnimj.errors import InputError
from omnimj.parameters import Robot
from omnimj.parameters.reading import positive, read_table, read_toml
from omnimj.resources import models_folder

SLIP, MOTOR = "slip", "motor"


def isolate_rig_fault(speed_is_over: bool, force_is_over: bool) -> str | None:
    """Table 5.1: (R1, R2) = (1, 0) slip, (1, 1) motor; a pattern without a row names nothing."""
    if not speed_is_over:
        return None
    return MOTOR if force_is_over else SLIP


def isolate_robot_fault(own_axis_is_over: bool, other_axis_is_over: bool, printed: bool) -> str | None:
    """Table 5.2 for the wheel whose r3 … r6 crossed first: its rows f1 … f4 and f5 … f8.

    Args:
      own_axis_is_over: R8 for a wheel that drives along y, R7 for one along x.
      other_axis_is_over: The other one.
      printed: A motor fault shows on its own axis only, as the table has it. Repaired: whatever the other
        axis says, since a motor's fault turns the robot and shows on both.

    Returns:
      `slip`, `motor`, or None for a pattern without a row.
    """
    if own_axis_is_over:
        return None if printed and other_axis_is_over else MOTOR
    return None if other_axis_is_over else SLIP


def above_threshold(residuals: Sequence[float], threshold: float, printed: bool) -> list[bool]:
    """Which of r3 … r6 are above threshold 3: |r|, or r as printed (erratum 5)."""
    if printed:
        return [r > threshold for r in residuals]
    return [abs(r) > threshold for r in residuals]


def first_to_cross(first: int, is_over: Sequence[bool], residuals: Sequence[float]) -> int:
    """The wheel that an event belongs to: the first of r3 … r6 above the threshold, of several the largest.

    Args:
      first: Of the event so far; −1 when there is none.
      is_over: From `above_threshold`.
      residuals: r3 … r6.

    Returns:
      0 … n−1; −1 once all are below again, which ends the event.
    """
    if not any(is_over):
        return -1
    if first >= 0:
        return first
    return max((i for i, above in enumerate(is_over) if above), key=lambda i: abs(residuals[i]))


LAYOUT_RULE = (
    "Table 5.2 is for four omni wheels of which 1 and 3 drive along y, 2 and 4 along x, or the other way"
)
"""The rule, for messages."""
WHEELS = 4


def layout_mismatch(robot: Robot) -> str:
    """Reason why the published method does not suit a robot's wheels; empty where it does."""
    u, n = robot.drive_directions, len(robot.wheels)
    if n != WHEELS:
        return f"found {n} wheels"
    if not np.all(np.isclose(np.abs(u).max(axis=1), 1.0, atol=1e-6)):
        return "a wheel drives askew"
    along_x = np.abs(u[:, 0]) > 0.5
    if np.any(along_x != along_x[[2, 3, 0, 1]]) or along_x[0] == along_x[1]:
        return "wheels 1 and 3 do not drive across wheels 2 and 4"
    if any(abs(wheel.roller_angle - 0.5 * np.pi) > 1e-6 for wheel in robot.wheels):
        return "a wheel has turned rollers"
    return ""


@dataclass(frozen=True, slots=True)
class PublishedThresholds:
    """Thresholds above which a residual counts as 1 in Tables 5.1 and 5.2; Eqs. 5.3, 5.8, 5.13 and 5.21."""

    rig_wheel_speed: float = positive("rad/s")
    """Threshold 1, of R1: fault-free runs of the rig, Eq. 5.3."""
    rig_force: float = positive("N")
    """Threshold 2, of R2: fault-free runs and slip on the rig, Eq. 5.8."""
    wheel_speed: float = positive("rad/s")
    """Threshold 3, of r3 … r6: fault-free runs of the robot, Eq. 5.13."""
    force: float = positive("N")
    """Threshold 4, of R7 and R8: fault-free runs and slip of the robot, Eq. 5.21."""


PRINTED_THRESHOLDS = PublishedThresholds(2.07, 1.32, 3.9, 3.5)
"""Thresholds printed in the dissertation, for its own machines."""


def shipped_thresholds_file() -> Path:
    """The shipped thresholds from runs of the twin."""
    return models_folder() / "published_thresholds.toml"


def select_thresholds(choice: DetectorOptions, path: Path | None = None) -> PublishedThresholds:
    """The thresholds of a choice.

    Args:
      choice: The printed ones need no file; those from runs belong to the variant.
      path: Of another file than the shipped one.

    Raises:
      InputError: The file lacks the variant, or a value breaks its rule.
    """
    if choice.thresholds == "printed":
        return PRINTED_THRESHOLDS
    path = shipped_thresholds_file() if path is None else path
    tree = read_toml(path)
    if choice.variant not in tree:
        raise InputError(path, f"[{choice.variant}] is missing")
    return read_table(PublishedThresholds, tree[choice.variant], lambda _: path, {}, choice.variant)
