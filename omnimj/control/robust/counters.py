"""What each wheel has been up to: slip, rolling under load, standing, disobeying; and what the floor is like.

Slip counts by its way: the shortfall of speed beyond what a healthy wheel may show, summed while it lasts, so
that a large slip is seen at once and a small one soon, and a spike of noise never.
"""

from __future__ import annotations

import math

from omnimj.control.robust.constants import LOAD, TIME
from omnimj.control.robust.slip import (
    SLICK,
    SLOPE,
    SOFT,
    away_from_rolling,
    creep,
    next_bristle,
    slid,
    spread_of,
    weakest_pull,
)
from omnimj.physics.native import kernel

SLIPPING, ROLLING, AGAINST, STUCK, SILENT, RUNAWAY, SHORT, GRIP, SOFTLY, SLICKLY, STILL, TURNING = range(12)
"""Numbers of a wheel: way slipped beyond what is allowed [m]; blocks in a row of rolling under a load at
which it slipped before, of a speed that no slip explains, of standing while the floor passes, of a motor
without the current that was asked for, of one with another current; the last shortfall [m/s], the grip that
it told of [1], the bristles of the two weakest floors [m], blocks in a row of standing under a motor that
should turn the wheel, and of turning."""
COUNTERS = 12
NO_COUNTS = (0.0,) * 7 + (1.0,) + (0.0,) * 4
"""Before the first block."""

ALLOWED, ALLOWED_TURNING, ALLOWED_IDLE = 0.03, 0.02, 0.03
"""Shortfall that a healthy wheel may show [m/s]; more per rad/s of yaw rate, since its rows of rollers take
turns at two distances from the centre [m]; and more without load, when it says little [m/s]."""
WEAKEST, STRONGEST, CAUTION = 0.6, 1.5, 0.8
"""κ before anything is known, the most that is believed, and how much of what was learnt is used."""
FIRST_WEIGHT = 100.0
"""Of the κ before anything is known [N²]."""
LOADED = 1.5
"""Traction from which a wheel is under load: slip against it says something about grip [N]."""
NO_SLIP = 0.12
"""A wheel off by this against its load, or without any, does not slip: its speed is read wrongly [m/s]."""
_SEEN = 0.03  # [m/s] of slip that says something about κ
_FORGETS = 2e-4  # per block that says something
_FADES = 0.98  # per block of what was slipped, once the wheel pulls the other way
_SIGMAS = 2.0  # of the body's velocity, given to the wheel
_TOLD = 0.04  # [m/s] of slip that the lost grip would make at this load: less is no sign of health
_HEALED = 0.3  # share of that slip below which the grip is back
_LEAST_GRIP, _NEWEST = 0.02, 0.2
_STANDS, _PASSES, _PUSHED = 0.4, 0.05, 0.4  # [rad/s] of a locked wheel, [m/s] of the floor below it, [A]
_WOULD, _TURNS = 0.08, 1.5  # [m/s] that a motor would make of its wheel, [rad/s] of one that is not locked
_OBEYED, _ASKED, _SILENT = 0.25, 0.15, 0.03  # [A]


@kernel
def floor_scale(floor, i):
    """κ as far as it may be believed of wheel i: what the others found.

    Args:
      floor: Sums of F̂ f and f² per wheel, f = F_N (σ_0 z + σ s), shape (n, 2).
      i: The wheel.
    """
    above = below = 0.0
    for j in range(floor.shape[0]):
        if j != i:
            above, below = above + floor[j, 0], below + floor[j, 1]
    return min(CAUTION * above / below, STRONGEST)


@kernel
def feel_floor(c, forces, speed, turning, force, velocity, believed, counters, floor):
    """κ from every wheel that slips a little and is believed; `floor` in place."""
    for i in range(speed.size):
        slip = slid(c, forces, speed, turning, velocity[i], i)
        suspect = believed[i] == 0.0 or counters[i, SLIPPING] > 0.0
        if suspect or abs(slip) < _SEEN or force[i] * slip <= 0.0:
            continue
        toward = 1.0 if slip >= 0.0 else -1.0
        f = max(c[LOAD] * weakest_pull(slip, toward, counters[i, SOFTLY], counters[i, SLICKLY]), 0.0)
        floor[i, 0] = (1.0 - _FORGETS) * floor[i, 0] + abs(force[i]) * f
        floor[i, 1] = (1.0 - _FORGETS) * floor[i, 1] + f * f


@kernel
def _more_if(row, counter, so):
    row[counter] = row[counter] + 1.0 if so else 0.0


@kernel
def count_slip(c, force, slip, doubt, turning, scale, moving, row):
    """SLIPPING, ROLLING, SHORT, GRIP and the bristles of one wheel, in place.

    Args:
      c: `constants.numbers`.
      force: F̂ [N].
      slip: s [m/s].
      doubt: Standard deviation of s [m/s].
      turning: Yaw rate [rad/s].
      scale: κ.
      moving: Whether any wheel turns: a robot at rest only thinks that it moves.
      row: Its numbers, shape (COUNTERS,).
    """
    row[SOFTLY] = next_bristle(row[SOFTLY], slip, SOFT[0], SOFT[1], c[TIME])
    row[SLICKLY] = next_bristle(row[SLICKLY], slip, SLICK[0], SLICK[1], c[TIME])
    toward = force if abs(force) > LOADED else slip
    toward = 1.0 if toward >= 0.0 else -1.0
    full = c[LOAD] * weakest_pull(slip, toward, row[SOFTLY], row[SLICKLY])
    full *= scale if full > 0.0 else 1.0
    pull = toward * force
    short = (full - pull) / (c[LOAD] * SLOPE) - _SIGMAS * doubt
    idle = 0.0 if abs(force) > LOADED else ALLOWED_IDLE
    allowed = ALLOWED + ALLOWED_TURNING * abs(turning) + idle
    if moving and pull > -0.5 * LOADED:
        row[SLIPPING] = max(row[SLIPPING] + c[TIME] * (short - allowed), 0.0)
    else:
        row[SLIPPING] *= _FADES
    row[SHORT] = short
    if short > allowed and row[SLIPPING] > 0.0:
        grip = min(max(pull / full, _LEAST_GRIP), 1.0)
        row[GRIP] = grip if row[GRIP] == 1.0 else (1.0 - _NEWEST) * row[GRIP] + _NEWEST * grip
    would = abs(force) / (c[LOAD] * SLOPE) * (1.0 / row[GRIP] - 1.0)
    if would > _TOLD:
        _more_if(row, ROLLING, short < _HEALED * would)


@kernel
def count_wheel(c, forces, speed, current, wanted, turning, force, x, cov, scale, moving, row, i):
    """All numbers of wheel i, in place.

    Args:
      c: `constants.numbers`.
      forces: B, shape (3, n).
      speed: Shape (n,) [rad/s].
      current: Shape (n,) [A].
      wanted: What the amplifiers should give, shape (n,) [A].
      turning: Yaw rate [rad/s].
      force: F̂, shape (n,) [N].
      x: State of the velocity filter without this wheel.
      cov: Its covariance.
      scale: κ.
      moving: Whether any wheel turns.
      row: The wheel's numbers, shape (COUNTERS,).
      i: The wheel.
    """
    doubt = spread_of(cov, forces[0, i], forces[1, i])
    count_slip(c, force[i], slid(c, forces, speed, turning, x, i), doubt, turning, scale, moving, row)
    away, usual = away_from_rolling(c, forces, speed, turning, force, x, i), abs(creep(c, force[i]))
    ahead = away if force[i] >= 0.0 else -away
    idle = abs(force[i]) <= LOADED
    _more_if(row, AGAINST, ahead < -NO_SLIP - usual or (idle and abs(away) > NO_SLIP))
    below = forces[0, i] * x[0] + forces[1, i] * x[1] + forces[2, i] * turning
    # what its motor would make of it, if it could turn: the floor's speed, and creep under this force
    would = (below + creep(c, force[i])) * math.copysign(1.0, current[i])
    stands, doubt = abs(speed[i]) < _STANDS, _SIGMAS * doubt
    still = stands and abs(current[i]) > _PUSHED and would > _WOULD + doubt
    _more_if(row, STUCK, still and below * math.copysign(1.0, current[i]) > _PASSES + doubt)
    _more_if(row, STILL, still)
    _more_if(row, TURNING, abs(speed[i]) > _TURNS)
    silent = abs(current[i]) < _SILENT
    lacks = abs(current[i] - wanted[i]) > _OBEYED or (silent and abs(wanted[i]) > _ASKED)
    _more_if(row, SILENT, lacks and silent)
    _more_if(row, RUNAWAY, lacks and not silent)
