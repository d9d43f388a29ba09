"""When a robot that is asked to stand is left alone.

Asked for nothing, the yaw loops would still answer the gyro's bias and noise: the wheel-speed integrals build
up against stiction, break away and build up again, a limit cycle of a tenth of an ampere that moves nothing.
While the robot stands, its wheels are asked to stand too and their friction holds the heading.
"""

from __future__ import annotations

from omnimj.physics.native import kernel

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
