"""One block of evidence: everything that the decisions look at, brought up to date.

`Evidence` is the memory of the method; `update_evidence` changes the arrays of a copy in place.
"""

from __future__ import annotations

from dataclasses import dataclass, fields

import numpy as np

from omnimj.control.cascade.heading import wrapped
from omnimj.control.detection.robust.force_balance import balance, columns, lasting, wheel_force, whiten
from omnimj.control.detection.robust.glr import LIKELIHOOD, LONGEST_WINDOW, SCORE, likelihood_ratios
from omnimj.control.detection.robust.parameter_filter import prior_deviation, update_parameters
from omnimj.control.detection.robust.slip import STATE, correct_velocity, predict_velocity
from omnimj.control.detection.robust.wheel_monitors import (
    INITIAL_MONITORS,
    OPPOSED,
    expected_creep,
    update_wheel_monitors,
)
from omnimj.control.robot_constants import LOAD
from omnimj.physics.native import kernel
from omnimj.signals import Array

RECENT = 10
"""Blocks of a tenth of a second: how long a wheel that was slow is still called slow."""
FILLED, HEAD, ROW = range(3)
"""Cursor: blocks in the ring, its newest row, row of `recent`."""
MOVING_SPEED = 1.0
"""A robot whose wheels all turn slower tells nothing about its motors [rad/s]."""
QUIET_LIKELIHOOD = 12.0
"""Λ up to which blocks are learnt from: no fault is half believed [nats]."""
LIGHTEST, HEAVIEST = 0.75, 1.3
"""Of the robot's mass, as far as it is believed."""
SLOPE_STEP = 0.05
"""Standard deviation that the accelerometer's bias gains per block where a slope begins or ends [m/s²]."""
COMPARISON_TIME = 1.0
"""Time over which converter, wheels and gyro are compared [s]."""


@dataclass(frozen=True, slots=True)
class Evidence:
    """What is remembered from block to block, n wheels, p numbers θ."""

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
    """Of `counters`, shape (n, COUNTERS)."""
    found: Array
    """Scores of `glr.likelihood_ratios`, shape (2n+2, SCORE)."""
    force: Array
    """F̂ of the last block, shape (n,) [N]."""
    rho: Array
    """ρ of the last block, shape (3,)."""
    heading: Array
    """Heading at the end of the block before, NaN before the first, and how far converter and wheels have
    turned beyond the gyro in about a second, shape (3,) [rad]."""
    misfit: Array
    """Size of the noise per window, in units of what is expected."""

    def copy(self) -> Evidence:
        """A copy whose arrays may be changed."""
        return Evidence(*[getattr(self, name).copy() for name in _NAMES])


_NAMES = tuple(one.name for one in fields(Evidence))


def initial_evidence(wheels: int) -> Evidence:
    """Before the first block: a healthy robot at rest."""
    p = columns(wheels)
    start = np.diag([1e-6, 1e-6, 4e-4, 4e-4])
    return Evidence(
        ring=np.zeros((LONGEST_WINDOW, 3 * (p + 1))),
        cursor=np.array([0, -1, 0]),
        recent=np.zeros((RECENT, 2 * wheels)),
        theta=np.zeros(p),
        cov=np.diag(prior_deviation(wheels) ** 2),
        velocity=np.zeros((wheels + 1, STATE)),
        spread=np.tile(start, (wheels + 1, 1, 1)),
        counters=np.tile(INITIAL_MONITORS, (wheels, 1)),
        found=np.zeros((2 * wheels + 2, SCORE)),
        force=np.zeros(wheels),
        rho=np.zeros(3),
        heading=np.array([np.nan, 0.0, 0.0]),
        misfit=np.zeros(5),
    )


@kernel
def compare_yaw_rates(heading, turn, period, yaw, speed, turning):
    """One block into the comparison of converter, wheels and gyro, in place.

    Args:
      heading: Of `Evidence`.
      turn: Yaw rate per wheel speed, shape (n,).
      period: Of a block [s].
      yaw: Heading at the block's end [rad].
      speed: Shape (n,) [rad/s].
      turning: Gyro's mean [rad/s].
    """
    keep = 1.0 - period / COMPARISON_TIME
    by_wheels = 0.0
    for i in range(speed.size):
        by_wheels += turn[i] * speed[i]
    if heading[0] == heading[0]:
        heading[1] = keep * heading[1] + wrapped(yaw - heading[0]) - period * turning
        heading[2] = keep * heading[2] + period * (by_wheels - turning)
    heading[0] = yaw


@kernel
def _push_block(ring, cursor, theta, cov, walk, lasts, x, rho, learning):
    """The block into the ring; the one that it pushes out is learnt from."""
    p = theta.size
    if cursor[FILLED] == ring.shape[0] and learning:
        old = ring[(cursor[HEAD] + 1) % ring.shape[0]]
        update_parameters(theta, cov, walk, lasts, old[: 3 * p].copy().reshape(3, p), old[3 * p :])
    cursor[HEAD] = (cursor[HEAD] + 1) % ring.shape[0]
    cursor[FILLED] = min(cursor[FILLED] + 1, ring.shape[0])
    ring[cursor[HEAD], : 3 * p] = x.copy().reshape(3 * p)
    ring[cursor[HEAD], 3 * p :] = rho


@kernel
def _is_quiet(found, weak):
    """Whether no fault is half believed in; that a weak motor is a little weaker is learnt, not doubted."""
    n = weak.size
    for h in range(found.shape[0]):
        known = h < 2 * n and weak[h % n] != 0.0
        if not known and found[h, LIKELIHOOD] >= QUIET_LIKELIHOOD:
            return False
    return True


@kernel
def _recent_minima(recent, cursor, speed, side):
    """The block into `recent`; least |φ̇| and speed along the axle of the last blocks, shape (n,) each."""
    n, row = speed.size, cursor[ROW]
    recent[row, :n], recent[row, n:] = np.abs(speed), np.abs(side)
    cursor[ROW] = (row + 1) % recent.shape[0]
    slowest, sideways = np.empty(n), np.empty(n)
    for i in range(n):
        slowest[i], sideways[i] = recent[:, i].min(), recent[:, n + i].min()
    return slowest, sideways


@kernel
def _release_bias_on_slope(forces, believed, counters, spread):
    """Lets the accelerometer's bias go along an axis where every wheel contradicts the velocity, in place.

    Uphill the accelerometer reads gravity as motion, so that all wheels seem to be too slow while they push:
    no slip does that. Oil is the other way round, wheels run away in the direction of their force.
    """
    for k in range(2):
        wheels, opposed = 0, 0.0
        for i in range(believed.size):
            if believed[i] != 0.0 and abs(forces[k, i]) > 0.5:
                wheels += 1
                opposed += np.sign(counters[i, OPPOSED] * forces[k, i])
        if wheels >= 2 and abs(opposed) == wheels:
            for q in range(spread.shape[0]):
                spread[q, 2 + k, 2 + k] += SLOPE_STEP * SLOPE_STEP


@kernel
def _update_force_channel(
    c, forces, across, walk, loose, low, high, current, speed, acceleration, turning, rate, spin,
    unknown, deaf, weak, accepted, fresh, ring, cursor, recent, theta, cov, found, force, rho, misfit,
):  # fmt: skip
    """The force channel's part of `update_evidence`; whether the robot moves enough to be judged."""
    n = speed.size
    x, raw, side = np.zeros((3, theta.size)), np.empty(3), np.empty(n)
    balance(
        c, forces, across, current, speed, rate, acceleration, turning, spin, accepted, x, raw, force, side
    )
    rho[:] = raw
    for i in range(n):  # with what was learnt of the motors
        force[i], _ = wheel_force(c, current[i], speed[i], rate[i], accepted[i] + theta[i], theta[n + i])
    slowest, sideways = _recent_minima(recent, cursor, speed, side)
    moving = np.abs(speed).max() > MOVING_SPEED
    if moving:
        whiten(c, forces, across, current, slowest, sideways, unknown, deaf, weak, x, raw)
        if fresh:
            update_parameters(theta, cov, walk, lasting(n), x, raw)
        learning = not fresh and _is_quiet(found, weak)
        _push_block(ring, cursor, theta, cov, walk, lasting(n), x, raw, learning)
        known = np.linalg.inv(cov + np.diag(loose))
        misfit[:] = likelihood_ratios(ring, cursor[FILLED], cursor[HEAD], theta, known, low, high, found)
    return moving


@kernel
def _update_slip_channel(
    c, forces, load, current, speed, acceleration, turning, wanted, believed, deaf, moving,
    velocity, spread, counters, force,
):  # fmt: skip
    """The slip channel's part of `update_evidence`."""
    n = speed.size
    for q in range(n + 1):
        predict_velocity(c, velocity[q], spread[q], acceleration, deaf, turning)
    creep = np.empty((n, 2))
    expected_creep(c, forces, load, force, counters, creep)
    for i in range(n):
        update_wheel_monitors(
            c, forces, speed, current, wanted, turning, load, force, creep, believed,
            velocity[i], spread[i], moving, counters[i], i,
        )  # fmt: skip
    _release_bias_on_slope(forces, believed, counters, spread)
    for q in range(n + 1):
        correct_velocity(
            c, forces, speed, turning, creep, believed, q if q < n else -1, velocity[q], spread[q]
        )
    if np.abs(speed).max() < 0.1 * MOVING_SPEED and abs(turning) < 0.02:
        velocity[:, :2] *= 0.9  # a robot at rest has no speed that wheels would have to correct


@kernel
def update_evidence(
    c, forces, across, walk, loose, low, high,
    current, speed, acceleration, turning, rate, spin, wanted, believed, unknown, deaf, weak, accepted, fresh,
    ring, cursor, recent, theta, cov, velocity, spread, counters, found, force, rho, misfit,
):  # fmt: skip
    """One block into the evidence, in place.

    Args:
      c: `robot_constants.robot_constants`.
      forces: B, shape (3, n).
      across: Shape (n, 3).
      walk: Variance that θ gains per block, shape (p,).
      loose: Variance of what θ differs by from window to window, shape (p,).
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
      deaf: 1 for axes along which the accelerometer lies, shape (2,).
      weak: 1 for wheels whose motor is known to be broken, shape (n,).
      accepted: Losses that were diagnosed, shape (n,): θ holds what comes on top.
      fresh: Whether blocks are learnt from at once: just after a loss was accepted.
      ring: And all behind it: of `Evidence`.

    Returns:
      Whether the robot moves enough to be judged.
    """
    moving = _update_force_channel(
        c, forces, across, walk, loose, low, high, current, speed, acceleration, turning, rate, spin,
        unknown, deaf, weak, accepted, fresh, ring, cursor, recent, theta, cov, found, force, rho, misfit,
    )  # fmt: skip
    load = c[LOAD] * min(max(1.0 + theta[2 * speed.size + 3], LIGHTEST), HEAVIEST)  # with what it carries
    _update_slip_channel(
        c, forces, load, current, speed, acceleration, turning, wanted, believed, deaf, moving,
        velocity, spread, counters, force,
    )  # fmt: skip
    return moving
