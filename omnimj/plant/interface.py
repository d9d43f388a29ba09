"""What a plant is: the one interface that the twin, the planar model and the robot share."""

from __future__ import annotations

from typing import Protocol

from omnimj.signals import Array, CurrentCommand, Measurement, RigMeasurement


class Plant(Protocol):
    """Takes current commands, gives measurements, one control period at a time.

    `Measurement` for a robot, `RigMeasurement` for the test rig. Truth is what a simulation knows and a
    controller may not; a real robot has none (`truth_names` is empty).
    """

    period: float
    """Control period [s]."""
    truth_names: tuple[str, ...]
    """Column names of `truth()`."""

    def reset(self) -> Measurement | RigMeasurement:
        """Puts the plant at its start and returns the first measurement (time 0)."""
        ...

    def step(self, command: CurrentCommand) -> Measurement | RigMeasurement:
        """Holds the command for one period and returns the measurement at its end."""
        ...

    def truth(self) -> Array:
        """Truth at the time of the last measurement, aligned with `truth_names`."""
        ...

    def close(self) -> None:
        """Lets go of what the plant holds; may be called twice."""
        ...


def robot_truth_names(wheels: int) -> tuple[str, ...]:
    """Truth columns of a simulated robot with n wheels.

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
"""Truth columns of a simulated rig: m, m/s, rad/s, m, rad, m/s, N, N, N."""


# Names and order of the measured channels; columns of recordings and sensor faults use the same names.

RIG_CHANNELS = ("current", "wheel_speed", "carriage_speed", "carriage_acceleration", "lateral_speed")
"""Channels of the test rig: A, rad/s, m/s, m/s², m/s."""


def robot_channels(wheels: int) -> tuple[str, ...]:
    """Channels of a robot with n wheels: n currents [A], n wheel speeds [rad/s], then the body's.

    The body's are acceleration x and y [m/s²], yaw rate [rad/s] and yaw [rad]; 2 n + 4 in all.
    """
    per_wheel = [f"{name}_{i}" for name in ("current", "wheel_speed") for i in range(1, wheels + 1)]
    return (*per_wheel, "acceleration_x", "acceleration_y", "yaw_rate", "yaw")


def plant_channels(wheels: int) -> tuple[str, ...]:
    """Channels of the plant with n wheels: with a single one it is the test rig."""
    return RIG_CHANNELS if wheels == 1 else robot_channels(wheels)
