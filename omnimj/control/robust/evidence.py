"""One block of evidence: everything that the decisions look at, brought up to date.

`Evidence` is the memory of the method; `update` changes the arrays of a copy in place.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, fields

import numpy as np

from omnimj.control.heading import wrapped
from omnimj.control.robust.constants import DRY, TORQUE
from omnimj.control.robust.force_balance import balance, whiten
from omnimj.control.robust.slip import (
    SLICK,
    SLOPE,
    SOFT,
    STATE,
    away_from_rolling,
    correct,
    creep,
    next_bristle,
    predict,
    slid,
    spread_of,
    weakest_pull,
)
from omnimj.control.robust.slow import learn, prior
from omnimj.control.robust.windows import LIKELIHOOD, LONGEST, SCORE, scores
from omnimj.physics.native import kernel
from omnimj.signals import Array

RECENT = 10
"""Blocks of a tenth of a second: how long a wheel that was slow is still called slow."""
FILLED, HEAD, ROW = range(3)
"""Cursor: blocks in the ring, its newest row, row of `recent`."""
MOVES = 1.0
"""A robot whose wheels all turn slower tells nothing about its motors [rad/s]."""
CALM = 12.0
"""Λ up to which blocks are learnt from: no fault is half believed [nats]."""

SLIPPING, ROLLING, AGAINST, STUCK, SILENT, RUNAWAY, SLID, GRIP, SOFTLY, SLICKLY = range(10)
"""Counters per wheel: sum of slip beyond what is allowed [m], blocks in a row of rolling under a load at which it
slipped before, of a speed that no slip explains, of standing while the floor passes, of a motor without the
current that was asked for, of one with another current than asked for; the last shortfall [m/s], the grip that it
told of [1], and the bristles of the two weakest floors [m]."""
COUNTERS = 10

ALLOWED, ALLOWED_TURNING = 0.035, 0.02
"""Shortfall that a healthy wheel may show [m/s], and per rad/s of yaw rate: its rows of rollers take turns at two
distances from the centre [m]."""
WEAKEST, STRONGEST, CAUTION = 0.6, 1.5, 0.8
"""κ of a floor before anything is known, the most that is believed, and how much of what was learnt is used."""
_SEEN = 0.03  # [m/s] of slip that says something about κ
_FORGETS = 2e-4  # per block that says something
COMPARED = 1.0
"""Time over which converter, wheels and gyro are compared [s]."""
LOADED = 1.5
"""Traction from which a wheel is under load: slip against it says something about grip [N]."""
NO_SLIP = 0.08
"""A wheel off by this against its load, or without any, does not slip: its speed is read wrongly [m/s]."""
_SIGMAS = 2.0  # of the body's velocity, given to the wheel
_TOLD = 0.04  # [m/s] of slip that the lost grip would make at this load: less is no sign of health
_STANDS, _PASSES, _PUSHED = 0.4, 0.12, 0.4  # [rad/s] of a locked wheel, [m/s] of the floor below it, [A]
_OBEYED, _ASKED = 0.25, 0.15  # [A]


@dataclass(frozen=True, slots=True)
class Evidence:
    """What is remembered from block to block, n wheels, p = 2n + 5."""

    ring: Array
    """Whitened blocks of the last second, shape (LONGEST, 3 (p+1))."""
    cursor: Array
    """FILLED, HEAD, ROW."""
    recent: Array
    """|φ̇_i| and |speed along axle i| of the last blocks, shape (RECENT, 2n)."""
    theta: Array
    """Mean of θ as learnt, shape (p,)."""
    cov: Array
    """Its covariance, shape (p, p)."""
    velocity: Array
    """Filters without wheel 1 … n, and with all: shape (n+1, STATE)."""
    spread: Array
    """Their covariances, shape (n+1, STATE, STATE)."""
    counters: Array
    """Shape (n, COUNTERS)."""
    found: Array
    """Scores of `windows.scores`, shape (2n+2, SCORE)."""
    force: Array
    """F̂ of the last block, shape (n,) [N]."""
    rho: Array
    """ρ of the last block, shape (3,)."""
    floor: Array
    """Sums of F̂ f and f² for κ, f = F_N (σ_0 z + σ s): the floor as each wheel finds it, shape (n, 2)."""
    heading: Array
    """Heading at the end of the block before [rad], and how far converter and wheels have turned beyond the gyro
    in about a second [rad]; NaN before the first block, shape (3,)."""
    misfit: Array
    """Size of the noise per window, in units of what is expected."""

    def copy(self) -> Evidence:
        """A copy whose arrays may be changed."""
        return Evidence(*(getattr(self, f.name).copy() for f in fields(self)))


def no_evidence(wheels: int) -> Evidence:
    """Before the first block: a healthy robot at rest."""
    p = 2 * wheels + 5
    start = np.diag([1e-6, 1e-6, 4e-4, 4e-4])
    return Evidence(
        ring=np.zeros((LONGEST, 3 * (p + 1))),
        cursor=np.array([0, -1, 0]),
        recent=np.zeros((RECENT, 2 * wheels)),
        theta=np.zeros(p),
        cov=np.diag(prior(wheels) ** 2),
        velocity=np.zeros((wheels + 1, STATE)),
        spread=np.tile(start, (wheels + 1, 1, 1)),
        counters=np.tile([0.0] * 7 + [1.0, 0.0, 0.0], (wheels, 1)),
        found=np.zeros((2 * wheels + 2, SCORE)),
        force=np.zeros(wheels),
        rho=np.zeros(3),
        floor=np.tile([WEAKEST / CAUTION * 100.0, 100.0], (wheels, 1)),
        heading=np.array([np.nan, 0.0, 0.0]),
        misfit=np.zeros(5),
    )


@kernel
def compare_turning(heading, turn, period, yaw, speed, turning):
    """One block into the comparison of converter, wheels and gyro, in place.

    Args:
      heading: Of `Evidence`.
      turn: Yaw rate per wheel speed, shape (n,).
      period: Of a block [s].
      yaw: Heading at the block's end [rad].
      speed: Shape (n,) [rad/s].
      turning: Gyro's mean [rad/s].
    """
    keep = 1.0 - period / COMPARED
    by_wheels = 0.0
    for i in range(speed.size):
        by_wheels += turn[i] * speed[i]
    if heading[0] == heading[0]:
        heading[1] = keep * heading[1] + wrapped(yaw - heading[0]) - period * turning
        heading[2] = keep * heading[2] + period * (by_wheels - turning)
    heading[0] = yaw


@kernel
def _in_ring(ring, cursor, theta, cov, walk, x, rho, learning):
    """The block into the ring; the one that it pushes out is learnt from."""
    p = theta.size
    if cursor[0] == ring.shape[0] and learning:
        old = ring[(cursor[1] + 1) % ring.shape[0]]
        learn(theta, cov, walk, old[: 3 * p].copy().reshape(3, p), old[3 * p :])
    cursor[1] = (cursor[1] + 1) % ring.shape[0]
    cursor[0] = min(cursor[0] + 1, ring.shape[0])
    ring[cursor[1], : 3 * p] = x.copy().reshape(3 * p)
    ring[cursor[1], 3 * p :] = rho


@kernel
def floor_scale(floor, i):
    """κ as far as it may be believed of wheel i: what the others found."""
    above = below = 0.0
    for j in range(floor.shape[0]):
        if j != i:
            above, below = above + floor[j, 0], below + floor[j, 1]
    return min(CAUTION * above / below, STRONGEST)


@kernel
def _feel_floor(c, forces, speed, turning, force, velocity, believed, counters, floor):
    """κ from all wheels that slip a little and are believed."""
    for i in range(speed.size):
        slip = slid(c, forces, speed, turning, velocity[i], i)
        if believed[i] == 0.0 or abs(slip) < _SEEN or force[i] * slip <= 0.0 or counters[i, 0] > 0.0:
            continue
        toward = 1.0 if slip >= 0.0 else -1.0
        f = max(c[4] * weakest_pull(slip, toward, counters[i, 8], counters[i, 9]), 0.0)
        floor[i, 0] = (1.0 - _FORGETS) * floor[i, 0] + abs(force[i]) * f
        floor[i, 1] = (1.0 - _FORGETS) * floor[i, 1] + f * f


@kernel
def _count(c, forces, speed, current, wanted, turning, force, velocity, spread, scale, counters, i):
    """Counters of wheel i."""
    row = counters[i]
    away = away_from_rolling(c, forces, speed, turning, force, velocity[i], i)
    slip = slid(c, forces, speed, turning, velocity[i], i)
    row[8] = next_bristle(row[8], slip, SOFT[0], SOFT[1], c[11])
    row[9] = next_bristle(row[9], slip, SLICK[0], SLICK[1], c[11])
    toward = force[i] if abs(force[i]) > LOADED else slip
    toward = 1.0 if toward >= 0.0 else -1.0
    pull, full = toward * force[i], c[4] * weakest_pull(slip, toward, row[8], row[9])
    short = ((scale * full if full > 0.0 else full) - pull) / (c[4] * SLOPE)
    doubt = _SIGMAS * spread_of(spread[i], forces[0, i], forces[1, i])
    short -= doubt
    row[6] = short
    allowed = ALLOWED + ALLOWED_TURNING * abs(turning)
    loaded = abs(force[i]) > LOADED
    row[0] = max(row[0] + c[11] * (short - allowed), 0.0) if pull > -0.5 * LOADED else row[0] * 0.98
    if short > allowed and row[0] > 0.0:
        grip = min(max(pull / (scale * full), 0.02), 1.0)
        row[7] = grip if row[7] == 1.0 else 0.8 * row[7] + 0.2 * grip
    # what the lost grip would have made of this pull
    would = abs(force[i]) / (c[4] * SLOPE) * (1.0 / row[7] - 1.0)
    if would > _TOLD:
        row[1] = row[1] + 1.0 if short < 0.3 * would else 0.0
    usual = abs(creep(c, force[i]))
    ahead = away if force[i] >= 0.0 else -away
    odd = ahead < -NO_SLIP - usual or (not loaded and abs(away) > NO_SLIP)
    row[2] = row[2] + 1.0 if odd else 0.0
    below = forces[0, i] * velocity[i, 0] + forces[1, i] * velocity[i, 1] + forces[2, i] * turning
    held = abs(speed[i]) < _STANDS and abs(below) > _PASSES + doubt
    row[3] = row[3] + 1.0 if held and abs(current[i]) > _PUSHED else 0.0
    lacks = abs(current[i] - wanted[i]) > _OBEYED or (
        abs(wanted[i]) > _ASKED and abs(current[i]) < 0.2 * _ASKED
    )
    silent = abs(current[i]) < 0.2 * _ASKED
    row[4] = row[4] + 1.0 if lacks and silent else 0.0
    row[5] = row[5] + 1.0 if lacks and not silent else 0.0


@kernel
def update(
    c, forces, across, walk, low, high,
    current, speed, acceleration, turning, rate, spin, wanted, believed, unknown, accepted, fresh,
    ring, cursor, recent, theta, cov, velocity, spread, counters, found, force, rho, floor, misfit,
):  # fmt: skip
    """One block into the evidence, in place.

    Args:
      c: `constants.numbers`.
      forces: B, shape (3, n).
      across: Shape (n, 3).
      walk: Variance that θ gains per block, shape (p,).
      low: Least size of a jump per hypothesis, shape (2n+2,).
      high: Largest.
      current: Means of the block, shape (n,) [A].
      speed: Shape (n,) [rad/s].
      acceleration: Shape (2,) [m/s²].
      turning: Yaw rate less its bias [rad/s].
      rate: φ̈, shape (n,) [rad/s²].
      spin: Yaw acceleration [rad/s²].
      wanted: What the amplifiers should give, shape (n,) [A].
      believed: 1 for wheels that have a say about the velocity, shape (n,).
      unknown: 1 for wheels whose force nobody knows (locked), shape (n,).
      accepted: Losses that were diagnosed, shape (n,): θ holds what comes on top.
      fresh: Whether blocks are learnt from at once: just after a loss was accepted.
      ring: And all behind it: of `Evidence`.

    Returns:
      Whether the robot moves enough to be judged.
    """
    n, p = speed.size, theta.size
    x, raw, side, slowest, sideways = np.zeros((3, p)), np.empty(3), np.empty(n), np.empty(n), np.empty(n)
    balance(
        c, forces, across, current, speed, rate, acceleration, turning, spin, accepted, x, raw, force, side
    )
    rho[:] = raw
    for i in range(n):  # what was learnt of the motors is not in F̂ yet
        force[i] -= theta[i] * c[TORQUE] * current[i] + theta[n + i] * c[DRY] * math.tanh(speed[i] / 0.3)
    row = cursor[2]
    recent[row, :n], recent[row, n:] = np.abs(speed), np.abs(side)
    cursor[2] = (row + 1) % recent.shape[0]
    for i in range(n):
        slowest[i], sideways[i] = recent[:, i].min(), recent[:, n + i].min()
    moving = np.abs(speed).max() > MOVES
    if moving:
        whiten(c, forces, across, slowest, sideways, unknown, x, raw)
        if fresh:
            learn(theta, cov, walk, x, raw)
        _in_ring(ring, cursor, theta, cov, walk, x, raw, not fresh and found[:, LIKELIHOOD].max() < CALM)
        precision = np.linalg.inv(cov)
        misfit[:] = scores(ring, cursor[0], cursor[1], theta, precision, low, high, found)
    for q in range(n + 1):
        predict(c, velocity[q], spread[q], acceleration, turning)
    for i in range(n):
        scale = floor_scale(floor, i)
        _count(c, forces, speed, current, wanted, turning, force, velocity, spread, scale, counters, i)
    _feel_floor(c, forces, speed, turning, force, velocity, believed, counters, floor)
    for q in range(n + 1):
        correct(c, forces, speed, turning, force, believed, q if q < n else -1, velocity[q], spread[q])
    if np.abs(speed).max() < 0.1 * MOVES and abs(turning) < 0.02:
        velocity[:, :2] *= 0.9  # a robot at rest has no speed that wheels would have to correct
    return moving
