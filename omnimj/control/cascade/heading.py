"""Heading and yaw rate: the heading estimate, the yaw-rate demand, standstill and the gyro's bias.

The heading converter has 12 bits (1.5 mrad) and is held for 5 ms, so that rotating a 1 m/s demand by it
makes steps of 1.5 mm/s in the wheel targets. A complementary filter takes the heading from the gyro between
samples and corrects it slowly by the converter. A gyro bias b leaves an error of b × FILTER_TIME, 0.1 mrad
for 1 mrad/s.

At standstill the yaw loops would answer the gyro's bias and noise: the wheel-speed integrals build up against
stiction, break away and build up again, a limit cycle of a tenth of an ampere that moves nothing. While the
robot stands, its wheel-speed targets are therefore zero and their friction holds the heading.

Each standstill also serves to average the gyro's bias. Uncorrected, 1 mrad/s turns the robot by 2.6 degrees
in 45 s. White noise of σ behind a filter of time constant τ leaves a standard error of σ √(2 τ / T) after a
rest of T: 0.32 mrad/s after 0.3 s and 0.06 mrad/s after 9 s for the robot's gyro. The wheels decide what
counts as rest: a robot that is pushed round slowly has a gyro reading like a bias and wheel speeds below
their noise, but its encoders count. A push passes for bias only when it is slower than `REST_TURN` in
`SETTLING_TIME`, 0.75 mrad/s, or slower than `REST_YAW_RATE` with sliding wheels.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from omnimj.parameters import Control, Robot
from omnimj.physics.kinematics import rolling_matrix
from omnimj.physics.native import kernel
from omnimj.signals import Array

FILTER_TIME = 0.1
"""Time constant of the correction by the converter [s]: many converter steps, few of a robot's turns."""

REST_YAW_RATE = 0.02
"""Gyro readings up to this are bias and noise: five times its standard deviation [rad/s]."""
REST_WHEEL_SPEED = 0.2
"""Wheel speeds up to this are noise and quantisation: ten steps of the speed monitor [rad/s]."""
REST_HEADING = 0.005
"""Heading errors too small to correct at rest: three steps of the converter [rad]."""

SETTLING_TIME = 0.2
"""Rest before the first reading counts: wheels stop within it and their bristles relax [s]."""
BIAS_MEMORY = 60.0
"""Rest over which the bias is averaged; a gyro's bias drifts with its temperature over minutes [s]."""
REST_TURN = 1.5e-4
"""Turn of the robot by its wheels that ends a rest: ten counts of one encoder, where noise makes one
[rad]."""
LARGEST_BIAS = 0.05
"""Bound on the estimated bias: healthy gyros of this class are off by less than 3 degrees per second
[rad/s]."""


@kernel
def wrapped(angle):
    """Wrap a finite angle to ±π [rad]."""
    return math.atan2(math.sin(angle), math.cos(angle))


@kernel
def update_heading(heading, yaw, yaw_rate, gyro_range, h):
    """Unwrapped heading after one step, θ⁺ = θ̂ + (h/τ) wrap(θ_measured − θ̂) with θ̂ = θ + h ω [rad].

    Args:
      heading: Estimate θ one step ago, unwrapped [rad].
      yaw: Measured heading, wrapped anywhere [rad].
      yaw_rate: Gyro ω, clipped to its range [rad/s].
      gyro_range: Largest reading of the gyro [rad/s].
      h: Control period [s].
    """
    predicted = heading + h * min(max(yaw_rate, -gyro_range), gyro_range)
    return predicted + min(h / FILTER_TIME, 1.0) * wrapped(yaw - predicted)


@kernel
def to_body(velocity_x, velocity_y, heading):
    """Rotate a world velocity into the body frame, R(θ)ᵀ v [m/s]."""
    c, s = math.cos(heading), math.sin(heading)
    return c * velocity_x + s * velocity_y, c * velocity_y - s * velocity_x


class YawRateGain(NamedTuple):
    """Gain of the yaw-rate loop: K for slow errors, K/ρ for fast ones, from `yaw_rate_gain`."""

    slow: float
    """K, 0 without the loop [1]."""
    fast_share: float
    """1/ρ, the share of K that is left for fast errors [1]."""
    decay: float
    """Decay factor of the slow error over one period, 0…1."""


def yaw_rate_gain(control: Control, period: float) -> YawRateGain:
    """Gain K (1 + s/ω)/(1 + ρ s/ω) of a robot, with its corner ω/2π, at a control period h [s]."""
    ratio = control.yaw_rate_lag
    decay = math.exp(-2.0 * math.pi * control.yaw_rate_corner / ratio * period)
    return YawRateGain(control.yaw_rate_proportional, 1.0 / ratio, decay)


@kernel
def yaw_rate_demand(held, measured_yaw_rate, slow_error, gain):
    """Yaw-rate command ω_c = ω_h + K (e/ρ + (1 − 1/ρ) e_slow) [rad/s], and e_slow, with e = ω_h − ω_measured.

    Section 3.1.2 is ρ = 1. Fast errors get a smaller gain since a loop that is as stiff at 40 Hz has no
    margin left for sensors that are late and gears that brake more than they drive.

    Args:
      held: Demand of the plan and of the heading hold, ω_h = ω_d + K_h e_heading [rad/s].
      measured_yaw_rate: Gyro [rad/s].
      slow_error: e_slow one period ago [rad/s].
      gain: `YawRateGain`.
    """
    error = held - measured_yaw_rate
    slow_error = error + gain.decay * (slow_error - error)
    answered = gain.fast_share * error + (1.0 - gain.fast_share) * slow_error
    return held + gain.slow * answered, slow_error


@kernel
def is_standing(velocity_x, velocity_y, yaw_rate, heading_error, measured_yaw_rate, wheel_speed):
    """True if the demand is zero and nothing moves by more than the sensors' noise.

    Args:
      velocity_x: Demand [m/s].
      velocity_y: Demand [m/s].
      yaw_rate: Demand [rad/s].
      heading_error: Error of the heading hold; 0 without one [rad].
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


class GyroBias(NamedTuple):
    """Estimate of the gyro's bias and the rest that it is averaged over."""

    bias: float = 0.0
    """Estimate b [rad/s]."""
    still: float = 0.0
    """Duration of the present rest [s]."""
    turned: float = 0.0
    """Turn of the robot by its wheels during the present rest [rad]."""
    averaged: float = 0.0
    """Rest averaged for the estimate, at most `BIAS_MEMORY` [s]."""


def yaw_rate_row(robot: Robot) -> Array:
    """Yaw rate per wheel speed, r (A⁺)₃ of V = A·twist, shape (n,) [1]."""
    rolling = rolling_matrix(robot.wheel_positions, robot.rolling_directions)
    return np.ascontiguousarray(robot.wheel.radius * np.linalg.pinv(rolling)[2])


@kernel
def yaw_rate_by_wheels(turn, wheel_speed):
    """Yaw rate that the wheels measure [rad/s].

    Args:
      turn: From `yaw_rate_row`, shape (n,).
      wheel_speed: Measured, shape (n,) [rad/s].
    """
    rate = 0.0
    for i in range(turn.size):
        rate += turn[i] * wheel_speed[i]
    return rate


@kernel
def update_gyro_bias(before, turn, standing, yaw_rate, wheel_speed, h):
    """Bias after one step, b⁺ = b + (h/T)(ω − b) within ±`LARGEST_BIAS`, T the rest averaged so far.

    Args:
      before: `GyroBias` one step ago.
      turn: From `yaw_rate_row`, shape (n,).
      standing: From `is_standing`; False ends the rest.
      yaw_rate: Gyro ω, finite when standing [rad/s].
      wheel_speed: Measured, shape (n,) [rad/s].
      h: Control period [s].

    Returns:
      The next `GyroBias`.
    """
    bias, still, turned, averaged = before
    if standing:
        still += h
        for i in range(turn.size):
            turned += h * turn[i] * wheel_speed[i]
    if not standing or abs(turned) > REST_TURN:
        still = turned = 0.0
    if still > SETTLING_TIME:
        averaged = min(averaged + h, BIAS_MEMORY)
        bias = bias + h / averaged * (yaw_rate - bias)
        bias = min(max(bias, -LARGEST_BIAS), LARGEST_BIAS)
    return GyroBias(bias, still, turned, averaged)
