"""From what is asked in the world to the twist asked of the body: heading estimate and yaw loops.

The heading converter has 12 bits (1.5 mrad) and is held for 5 ms, so that rotating a 1 m/s demand by it makes
steps of 1.5 mm/s in the wheel targets. The gyro carries the heading between samples and the converter
corrects it slowly: a complementary filter. A gyro bias b leaves an error of b × FILTER_TIME, 0.1 mrad for
1 mrad/s.
"""

from __future__ import annotations

import math

from omnimj.physics.native import kernel

FILTER_TIME = 0.1
"""Time in which the converter wins over the gyro [s]: many converter steps, few of a robot's turns."""


@kernel
def wrapped(angle):
    """The same direction within ±π [rad], for any finite angle."""
    return math.atan2(math.sin(angle), math.cos(angle))


@kernel
def next_heading(heading, yaw, yaw_rate, gyro_range, h):
    """θ⁺ = θ̂ + (h/τ) wrap(θ_measured − θ̂) with θ̂ = θ + h ω: unwrapped heading [rad].

    Args:
      heading: Estimate θ one step ago, unwrapped [rad].
      yaw: Measured heading, wrapped anywhere [rad].
      yaw_rate: Gyro ω [rad/s]; more than its range cannot be a measurement and is cut.
      gyro_range: [rad/s].
      h: Control period [s].
    """
    predicted = heading + h * min(max(yaw_rate, -gyro_range), gyro_range)
    return predicted + min(h / FILTER_TIME, 1.0) * wrapped(yaw - predicted)


@kernel
def to_body(velocity_x, velocity_y, heading):
    """R(θ)ᵀ v: a world velocity in the body frame [m/s]."""
    c, s = math.cos(heading), math.sin(heading)
    return c * velocity_x + s * velocity_y, c * velocity_y - s * velocity_x


@kernel
def yaw_rate_demand(yaw_rate, measured_yaw_rate, heading_error, gain, heading_gain):
    """ω_c = ω_h + K (ω_h − ω_measured) with ω_h = ω_d + K_h e: what the wheels are asked for [rad/s].

    Section 3.1.2 with the heading hold on top.

    Args:
      yaw_rate: Demand ω_d [rad/s].
      measured_yaw_rate: Gyro [rad/s].
      heading_error: e, wrapped: a plan that is half a turn ahead is not caught up with [rad].
      gain: K [1].
      heading_gain: K_h [1/s].
    """
    held = yaw_rate + heading_gain * heading_error
    return held + gain * (held - measured_yaw_rate)
