"""The floor as the controller expects it: the creep of a wheel under its traction, and the drag of rolling.

A soft floor, identified on earlier runs, lets wheels creep in proportion to their speed and resists their
rolling. Both are expected of a healthy robot. Creep is the traction law turned round: the slip at which, with
the wheel's rolling speed known, the law gives the traction that the motor transmits.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from omnimj.effects.machine import apply_effects
from omnimj.parameters import Floor, Robot
from omnimj.parameters.floor import TRACTION_SIZE, TractionParameters
from omnimj.parameters.parts import GRAVITY
from omnimj.physics.native import kernel
from omnimj.physics.planar import planar_constants
from omnimj.physics.planar_wheel import PlanarWheel, planar_wheel_at
from omnimj.physics.traction import (
    exact_step,
    force_ratio,
    load_factor,
    mean_deflection,
    relaxation_rate,
    rolling_resistance,
)
from omnimj.signals import Array

_FASTEST = 1.0  # [m/s] largest slip that is looked for
_BISECTIONS = 26
_DEFLECTION = 1e-4  # [m] at which the stiffness of bristles is taken


class ExpectedFloor(NamedTuple):
    """Floor that the controller expects under a robot with n wheels."""

    stated: bool
    """False: nothing is known of the floor."""
    traction: TractionParameters
    loads: Array
    """Normal force of each wheel at rest, shape (n,) [N]."""
    yields: Array
    """Deflection of the bristles under each wheel per traction, shape (n,) [m/N]: an error of the traction is
    as much of slipped way."""
    stroke: float
    """Largest deflection of the bristles, in full sliding [m]."""


def expected_floor(robot: Robot, floor: Floor | None) -> ExpectedFloor:
    """Constants of a stated floor with the effects of the robot's model file; of none when None.

    Raises:
      InputError: An effect of the model file does not suit the floor's law.
    """
    n = len(robot.wheels)
    if floor is None:
        return ExpectedFloor(False, TractionParameters(*[0.0] * TRACTION_SIZE), np.zeros(n), np.zeros(n), 0.0)
    changed = apply_effects(robot)
    made = planar_constants(changed.machine, changed.misalignment, changed.radius_scale, 1.0, changed.payload)
    wheels: list[PlanarWheel] = [planar_wheel_at(row) for row in made.wheels]
    traction = TractionParameters(*map(float, changed.floor(floor).traction))
    loads = np.array([wheel.normal for wheel in wheels])
    stiffness = force_ratio(traction, _DEFLECTION, 0.0, 0.0) / _DEFLECTION
    rate = relaxation_rate(traction, _FASTEST, 0.0)
    stroke = _FASTEST / rate if rate > 0.0 else np.inf
    floor_given = ExpectedFloor(True, traction, loads, np.zeros(n), float(stroke))
    effective = np.array([effective_load(floor_given, i, 1.0) for i in range(n)])
    return floor_given._replace(yields=1.0 / (stiffness * effective))


def largest_drag(robot: Robot, floor: Floor) -> float:
    """Largest drag of a floor on the rolling wheels of a robot together [N]."""
    traction = apply_effects(robot).floor(floor).traction
    most = traction.rolling_resistance + traction.roller_resistance + traction.roller_dry
    return most * robot.body.mass * GRAVITY


@kernel
def yielded_way(floor, i, force):
    """Way by which the bristles under wheel i may yield while its traction goes from −F to F [m].

    Args:
      floor: `ExpectedFloor`.
      i: Wheel.
      force: F [N].
    """
    return 2.0 * min(force * floor.yields[i], floor.stroke)


@kernel
def rolling_drag(floor, i, rim, sideways):
    """Drag of the floor on wheel i and on its rollers where they turn, both not negative [N].

    Args:
      floor: `ExpectedFloor`.
      i: Wheel.
      rim: r φ̇ [m/s].
      sideways: Speed of the rollers [m/s].
    """
    if not floor.stated:
        return 0.0, 0.0
    on_wheel, on_rollers = rolling_resistance(floor.traction, abs(rim), sideways)
    return floor.loads[i] * on_wheel, floor.loads[i] * on_rollers


@kernel
def creep_under(traction, share, rolling, damping, z, t):
    """Creep s at which the mean of F/F_N over a block is the given one, and the bristle at its end.

    f(z̄, s) + c ż̄ = F/F_N with z̄(s), ż̄(s) the means over the block; the left side grows with s, which is
    bisected. An added damping c leaves steady creep as it is; traction then follows later.

    Args:
      traction: `TractionParameters`.
      share: F/F_N at the reference load [1].
      rolling: Rolling speed as `traction.rolling_speed` [m/s].
      damping: c [s/m].
      z: Bristle deflection at the beginning [m].
      t: Duration of the block [s].

    Returns:
      Creep s [m/s] and the deflection at the end [m].
    """
    low, high = -_FASTEST, _FASTEST
    slip = rate = 0.0
    for _ in range(_BISECTIONS):
        slip = 0.5 * (low + high)
        rate = relaxation_rate(traction, slip, rolling)
        mean = mean_deflection(z, exact_step(z, slip, rate, t), slip, rate, t)
        if force_ratio(traction, mean, slip, rate) + damping * (slip - rate * mean) < share:
            low = slip
        else:
            high = slip
    return slip, exact_step(z, slip, rate, t)


@kernel
def effective_load(floor, i, mass):
    """F_N (F_N/F_ref)^(p−1) of wheel i, to which traction is in proportion [N].

    Args:
      floor: `ExpectedFloor`.
      i: Wheel.
      mass: Mass of the robot with its payload over that of its model.
    """
    normal = floor.loads[i] * mass
    return normal * load_factor(floor.traction, normal)
