"""One control period under a policy as kernels, common to planar robot and twin.

`p` is the `Setup` of the environment, `e` the `Episode` of the robot, changed in place, and `plan` its
`Plan`; `setup` and `episode` are records of the first two.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from omnimj.control.cascade.controller import (
    CascadeInput,
    CascadeParameters,
    CascadeState,
    Reconfiguration,
    advance_cascade,
    is_good_sample,
)
from omnimj.control.cascade.heading import to_body, wrapped
from omnimj.control.cascade.limits import limit_all
from omnimj.learning.observation import ACCELERATION, HEADING, LIMIT, PLACE, VELOCITY, YAW_RATE
from omnimj.physics.native import inlined, kernel
from omnimj.plant.planar import step_planar, write_planar_truth
from omnimj.signals import Array
from omnimj.simulate.compiled.row import CHUNK_IS_DONE, PLANT_CHANGES, TRUTH_IS_BROKEN, is_spent

TWIST, WHEEL_SPEEDS, CURRENTS = range(3)
"""Kinds of action."""


class Setup(NamedTuple):
    """Constants of an environment with a robot of n wheels."""

    cascade: CascadeParameters
    forward: Array
    """Body twist by rolling wheels, shape (3, n): v [m/s] and yaw rate [rad/s] per wheel speed [rad/s]."""
    action: int
    """`TWIST`, `WHEEL_SPEEDS` or `CURRENTS`."""
    scale: Array
    """Unit of each number of the action, shape (n,)."""
    resistance: float
    """Resistance of a motor's winding [Ω]."""
    back_emf: float
    """Voltage of a motor per wheel speed [V s/rad]."""
    wheel_speed: float
    """Scale of the observed wheel speeds [rad/s]."""
    ahead: int
    """Control periods by which the plan is seen ahead."""
    largest: float
    """Largest magnitude of a sound true value."""


class Episode(NamedTuple):
    """State of one episode, n wheels."""

    cascade: CascadeState
    changed: Reconfiguration
    """Change of the cascade by the action."""
    readings: Array
    """Newest readings, shape (2n+4,)."""
    truth: Array
    """True values aligned with `robot_truth_names`, shape (6+3n,)."""
    action: Array
    """Present action, within ±1, shape (n,); a twist takes the first three."""
    planned: Array
    """Present planned position [m] and heading [rad], shape (3,)."""
    reckoned: Array
    """Position by dead reckoning, shape (2,) [m]."""
    period: int
    """Control periods since the start."""
    begin: int
    """Control periods after which the present decision began."""
    end: int
    """Control periods after which the present decision ends."""
    last: int
    """Control periods after which the plan ends."""
    sound: bool
    """False once a true value is not finite or beyond `Setup.largest`."""
    distance: float
    """Present distance from the planned position [m]."""
    error: float
    """Integral of the distance from the planned position over the present decision [m s]."""
    turned: float
    """Integral of the magnitude of the heading error over the present decision [rad s]."""
    energy: float
    """Electrical energy drawn in the present decision [J]."""
    observation: NDArray[np.float32]
    """Shape (2n+12,)."""


@inlined
def set_currents(p, e, plan, time):
    """Set the currents of the coming period in the cascade of `e`, by cascade and action.

    `time` is that of the readings [s].
    """
    n, at, x = p.forward.shape[1], e.period, e.cascade
    current, wheel_speed, acceleration = e.readings[:n], e.readings[n : 2 * n], e.readings[2 * n : 2 * n + 2]
    yaw_rate, yaw, last = e.readings[2 * n + 2], e.readings[2 * n + 3], x.current.copy()
    planned, added = plan.columns[at], p.scale * e.action
    v_x, v_y, turn = planned[3], planned[4], plan.yaw_rate[at]
    if p.action == TWIST:
        c, s = math.cos(x.heading), math.sin(x.heading)
        v_x += c * added[0] - s * added[1]
        v_y += s * added[0] + c * added[1]
        turn += added[2]
    elif p.action == WHEEL_SPEEDS:
        e.changed.offset[:] = added
    good = is_good_sample(n, time, current, wheel_speed, acceleration, yaw_rate, yaw)
    now = CascadeInput(good, wheel_speed, yaw_rate, yaw, v_x, v_y, turn, planned[2])
    advance_cascade(p.cascade, e.changed, x, now)
    if p.action == CURRENTS:
        limit_all(p.cascade.limits, added, last, wheel_speed, good, x.current, x.log[5 + n :])
        x.integral[:] = 0.0


@inlined
def account(p, e, plan, values):
    """Count one more period: dead reckoning, distance from the plan, heading error, energy.

    `values` begin with true currents [A] and wheel speeds [rad/s], shape (2n+4,).

    Returns:
      False if a true value is not finite or beyond `Setup.largest`.
    """
    n, h = p.forward.shape[1], p.cascade.period
    for value in e.truth:
        if not abs(value) <= p.largest:
            e.sound = False
            return False
    x = y = power = 0.0
    for i in range(n):
        speed = e.readings[n + i]
        x += p.forward[0, i] * speed
        y += p.forward[1, i] * speed
        power += values[i] * (p.resistance * values[i] + p.back_emf * values[n + i])
    c, s = math.cos(e.cascade.heading), math.sin(e.cascade.heading)
    e.reckoned[0] += h * (c * x - s * y)
    e.reckoned[1] += h * (s * x + c * y)
    e.period += 1
    e.planned[:] = plan.columns[e.period, :3]
    e.distance = math.hypot(e.truth[0] - e.planned[0], e.truth[1] - e.planned[1])
    e.error += h * e.distance
    e.turned += h * abs(wrapped(e.truth[2] - e.planned[2]))
    e.energy += h * max(power, 0.0)
    return True


@kernel
def _scaled(value, scale):
    number = value / scale
    return min(max(number, -LIMIT), LIMIT) if math.isfinite(number) else 0.0


@kernel
def observe(p, e, plan):
    """Fill the observation by the readings and the plan."""
    n, heading, seen = p.forward.shape[1], e.cascade.heading, e.observation
    at = e.period
    ahead = min(at + p.ahead, plan.columns.shape[0] - 1)
    for i in range(n):
        seen[i] = _scaled(e.readings[n + i], p.wheel_speed)
        seen[n + i] = _scaled(e.readings[i], p.cascade.limits.current)
    seen[2 * n] = _scaled(e.readings[2 * n], ACCELERATION)
    seen[2 * n + 1] = _scaled(e.readings[2 * n + 1], ACCELERATION)
    seen[2 * n + 2] = _scaled(e.readings[2 * n + 2] - e.cascade.gyro_bias.bias, YAW_RATE)
    seen[2 * n + 3] = _scaled(wrapped(plan.columns[at, 2] - heading), HEADING)
    x, y = to_body(plan.columns[at, 3], plan.columns[at, 4], heading)
    seen[2 * n + 4], seen[2 * n + 5] = _scaled(x, VELOCITY), _scaled(y, VELOCITY)
    seen[2 * n + 6] = _scaled(plan.yaw_rate[at], YAW_RATE)
    x, y = to_body(plan.columns[ahead, 3], plan.columns[ahead, 4], heading)
    seen[2 * n + 7], seen[2 * n + 8] = _scaled(x, VELOCITY), _scaled(y, VELOCITY)
    seen[2 * n + 9] = _scaled(plan.yaw_rate[ahead], YAW_RATE)
    x, y = to_body(plan.columns[at, 0] - e.reckoned[0], plan.columns[at, 1] - e.reckoned[1], heading)
    seen[2 * n + 10], seen[2 * n + 11] = _scaled(x, PLACE), _scaled(y, PLACE)


@kernel
def act_on_planar(plant, setup, episode, plan, next_change):
    """Drive until the end of the decision or until Python is needed; observe at the end.

    The plant, `PlanarArrays`, has conditions to change from the time `next_change` [s].

    Returns:
      The reason for which the loop returns.
    """
    p, e = setup[0], episode[0]
    while e.period < e.end:
        if plant.steps[0] * plant.period >= next_change or is_spent(plant.sensors):
            return PLANT_CHANGES
        set_currents(p, e, plan, plant.steps[0] * plant.period)
        e.readings[:] = step_planar(plant, e.cascade.current)
        write_planar_truth(plant, e.truth)
        if not account(p, e, plan, plant.values):
            return TRUTH_IS_BROKEN
    observe(p, e, plan)
    return CHUNK_IS_DONE
