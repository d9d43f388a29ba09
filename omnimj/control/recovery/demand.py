"""From what was asked for to what the cascade is asked for: demand, offsets and bounds of the wheels."""

from __future__ import annotations

import math

import numpy as np

from omnimj.control.cascade.heading import to_body
from omnimj.control.detection.robust.slip import CREEP_SLOPE
from omnimj.control.gains import RecoveryGains
from omnimj.control.recovery.force_allocation import allocate_forces, required_wrench
from omnimj.control.recovery.tracking import FORWARD_X, FORWARD_Y, PLACE_X, PLACE_Y, SPIN
from omnimj.control.robot_constants import LOAD, MASS, RADIUS, ROLLER_DRY, ROLLER_VISCOUS, YAW_INERTIA
from omnimj.physics.native import kernel

USUAL_GRIP = 0.09
"""μ of an ordinary floor [1]."""
_USUAL = RecoveryGains()
_BACK, _FASTEST = _USUAL.place_proportional, _USUAL.place_speed
_GIVES_WAY = 0.15  # [m/s]
_STANDS = 0.01  # [m/s] a robot that is to stand is not moved for its place


@kernel
def steady_creep(c, force):
    """Creep of an ordinary floor under a lasting traction, (|F|/F_N − μ)/σ sign F [m/s]."""
    return math.copysign(max(abs(force) / c[LOAD] - USUAL_GRIP, 0.0) / CREEP_SLOPE, force)


@kernel
def place_correction(x, target_x, target_y, gain=_BACK, fastest=_FASTEST):
    """K e, bounded, while the robot is to move [m/s].

    Args:
      x: Of `memory`.
      target_x: World demand [m/s].
      target_y: World demand [m/s].
      gain: K [1/s].
      fastest: Its bound [m/s].
    """
    if math.hypot(target_x, target_y) < _STANDS:
        return 0.0, 0.0
    back_x, back_y = gain * x[PLACE_X], gain * x[PLACE_Y]
    size = math.hypot(back_x, back_y)
    if size > fastest:
        back_x, back_y = back_x * fastest / size, back_y * fastest / size
    return back_x, back_y


@kernel
def pivot_yaw_rate(forces, radius, pivot, speed, velocity_x, velocity_y):
    """ω of a robot that turns about wheel b: u_b·v + B_3b ω = r φ̇_b [rad/s]; 0 while it is to stand.

    A wheel that gives way faster than `_GIVES_WAY` holds nothing: it must not drive what is asked for.

    Args:
      forces: B, shape (3, n).
      radius: r [m].
      pivot: b.
      speed: φ̇_b of a shorted motor, which gives way; 0 of a wheel that is held [rad/s].
      velocity_x: Of the centre, body frame [m/s].
      velocity_y: Of the centre, body frame [m/s].
    """
    if math.hypot(velocity_x, velocity_y) < _STANDS:
        return 0.0
    way = min(max(radius * speed, -_GIVES_WAY), _GIVES_WAY)
    along = forces[0, pivot] * velocity_x + forces[1, pivot] * velocity_y
    return (way - along) / forces[2, pivot]


@kernel
def creep_offsets(c, forces, across, arm, x, heading, twist, most, used, pivot, felt, offset):
    """Adds creep(f*_i)/r to the wheels that obey, in place; returns f*, shape (n,) [N].

    Args:
      c: `robust.robot_constants`.
      forces: B, shape (3, n).
      across: Shape (n, 3).
      arm: [m].
      x: Of `memory`.
      heading: [rad].
      twist: Demanded, body frame, shape (3,).
      most: Largest traction of each wheel, shape (n,) [N].
      used: Wheels that obey, and the one that is turned about, shape (n,).
      pivot: That one, or −1.
      felt: Traction of the wheels as their motors tell, shape (n,) [N].
      offset: Output, shape (n,) [rad/s].
    """
    n = used.size
    side = across @ twist
    # the acceleration of the demand, felt in the frame that turns with the body, is its world one, turned
    a_x, a_y = to_body(x[FORWARD_X], x[FORWARD_Y], heading)
    friction = c[LOAD] * np.array((c[ROLLER_DRY], c[ROLLER_VISCOUS]))
    wrench = required_wrench(
        c[MASS], c[YAW_INERTIA], friction, forces, across, used, felt, np.array((a_x, a_y)), x[SPIN], side
    )
    share = allocate_forces(forces, arm, wrench, most, used)
    for i in range(n):
        if used[i] and i != pivot:
            wide = math.hypot(forces[0, i], forces[1, i])  # 1/sin γ of its rollers
            offset[i] += wide * steady_creep(c, wide * share[i]) / c[RADIUS]
    return share


@kernel
def cap_slip(c, forces, velocity, turning, slipping, cap, lowest, highest):
    """Bounds of wheels that slip: the floor's speed ± `cap` [m/s], in place [rad/s]."""
    for i in range(slipping.size):
        if slipping[i]:
            below = forces[0, i] * velocity[0] + forces[1, i] * velocity[1] + forces[2, i] * turning
            lowest[i], highest[i] = (below - cap) / c[RADIUS], (below + cap) / c[RADIUS]


# How fast the plan runs: at the pace p the robot drives the same path with p v and p² a.

LEAST_TIME_SCALING = 0.15
"""Least pace while the robot is to go on."""
PIVOT_SPEED = 0.65
"""Of the centre while the robot turns about a wheel [m/s]: its yaw rate is up to this over the wheel's arm,
and swinging round asks I (v/l)²/2 of moment."""
_BRAKING, _STARTING = 0.5, 0.25  # [m/s²] with which the pace takes speed away and gives it back
_SHARE = RecoveryGains().grip_share
_HARDEST = 0.3  # [m/s²] any plan will ask for so much some time
_SLOW = 0.1  # [m/s] below which a pace may change at once


@kernel
def next_time_scaling(pace, h, goal, speed, most):
    """p one step on, toward its goal as fast as floor and plan allow.

    Args:
      pace: p.
      h: Control period [s].
      goal: p that is wanted.
      speed: Of the plan at pace p [m/s].
      most: Acceleration that the floor allows [m/s²].
    """
    plan = max(speed / max(pace, 1e-3), _SLOW)
    down, up = min(_BRAKING, most) * h / plan, min(_STARTING, most) * h / plan
    return min(max(goal, pace - down), pace + up)


@kernel
def time_scaling_on_slippery_floor(grip, hardest, gravity, share=_SHARE):
    """Goal of p when all wheels slip, and what the floor allows [m/s²].

    Args:
      grip: A coefficient of friction [1].
      hardest: Hardest acceleration of the plan so far [m/s²].
      gravity: [m/s²].
      share: Of the grip that is for the plan [1].
    """
    allowed = share * grip * gravity
    return min(max(math.sqrt(allowed / max(hardest, _HARDEST)), LEAST_TIME_SCALING), 1.0), allowed


@kernel
def time_scaling_of_pivot(pace, speed):
    """Goal of p with which the centre is not faster than `PIVOT_SPEED`."""
    plan = speed / max(pace, 1e-3)
    return min(1.0, PIVOT_SPEED / max(plan, 1e-3))
