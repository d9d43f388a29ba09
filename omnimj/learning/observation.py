"""Observation of the policy: measurement and target, scaled so that usual values lie within ±1."""

from __future__ import annotations

from typing import NamedTuple

from omnimj.parameters import Robot

LIMIT = 10.0
"""Bound of every scaled number; larger ones are clipped, and what is not finite becomes 0."""
ACCELERATION, YAW_RATE, HEADING, VELOCITY, PLACE = 5.0, 2.0, 0.1, 1.0, 0.1
"""Scales of acceleration [m/s²], yaw rate [rad/s], heading error [rad], velocity [m/s], position [m]."""
AHEAD = 0.1
"""Time by which the plan is seen ahead [s]."""


class Entry(NamedTuple):
    """One number of the observation."""

    name: str
    unit: str
    scale: float
    """Value in its unit that is 1 in the observation."""


def entries(robot: Robot) -> tuple[Entry, ...]:
    """Entries of the observation of a robot with n wheels in their order, 2n + 12.

    `heading_error` is planned heading − the cascade's estimate. Targets are turned into the body frame by
    that estimate; those `ahead` are the plan's `AHEAD` later. `behind` is planned position − dead reckoning
    by wheel speeds and estimated heading, body frame: position errors caused by slip and creep are not
    observed.
    """
    n = robot.wheel_count
    wheels = [Entry(f"wheel_speed_{i}", "rad/s", wheel_speed_scale(robot)) for i in range(1, n + 1)]
    currents = [Entry(f"current_{i}", "A", robot.control.current_limit) for i in range(1, n + 1)]
    targets = [
        entry
        for when in ("target", "ahead")
        for entry in (
            Entry(f"{when}_velocity_x", "m/s", VELOCITY),
            Entry(f"{when}_velocity_y", "m/s", VELOCITY),
            Entry(f"{when}_yaw_rate", "rad/s", YAW_RATE),
        )
    ]
    return (
        *wheels,
        *currents,
        Entry("acceleration_x", "m/s²", ACCELERATION),
        Entry("acceleration_y", "m/s²", ACCELERATION),
        Entry("yaw_rate", "rad/s", YAW_RATE),
        Entry("heading_error", "rad", HEADING),
        *targets,
        Entry("behind_x", "m", PLACE),
        Entry("behind_y", "m", PLACE),
    )


def wheel_speed_scale(robot: Robot) -> float:
    """Wheel speed at a rim speed of 1 m/s [rad/s]."""
    return VELOCITY / robot.wheel.radius
