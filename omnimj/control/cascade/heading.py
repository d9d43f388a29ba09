"""From what is asked in the world to the twist asked of the body: heading estimate and yaw loops.

The heading converter has 12 bits (1.5 mrad) and is held for 5 ms, so that rotating a 1 m/s demand by it makes
steps of 1.5 mm/s in the wheel targets. The gyro carries the heading between samples and the converter
corrects it slowly: a complementary filter. A gyro bias b leaves an error of b × FILTER_TIME, 0.1 mrad for
1 mrad/s.
"""

from __future__ import annotations

import math

import numpy as np

from omnimj.parameters import Robot
from omnimj.physics.kinematics import rolling_matrix
from omnimj.physics.native import kernel
from omnimj.signals import Array

FILTER_TIME = 0.1
"""Time in which the converter wins over the gyro [s]: many converter steps, few of a robot's turns."""


@kernel
def wrapped(angle):
    """The same direction within ±π [rad], for any finite angle."""
    return math.atan2(math.sin(angle), math.cos(angle))


@kernel
def update_heading(heading, yaw, yaw_rate, gyro_range, h):
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


# When a robot that is asked to stand is left alone.

REST_YAW_RATE = 0.02
"""Gyro readings up to this are bias and noise: five times its standard deviation [rad/s]."""
REST_WHEEL_SPEED = 0.2
"""Wheel speeds up to this are noise and quantisation: ten steps of the speed monitor [rad/s]."""
REST_HEADING = 0.005
"""Heading errors that are not worth a move: three steps of the converter [rad]."""


@kernel
def is_standing(velocity_x, velocity_y, yaw_rate, heading_error, measured_yaw_rate, wheel_speed):
    """Whether nothing is asked for and nothing moves more than the sensors' noise.

    Args:
      velocity_x: Demand [m/s].
      velocity_y: Demand [m/s].
      yaw_rate: Demand [rad/s].
      heading_error: What a heading hold would correct; 0 without one [rad].
      measured_yaw_rate: Gyro [rad/s].
      wheel_speed: Measured, shape (n,) [rad/s].
    """
    if velocity_x != 0.0 or velocity_y != 0.0 or yaw_rate != 0.0 or abs(heading_error) > REST_HEADING:
        return False
    if abs(measured_yaw_rate) > REST_YAW_RATE:
        return False
    for speed in wheel_speed:  # noqa: SIM110 a loop is what compiles well
        if abs(speed) > REST_WHEEL_SPEED:
            return False
    return True


# What the gyro reads while the robot stands still: its bias, averaged over every rest.

SETTLING_TIME = 0.2
"""Rest before the first reading counts: wheels stop within it, their bristles have calmed down [s]."""
BIAS_MEMORY = 60.0
"""Rest that the mean remembers; a gyro's bias drifts with its temperature over minutes [s]."""
REST_TURN = 1.5e-4
"""Turn by the wheels that ends a rest: ten counts of one encoder, where noise makes one [rad]."""
LARGEST_BIAS = 0.05
"""Healthy gyros of this class are off by less than 3 degrees per second; more is a fault [rad/s]."""

BIAS, STILL, TURNED, AVERAGED = range(4)
"""State: bias b [rad/s], this rest so far [s], turn by the wheels in it [rad], rest averaged for b [s]."""


def initial_gyro_bias() -> Array:
    """The state before the first step: no bias known."""
    return np.zeros(4)


def yaw_rate_row(robot: Robot) -> Array:
    """Yaw rate per wheel speed, r (A⁺)₃ of V = A·twist, shape (n,) [1]."""
    rolling = rolling_matrix(robot.wheel_positions, robot.rolling_directions)
    return np.ascontiguousarray(robot.wheel.radius * np.linalg.pinv(rolling)[2])


@kernel
def update_gyro_bias(rest, turn, standing, yaw_rate, wheel_speed, h):
    """b⁺ = b + (h/T)(ω − b), T the rest averaged so far, within ±`LARGEST_BIAS`: the next state, shape (4,).

    Args:
      rest: State, shape (4,), left as it is.
      turn: From `yaw_rate_row`, shape (n,).
      standing: Whether nothing is asked for and nothing moves beyond noise; False ends the rest.
      yaw_rate: Gyro ω, finite when standing [rad/s].
      wheel_speed: Measured, shape (n,) [rad/s].
      h: Control period [s].
    """
    after = rest.copy()
    if standing:
        after[STILL] += h
        for i in range(turn.size):
            after[TURNED] += h * turn[i] * wheel_speed[i]
    if not standing or abs(after[TURNED]) > REST_TURN:
        after[STILL] = after[TURNED] = 0.0
    if after[STILL] > SETTLING_TIME:
        after[AVERAGED] = min(after[AVERAGED] + h, BIAS_MEMORY)
        bias = after[BIAS] + h / after[AVERAGED] * (yaw_rate - after[BIAS])
        after[BIAS] = min(max(bias, -LARGEST_BIAS), LARGEST_BIAS)
    return after
