"""Feed-forward of creep: the wheels turn as much faster as they creep on a floor that is known.

Rolling kinematics leave a robot behind its plan where its wheels creep. With the traction law of a floor, as
it was identified on earlier runs, the wheel speeds at which the planned twist is steady are known
(`physics.inverse_equilibrium`); what they exceed rolling by is added to the targets of the cascade. Only the
plan enters, not the corrections of the yaw loops, whose noise would change the sign of dry friction. Traction
builds up over some centimetres of rolling, which a steady balance leaves out.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from omnimj.effects.machine import apply_effects
from omnimj.parameters import Floor, Robot
from omnimj.parameters.floor import TRACTION_SIZE
from omnimj.parameters.parts import GRAVITY
from omnimj.physics.effect_terms import zero_terms
from omnimj.physics.inverse_equilibrium import approach_rims, rolling_rim
from omnimj.physics.motor import MOTOR_SIZE
from omnimj.physics.native import kernel
from omnimj.physics.planar import BODY_SIZE, PlanarModel, body_at, driven_wheel, planar_constants
from omnimj.physics.planar_wheel import PLANAR_WHEEL_SIZE

_SMOOTHING = 0.005
"""Velocity over which dry friction changes its sign [m/s]: the rollers of a wheel that rolls nearly straight
may turn either way, and the targets must not jump."""
_ROUNDS = 2
"""Newton steps in a control period, each from the solution of the period before."""
_MOST = 4.0
"""Largest excess over rolling, in rolling speeds of the fastest wheel: no floor model is good beyond."""
_REST = 0.02
"""Share of the weight that forces out of balance may reach: beyond it the floor cannot give the traction."""


class CreepParameters(NamedTuple):
    """Constants of the feed-forward of creep."""

    feeds: bool
    """False: no feed-forward."""
    model: PlanarModel
    """The robot on the floor that the controller assumes, with the effects of its model file."""


def creep_parameters(robot: Robot, floor: Floor | None) -> CreepParameters:
    """Constants of the feed-forward on a floor; none of it when None.

    Args:
      robot: The robot, with effects of its model file.
      floor: The floor as the controller assumes it.

    Raises:
      InputError: An effect of the model file does not suit the floor's law.
    """
    n = len(robot.wheels)
    motors, terms = np.zeros((n, MOTOR_SIZE)), zero_terms(n)
    if floor is None:
        body, wheels, row = np.zeros(BODY_SIZE), np.zeros((n, PLANAR_WHEEL_SIZE)), np.zeros(TRACTION_SIZE)
    else:
        changed = apply_effects(robot)
        made = planar_constants(
            changed.machine, changed.misalignment, changed.radius_scale, 1.0, changed.payload
        )
        body, wheels, row = made.body, made.wheels, changed.floor(floor).row
    model = PlanarModel(body, wheels, motors, np.tile(row, (n, 1)), terms, False)
    return CreepParameters(floor is not None, model)


@kernel
def update_creep(p, speed_per_twist, twist, creep, added):
    """Excess of the rims over rolling at which the planned twist is steady, and the wheel speeds it adds.

    Args:
      p: `CreepParameters`.
      speed_per_twist: Inverse kinematics B/r that the cascade uses, shape (n, 3).
      twist: Planned v_x, v_y, yaw rate in the body frame, shape (3,).
      creep: r φ̇ beyond rolling one period ago, replaced by that of now, shape (n,) [m/s].
      added: Filled with what is added to the wheel-speed targets, shape (n,) [rad/s]; zero where traction
        cannot keep up the twist.
    """
    n, fastest = creep.size, 0.0
    rims = np.empty(n)
    for i in range(n):
        rolling = rolling_rim(driven_wheel(p.model, i).wheel, twist)
        rims[i] = rolling + creep[i]
        fastest = max(fastest, abs(rolling))
    _, left = approach_rims(p.model, twist, _SMOOTHING, _ROUNDS, rims)
    can = left < _REST * GRAVITY * body_at(p.model.body).mass
    for i in range(n):
        wheel = driven_wheel(p.model, i).wheel
        rolling = rolling_rim(wheel, twist)
        creep[i] = min(max(rims[i] - rolling, -_MOST * fastest), _MOST * fastest)
        row = speed_per_twist[i]
        speed = (rolling + creep[i]) / wheel.wheel.radius
        speed -= row[0] * twist[0] + row[1] * twist[1] + row[2] * twist[2]
        added[i] = speed if can else 0.0
