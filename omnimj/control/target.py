"""What the controller is asked for in one step."""

from __future__ import annotations

from dataclasses import dataclass

from omnimj.signals import Array, Reference


@dataclass(frozen=True, slots=True)
class Target:
    """Demanded motion in the world frame, held for one control step."""

    velocity: Array
    """Shape (2,) [m/s]."""
    yaw_rate: float
    """Counter-clockwise [rad/s]."""
    heading: float
    """Planned heading [rad]."""


def target_at(reference: Reference, step: int) -> Target:
    """The reference's sample of one control step; past its end the robot is asked to stand still.

    Args:
      reference: The planned motion, k samples.
      step: Number of the control step, 0 at the start.
    """
    last = len(reference.time) - 1
    if step > last:
        return Target(reference.velocity[last] * 0.0, 0.0, float(reference.heading[last]))
    return Target(reference.velocity[step], float(reference.yaw_rate[step]), float(reference.heading[step]))
