"""What each wheel has been up to: slip, rolling under load, standing, disobeying.

Slip counts by its way: the creep beyond what a healthy wheel may show, summed while it lasts, so that a large
slip is seen at once and a small one soon, and a spike of noise never. Health after it counts by likelihood:
how much less the wheel slips than it would under this traction with the grip that it had lost.
"""

from __future__ import annotations

import math

from omnimj.control.detection.robust.slip import (
    CREEP_SLOPE,
    SOFT_FLOOR,
    STIFF_FLOOR,
    healthy_creep_bounds,
    next_creep,
    slip_residual,
    speed_deviation,
    wheel_slip,
)
from omnimj.control.robot_constants import TIME
from omnimj.physics.native import kernel

(
    SLIPPING,
    HEALTH,
    AGAINST,
    STUCK,
    STILL,
    TURNS,
    SILENT,
    RUNAWAY,
    OPPOSED,
    SHORT,
    GRIP,
) = range(11)
"""Numbers of a wheel: way slipped beyond what is allowed [m]; likelihood that its grip is back [nats]; blocks
in a row of a speed that no slip explains, of standing while the floor passes, of standing under a motor that
should turn the wheel, of turning, of a motor without the current that was asked for, of one with another
current; how far it is ahead of a velocity against its force, or behind it with its force (below 0) [m/s]; the
last creep beyond health [m/s], the grip that it told of [1]; then the bristles of `healthy_creep_bounds`,
those of a
soft and a stiff floor, and of a floor with that grip [m]."""
BRISTLES, GIVEN, HELD, LOST, MONITORS = 11, 15, 16, 17, 18
INITIAL_MONITORS = (0.0,) * GRIP + (1.0,) + (0.0,) * (MONITORS - GRIP - 1)
"""Before the first block."""

ALLOWED, ALLOWED_TURNING = 0.02, 0.015
"""Creep beyond health that the velocity's error may make [m/s]; more per rad/s of yaw rate, since rows of
rollers take turns at two distances from the centre [m]."""
MOST = 0.002
"""Way that is counted at most: a slip that has ended is soon forgotten [m]."""
LOADED = 1.5
"""Traction from which a wheel is under load [N]."""
AGREES = -0.75
"""Traction along the slip from which it may be one: a wheel is never slower than its force for long [N]."""
NO_SLIP = 0.12
"""A wheel off by this against its load, or without any, does not slip: its speed is read wrongly [m/s]."""
_FADES = 0.9  # per block of what was slipped, once the wheel pulls the other way
_SPREADS = 4.0  # wheels 120 degrees apart have 2
_SIGMAS = 2.0  # of the body's velocity, given to the wheel
_DRIFTS = 3.0  # factor on it where only the accelerometer tells it: its errors are not white
_HOLDS = 0.08  # μ of a usual floor
_FORCE, _LITTLE = 0.7, 0.3  # [N] by which F̂ may be off, and what is added of it to a lost grip
_LEAST_GRIP, _NEWEST = 0.02, 0.1
_TOLD = 0.015  # [m/s] of slip that the lost grip would make at this load: less is no sign of health
_SPREAD, _COLOUR = 0.02, 6.0  # [m/s] of a slip, and blocks in which its error stays alike
_AT_ONCE = 0.6  # [nats] of one block
_ROLLS, _LIES = 2.5, 0.08  # [rad/s], [m/s]
_STANDS, _PASSES, _PUSHED = 0.4, 0.05, 0.4  # [rad/s] of a locked wheel, [m/s] of the floor below it, [A]
_WOULD, _TURNING = 0.08, 1.5  # [m/s] that a motor would make of its wheel, [rad/s] of one that is not locked
_OBEYED, _ASKED, _SILENT = 0.25, 0.15, 0.03  # [A]


@kernel
def roller_ratio(forces, i):
    """1/sin γ of wheel i: floor's force over motor's, wheel's slip over the contact's; 1 of an omni wheel."""
    return math.hypot(forces[0, i], forces[1, i])


@kernel
def expected_creep(c, forces, load, force, counters, creep):
    """Fills what each wheel creeps under its traction and how doubtful that is, shape (n, 2) [m/s].

    Args:
      c: `robot_constants.robot_constants`.
      forces: B, shape (3, n).
      load: F_N of a wheel [N].
      force: F̂, shape (n,) [N].
      counters: GIVEN and HELD are brought up to date, shape (n, COUNTERS).
      creep: Output.
    """
    for i in range(force.size):
        row, wide = counters[i], roller_ratio(forces, i)
        share = force[i] * wide / load
        soft, row[GIVEN] = next_creep(share, row[GIVEN], SOFT_FLOOR[0], SOFT_FLOOR[1], c[TIME])
        stiff, row[HELD] = next_creep(share, row[HELD], STIFF_FLOOR[0], STIFF_FLOOR[1], c[TIME])
        creep[i, 0], creep[i, 1] = 0.5 * wide * (soft + stiff), 0.5 * wide * abs(soft - stiff)


@kernel
def _count_consecutive(row, counter, so):
    row[counter] = row[counter] + 1.0 if so else 0.0


@kernel
def update_slip_monitor(c, load, force, slip, doubt, turning, moving, row):
    """SLIPPING, HEALTH, SHORT, GRIP and the bristles of one wheel, in place.

    Args:
      c: `robot_constants.robot_constants`.
      load: F_N [N].
      force: F̂ [N].
      slip: s [m/s].
      doubt: Standard deviation of s [m/s].
      turning: Yaw rate [rad/s].
      moving: Whether any wheel turns: a robot at rest only thinks that it moves.
      row: Its numbers, shape (COUNTERS,).
    """
    least, most = healthy_creep_bounds(force / load, row[BRISTLES : BRISTLES + 4], c[TIME])
    beyond = max(slip - most, least - slip)
    pull = force if slip - most > least - slip else -force
    short = beyond - _SIGMAS * doubt
    allowed = ALLOWED + ALLOWED_TURNING * abs(turning)
    if moving and pull > AGREES:
        row[SLIPPING] = min(max(row[SLIPPING] + c[TIME] * (short - allowed), 0.0), MOST)
    else:
        row[SLIPPING] *= _FADES
    row[SHORT], row[OPPOSED] = short, 0.0
    if moving and short > allowed and pull < AGREES:
        row[OPPOSED] = short if slip > most else -short
    if short > allowed and row[SLIPPING] > 0.0:
        row[HEALTH] = 0.0
        grip = (abs(force) + _LITTLE) / (load * (_HOLDS + CREEP_SLOPE * abs(slip)))
        grip = min(max(grip, _LEAST_GRIP), 1.0)
        row[GRIP] = grip if row[GRIP] == 1.0 else (1.0 - _NEWEST) * row[GRIP] + _NEWEST * grip
    share = math.copysign(max(abs(force) - _FORCE, 0.0), force) / (load * row[GRIP])
    lost, row[LOST] = next_creep(share, row[LOST], SOFT_FLOOR[0], SOFT_FLOOR[1], c[TIME])
    would, shows = (lost - most, slip - most) if force > 0.0 else (least - lost, least - slip)
    if would > _TOLD:
        likely = would * (0.5 * would - max(shows, 0.0)) / (_COLOUR * (_SPREAD * _SPREAD + doubt * doubt))
        row[HEALTH] = max(row[HEALTH] + min(likely, _AT_ONCE), 0.0)


@kernel
def _is_alone(forces, believed, i):
    """Whether the other wheels that are believed tell little of the velocity along wheel i: dead reckoning.

    Little is a variance dᵀ(Σ d_j d_jᵀ)⁻¹d beyond `_SPREADS` times that of one wheel that drives along d.
    """
    xx = xy = yy = 0.0
    for j in range(believed.size):
        if j != i and believed[j] != 0.0:
            xx, xy, yy = (
                xx + forces[0, j] * forces[0, j],
                xy + forces[0, j] * forces[1, j],
                yy + forces[1, j] * forces[1, j],
            )
    if xx + yy == 0.0:
        return True
    x, y = forces[0, i], forces[1, i]
    return yy * x * x - 2.0 * xy * x * y + xx * y * y > _SPREADS * (xx * yy - xy * xy)


@kernel
def update_wheel_monitors(
    c, forces, speed, current, wanted, turning, load, force, creep, believed, x, cov, moving, row, i
):
    """All numbers of wheel i, in place.

    Args:
      c: `robot_constants.robot_constants`.
      forces: B, shape (3, n).
      speed: Shape (n,) [rad/s].
      current: Shape (n,) [A].
      wanted: What the amplifiers should give, shape (n,) [A].
      turning: Yaw rate [rad/s].
      load: F_N of a wheel [N].
      force: F̂, shape (n,) [N].
      creep: Of `expected_creep`.
      believed: 1 for wheels that have a say about the velocity, shape (n,).
      x: State of the velocity filter without this wheel.
      cov: Its covariance.
      moving: Whether any wheel turns.
      row: The wheel's numbers, shape (COUNTERS,).
      i: The wheel.
    """
    doubt = speed_deviation(cov, forces[0, i], forces[1, i])
    if _is_alone(forces, believed, i):
        doubt *= _DRIFTS
    wide, slip = roller_ratio(forces, i), wheel_slip(c, forces, speed, turning, x, i)
    update_slip_monitor(c, load / wide, force[i], slip / wide, doubt / wide, turning, moving, row)
    away, usual = slip_residual(c, forces, speed, turning, creep, x, i), abs(creep[i, 0])
    ahead = away if force[i] >= 0.0 else -away
    idle = abs(force[i]) <= LOADED
    odd = ahead < -NO_SLIP - usual or (idle and abs(away) > NO_SLIP)
    turns = abs(speed[i]) > _ROLLS  # or else its motor would not be judged, which may be weak instead
    _count_consecutive(row, AGAINST, odd or (turns and abs(row[OPPOSED]) > _LIES))
    below = forces[0, i] * x[0] + forces[1, i] * x[1] + forces[2, i] * turning
    pushed, doubt = math.copysign(1.0, current[i]), _SIGMAS * doubt
    stands = abs(speed[i]) < _STANDS and abs(current[i]) > _PUSHED
    _count_consecutive(row, STUCK, stands and pushed * below > _PASSES + doubt)
    # what its motor would make of it, if it could turn: the floor's speed, and creep under this force
    _count_consecutive(row, STILL, stands and pushed * (below + creep[i, 0]) > _WOULD + doubt)
    _count_consecutive(row, TURNS, abs(speed[i]) > _TURNING)
    silent = abs(current[i]) < _SILENT
    lacks = abs(current[i] - wanted[i]) > _OBEYED or (silent and abs(wanted[i]) > _ASKED)
    _count_consecutive(row, SILENT, lacks and silent)
    _count_consecutive(row, RUNAWAY, lacks and not silent)
