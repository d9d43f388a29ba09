"""PI control of one wheel's speed with anti-windup.

Known dry friction is not fed forward: in simulation that lowers the tracking error by a tenth only, since
most of it is inertia, and takes the overshoot of a wheel without grip from 6 % to 24 %.
"""

from __future__ import annotations

import numpy as np

from omnimj.parameters import Robot
from omnimj.physics.motor import achievable_current, motor_at, motor_parameters
from omnimj.physics.native import kernel

PROPORTIONAL, INTEGRAL = range(2)


def speed_loop_row(robot: Robot, period: float) -> np.ndarray:
    """[K_P [A.s/rad], K_I h [A/rad]] for the kernels.

    Args:
      robot: Its gains.
      period: Control period h [s].
    """
    return np.array([robot.control.speed_proportional, robot.control.speed_integral * period])


def amplifier_row(robot: Robot) -> np.ndarray:
    """The healthy motor with the controller's own current limit where that is lower, for `speed_loop`."""
    motor = motor_parameters(robot.motor)
    return np.array(motor._replace(current_limit=min(motor.current_limit, robot.control.current_limit)))


@kernel
def speed_loop(row, amplifier, target, measured, integral, scale=1.0):
    """i = s (K_P e + q), q⁺ = q + K_I h e unless the amplifier is at its limit: current and q⁺ [A].

    Anti-windup by conditional integration: the integral rests while the amplifier can not deliver (largest
    current, or supply less back-EMF) and the error would take it further.

    Args:
      row: From `speed_loop_row`.
      amplifier: From `amplifier_row`.
      target: φ̇_target [rad/s].
      measured: φ̇ [rad/s].
      integral: q [A].
      scale: s, 1 over what is left of the torque constant; 0 for a motor that is given up.
    """
    motor, error = motor_at(amplifier), target - measured
    wanted = scale * (row[PROPORTIONAL] * error + integral)
    missing = wanted - achievable_current(motor, wanted, measured)
    if missing * error <= 0.0:
        integral += row[INTEGRAL] * error
    return wanted, min(max(integral, -motor.current_limit), motor.current_limit)
