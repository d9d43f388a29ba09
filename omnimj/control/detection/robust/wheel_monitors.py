"""Monitors of every wheel: slip, rolling under load, standing, disobeying.

Slip counts by its way: the creep beyond that of a healthy wheel, summed while it lasts, so that a large slip
is seen at once and a small one soon, and a spike of noise never. Recovered grip counts by likelihood: how
much less the wheel slips than it would under this traction with the grip that it had lost.

In the kernels `robot` is `RobotConstants`, `parameters` `RobustParameters`, `block` `Block`, `monitors`
`WheelMonitors`, and i the wheel.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from omnimj.control.detection.robust.force_balance import moments, roller_speeds
from omnimj.control.detection.robust.slip import (
    SOFT_FLOOR,
    STIFF_FLOOR,
    STRONGER,
    WEAKER,
    healthy_creep_bounds,
    next_creep,
    slip_residual,
    speed_deviation,
    wheel_slip,
)
from omnimj.control.expected_floor import creep_under, effective_load, yielded_way
from omnimj.control.robot_constants import CREEP_SLOPE
from omnimj.physics.equilibrium import SMOOTHING, steady_ratio
from omnimj.physics.native import kernel
from omnimj.physics.traction import rolling_speed
from omnimj.signals import Array

ALLOWED, ALLOWED_TURNING = 0.02, 0.015
"""Creep beyond health that the velocity's error may make [m/s]; more per rad/s of yaw rate, since rows of
rollers alternate at two distances from the centre [m]."""
MOST = 0.002
"""Largest way that is counted: a slip that has ended is soon forgotten [m]."""
LOADED = 1.5
"""Traction from which a wheel is under load [N]."""
AGREES = -0.75
"""Smallest traction along the slip at which it may be one: a wheel does not lag behind its own force for long
[N]."""
NO_SLIP = 0.12
"""Slip against the load, or without load, above which the wheel-speed reading must be wrong [m/s]."""
SLOW_BRISTLE = CREEP_SLOPE
"""Damping that is added to a stated floor where its traction follows late: that of stone [s/m]."""
DOUBT = 0.2
"""Standard deviation of the creep on a stated floor, as a share of it."""
_FADES = 0.9  # factor per block on the counted way, once the wheel pulls the other way
_SPREADS = (
    4.0  # variance ratio beyond which the other wheels leave dead reckoning; wheels 120 degrees apart: 2
)
_UNSURE = 0.5  # standard deviation of the creep beside an oscillation, as a share of it
_SIGMAS = 2.0  # standard deviations of the body's velocity by which a wheel may be off
_DRIFTS = 3.0  # factor on it under dead reckoning: errors of the accelerometer are not white
_GRIP = 0.08  # μ of a usual floor
_FORCE, _LITTLE = 0.7, 0.3  # [N] error of F̂, and what is added to it for a lost grip
_LEAST_GRIP, _NEWEST = 0.02, 0.1  # bounds of a lost grip, weight of its newest value
_SHOWS = 0.015  # [m/s] slip that the lost grip would make at this load: less is no sign of health
_SPREAD, _COLOUR = 0.02, 6.0  # [m/s] error of a slip, and blocks over which it is correlated
_AT_ONCE = 0.6  # [nats] largest likelihood of one block
_ROLLS, _OPPOSES = 2.5, 0.08  # [rad/s], [m/s]
_STANDS, _PASSES, _PUSHED = 0.4, 0.05, 0.4  # [rad/s] of a locked wheel, [m/s] of the floor below it, [A]
_WOULD, _TURNING = 0.08, 1.5  # [m/s] that a motor would make of its wheel, [rad/s] of one that is not locked
_OBEYED, _COMMANDED, _SILENT = 0.25, 0.15, 0.03  # [A]


class WheelMonitors(NamedTuple):
    """Monitors of n wheels; counts are blocks in a row."""

    slipped: Array
    """Way slipped beyond the allowed creep, and on a stated floor beyond what its bristles yield, shape (n,)
    [m]."""
    yielded: Array
    """Way slipped beyond the allowed creep by which bristles of a stated floor may yield, shape (n,) [m]."""
    regained: Array
    """Log-likelihood that the lost grip is back, shape (n,) [nats]."""
    implausible: Array
    """Count of speeds that no slip explains, shape (n,)."""
    stuck: Array
    """Count of standing while the floor passes, shape (n,)."""
    stalled: Array
    """Count of standing under a motor that should turn the wheel, shape (n,)."""
    turning: Array
    """Count of turning, shape (n,)."""
    silent: Array
    """Count of a motor without its commanded current, shape (n,)."""
    disobeying: Array
    """Count of a motor with another current, shape (n,)."""
    opposed: Array
    """Speed ahead of the velocity against the wheel's force, or behind it with its force (below 0), shape
    (n,) [m/s]."""
    excess: Array
    """Last creep beyond health, shape (n,) [m/s]."""
    grip: Array
    """Grip of the last slip, 1 before any, shape (n,) [1]."""
    healthy_bristles: Array
    """Deflections of `healthy_creep_bounds`, shape (n, 4) [m]."""
    soft_bristle: Array
    """Deflection on a soft floor, shape (n,) [m]."""
    stiff_bristle: Array
    """Deflection on a stiff floor, shape (n,) [m]."""
    lost_bristle: Array
    """Deflection on a floor with the grip of the last slip, shape (n,) [m]."""
    rolling: Array
    """Rolling speed on a stated floor, 0 without one, shape (n,) [m/s]."""


class Traction(NamedTuple):
    """Load, force and creep of n wheels in one block."""

    load: float
    """Mean normal force of a wheel, F_N [N]."""
    force: Array
    """F̂, shape (n,) [N]."""
    swing: Array
    """Change of F̂ since the block before, shape (n,) [N]."""
    oscillation: Array
    """Mean square oscillation of the speeds of the wheels' rims, from `update_oscillation`, shape (n,)
    [m²/s²]."""
    creep: Array
    """Expected creep and its uncertainty, shape (n, 2) [m/s]."""
    held: Array
    """Dry friction that may have held each wheel lately; 0 for wheels that turned. Shape (n,) [N]."""
    moving: bool
    """True if any wheel turns: the velocity of a robot at rest is only its filters' error."""
    unknown: NDArray[np.bool_]
    """Mask of wheels whose traction is not known, and so neither their creep on a stated floor: dry friction
    may have held them lately, or a new loss is still being measured. Shape (n,)."""


def initial_monitors(wheels: int) -> WheelMonitors:
    """Monitors before the first block."""
    zeros = {name: np.zeros(wheels) for name in WheelMonitors._fields}
    return WheelMonitors(**zeros | {"grip": np.ones(wheels), "healthy_bristles": np.zeros((wheels, 4))})


@kernel
def restart_monitors(monitors):
    """Go on after a gap in the measurements, in place: counts start anew, grip and bristles stay."""
    for counts in (
        monitors.slipped,
        monitors.yielded,
        monitors.regained,
        monitors.implausible,
        monitors.stuck,
        monitors.stalled,
        monitors.turning,
        monitors.silent,
        monitors.disobeying,
        monitors.opposed,
        monitors.excess,
    ):
        counts[:] = 0.0


@kernel
def roller_ratio(robot, i):
    """Ratio 1/sin γ of a wheel, of its floor's force to its motor's; 1 for an omni wheel.

    It is also the ratio of the wheel's slip to that of the contact.
    """
    return math.hypot(robot.forces[0, i], robot.forces[1, i])


@kernel
def expected_creep(robot, block, velocity, load, force, monitors):
    """Creep of each wheel under its traction and its uncertainty, shape (n, 2) [m/s].

    Args:
      velocity: Estimated v_x, v_y of the body, shape (2,) [m/s].
      load: F_N of a wheel [N].
      force: F̂, shape (n,) [N].
      monitors: `WheelMonitors`, whose soft and stiff bristles are updated in place, and on a stated floor
        its rolling speed.
    """
    creep, t = np.empty((force.size, 2)), block.duration
    if robot.floor.stated:
        _creep_on_floor(robot, block, velocity, load, force, monitors, creep)
        return creep
    softs, stiffs = monitors.soft_bristle, monitors.stiff_bristle
    for i in range(force.size):
        ratio = roller_ratio(robot, i)
        share = force[i] * ratio / load
        soft, softs[i] = next_creep(share, softs[i], SOFT_FLOOR[0], SOFT_FLOOR[1], t)
        stiff, stiffs[i] = next_creep(share, stiffs[i], STIFF_FLOOR[0], STIFF_FLOOR[1], t)
        creep[i, 0], creep[i, 1] = 0.5 * ratio * (soft + stiff), 0.5 * ratio * abs(soft - stiff)
    return creep


@kernel
def _creep_on_floor(robot, block, velocity, load, force, monitors, creep):
    """Fill the creep of each wheel on the stated floor; arguments as `expected_creep`.

    Identified floors come from steady driving, so that how fast traction builds up is not known: the creep is
    the mean of that by the law and of that by a law whose traction follows later, uncertain by their
    difference.
    """
    floor, sideways = robot.floor, np.empty(force.size)
    roller_speeds(robot, block, velocity, sideways)
    for i in range(force.size):
        ratio, rim = roller_ratio(robot, i), robot.radius[i] * block.wheel_speed[i]
        u = robot.forces[:, i]
        along = u[0] * velocity[0] + u[1] * velocity[1] + u[2] * block.yaw_rate
        rolling = rolling_speed(floor.traction, rim, along, sideways[i])
        share = force[i] * ratio / effective_load(floor, i, load / robot.load)
        softs, stiffs, t = monitors.soft_bristle, monitors.stiff_bristle, block.duration
        soft, softs[i] = creep_under(floor.traction, share, rolling, SLOW_BRISTLE, softs[i], t)
        stiff, stiffs[i] = creep_under(floor.traction, share, rolling, 0.0, stiffs[i], t)
        creep[i, 0], creep[i, 1] = 0.5 * ratio * (soft + stiff), 0.5 * ratio * abs(soft - stiff)
        monitors.rolling[i] = rolling


@kernel
def _count(counter, i, condition, weight=1.0):
    """Count blocks in a row, in place."""
    counter[i] = counter[i] + weight if condition else 0.0


@kernel
def _standing_weight(parameters, passed, i):
    """Weight of a block in which wheel i stands while the floor passes.

    Bristles of a stated floor hold a healthy wheel until they have yielded from one end of its dry friction
    to the other; no count is full before the floor has passed by as far.

    Args:
      passed: Way of the floor in the block [m].
    """
    robot, floor = parameters.robot, parameters.robot.floor
    if not floor.stated:
        return 1.0
    dry = robot.dry[i] + floor.traction.rolling_resistance * floor.loads[i] + _FORCE
    return min(passed * parameters.thresholds.stuck / yielded_way(floor, i, dry), 1.0)


class ContactSlip(NamedTuple):
    """Slip of one wheel at its contact."""

    load: float
    """F_N [N]."""
    force: float
    """F̂ [N]."""
    slip: float
    """s [m/s]."""
    deviation: float
    """Standard deviation of s [m/s]."""
    rolling: float
    """Rolling speed on a stated floor [m/s]."""
    held: float
    """Dry friction that may have held the wheel lately [N]."""


@kernel
def floor_creep_bounds(traction, share, rolling, bristles, t):
    """Smallest and largest creep of a healthy wheel on a stated floor [m/s].

    The floor may be a fifth weaker and carry less load, or carry more; traction may follow late or at once.

    Args:
      traction: `TractionParameters`.
      share: F̂/F_N [1].
      rolling: Rolling speed [m/s].
      bristles: Deflections on the weaker floor and on the stronger one, shape (4,), updated in place [m].
      t: Duration of the block [s].
    """
    least, most = math.inf, -math.inf
    for k in range(4):
        part = share / (WEAKER * WEAKER if k < 2 else STRONGER)
        damping = SLOW_BRISTLE if k % 2 else 0.0
        creep, bristles[k] = creep_under(traction, part, rolling, damping, bristles[k], t)
        least, most = min(least, creep), max(most, creep)
    return least, most


@kernel
def update_slip_monitor(floor, period, contact, yaw_rate, judged, monitors, i):
    """Slip and grip of wheel i after a block, in place.

    Args:
      floor: `ExpectedFloor`.
      period: Duration of a block [s].
      contact: `ContactSlip`.
      yaw_rate: [rad/s].
      judged: Whether any wheel turns and the traction of this one is known.
    """
    load, force, slip, deviation, rolling, held = contact
    bristles, traction = monitors.healthy_bristles[i], floor.traction
    if floor.stated:
        least, most = floor_creep_bounds(traction, force / load, rolling, bristles, period)
    else:
        least, most = healthy_creep_bounds(force / load, bristles, period)
    beyond = max(slip - most, least - slip)
    pull = force if slip - most > least - slip else -force
    excess = beyond - _SIGMAS * deviation
    allowed = ALLOWED + ALLOWED_TURNING * abs(yaw_rate)
    if judged and pull > AGREES:
        free = yielded_way(floor, i, _FORCE)
        way = monitors.yielded[i] + monitors.slipped[i] + period * (excess - allowed)
        monitors.slipped[i] = min(max(way - free, 0.0), MOST)
        monitors.yielded[i] = min(max(way, 0.0), free)
    else:
        monitors.slipped[i] *= _FADES
        monitors.yielded[i] *= _FADES
    monitors.excess[i], monitors.opposed[i] = excess, 0.0
    if judged and excess > allowed and pull < AGREES:
        monitors.opposed[i] = excess if slip > most else -excess
    if excess > allowed and monitors.slipped[i] > 0.0:
        monitors.regained[i] = 0.0
        usual = _GRIP + CREEP_SLOPE * abs(slip)
        if floor.stated:
            usual = max(steady_ratio(traction, abs(slip), rolling, SMOOTHING), _LEAST_GRIP)
        grip = (abs(force) + _LITTLE) / (load * usual)
        grip = min(max(grip, _LEAST_GRIP), 1.0)
        known = monitors.grip[i]
        monitors.grip[i] = grip if known == 1.0 else (1.0 - _NEWEST) * known + _NEWEST * grip
    # the torque of a motor that cannot turn its wheel is no traction
    certain = max(abs(force) - _FORCE - held, 0.0)
    share = math.copysign(certain, force) / (load * monitors.grip[i])
    before = monitors.lost_bristle[i]
    if floor.stated:
        lost, monitors.lost_bristle[i] = creep_under(traction, share, rolling, SLOW_BRISTLE, before, period)
    else:
        lost, monitors.lost_bristle[i] = next_creep(share, before, SOFT_FLOOR[0], SOFT_FLOOR[1], period)
    would, shows = (lost - most, slip - most) if force > 0.0 else (least - lost, least - slip)
    if would > _SHOWS:
        variance = _COLOUR * (_SPREAD * _SPREAD + deviation * deviation)
        likelihood = would * (0.5 * would - max(shows, 0.0)) / variance
        monitors.regained[i] = max(monitors.regained[i] + min(likelihood, _AT_ONCE), 0.0)


@kernel
def _is_dead_reckoning(robot, included, i):
    """True if the other included wheels say little about the velocity along wheel i.

    Little is a variance dᵀ(Σ d_j d_jᵀ)⁻¹d beyond `_SPREADS` times that of one wheel that drives along d.
    """
    forces = robot.forces
    xx, xy, yy = moments(forces, included, i)
    if xx + yy == 0.0:
        return True
    x, y = forces[0, i], forces[1, i]
    return yy * x * x - 2.0 * xy * x * y + xx * y * y > _SPREADS * (xx * yy - xy * xy)


@kernel
def _creep_doubt(robot, included, creep, i):
    """Standard deviation of the velocity along wheel i for errors of the other wheels' creep [m/s].

    The velocity by the others is u_iᵀ (Σ u_j u_jᵀ)⁻¹ Σ u_j v_j; each v_j is off by `DOUBT` of the creep. That
    error lasts, so that no filter averages it.

    Args:
      included: Mask of the wheels used by the velocity estimate, shape (n,).
      creep: Expected creep and its uncertainty, shape (n, 2) [m/s].
    """
    forces, total = robot.forces, 0.0
    xx, xy, yy = moments(forces, included, i)
    det = xx * yy - xy * xy
    if det <= 1e-6:
        return 0.0
    a, b = (yy * forces[0, i] - xy * forces[1, i]) / det, (xx * forces[1, i] - xy * forces[0, i]) / det
    for j in range(included.size):
        if j != i and included[j]:
            part = (a * forces[0, j] + b * forces[1, j]) * DOUBT * creep[j, 0]
            total += part * part
    return math.sqrt(total)


@kernel
def update_wheel_monitors(parameters, block, included, traction, x, cov, monitors, i):
    """All monitors of wheel i after a block, in place.

    Args:
      included: Mask of the wheels used by the velocity estimate, shape (n,).
      traction: `Traction`.
      x: State of the velocity filter without this wheel, shape (STATE,).
      cov: Its covariance, shape (STATE, STATE).
    """
    robot, yaw_rate, force = parameters.robot, block.yaw_rate, traction.force[i]
    speed, current, commanded = block.wheel_speed[i], block.current[i], block.commanded[i]
    deviation = speed_deviation(cov, robot.forces[0, i], robot.forces[1, i])
    if _is_dead_reckoning(robot, included, i):
        deviation *= _DRIFTS
    load = traction.load
    # where a loop oscillates from block to block, the creep is that of a force between both; its times are
    # uncertain, and a floor whose grip ends within the oscillation gives a mean that no law of the mean has
    deviation = math.hypot(deviation, 0.5 * traction.swing[i] / (CREEP_SLOPE * load))
    deviation = math.hypot(deviation, _UNSURE * math.sqrt(traction.oscillation[i]))
    if robot.floor.stated:
        load = effective_load(robot.floor, i, load / robot.load)
        deviation = math.hypot(deviation, _creep_doubt(robot, included, traction.creep, i))
    ratio, slip = roller_ratio(robot, i), wheel_slip(robot, block, x, i)
    contact = ContactSlip(
        load / ratio, force, slip / ratio, deviation / ratio, monitors.rolling[i], traction.held[i]
    )
    judged = traction.moving and not traction.unknown[i]
    update_slip_monitor(robot.floor, block.duration, contact, yaw_rate, judged, monitors, i)

    residual, usual = slip_residual(robot, block, traction.creep, x, i), abs(traction.creep[i, 0])
    ahead = residual if force >= 0.0 else -residual
    idle = abs(force) <= LOADED
    odd = ahead < -NO_SLIP - usual or (idle and abs(residual) > NO_SLIP)
    turns = abs(speed) > _ROLLS  # or else its motor would not be judged, which may be degraded instead
    _count(monitors.implausible, i, odd or (turns and abs(monitors.opposed[i]) > _OPPOSES))

    floor = robot.forces[0, i] * x[0] + robot.forces[1, i] * x[1] + robot.forces[2, i] * yaw_rate
    pushed, margin = math.copysign(1.0, current), _SIGMAS * deviation
    stands = abs(speed) < _STANDS and abs(current) > _PUSHED
    weight = _standing_weight(parameters, abs(floor) * block.duration, i)
    _count(monitors.stuck, i, stands and pushed * floor > _PASSES + margin, weight)
    # what its motor would make of it, if it could turn: the floor's speed, and creep under this force; on a
    # stated floor bristles hold a wheel at rest
    creep = 0.0 if robot.floor.stated else traction.creep[i, 0]
    _count(monitors.stalled, i, stands and pushed * (floor + creep) > _WOULD + margin, weight)
    _count(monitors.turning, i, abs(speed) > _TURNING)

    silent = abs(current) < _SILENT
    lacks = abs(current - commanded) > _OBEYED or (silent and abs(commanded) > _COMMANDED)
    _count(monitors.silent, i, lacks and silent)
    _count(monitors.disobeying, i, lacks and not silent)
