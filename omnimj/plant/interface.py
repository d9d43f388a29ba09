"""Interface common to the twin, the planar model and the real robot, and the column names of the truth."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Protocol

import numpy as np

from omnimj.errors import InputError
from omnimj.parameters import Floor
from omnimj.parameters.floor import find_floor
from omnimj.signals import RIG_CHANNELS, Array, CurrentCommand, Measurement, RigMeasurement, robot_channels


class Plant(Protocol):
    """Plant that takes current commands and returns measurements, one control period at a time.

    A robot returns `Measurement`, the test rig `RigMeasurement`. A simulation also provides the truth, which
    is hidden from controllers; a real robot has none (`truth_names` is empty).
    """

    period: float
    """Control period [s]."""
    truth_names: tuple[str, ...]
    """Column names of `truth()`."""

    def reset(self) -> Measurement | RigMeasurement:
        """Put the plant at its start and return the first measurement (time 0); comes before `step`."""
        ...

    def step(self, command: CurrentCommand) -> Measurement | RigMeasurement:
        """Hold the command for one period and return the measurement at its end."""
        ...

    def truth(self) -> Array:
        """True values at the time of the last measurement by `truth_names`, shape (len(truth_names),)."""
        ...

    def close(self) -> None:
        """Release the resources of the plant; may be called twice."""
        ...


def robot_truth_names(wheels: int) -> tuple[str, ...]:
    """Names of the truth columns of a simulated robot with n wheels.

    `x`, `y` [m] and `heading` [rad] in the world; `twist_x`, `twist_y` [m/s] and `twist_yaw` [rad/s] in the
    body frame; per wheel slip velocity [m/s], normal and traction force [N].
    """
    per_wheel = [
        f"{name}_{i}"
        for name in ("slip_velocity", "normal_force", "traction_force")
        for i in range(1, wheels + 1)
    ]
    return ("x", "y", "heading", "twist_x", "twist_y", "twist_yaw", *per_wheel)


RIG_TRUTH_NAMES: tuple[str, ...] = (
    "carriage_position",
    "true_carriage_speed",
    "true_wheel_speed",
    "lateral_position",
    "tilt",
    "slip_velocity_1",
    "normal_force_1",
    "traction_force_1",
    "lateral_force_1",
)
"""Names of the truth columns of a simulated rig; units m, m/s, rad/s, m, rad, m/s, N, N, N."""


def plant_channels(wheels: int) -> tuple[str, ...]:
    """Measured channels of a plant with n wheels; a single wheel means the test rig."""
    return RIG_CHANNELS if wheels == 1 else robot_channels(wheels)


def commanded_currents(command: CurrentCommand, wheels: int, steps: int) -> Array:
    """Set currents of a command, shape (wheels,) [A].

    Args:
      command: Command of a user's own loop, or of a controller.
      wheels: Number of wheels of the plant.
      steps: Control periods since the start; negative before the first reset.

    Raises:
      InputError: Another number of currents, or a plant that has not been reset.
    """
    if steps < 0:
        raise InputError("step", "the plant has not been reset", "call reset() before the first step")
    try:
        current = np.asarray(command.current, float)
    except (TypeError, ValueError):
        raise InputError("command", f"found {command.current!r}", "numbers are needed") from None
    if current.shape != (wheels,):
        rule = "one is needed" if wheels == 1 else f"{wheels} are needed, one per wheel"
        raise InputError("command", f"found {current.size} currents", rule)
    return np.ascontiguousarray(current)


def given_floor(floor: Floor | str, floors: Mapping[str, Floor]) -> Floor:
    """Floor as such or by its name.

    Args:
      floor: The floor, or its name in `floors`.
      floors: Known floors by name.

    Raises:
      UnknownNameError: No such floor; the message lists the known ones.
    """
    return floor if isinstance(floor, Floor) else find_floor(floor, "floor", floors)
