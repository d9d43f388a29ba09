"""PI control of one wheel's speed with anti-windup.

Known dry friction is not fed forward: in simulation that lowers the tracking error by a tenth only, since
most of it is inertia, and takes the overshoot of a wheel without grip from 6 % to 24 %.
"""

from __future__ import annotations

from typing import NamedTuple

from omnimj.parameters import Robot
from omnimj.physics.motor import MotorParameters, achievable_current, motor_parameters
from omnimj.physics.native import kernel


class SpeedGains(NamedTuple):
    """Gains of the discrete PI law."""

    proportional: float
    """K_P [A.s/rad]."""
    integral: float
    """K_I h, the change of the integral per step and error [A.s/rad]."""


def speed_gains(robot: Robot, period: float) -> SpeedGains:
    """Gains of a robot's wheel-speed loops at a control period h [s]."""
    return SpeedGains(robot.control.speed_proportional, robot.control.speed_integral * period)


def amplifier_parameters(robot: Robot) -> MotorParameters:
    """The healthy motor with the controller's own current limit where that is lower."""
    motor = motor_parameters(robot.motor)
    return motor._replace(current_limit=min(motor.current_limit, robot.control.current_limit))


@kernel
def speed_loop(gains, amplifier, target, measured, integral, scale=1.0):
    """Current i = s (K_P e + q) [A] and the integral q⁺ = q + K_I h e [A].

    Anti-windup by conditional integration: the integral rests while the amplifier cannot deliver (largest
    current, or supply less back-EMF) and the error would take it further.

    Args:
      gains: `SpeedGains`.
      amplifier: From `amplifier_parameters`.
      target: φ̇_target [rad/s].
      measured: φ̇ [rad/s].
      integral: q [A].
      scale: s, the inverse of the remaining share of the torque constant; 0 for a motor without a command.
    """
    error = target - measured
    wanted = scale * (gains.proportional * error + integral)
    missing = wanted - achievable_current(amplifier, wanted, measured)
    if missing * error <= 0.0:
        integral += gains.integral * error
    return wanted, min(max(integral, -amplifier.current_limit), amplifier.current_limit)
