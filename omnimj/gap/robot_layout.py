"""Which robots the gap workflow is for: four wheels whose rollers roll along the axle."""

from __future__ import annotations

import math

from omnimj.errors import InputError
from omnimj.gap.robot_kernels import WHEELS
from omnimj.parameters import Robot
from omnimj.recording.dataset import Dataset

_ACROSS = 1e-6  # [rad] off the right angle between driving direction and roller axis


def require_layout(dataset: Dataset, robot: Robot) -> None:
    """Refuses what the replay's equations are not for.

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
