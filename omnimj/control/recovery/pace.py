"""How fast the plan runs: at the pace p the robot drives the same path with p v and p² a.

When the whole floor gives way, p = √(a_grip/a_plan): what the plan asked for at its hardest then fits the
grip. Turning about a held wheel asks more of wheels and floor: the plan's speed is kept below what both can
do.
"""

from __future__ import annotations

import math

from omnimj.control.recovery.gains import RecoveryGains
from omnimj.physics.native import kernel

SLOWEST = 0.15
"""Least pace while the robot is to go on."""
PIVOT_SPEED = 0.65
"""Of the centre while the robot turns about a wheel [m/s]: its yaw rate is up to this over the wheel's arm,
and swinging round asks I (v/l)²/2 of moment."""
_BRAKING, _STARTING = 0.5, 0.25  # [m/s²] with which the pace takes speed away and gives it back
_SHARE = RecoveryGains().grip_share
_HARDEST = 0.3  # [m/s²] any plan will ask for so much some time
_SLOW = 0.1  # [m/s] below which a pace may change at once


@kernel
def next_pace(pace, h, goal, speed, most):
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
def pace_on_slippery_floor(grip, hardest, gravity, share=_SHARE):
    """Goal of p when all wheels slip, and what the floor allows [m/s²].

    Args:
      grip: A coefficient of friction [1].
      hardest: Hardest acceleration of the plan so far [m/s²].
      gravity: [m/s²].
      share: Of the grip that is for the plan [1].
    """
    allowed = share * grip * gravity
    return min(max(math.sqrt(allowed / max(hardest, _HARDEST)), SLOWEST), 1.0), allowed


@kernel
def pace_of_pivot(pace, speed):
    """Goal of p with which the centre is not faster than `PIVOT_SPEED`."""
    plan = speed / max(pace, 1e-3)
    return min(1.0, PIVOT_SPEED / max(plan, 1e-3))
