"""Demands that a faulty robot can follow: position correction, turning about a wheel, slip cap, time scaling.

At a time scaling p the robot drives the same path with p v and p² a. When the whole floor gives way, p =
√(a_grip/a_plan): the hardest demand of the plan then fits the grip. Turning about a held wheel demands more
of wheels and floor: the plan's speed is kept below what both can do.
"""

from __future__ import annotations

import math

import numpy as np

from omnimj.physics.native import kernel

LEAST_TIME_SCALING = 0.15
"""Least time scaling while the robot is to go on."""
PIVOT_SPEED = 0.65
"""Largest speed of the centre while the robot turns about a wheel [m/s]: its yaw rate is up to this over the
wheel's arm, and swinging round takes a moment of I (v/l)²/2."""
_GIVES_WAY = 0.15  # [m/s] speed of a braked wheel beyond which it holds nothing
_STANDING = 0.01  # [m/s] below this demand the position is not corrected
_BRAKING, _STARTING = 0.5, 0.25  # [m/s²] at which time scaling takes speed away and gives it back
_HARDEST = 0.3  # [m/s²] acceleration to be expected of any plan
_SLOW = 0.1  # [m/s] below this speed of the plan its time scaling may change at once


@kernel
def place_correction(place_x, place_y, demand_x, demand_y, gain, fastest):
    """Velocity K e, bounded, that drives a position error back; 0 while the robot is to stand [m/s].

    Args:
      place_x: Position error e, world frame [m].
      place_y: Position error e, world frame [m].
      demand_x: World demand [m/s].
      demand_y: World demand [m/s].
      gain: K [1/s].
      fastest: Bound [m/s].
    """
    if math.hypot(demand_x, demand_y) < _STANDING:
        return 0.0, 0.0
    back_x, back_y = gain * place_x, gain * place_y
    size = math.hypot(back_x, back_y)
    if size > fastest:
        back_x, back_y = back_x * fastest / size, back_y * fastest / size
    return back_x, back_y


@kernel
def pivot_yaw_rate(robot, pivot, wheel_speed, velocity_x, velocity_y):
    """Yaw rate of a robot that turns about wheel b: u_b·v + B_3b ω = r φ̇_b [rad/s]; 0 while it is to stand.

    The speed of a wheel that gives way faster than `_GIVES_WAY` is clipped: it must not drive the demand.

    Args:
      robot: `RobotConstants`.
      pivot: b.
      wheel_speed: φ̇_b of a shorted motor, which gives way; 0 of a held wheel [rad/s].
      velocity_x: Velocity of the centre, body frame [m/s].
      velocity_y: Velocity of the centre, body frame [m/s].
    """
    if math.hypot(velocity_x, velocity_y) < _STANDING:
        return 0.0
    way = min(max(robot.radius[pivot] * wheel_speed, -_GIVES_WAY), _GIVES_WAY)
    along = robot.forces[0, pivot] * velocity_x + robot.forces[1, pivot] * velocity_y
    return (way - along) / robot.forces[2, pivot]


@kernel
def slip_bounds(robot, velocity, yaw_rate, slipping, cap):
    """Bounds of the wheel speeds: the floor's speed ± `cap` for slipping wheels, infinite for others.

    Args:
      robot: `RobotConstants`.
      velocity: Estimated body velocity, shape (2,) [m/s].
      yaw_rate: [rad/s].
      slipping: Mask of the slipping wheels, shape (n,).
      cap: Largest slip velocity [m/s].

    Returns:
      Lower and upper bounds, shape (n,) each [rad/s].
    """
    lowest, highest = np.full(slipping.size, -np.inf), np.full(slipping.size, np.inf)
    for i in range(slipping.size):
        if slipping[i]:
            floor = robot.forces[0, i] * velocity[0] + robot.forces[1, i] * velocity[1]
            floor += robot.forces[2, i] * yaw_rate
            lowest[i], highest[i] = (floor - cap) / robot.radius[i], (floor + cap) / robot.radius[i]
    return lowest, highest


@kernel
def next_time_scaling(scaling, h, goal, speed, most):
    """Time scaling p one step on, toward its goal as fast as floor and plan allow.

    Args:
      scaling: p.
      h: Control period [s].
      goal: Wanted p.
      speed: Speed of the plan at time scaling p [m/s].
      most: Acceleration that the floor allows [m/s²].
    """
    plan = max(speed / max(scaling, 1e-3), _SLOW)
    down, up = min(_BRAKING, most) * h / plan, min(_STARTING, most) * h / plan
    return min(max(goal, scaling - down), scaling + up)


@kernel
def time_scaling_on_slippery_floor(grip, hardest, gravity, share):
    """Wanted time scaling when all wheels slip, and the acceleration that the floor allows [m/s²].

    Args:
      grip: Coefficient of friction [1].
      hardest: Hardest acceleration of the plan so far [m/s²].
      gravity: [m/s²].
      share: Share of the grip that the plan may use [1].
    """
    allowed = share * grip * gravity
    return min(max(math.sqrt(allowed / max(hardest, _HARDEST)), LEAST_TIME_SCALING), 1.0), allowed


@kernel
def time_scaling_of_pivot(scaling, speed):
    """Wanted time scaling that keeps the centre at or below `PIVOT_SPEED`.

    Args:
      scaling: Present time scaling.
      speed: Speed of the plan at it [m/s].
    """
    plan = speed / max(scaling, 1e-3)
    return min(1.0, PIVOT_SPEED / max(plan, 1e-3))
