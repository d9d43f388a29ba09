"""Names and order of the measured channels; columns of recordings and sensor faults use the same names."""

from __future__ import annotations

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
