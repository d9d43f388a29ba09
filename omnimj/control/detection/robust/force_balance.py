"""The force channel: the body's acceleration against the motors' forces, ρ = L + B F̂ − M a.

F̂_i = g (K_t i E G_r/r − dry σ(φ̇) − viscous φ̇) − I_eff φ̈/r comes from the joint side, so no friction law of
the floor enters: the channel is blind to slip and to the floor. g is 1 while the motor drives the wheel and
1/(E E_b) while the floor does. M a is accelerometer and gyro. A floor that is stated (`ExpectedFloor`) takes
its resistance to the rolling of wheels and rollers from both. Deviations of a healthy robot from its nominal
parameters are columns of a law

  ρ = X θ + noise,  θ = [δ_1…n, ν_1…n, β_x, β_y, λ, μ, ι, γ, κ, c_x, c_y, h_1…n, k_1…n]
 δ loss of torque constant and ν excess of dry friction per wheel, β accelerometer bias, λ excess of the
friction of rollers and floor, μ excess of mass, ι of inertia, γ excess of g where the floor drives the wheel,
κ excess of viscous friction, c displacement of the centre of mass; h and k, −1 … 1, the stiction of a wheel
and of its rollers at rest, which is unknown and never learnt. The law is linear in all of them but γ, which
multiplies δ, ν and κ: their columns are those at the γ that has been learnt.

In the kernels `robot` is `RobotConstants`, `block` `Block`, `accommodation` `Accommodation`, and i the wheel.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np

from omnimj.control.expected_floor import rolling_drag
from omnimj.physics.native import kernel

SLOW = 1.5
"""Wheel speed below which the sign of dry friction is unknown [rad/s]."""
SLOW_SIDEWAYS = 0.05
"""Roller speed below which it is unknown [m/s]."""
NOISE = (1.0, 1.0, 0.6)
"""Standard deviation of ρ in a block of 10 ms: N, N, N.m; accelerometer, gyro's difference, rollers."""
_UNKNOWN = 1e4  # [N²] variance of a force that is unknown
_NOT_JUDGED = 0.5  # standard deviation of the loss of a motor that is not judged
_PULLS = 5.0  # × dry friction: from there on a slow wheel excites a motor that is known to be degraded
_TURNING = 0.3  # [rad/s] width of the sign of a wheel's dry friction
_SIDEWAYS = 0.01  # [m/s] width of the sign of its rollers' dry friction
VISCOUS_AT = 100.0
"""Wheel speed at which κ is the excess of viscous friction over the nominal dry friction [rad/s]."""
LEARNT_FROM, LEARNT_FULLY = 1.0, 2.0
"""Traction before the gear from which γ is learnt, and from which it is learnt fully [N]."""
TIMING = 0.3
"""Uncertainty of the channels' relative times as a share of a block: 3 ms, as sensors and filters differ."""
_SHAKEN = 10.0  # blocks over which an oscillation is averaged
_COMMON = 9  # entries of θ that all wheels share: β, λ, μ, ι, γ, κ, c


@kernel
def columns(wheels):
    """Length p of θ."""
    return 4 * wheels + _COMMON


@kernel
def lasting(wheels):
    """Number of the leading entries of θ that are lasting parameters of the robot."""
    return 2 * wheels + _COMMON


@kernel
def mass_column(wheels):
    """Index of μ in θ; ι, γ, κ, c_x and c_y follow it."""
    return 2 * wheels + 3


@kernel
def gear_column(wheels):
    """Index of γ in θ; κ, c_x and c_y follow it."""
    return 2 * wheels + 5


@kernel
def shaft_force(robot, block, theta, losses, i):
    """Traction of one wheel before its gear, by the nominal law and by the learnt one [N].

    Args:
      theta: θ as learnt, shape (p,).
      losses: Diagnosed losses of the torque constants, shape (n,) [1].
    """
    speed, n = block.wheel_speed[i], losses.size
    full, dry = robot.torque[i] * block.current[i], robot.dry[i] * math.tanh(speed / _TURNING)
    nominal = full * (1.0 - losses[i]) - dry - robot.viscous[i] * speed
    viscous = theta[gear_column(n) + 1] * robot.dry[i] / VISCOUS_AT
    return nominal, nominal - full * theta[i] - dry * theta[n + i] - viscous * speed


@kernel
def moments(forces, included, left_out):
    """Sums of u_x², u_x u_y and u_y² over the included wheels but one; −1: but none."""
    xx = xy = yy = 0.0
    for i in range(included.size):
        if i != left_out and included[i]:
            u_x, u_y = forces[0, i], forces[1, i]
            xx, xy, yy = xx + u_x * u_x, xy + u_x * u_y, yy + u_y * u_y
    return xx, xy, yy


@kernel
def rolling_velocity(robot, wheel_speed, yaw_rate, included, left_out):
    """Velocity v_x, v_y of a body whose wheels roll, by least squares with the gyro's yaw rate [m/s].

    Args:
      wheel_speed: Shape (n,) [rad/s].
      yaw_rate: [rad/s].
      included: Mask of the wheels, shape (n,).
      left_out: One of them that is left out; −1: none.
    """
    xx, xy, yy = moments(robot.forces, included, left_out)
    bx = by = 0.0
    for i in range(included.size):
        if i != left_out and included[i]:
            along = robot.radius[i] * wheel_speed[i] - robot.forces[2, i] * yaw_rate
            bx, by = bx + robot.forces[0, i] * along, by + robot.forces[1, i] * along
    det = xx * yy - xy * xy
    return (yy * bx - xy * by) / det, (xx * by - xy * bx) / det


@kernel
def roller_speeds(robot, block, velocity, sideways):
    """Fill the speeds at which the rollers turn, those along the axles of omni wheels [m/s].

    Args:
      velocity: Estimated v_x, v_y of the body on a stated floor, on which wheels creep; elsewhere they are
        taken to roll. Shape (2,) [m/s].
      sideways: Output, shape (n,) [m/s].
    """
    v_x, v_y = velocity[0], velocity[1]
    if not robot.floor.stated:
        everyone = np.ones(sideways.size, np.bool_)
        v_x, v_y = rolling_velocity(robot, block.wheel_speed, block.yaw_rate, everyone, -1)
    for i in range(sideways.size):
        across = robot.across[i]
        sideways[i] = across[0] * v_x + across[1] * v_y + across[2] * block.yaw_rate


@kernel
def balance(robot, block, theta, accommodation, sideways, x, rho, force):
    """Fill regressors X, balance ρ and wheel forces F̂ of one block.

    Args:
      theta: θ as learnt, shape (p,): it gives F̂, the γ of the columns, and which wheels the floor drives.
      accommodation: `Accommodation`; nothing is learnt about the gears, which are alike, from the motors that
        are known to be degraded: their friction has a law of its own.
      sideways: From `roller_speeds`, shape (n,) [m/s].
      x: Output X, shape (3, p).
      rho: Output ρ, shape (3,) [N, N, N.m].
      force: Output F̂ at θ, shape (n,) [N].
    """
    n = force.size
    common, gear = 2 * n, gear_column(n)
    x[:] = 0.0
    rho[0], rho[1] = -robot.mass * block.acceleration[0], -robot.mass * block.acceleration[1]
    rho[2] = -robot.yaw_inertia * block.yaw_acceleration
    _subtract_centre(robot, block, x, rho, gear + 2)
    pushes = np.zeros(3)
    for i in range(n):
        speed, inertial = block.wheel_speed[i], robot.inertia[i] * block.wheel_acceleration[i]
        shaft, learnt = shaft_force(robot, block, theta, accommodation.losses, i)
        driven = learnt * speed < 0.0  # by the floor: the gear takes its share the other way
        nominal_gain = robot.driven[i] if driven else 1.0
        gain = nominal_gain * (1.0 + theta[gear]) if driven else 1.0
        resisted, resisted_across = rolling_drag(robot.floor, i, robot.radius[i] * speed, sideways[i])
        resisted *= math.tanh(speed / _TURNING)
        force[i] = gain * learnt - inertial - resisted * (1.0 + theta[common + 2])
        across, way = robot.across[i], math.tanh(sideways[i] / _SIDEWAYS)
        drag = robot.roller_dry * way + robot.roller_viscous * sideways[i]
        for k in range(3):
            along, rollers = robot.forces[k, i], across[k] * robot.load * drag
            rollers += across[k] * resisted_across * way + along * resisted
            x[k, i] = along * gain * robot.torque[i] * block.current[i]
            x[k, n + i] = along * gain * robot.dry[i] * math.tanh(speed / _TURNING)
            x[k, common + 2] += rollers
            if not accommodation.degraded[i]:
                x[k, gear] -= along * nominal_gain * shaft if driven else 0.0
                x[k, gear + 1] += along * gain * robot.dry[i] / VISCOUS_AT * speed
            rho[k] += along * (nominal_gain * shaft - inertial) - rollers
            pushes[k] += along * gain * shaft - rollers
    x[0, common], x[1, common + 1] = -robot.mass, -robot.mass
    for k in range(3):
        # what should accelerate the body, without what was differentiated: noise would pull μ and ι to zero
        x[k, common + 3 if k < 2 else common + 4] = pushes[k]


@kernel
def instructive_gear(robot, block, theta, accommodation, column):
    """Fill the column of γ from which it is learnt: only wheels that the floor surely drives.

    Near zero the shaft's force is its own error, of cogging, of the current's noise, of a friction that is
    not learnt yet. Both sides of the balance contain it, so that it would pull γ towards −1 wherever a robot
    coasts (regression dilution), until the first hard braking contradicts.

    Args:
      theta: θ as learnt, shape (p,).
      column: Output, shape (3,) [N, N, N.m].
    """
    column[:] = 0.0
    for i in range(accommodation.degraded.size):
        shaft, learnt = shaft_force(robot, block, theta, accommodation.losses, i)
        if accommodation.degraded[i] or learnt * block.wheel_speed[i] >= 0.0:
            continue
        weight = (abs(learnt) - LEARNT_FROM) / (LEARNT_FULLY - LEARNT_FROM)
        for k in range(3):
            column[k] -= min(max(weight, 0.0), 1.0) * robot.forces[k, i] * robot.driven[i] * shaft


@kernel
def least_gear_share(robot):
    """Smallest γ: no gear gives a wheel that the floor drives less resistance than its motor's own torque.

    1/(E E_b) ≥ 1, since a gear that multiplies by E in both directions, E_b = 1/E, is the most efficient one.
    """
    return 1.0 / robot.driven.min() - 1.0


@kernel
def _subtract_centre(robot, block, x, rho, column):
    """Inertial forces of a centre of mass beside the origin, where the accelerometer is, in ρ and in X.

    m (a_x − ω̇ c_y − ω² c_x),  m (a_y + ω̇ c_x − ω² c_y),  I ω̇ + m (c_x a_y − c_y a_x).

    Args:
      x: X, shape (3, p); two columns are filled.
      rho: ρ, shape (3,), changed in place.
      column: Index of c_x.
    """
    spin, square = block.yaw_acceleration, block.yaw_rate * block.yaw_rate
    x[0, column], x[0, column + 1] = -robot.mass * square, -robot.mass * spin
    x[1, column], x[1, column + 1] = robot.mass * spin, -robot.mass * square
    x[2, column], x[2, column + 1] = robot.mass * block.acceleration[1], -robot.mass * block.acceleration[0]
    for k in range(3):
        rho[k] -= x[k, column] * robot.centre[0] + x[k, column + 1] * robot.centre[1]


class Recent(NamedTuple):
    """Motion of the last tenth of a second, which makes the forces of a block uncertain."""

    slowest: Any
    """Smallest |φ̇|, shape (n,) [rad/s]."""
    sideways: Any
    """Smallest roller speed, shape (n,) [m/s]."""
    swing: Any
    """Change of F̂ since the block before, and `oscillation_swing`, shape (n,) [N]."""


@kernel
def update_oscillation(oscillation, values):
    """Update the mean square oscillation of some values by those of one block, in place.

    Mean of −Δ_k Δ_{k−1}, where positive: changes that alternate from block to block, as they do where a loop
    oscillates at 25 Hz or more, 0.7 to 2 times the square of the amplitude. A change that lasts, like that of
    a fault, does not count.

    Args:
      oscillation: Last values, last changes and mean squares, shape (3, m).
      values: Of the block, shape (m,).
    """
    for k in range(values.size):
        change = values[k] - oscillation[0, k]
        square = max(-change * oscillation[1, k], 0.0)
        oscillation[2, k] += (square - oscillation[2, k]) / _SHAKEN
        oscillation[0, k], oscillation[1, k] = values[k], change


@kernel
def oscillation_swing(swing, mean_square):
    """Change from block to block whose `TIMING` is as uncertain as swing and oscillation together [N].

    A force of amplitude A about zero, with a gain that differs by g between both directions, has a mean of
    g A/π, 0.3 to 0.5 A for most gears. All blocks of a window are off by it alike, which white noise of the
    size of the amplitude stands for.

    Args:
      swing: Change of F̂ since the block before [N].
      mean_square: Mean square of the oscillation of the motor's force [N²].
    """
    return math.sqrt(swing * swing + mean_square / (TIMING * TIMING))


@kernel
def whiten(robot, theta, current, recent, accommodation, x, rho):
    """Scale the rows of X and ρ, in place, so that the noise is white and of size 1.

    A wheel that turns slowly, or did within the last tenth of a second, holds any friction between ± dry, and
    goes on to hold it: a parameter h of its own along its column of B, and noise for its changes. So do
    rollers that hardly turn. The motor of a slow wheel is not judged meanwhile: its possible loss is noise
    too, or the robot's other parameters would have to explain it. A degraded motor is judged all the same
    where its current is far beyond what friction can hold: a wheel that stands for lack of torque must not
    hide its loss. Where its friction has been learnt to be larger, it holds that much, and up to a speed that
    is larger by as much: a second motor in parallel brakes like its own windings until it turns.

    A wheel that slips on a stated floor may stand on another one, whose drag is not known.

    A force that changes from block to block is known as of a time only that is uncertain by `TIMING`; where a
    loop oscillates, the gear's share, which differs between both directions, is not even that of the mean,
    from one block to the next in the same sense (`oscillation_swing`).

    Args:
      theta: θ as learnt, shape (p,).
      current: Mean over the block, shape (n,) [A].
      recent: `Recent`.
      x: X, shape (3, p) or with further columns, changed in place.
      rho: ρ, shape (3,), changed in place.
    """
    cov, spin = np.zeros((3, 3)), np.empty(3)
    # the error of ω̇, with what it adds where the accelerometer is not at the centre
    per_moment = robot.mass / robot.yaw_inertia
    spin[0], spin[1] = per_moment * robot.accelerometer[1], -per_moment * robot.accelerometer[0]
    spin[2] = 1.0
    for k in range(3):
        for j in range(3):
            cov[k, j] = NOISE[2] * NOISE[2] * spin[k] * spin[j]
        if k < 2:
            cov[k, k] += NOISE[k] * NOISE[k]
            if accommodation.excluded_axes[k]:
                cov[k, k] = _UNKNOWN
    for i in range(current.size):
        _add_unknown_forces(robot, theta, current, recent, accommodation, i, cov, x)
    _scale_rows(cov, x, rho)


@kernel
def _add_unknown_forces(robot, theta, current, recent, accommodation, i, cov, x):
    """Add the unknown forces of a wheel to the covariance, shape (3, 3), and fill columns h and k of X."""
    n, slowest, sideways = current.size, recent.slowest[i], recent.sideways[i]
    held = lasting(n)
    more = 1.0 + max(theta[n + i], 0.0) if accommodation.degraded[i] else 1.0
    full, dry, slow = robot.torque[i] * current[i], robot.dry[i] * more, slowest < SLOW * more
    resisted, rollers = rolling_drag(robot.floor, i, robot.radius[i] * slowest, SLOW_SIDEWAYS)
    dry, rollers = dry + resisted, robot.load * robot.roller_dry + rollers
    hidden = slow and (not accommodation.degraded[i] or abs(full) < _PULLS * dry)
    lacks = _NOT_JUDGED * full if hidden else 0.0
    elsewhere = robot.floor.stated and not (accommodation.included[i] or accommodation.degraded[i])
    for k in range(3):
        along, across = robot.forces[k, i], robot.across[i, k]
        for j in range(3):
            if accommodation.unknown_force[i]:
                cov[k, j] += along * robot.forces[j, i] * _UNKNOWN
            elif slow:
                cov[k, j] += along * robot.forces[j, i] * (dry * dry + lacks * lacks)
            cov[k, j] += along * robot.forces[j, i] * (TIMING * recent.swing[i]) ** 2
            if sideways < SLOW_SIDEWAYS:
                cov[k, j] += across * robot.across[i, j] * rollers * rollers
            if elsewhere:
                cov[k, j] += (across * robot.across[i, j] + along * robot.forces[j, i]) * _UNKNOWN
        x[k, held + i] = along * dry if hidden else 0.0
        if hidden:  # friction may take whatever the motor gives
            x[k, i] = x[k, n + i] = 0.0
        x[k, held + n + i] = across * rollers if sideways < SLOW_SIDEWAYS else 0.0


@kernel
def _scale_rows(cov, x, rho):
    """Multiply X and ρ by L⁻¹, L Lᵀ the covariance of their rows, shape (3, 3): forward substitution."""
    low = np.zeros((3, 3))
    for k in range(3):
        for j in range(k + 1):
            rest = cov[k, j]
            for q in range(j):
                rest -= low[k, q] * low[j, q]
            low[k, j] = math.sqrt(rest) if k == j else rest / low[j, j]
    for col in range(x.shape[1]):
        for k in range(3):
            value = x[k, col]
            for q in range(k):
                value -= low[k, q] * x[q, col]
            x[k, col] = value / low[k, k]
    for k in range(3):
        value = rho[k]
        for q in range(k):
            value -= low[k, q] * rho[q]
        rho[k] = value / low[k, k]
