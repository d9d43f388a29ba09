"""Tracking of the plan: position error, heading offset, and how well the robot follows its demands.

The position error is the demanded displacement minus the estimated one, ∫ v_d − R(θ) v̂ dt [m]. It fades
within a second while the robot is healthy; recovery drives it back after a fault.
"""

from __future__ import annotations

import math
from typing import NamedTuple

from omnimj.control.cascade.heading import wrapped
from omnimj.physics.native import kernel

_PLACE_FADES = 1.0  # [s] time constant of a healthy robot's position error
_OFFSET_SETTLES = 3.0  # [s] in which a heading error becomes the usual one
_LARGEST_PLACE = 0.5  # [m] beyond which a position error grows no more
_SHORT = 0.3  # [s] over which the tracking error is averaged
_LONG = 10.0  # [s] over which a healthy robot's largest tracking error is remembered
_SMOOTH = 0.02  # [s] filter of demanded accelerations
_LARGEST = 5.0  # [m/s², rad/s² times an arm] larger demanded accelerations are clipped: steps of the demand


class Tracking(NamedTuple):
    """State of the tracking filters."""

    place_x: float = 0.0
    """Position error, world frame [m]."""
    place_y: float = 0.0
    """Position error, world frame [m]."""
    heading_offset: float = 0.0
    """Usual heading error of the healthy robot [rad]."""
    error: float = 0.0
    """Low-passed tracking error of the twist [m/s]."""
    usual_error: float = 0.0
    """Largest recent tracking error of the healthy robot [m/s]."""
    hardest: float = 0.0
    """Hardest demanded acceleration of the healthy robot so far [m/s²]."""
    demand_x: float = 0.0
    """Last world demand [m/s]."""
    demand_y: float = 0.0
    """Last world demand [m/s]."""
    demand_yaw_rate: float = 0.0
    """Last demand [rad/s]."""
    acceleration_x: float = 0.0
    """Low-passed demanded acceleration, world frame [m/s²]."""
    acceleration_y: float = 0.0
    """Low-passed demanded acceleration, world frame [m/s²]."""
    yaw_acceleration: float = 0.0
    """Low-passed demanded yaw acceleration [rad/s²]."""


@kernel
def _low_pass(old, new, h, time):
    return old + min(h / time, 1.0) * (new - old)


@kernel
def _acceleration(before, last, now, h, largest):
    """Low-passed derivative of a demand, clipped before the filter."""
    return _low_pass(before, min(max((now - last) / h, -largest), largest), h, _SMOOTH)


@kernel
def update_tracking(x, velocity, now, h, arm, healthy, integrates):
    """Update the tracking by one step, in place.

    Args:
      x: `Tracking`, a field of a record, changed in place.
      velocity: Estimated body velocity, body frame, shape (2,) [m/s].
      now: `RecoveryInput`.
      h: Control period [s].
      arm: Length that turns a yaw rate into a speed [m].
      healthy: Whether no fault stands.
      integrates: Whether the body velocity is known well enough to integrate the position error.
    """
    demand = now.demand
    c, s = math.cos(now.heading), math.sin(now.heading)
    off_x = demand.velocity_x - (c * velocity[0] - s * velocity[1])
    off_y = demand.velocity_y - (s * velocity[0] + c * velocity[1])
    place_x, place_y = x.place_x, x.place_y
    if integrates:
        place_x, place_y = place_x + h * off_x, place_y + h * off_y
    if healthy:
        place_x, place_y = _low_pass(place_x, 0.0, h, _PLACE_FADES), _low_pass(place_y, 0.0, h, _PLACE_FADES)
        error = wrapped(now.heading - demand.heading - x.heading_offset)
        x.heading_offset += min(h / _OFFSET_SETTLES, 1.0) * error
    far = math.hypot(place_x, place_y)
    if far > _LARGEST_PLACE:
        place_x, place_y = place_x * _LARGEST_PLACE / far, place_y * _LARGEST_PLACE / far
    x.place_x, x.place_y = place_x, place_y
    off = math.hypot(off_x, off_y) + arm * abs(demand.yaw_rate - now.yaw_rate)
    x.error = _low_pass(x.error, off, h, _SHORT)
    if healthy:
        x.usual_error = max(x.error, _low_pass(x.usual_error, 0.0, h, _LONG))
    x.acceleration_x = _acceleration(x.acceleration_x, x.demand_x, demand.velocity_x, h, _LARGEST)
    x.acceleration_y = _acceleration(x.acceleration_y, x.demand_y, demand.velocity_y, h, _LARGEST)
    x.yaw_acceleration = _acceleration(
        x.yaw_acceleration, x.demand_yaw_rate, demand.yaw_rate, h, _LARGEST / arm
    )
    x.demand_x, x.demand_y, x.demand_yaw_rate = demand.velocity_x, demand.velocity_y, demand.yaw_rate
    if healthy:
        x.hardest = max(x.hardest, math.hypot(x.acceleration_x, x.acceleration_y))
