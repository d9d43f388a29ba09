"""Memory of the force channel and the slip channel, and its update by one block.

In the kernels `robot` is `RobotConstants`, `parameters` `RobustParameters`, `block` `Block`, `accommodation`
`Accommodation`, and `evidence` `Evidence`, changed in place.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from omnimj.control.cascade.heading import wrapped, yaw_rate_by_wheels, yaw_rate_row
from omnimj.control.detection.robust.blocks import LONGEST_GAP, samples_per_block
from omnimj.control.detection.robust.force_balance import (
    SLOW,
    Recent,
    balance,
    columns,
    gear_column,
    instructive_gear,
    lasting,
    least_gear_share,
    mass_column,
    moments,
    oscillation_swing,
    roller_speeds,
    rolling_velocity,
    update_oscillation,
    whiten,
)
from omnimj.control.detection.robust.glr import (
    FILLED,
    HEAD,
    USUAL,
    WINDOWS,
    BlockHistory,
    JumpScores,
    clear_scores,
    coloured_variance,
    initial_history,
    likelihood_ratios,
    no_scores,
    push_block,
    update_usual_level,
)
from omnimj.control.detection.robust.parameter_filter import (
    ParameterModel,
    parameter_model,
    prior_deviation,
    short_term_precision,
    update_parameters,
    with_degraded_motors,
)
from omnimj.control.detection.robust.ripple import (
    LARGEST,
    initial_ripple,
    learn_ripple,
    subtract_ripple,
    turn_wheels,
)
from omnimj.control.detection.robust.slip import STATE, VelocityNoise, correct_velocity, predict_velocity
from omnimj.control.detection.robust.thresholds import Thresholds
from omnimj.control.detection.robust.wheel_monitors import (
    Traction,
    WheelMonitors,
    expected_creep,
    initial_monitors,
    restart_monitors,
    update_wheel_monitors,
)
from omnimj.control.gains import ObserverGains
from omnimj.control.robot_constants import RobotConstants, robot_constants
from omnimj.parameters import Floor, Robot
from omnimj.physics.native import kernel
from omnimj.signals import Array

RECENT = 10
"""Blocks of a tenth of a second, for which a wheel that was slow counts as slow."""
MOVING_SPEED = 1.0
"""Wheel speed from which a robot moves; below it nothing is learnt about its motors [rad/s]."""
QUIET_LIKELIHOOD = 12.0
"""Λ up to which blocks are learnt from: above it a fault is too likely [nats]."""
LIGHTEST, HEAVIEST = 0.75, 1.3
"""Bounds of the robot's estimated mass over the nominal one."""
SLOPE_STEP = 0.05
"""Deviation that the accelerometer's bias gains per block where a slope begins or ends [m/s²]."""
COMPARISON_TIME = 1.0
"""Time over which converter, wheels and gyro are compared [s]."""
HEADING, CONVERTER, ROLLED = range(3)
"""Places of `Evidence.yaw`."""

_ROLLING_DOUBT = 0.05  # [m/s] standard deviation of a velocity that only wheels measure, which may slip
_SINGULAR = 1e-6  # determinant below which wheels along one axis say nothing about the other


class RobustParameters(NamedTuple):
    """Constants of the robust detector."""

    robot: RobotConstants
    noise: VelocityNoise
    model: ParameterModel
    turn: Array
    """From `yaw_rate_row`, shape (n,)."""
    period: float
    """Duration of a block without a missing sample [s]."""
    sample_period: float
    """[s]"""
    thresholds: Thresholds


class Evidence(NamedTuple):
    """Memory from block to block, n wheels, p parameters θ."""

    theta: Array
    """Mean of θ as learnt, shape (p,)."""
    cov: Array
    """Its covariance, shape (p, p)."""
    history: BlockHistory
    scores: JumpScores
    usual: Array
    """Usual level of the largest Λ [nats] and number of blocks in it, shape (2,)."""
    misfit: Array
    """Variance of the noise per window, in units of the expected one, shape (windows,)."""
    residual: Array
    """ρ of the last block, shape (3,) [N, N, N.m]."""
    recent: Array
    """|φ̇_i| [rad/s] and |roller speed of i| [m/s] of the last blocks, shape (RECENT, 2n)."""
    recent_row: Array
    """Row of `recent` that is written next, shape (1,), integer."""
    force: Array
    """F̂ of the last block, shape (n,) [N]."""
    oscillation: Array
    """State of `update_oscillation` for the motors' forces before the gear's losses [N] and the speeds of the
    wheels' rims [m/s], shape (3, 2n)."""
    ripple: Array
    """Ripple of passing rollers by wheel, shape (4, n)."""
    velocity: Array
    """States of the filters without wheel 1 … n, and with all: shape (n+1, STATE)."""
    velocity_cov: Array
    """Their covariances, shape (n+1, STATE, STATE)."""
    monitors: WheelMonitors
    yaw: Array
    """Heading at the end of the last block (NaN before the first), and turns of converter and wheels beyond
    the gyro's over about a second, shape (3,) [rad]: `HEADING`, `CONVERTER`, `ROLLED`."""


def robust_parameters(
    robot: Robot,
    period: float,
    thresholds: Thresholds | None = None,
    gains: ObserverGains | None = None,
    floor: Floor | None = None,
) -> RobustParameters:
    """Constants of a robot's detector.

    Args:
      robot: Nominal robot.
      period: Control period [s].
      thresholds: Values from which a suspicion becomes a decision; as shipped when None.
      gains: Of the observer; as shipped when None.
      floor: Floor that the controller expects; None: nothing is known of it.
    """
    own = ObserverGains() if gains is None else gains
    limits = Thresholds() if thresholds is None else thresholds
    block = samples_per_block(period) * period
    return RobustParameters(
        robot_constants(robot, floor),
        VelocityNoise(float(own.wheel_noise), float(own.creep_noise), float(own.acceleration_noise)),
        parameter_model(len(robot.wheels), block, own.memory),
        yaw_rate_row(robot),
        block,
        float(period),
        Thresholds._make(map(float, limits)),
    )


def initial_evidence(wheels: int) -> Evidence:
    """Memory before the first block of a healthy robot at rest."""
    p = columns(wheels)
    return Evidence(
        theta=np.zeros(p),
        cov=np.diag(prior_deviation(wheels) ** 2),
        history=initial_history(p),
        scores=no_scores(wheels),
        usual=np.array([USUAL, 0.0]),
        misfit=np.zeros(len(WINDOWS)),
        residual=np.zeros(3),
        recent=np.zeros((RECENT, 2 * wheels)),
        recent_row=np.array([0]),
        force=np.zeros(wheels),
        oscillation=np.zeros((3, 2 * wheels)),
        ripple=initial_ripple(wheels),
        velocity=np.zeros((wheels + 1, STATE)),
        velocity_cov=np.tile(np.diag([1e-6, 1e-6, 4e-4, 4e-4]), (wheels + 1, 1, 1)),
        monitors=initial_monitors(wheels),
        yaw=np.array([np.nan, 0.0, 0.0]),
    )


@kernel
def compare_yaw_rates(x, parameters, block, yaw):
    """Compare converter, wheels and gyro after a block.

    Args:
      x: `Evidence.yaw`, changed in place.
      yaw: Heading at the block's end [rad].
    """
    period = block.duration
    keep = 1.0 - period / COMPARISON_TIME
    if not math.isnan(x[HEADING]):
        by_wheels = yaw_rate_by_wheels(parameters.turn, block.wheel_speed)
        x[CONVERTER] = keep * x[CONVERTER] + wrapped(yaw - x[HEADING]) - period * block.yaw_rate
        x[ROLLED] = keep * x[ROLLED] + period * (by_wheels - block.yaw_rate)
    x[HEADING] = yaw


@kernel
def _push_block(robot, evidence, walk, noise, row, learning):
    """Push a whitened block into the history; θ and the usual level learn from the one that drops out."""
    history, cursor = evidence.history, evidence.history.cursor
    rows = history.ring.shape[0]
    if cursor[FILLED] == rows and learning:
        last = (cursor[HEAD] + 1) % rows
        update_usual_level(evidence.usual, history.largest[last])
        _learn(robot, evidence, walk, noise, history.ring[last])
    push_block(history, row)


@kernel
def _learn(robot, evidence, walk, noise, row):
    """Take a row of the history into θ, in place; a γ that no gear has is projected to the nearest one.

    The other parameters follow by their correlation (D. Simon and T. Chia, Kalman filtering with state
    equality constraints, IEEE Trans. AES 38, 2002).
    """
    p, n = evidence.theta.size, evidence.force.size
    regressors = row[: 3 * p].copy().reshape(3, p)
    regressors[:, gear_column(n)] = row[3 * (p + 1) :]
    rho = row[3 * p : 3 * (p + 1)]
    update_parameters(evidence.theta, evidence.cov, walk, lasting(n), noise, regressors, rho)
    beyond = least_gear_share(robot) - evidence.theta[gear_column(n)]
    if beyond > 0.0:
        g = gear_column(n)
        evidence.theta[:] += evidence.cov[:, g] * (beyond / evidence.cov[g, g])


@kernel
def _is_quiet(scores, degraded):
    """True if no fault is likely; a degraded motor that becomes a little weaker is learnt, not doubted."""
    n = degraded.size
    for h in range(scores.likelihood.size):
        known = h < 2 * n and degraded[h % n]
        if not known and scores.likelihood[h] >= QUIET_LIKELIHOOD:
            return False
    return True


@kernel
def _recent_minima(evidence, wheel_speed, sideways):
    """Smallest |φ̇| [rad/s] and roller speed [m/s] of the last blocks, shape (n,) each."""
    n, recent, row = wheel_speed.size, evidence.recent, evidence.recent_row[0]
    recent[row, :n], recent[row, n:] = np.abs(wheel_speed), np.abs(sideways)
    evidence.recent_row[0] = (row + 1) % recent.shape[0]
    slowest, slowest_sideways = np.empty(n), np.empty(n)
    for i in range(n):
        slowest[i], slowest_sideways[i] = recent[:, i].min(), recent[:, n + i].min()
    return slowest, slowest_sideways


@kernel
def _release_bias_on_slope(robot, included, monitors, velocity_cov):
    """Release the accelerometer's bias along an axis where every wheel contradicts the velocity, in place.

    Uphill the accelerometer reads gravity as motion, so that all wheels seem to be too slow while they push:
    no slip does that. Oil is the other way round, wheels run away in the direction of their force.
    """
    for k in range(2):
        wheels, opposed = 0, 0.0
        for i in range(included.size):
            if included[i] and abs(robot.forces[k, i]) > 0.5:
                wheels += 1
                opposed += np.sign(monitors.opposed[i] * robot.forces[k, i])
        if wheels >= 2 and abs(opposed) == wheels:
            for q in range(velocity_cov.shape[0]):
                velocity_cov[q, 2 + k, 2 + k] += SLOPE_STEP * SLOPE_STEP


@kernel
def _oscillate(robot, block, swing, oscillation):
    """Update the oscillation in place; return `oscillation_swing` of every wheel, shape (n,) [N]."""
    n = swing.size
    values, unsteady = np.empty(2 * n), np.empty(n)
    for i in range(n):
        values[i], values[n + i] = robot.torque[i] * block.current[i], robot.radius[i] * block.wheel_speed[i]
    update_oscillation(oscillation, values)
    for i in range(n):
        unsteady[i] = oscillation_swing(swing[i], oscillation[2, i])
    return unsteady


@kernel
def _take_out_ripple(robot, block, learns, x, rho, evidence):
    """Take the known ripple out of ρ, in place, and learn it from what θ leaves."""
    basis, left = np.empty((2, block.wheel_speed.size)), rho.copy()
    turn_wheels(robot.rollers, block, evidence.ripple, basis)
    subtract_ripple(robot.forces, evidence.ripple, basis, LARGEST * robot.load, rho)
    if not learns:
        return
    subtract_ripple(robot.forces, evidence.ripple, basis, np.inf, left)
    for k in range(3):
        for j in range(evidence.theta.size):
            left[k] -= x[k, j] * evidence.theta[j]
    learn_ripple(robot.forces, block, basis, left, evidence.ripple)


@kernel
def _update_force_channel(parameters, block, accommodation, evidence, swing):
    """Force channel of `update_evidence`; whether the robot moves enough to be judged.

    `swing`, shape (n,) [N], is filled with the change of F̂ since the block before.
    """
    robot, theta, cov = parameters.robot, evidence.theta, evidence.cov
    model = with_degraded_motors(parameters.model, accommodation.degraded, block.duration)
    n = block.wheel_speed.size
    p, row, sideways = theta.size, np.empty(3 * (theta.size + 2)), np.empty(n)
    x, rho = np.zeros((3, p + 1)), row[3 * p : 3 * (p + 1)]
    roller_speeds(robot, block, evidence.velocity[n, :2], sideways)
    swing[:] = evidence.force
    balance(robot, block, theta, accommodation, sideways, x[:, :p], rho, evidence.force)
    instructive_gear(robot, block, theta, accommodation, x[:, p])
    swing[:] = np.abs(evidence.force - swing)
    quiet = _is_quiet(evidence.scores, accommodation.degraded)
    moving = np.abs(block.wheel_speed).max() > MOVING_SPEED
    learns = moving and quiet and not accommodation.degraded.any()
    _take_out_ripple(robot, block, learns, x, rho, evidence)
    evidence.residual[:] = rho
    unsteady = _oscillate(robot, block, swing, evidence.oscillation)
    slowest, sideways = _recent_minima(evidence, block.wheel_speed, sideways)
    if moving:
        # what is left of a weak motor must be followed, ripple or not
        noise = 1.0 if accommodation.degraded.any() else coloured_variance(evidence.usual)
        whiten(robot, theta, block.current, Recent(slowest, sideways, unsteady), accommodation, x, rho)
        row[: 3 * p], row[3 * (p + 1) :] = x[:, :p].copy().reshape(3 * p), x[:, p]
        if accommodation.relearning:
            _learn(robot, evidence, model.walk, noise, row)
        _push_block(robot, evidence, model.walk, noise, row, quiet and not accommodation.relearning)
        precision = short_term_precision(cov, model.short_term, lasting(n))
        evidence.misfit[:] = likelihood_ratios(evidence.history, theta, precision, model, evidence.scores)
        evidence.history.largest[evidence.history.cursor[HEAD]] = evidence.scores.likelihood.max()
        evidence.scores.likelihood[:] /= noise
    return moving


@kernel
def _update_slip_channel(parameters, block, accommodation, evidence, swing, moving):
    """Slip channel of `update_evidence`."""
    robot, included, monitors = parameters.robot, accommodation.included, evidence.monitors
    n, velocity, velocity_cov = included.size, evidence.velocity, evidence.velocity_cov
    mass = min(max(1.0 + evidence.theta[mass_column(n)], LIGHTEST), HEAVIEST)  # with its payload
    load = robot.load * mass
    for q in range(n + 1):
        predict_velocity(parameters, block, accommodation.excluded_axes, velocity[q], velocity_cov[q])
    creep = expected_creep(parameters.robot, block, velocity[n, :2], load, evidence.force, monitors)
    held, unknown = np.zeros(n), np.zeros(n, np.bool_)
    for i in range(n):
        slow = evidence.recent[:, i].min() < SLOW
        held[i] = robot.dry[i] if slow else 0.0
        learns = accommodation.relearning and accommodation.degraded[i]
        unknown[i] = robot.floor.stated and (learns or slow)
    oscillation = evidence.oscillation[2, n:]
    traction = Traction(load, evidence.force, swing, oscillation, creep, held, moving, unknown)
    for i in range(n):
        update_wheel_monitors(
            parameters, block, included, traction, velocity[i], velocity_cov[i], monitors, i
        )
    _release_bias_on_slope(robot, included, monitors, velocity_cov)
    for q in range(n + 1):
        left_out = q if q < n else -1
        correct_velocity(parameters, block, creep, included, left_out, velocity[q], velocity_cov[q])
    if np.abs(block.wheel_speed).max() < 0.1 * MOVING_SPEED and abs(block.yaw_rate) < 0.02:
        velocity[:, :2] *= 0.9  # the velocity of a robot at rest has nothing to correct it


@kernel
def roll_velocities(robot, wheel_speed, yaw_rate, included, evidence):
    """Set the body velocity of each filter to that of the wheels that roll, but its own, in place.

    Args:
      wheel_speed: φ̇, shape (n,) [rad/s].
      yaw_rate: [rad/s].
      included: Mask of the wheels that are taken to roll, shape (n,).
    """
    n, everyone = included.size, np.ones(included.size, np.bool_)
    for q in range(n + 1):
        x, cov = evidence.velocity[q], evidence.velocity_cov[q]
        xx, xy, yy = moments(robot.forces, included, q)
        if xx * yy - xy * xy < _SINGULAR:  # too few wheels roll: the others, too
            x[0], x[1] = rolling_velocity(robot, wheel_speed, yaw_rate, everyone, q)
        else:
            x[0], x[1] = rolling_velocity(robot, wheel_speed, yaw_rate, included, q)
        cov[:2, :] = 0.0
        cov[:, :2] = 0.0
        cov[0, 0] = cov[1, 1] = _ROLLING_DOUBT * _ROLLING_DOUBT


@kernel
def restart_evidence(robot, block, gap, included, evidence):
    """Go on after a gap in the measurements, in place: what was learnt stays, since a gap repairs nothing.

    Velocity, monitors and the comparison of yaw rates start anew, after a long gap the history of blocks too.

    Args:
      block: First `Block` after the gap.
      gap: [s].
      included: Mask of the wheels that are taken to roll, shape (n,).
    """
    roll_velocities(robot, block.wheel_speed, block.yaw_rate, included, evidence)
    restart_monitors(evidence.monitors)
    evidence.yaw[HEADING], evidence.yaw[CONVERTER], evidence.yaw[ROLLED] = np.nan, 0.0, 0.0
    if gap > LONGEST_GAP:
        evidence.history.cursor[FILLED] = 0
        clear_scores(evidence.scores)
        evidence.oscillation[1:] = 0.0


@kernel
def update_evidence(parameters, block, accommodation, evidence, yaw):
    """Update both channels and the comparison of yaw rates by one block, in place.

    Args:
      yaw: Heading at the block's end [rad].

    Returns:
      Whether the robot moves enough to be judged.
    """
    swing = np.empty(block.wheel_speed.size)
    moving = _update_force_channel(parameters, block, accommodation, evidence, swing)
    _update_slip_channel(parameters, block, accommodation, evidence, swing, moving)
    compare_yaw_rates(evidence.yaw, parameters, block, yaw)
    return moving
