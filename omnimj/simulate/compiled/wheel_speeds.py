"""Wheels that follow given speeds, as kernels: wheel-speed loops and limits without the rest of the cascade.

Measured runs are driven again with the wheel speeds that their encoders show; how the body moves is then up
to the floor.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from omnimj.control.cascade.limits import CurrentLimits, current_limits, limit_all
from omnimj.control.cascade.wheel_speed import SpeedGains, amplifier_parameters, speed_loop
from omnimj.control.records import Record, packed
from omnimj.parameters import Robot
from omnimj.physics.motor import MotorParameters
from omnimj.physics.native import inlined
from omnimj.signals import Array

_POLES = 100.0  # [1/s] of the loop with a free wheel


class WheelSpeedLoops(NamedTuple):
    """Wheel-speed loops of a robot with n wheels, and their state."""

    gains: SpeedGains
    amplifier: MotorParameters
    """From `amplifier_parameters`."""
    limits: CurrentLimits
    integral: Array
    """Integrals q, shape (n,) [A]."""
    current: Array
    """Last command, shape (n,) [A]."""
    reason: Array
    """Numbers of `limits.Reason`, shape (n,)."""


def wheel_speed_loops(robot: Robot, period: float) -> Record:
    """Packed loops of a robot at a control period [s], at rest."""
    n = robot.wheel_count
    limits = current_limits(robot.control, period)
    states = (np.zeros(n), np.zeros(n), np.zeros(n))
    return packed(WheelSpeedLoops(_stiff_gains(robot, period), amplifier_parameters(robot), limits, *states))


def _stiff_gains(robot: Robot, period: float) -> SpeedGains:
    """Gains that place both poles of a free wheel at `_POLES`.

    The robot's own gains answer demands softly: on a floor that resists, its wheels would reach a measured
    speed a second late, and a run would begin with another motion than the measured one.
    """
    motor = robot.motor
    inertia = robot.wheel.inertia + motor.reflected_inertia
    per_ampere = motor.torque_constant * motor.gear_ratio * motor.gear_efficiency
    proportional = 2.0 * _POLES * inertia / per_ampere
    return SpeedGains(proportional, 0.5 * _POLES * proportional * period)


@inlined
def follow_row(loops, run, output, time, targets):
    """Set the currents of the coming period, and fill a row with time, readings and set currents.

    Args:
      loops: `WheelSpeedLoops`, changed in place.
      run: `Progress`.
      output: `Output`.
      time: Time of the measurement [s].
      targets: Wheel speeds of every row, shape (rows, n) [rad/s].

    Returns:
      The part of the row for the truth, a view.
    """
    n, row = loops.current.size, output.table[run.row]
    last, wanted, speed = loops.current.copy(), np.empty(loops.current.size), output.readings[n : 2 * n]
    for i in range(n):
        wanted[i], loops.integral[i] = speed_loop(
            loops.gains, loops.amplifier, targets[run.row, i], speed[i], loops.integral[i], 1.0
        )
    limit_all(loops.limits, wanted, last, speed, True, loops.current, loops.reason)
    row[0], row[1 : 2 * n + 5], row[2 * n + 5 : 3 * n + 5] = time, output.readings, loops.current
    return row[3 * n + 5 :]
