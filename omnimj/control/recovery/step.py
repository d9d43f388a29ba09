"""One step of recovery as a kernel, on records that are changed in place."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from omnimj.control.cascade.controller import Reconfiguration
from omnimj.control.cascade.heading import to_body, wrapped
from omnimj.control.recovery.demand import (
    next_time_scaling,
    pivot_yaw_rate,
    place_correction,
    slip_bounds,
    time_scaling_of_pivot,
    time_scaling_on_slippery_floor,
)
from omnimj.control.recovery.dither import (
    DITHER_SPEED,
    SELF_TEST_SPEED,
    Dither,
    next_self_test,
    probe_speed,
    update_dither,
)
from omnimj.control.recovery.force_allocation import allocate_forces, required_wrench, steady_creep
from omnimj.control.recovery.modes import (
    CAPPING,
    COMPENSATING,
    NORMAL,
    PIVOTING,
    REVERTED,
    SLOWING,
    STOPPING,
)
from omnimj.control.recovery.tracking import Tracking, update_tracking
from omnimj.control.robot_constants import RobotConstants
from omnimj.parameters.parts import GRAVITY
from omnimj.physics.native import kernel
from omnimj.signals import Array

LEAST_EFFECTIVENESS = 0.3
"""Currents are scaled by at most 1/0.3: more does not help a dead motor."""
_JUDGED = 0.3  # [s] after a decision until its recovery is judged
_WORSE, _MARGIN = 2.0, 0.06  # tracking error that reverts a recovery: factor on that before, [m/s] more
_BLAMED = 0.05  # [m/s] by which a recovery must change speeds to be held responsible
_GRIP_FADES = 0.5  # [1/s] rate at which the grip of a slippery floor is forgotten
_FILTER = 0.03  # [s] filter of the wheels' traction


class RecoveryParameters(NamedTuple):
    """Constants of a recovery, n wheels."""

    period: float
    """Control period [s]."""
    arm: float
    """Largest moment per traction of a wheel [m]."""
    strongest: float
    """Traction of a wheel at the largest current [N]."""
    holds_heading: bool
    """True if the cascade holds the planned heading anyway; else the usual heading error is kept."""
    dithers: bool
    """True if the motors are excited while the drive reveals nothing about them."""
    place_proportional: float
    """From `RecoveryGains` [1/s]."""
    place_speed: float
    """From `RecoveryGains` [m/s]."""
    slip_cap: float
    """From `RecoveryGains` [m/s]."""
    grip_share: float
    """From `RecoveryGains` [1]."""
    robot: RobotConstants
    speed_per_twist: Array
    """Inverse kinematics B/r, shape (n, 3)."""
    null_space: Array
    """Wheel speeds that push the body nowhere, per m/s of the fastest wheel, shape (n,) [rad/m]."""


class Demand(NamedTuple):
    """Target of the cascade as numbers."""

    velocity_x: float = 0.0
    """World demand [m/s]."""
    velocity_y: float = 0.0
    """World demand [m/s]."""
    yaw_rate: float = 0.0
    """[rad/s]"""
    heading: float = 0.0
    """Planned heading [rad]."""


class RecoveryInput(NamedTuple):
    """Measurement, estimated motion and plan of one step."""

    time: float
    """Time of the measurement [s]."""
    wheel_speed: Array
    """Measured, shape (n,) [rad/s]."""
    heading: float
    """Estimate [rad]."""
    yaw_rate: float
    """Gyro less its bias, or by the wheels [rad/s]."""
    demand: Demand
    """Plan at the time scaling of the step before."""


class RecoveryFields(NamedTuple):
    """Fields of the record behind `RecoveryState`, n wheels."""

    demand: Demand
    """For the cascade."""
    reconfiguration: Reconfiguration
    """For the cascade."""
    brake: Array
    """Mask of the motors that are shorted now, shape (n,)."""
    tracking: Tracking
    dither: Dither
    traction: Array
    """Low-passed traction of the wheels, shape (n,) [N]."""
    test_left: float
    """Remaining time of the self-test [s]."""
    time_scaling: float
    """Speed of the plan, 1: as planned."""
    mode: int
    """Chosen mode, one of `modes.MODE_NAMES`."""
    pivot: int
    """Wheel 0…n−1 that the robot turns about; −1: none."""
    shorts: Array
    """Mask of the motors that the mode shorts, shape (n,)."""
    decided: float = -math.inf
    """Time of the detector's newest decision [s]."""
    error_before: float = 0.0
    """Tracking error at that time [m/s]."""
    reverted: bool = False
    """True if the mode is reverted since it made tracking worse."""
    correction: float = 0.0
    """Largest change of a speed by the recovery [m/s]."""
    grip: float = 0.0
    """Friction coefficient felt on a slippery floor [1]."""


@kernel
def advance_recovery(p, estimate, now, x):
    """One step after a good measurement, in place.

    Args:
      p: `RecoveryParameters`.
      estimate: `FaultEstimate`, for which `x.mode`, `x.pivot` and `x.shorts` were chosen.
      now: `RecoveryInput`.
      x: `RecoveryFields`, changed in place.
    """
    healthy, demand = x.mode == NORMAL, now.demand
    for i in range(x.traction.size):
        x.traction[i] += min(p.period / _FILTER, 1.0) * (estimate.force[i] - x.traction[i])
    integrates = x.mode != SLOWING
    update_tracking(x.tracking, estimate.velocity, now, p.period, p.arm, healthy, integrates)
    _judge_recovery(x, estimate.decided, now.time)
    speed = math.hypot(demand.velocity_x, demand.velocity_y)
    wave, x.test_left = next_self_test(x.test_left, p.period)
    wave *= SELF_TEST_SPEED
    if wave == 0.0:
        wave = DITHER_SPEED * _dither_sign(p, x, healthy, speed)
    if x.test_left <= 0.0:
        _update_time_scaling(p, x, speed)
    x.brake[:] = False
    _reset_reconfiguration(x.reconfiguration)
    _set_demand(x.demand, demand.velocity_x, demand.velocity_y, demand.yaw_rate, demand.heading)
    if not healthy:
        mode = REVERTED if x.reverted else x.mode
        _change_demand(p, x, mode, now)
        _reconfigure(p, x, mode, estimate, now)
        if not x.reverted:
            x.brake[:] = x.shorts
        return
    if wave != 0.0:  # dither loosens the bristles: the robot would fall behind
        for i in range(p.null_space.size):
            x.reconfiguration.offset[i] = wave * p.null_space[i]
        back_x, back_y = _place_correction(p, x.tracking, demand)
        x.demand.velocity_x, x.demand.velocity_y = demand.velocity_x + back_x, demand.velocity_y + back_y


@kernel
def _judge_recovery(x, decided, time):
    """Note a new decision and the tracking error at its time; revert a mode that made tracking worse.

    A fault makes tracking worse by itself; only a recovery that changes speeds by more than `_BLAMED` is
    blamed.
    """
    if decided > x.decided:
        x.decided, x.reverted = decided, False
        x.error_before = max(x.tracking.error, x.tracking.usual_error)
        return
    worse = x.correction > _BLAMED and x.tracking.error > _WORSE * x.error_before + _MARGIN
    active = x.mode in (COMPENSATING, CAPPING)
    x.reverted = active and (x.reverted or (worse and time > x.decided + _JUDGED))


@kernel
def _demanded_acceleration(p, tracking):
    """Largest demanded acceleration of a wheel [m/s²]."""
    acceleration = math.hypot(tracking.acceleration_x, tracking.acceleration_y)
    return acceleration + abs(tracking.yaw_acceleration) * p.arm


@kernel
def _dither_sign(p, x, healthy, speed):
    acceleration = _demanded_acceleration(p, x.tracking)
    return update_dither(x.dither, p.period, healthy and p.dithers, speed, acceleration, x.traction)


@kernel
def _update_time_scaling(p, x, speed):
    """Update the time scaling and the grip felt on a slippery floor."""
    scaling, grip, goal, most = x.time_scaling, 0.0, 1.0, GRAVITY
    if x.mode == SLOWING:
        share = np.abs(x.traction).max() / p.robot.load
        grip = max(share, x.grip * (1.0 - _GRIP_FADES * p.period))
        goal, most = time_scaling_on_slippery_floor(grip, x.tracking.hardest, GRAVITY, p.grip_share)
    if x.mode == PIVOTING:
        goal = time_scaling_of_pivot(scaling, speed)
    elif x.mode == STOPPING:
        goal = 0.0
    if goal != scaling:
        x.time_scaling = next_time_scaling(scaling, p.period, goal, speed, most)
    x.grip = grip


@kernel
def _reset_reconfiguration(changed):
    changed.current_scale[:] = 1.0
    changed.offset[:] = 0.0
    changed.lowest[:] = -math.inf
    changed.highest[:] = math.inf
    changed.trusts_gyro, changed.holds_heading = True, False


@kernel
def _set_demand(demand, velocity_x, velocity_y, yaw_rate, heading):
    demand.velocity_x, demand.velocity_y = velocity_x, velocity_y
    demand.yaw_rate, demand.heading = yaw_rate, heading


@kernel
def _place_correction(p, tracking, demand):
    return place_correction(
        tracking.place_x,
        tracking.place_y,
        demand.velocity_x,
        demand.velocity_y,
        p.place_proportional,
        p.place_speed,
    )


@kernel
def _change_demand(p, x, mode, now):
    """Correct the position and demand a heading that can be held; note the change of speed [m/s]."""
    demand = now.demand
    if mode == STOPPING:
        _set_demand(x.demand, demand.velocity_x, demand.velocity_y, 0.0, now.heading)
        return
    back_x = back_y = 0.0
    if mode in (COMPENSATING, PIVOTING):
        back_x, back_y = _place_correction(p, x.tracking, demand)
    v_x, v_y = demand.velocity_x + back_x, demand.velocity_y + back_y
    x.correction = math.hypot(back_x, back_y)
    if mode == PIVOTING:
        b_x, b_y = to_body(v_x, v_y, now.heading)
        way = now.wheel_speed[x.pivot] if x.shorts[x.pivot] else 0.0
        _set_demand(x.demand, v_x, v_y, pivot_yaw_rate(p.robot, x.pivot, way, b_x, b_y), now.heading)
        return
    held = demand.heading
    if not p.holds_heading:
        held = wrapped(held + x.tracking.heading_offset)
    _set_demand(x.demand, v_x, v_y, demand.yaw_rate, held)


@kernel
def _reconfigure(p, x, mode, estimate, now):
    """Scaled currents, creep of the shares f* and bounds of slipping wheels; note the change of speed."""
    changed, radius = x.reconfiguration, p.robot.radius.max()
    changed.trusts_gyro = estimate.trusts_gyro
    if mode == REVERTED:
        return
    for i in range(changed.offset.size):
        left = max(1.0 - estimate.losses[i], LEAST_EFFECTIVENESS)
        changed.current_scale[i] = 0.0 if estimate.held[i] else 1.0 / left
    changed.holds_heading = mode not in (PIVOTING, STOPPING)
    v_x, v_y = to_body(x.demand.velocity_x, x.demand.velocity_y, now.heading)
    if mode == CAPPING:
        lowest, highest = slip_bounds(p.robot, estimate.velocity, now.yaw_rate, estimate.slipping, p.slip_cap)
        most = 0.0
        for i in range(lowest.size):
            row = p.speed_per_twist[i]
            speed = row[0] * v_x + row[1] * v_y + row[2] * x.demand.yaw_rate
            most = max(most, lowest[i] - speed, speed - highest[i])
        changed.lowest[:], changed.highest[:] = lowest, highest
        if p.dithers:
            acceleration = _demanded_acceleration(p, x.tracking)
            for i in range(lowest.size):
                if estimate.slipping[i]:
                    probe = probe_speed(now.time, math.hypot(v_x, v_y), acceleration, x.traction[i])
                    changed.offset[i] = probe / p.robot.radius[i]
        x.correction = radius * most
        return
    moves = x.demand.velocity_x != 0.0 or x.demand.velocity_y != 0.0 or x.demand.yaw_rate != 0.0
    if moves and mode in (COMPENSATING, PIVOTING):
        offset = _creep_offsets(p, x, estimate, v_x, v_y, now.heading)
        changed.offset[:] = offset
        x.correction += radius * np.abs(offset).max()


@kernel
def _creep_offsets(p, x, estimate, v_x, v_y, heading):
    """Offsets creep(f*_i)/r of the wheel speeds, which make up for creep, shape (n,) [rad/s].

    f*_i are shares of the demanded force; a wheel that the robot turns about takes one, but gets no offset.
    """
    n, robot = p.null_space.size, p.robot
    available, most = np.empty(n, np.bool_), np.empty(n)
    for i in range(n):
        wrong = estimate.dead[i] or estimate.runaway[i] or estimate.held[i] or estimate.slipping[i]
        available[i] = not wrong or i == x.pivot
        most[i] = max(p.strongest * (1.0 - estimate.losses[i]) - robot.dry[i], 0.0)
    # demanded acceleration in the frame that turns with the body: the world one, turned
    a_x, a_y = to_body(x.tracking.acceleration_x, x.tracking.acceleration_y, heading)
    twist, acceleration = (v_x, v_y, x.demand.yaw_rate), (a_x, a_y, x.tracking.yaw_acceleration)
    wrench = required_wrench(robot, twist, acceleration, available, x.traction)
    share, offset = allocate_forces(robot.forces, p.arm, wrench, most, available), np.zeros(n)
    for i in range(n):
        if available[i] and i != x.pivot:
            ratio = math.hypot(robot.forces[0, i], robot.forces[1, i])  # 1/sin γ of its rollers
            offset[i] = ratio * steady_creep(robot.load, ratio * share[i]) / robot.radius[i]
    return offset
