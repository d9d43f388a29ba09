"""What the gyro reads while the robot stands still: its bias, averaged over every rest.

A yaw-rate loop follows its gyro, bias included: 1 mrad/s turns the robot by 2.6 degrees in 45 s. White noise
of σ behind a filter of time constant τ leaves a standard error of σ √(2 τ / T) after T of rest: 0.32 mrad/s
after 0.3 s and 0.06 mrad/s after 9 s for the robot's gyro. Nothing is learnt while it drives.

Rest is what the wheels say, not the gyro: a robot that is pushed round slowly has a gyro reading like a bias
and wheel speeds below their noise, but its encoders count. A push passes for bias only when it is slower than
`REST_TURN` in `SETTLING_TIME`, 0.75 mrad/s, or slower than `standstill.REST_YAW_RATE` with sliding wheels.
"""

from __future__ import annotations

import numpy as np

from omnimj.parameters import Robot
from omnimj.physics.kinematics import rolling_matrix
from omnimj.physics.native import kernel
from omnimj.signals import Array

SETTLING_TIME = 0.2
"""Rest before the first reading counts: wheels stop within it, their bristles have calmed down [s]."""
MEMORY = 60.0
"""Rest that the mean remembers; a gyro's bias drifts with its temperature over minutes [s]."""
REST_TURN = 1.5e-4
"""Turn by the wheels that ends a rest: ten counts of one encoder, where noise makes one [rad]."""
LARGEST_BIAS = 0.05
"""Healthy gyros of this class are off by less than 3 degrees per second; more is a fault [rad/s]."""

BIAS, STILL, TURNED, AVERAGED = range(4)
"""State: bias b [rad/s], this rest so far [s], turn by the wheels in it [rad], rest averaged for b [s]."""


def no_rest_yet() -> Array:
    """The state before the first step: no bias known."""
    return np.zeros(4)


def turn_row(robot: Robot) -> Array:
    """Yaw rate per wheel speed, r (A⁺)₃ of V = A·twist, shape (n,) [1]."""
    rolling = rolling_matrix(robot.wheel_positions, robot.rolling_directions)
    return np.ascontiguousarray(robot.wheel.radius * np.linalg.pinv(rolling)[2])


@kernel
def next_bias(rest, turn, standing, yaw_rate, wheel_speed, h):
    """b⁺ = b + (h/T)(ω − b), T the rest averaged so far, within ±`LARGEST_BIAS`: the next state, shape (4,).

    Args:
      rest: State, shape (4,), left as it is.
      turn: From `turn_row`, shape (n,).
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
        after[AVERAGED] = min(after[AVERAGED] + h, MEMORY)
        bias = after[BIAS] + h / after[AVERAGED] * (yaw_rate - after[BIAS])
        after[BIAS] = min(max(bias, -LARGEST_BIAS), LARGEST_BIAS)
    return after
