"""One control period and its row as kernels: detector, recovery, cascade, columns of the trace.

It does what `loop.steps` does under a controller that follows a reference, or under given currents, by the
same kernels, so that both give the same numbers. The controller's kernels get readings, plan and their own
state; the truth goes from the plant to the row.

Measured runs are driven again with the wheel speeds that their encoders show, by wheel-speed loops and limits
without the rest of the cascade; how the body moves is then up to the floor.

The loops in `planar` and `twin` run until `end` rows are finished or Python is needed, and return the reason.
Their arguments, and those of the functions below:

    plant: Arrays of the plant, changed in place.
    progress: Record of `Progress`, changed in place; `run` is its only row.
    output: `Output`, whose arrays are filled.
    next_change: Time of the simulation from which the plant has conditions to change [s].
    end: Number of rows.
    time: Time of the measurement [s].
    controller: `ControllerArrays`.
    plan: `Plan`.
    loops: Record of `WheelSpeedLoops`, changed in place; `follow_row` gets its only row.
    targets: Wheel speeds of every row, shape (rows, n) [rad/s].
    current: Set current of every row, shape (rows,) [A].
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from omnimj.control.cascade.limits import CurrentLimits, current_limits, limit_all
from omnimj.control.cascade.wheel_speed import SpeedGains, amplifier_parameters, speed_loop
from omnimj.control.compiled import Reading, respond, take_reading
from omnimj.control.detection.robust.judgement import judge_block
from omnimj.control.records import Record, packed
from omnimj.control.recovery.step import Demand
from omnimj.parameters import Robot
from omnimj.physics.motor import MotorParameters
from omnimj.physics.native import inlined, kernel
from omnimj.signals import RIG_CHANNELS, Array

CHUNK_IS_DONE, DECISION_IS_DUE, PLANT_CHANGES, TRUTH_IS_BROKEN = range(4)
"""Reasons for which a loop returns."""
RIG_COLUMNS = len(RIG_CHANNELS) + 2
"""Columns of a rig's row before the truth: time, readings, set current."""
_POLES = 100.0  # [1/s] of the loop with a free wheel


class ControllerArrays(NamedTuple):
    """Controller of a run."""

    parameters: Record
    """Packed `ControlParameters`."""
    constants: Record
    """Packed `RobustParameters`."""
    record: Record
    """Packed `ControlFields`, changed in place."""
    evidence: Record
    """Packed `Evidence`, changed in place."""


class Plan(NamedTuple):
    """Reference of a run, k samples."""

    columns: Array
    """Position [m], heading [rad] and velocity [m/s], shape (k, 5)."""
    yaw_rate: Array
    """Shape (k,) [rad/s]."""


class Progress(NamedTuple):
    """State of the loop between two calls."""

    at: float = 0.0
    """Sample of the plan."""
    scaling: float = 1.0
    """Time scaling of the present period."""
    row: int = 0
    """Rows that are finished."""
    good: bool = True
    """True if the present measurement is good."""
    decided: bool = False
    """True if the detector's present block has been decided."""
    moves: bool = False
    """True if the plant has to step before the next row."""


class Output(NamedTuple):
    """Arrays that the loop fills."""

    table: Array
    """Rows of the trace, shape (rows, columns)."""
    poses: Array
    """A pose of the plant every `every` rows, shape (m, nq); m = 0 if none are wanted."""
    every: int
    readings: Array
    """Newest readings, shape (2n+4,); of a rig (5,)."""
    signals: int
    """Number of the controller's logged signals; 0 for a rig."""
    largest: float
    """Largest magnitude of a sound true value."""


@inlined
def control_period(controller, run, plan, output, time):
    """Control one period and fill its row, but for the truth.

    Returns:
      Whether the detector has to decide first; the period is then continued by a second call.
    """
    p, x, readings = controller.parameters[0], controller.record[0], output.readings
    n, at = p.cascade.turn.size, int(run.at)
    if not run.decided:
        run.scaling = x.recovery.time_scaling if p.recovers else 1.0
    planned, row = plan.columns[at], output.table[run.row]
    v_x, v_y = run.scaling * planned[3], run.scaling * planned[4]
    now = Reading(
        time,
        readings[:n],
        readings[n : 2 * n],
        readings[2 * n : 2 * n + 2],
        readings[2 * n + 2],
        readings[2 * n + 3],
        Demand(v_x, v_y, run.scaling * plan.yaw_rate[at], planned[2]),
    )
    if not run.decided:
        run.good, full = take_reading(p, x, now)
        constants, evidence = controller.constants[0], controller.evidence[0]
        if full and judge_block(constants, x.samples, evidence, x.judged, now.yaw, time):
            run.decided = True
            return True
    run.decided = False
    respond(p, x, now, run.good)
    run.at = min(run.at + run.scaling, plan.columns.shape[0] - 1.0)
    row[0], row[1 : 2 * n + 5] = time, readings
    row[2 * n + 5 : 3 * n + 5] = x.cascade.current
    row[3 * n + 5 : 3 * n + 5 + output.signals] = x.log[: output.signals]
    row[-5:-2] = planned[:3]
    row[-2], row[-1] = v_x, v_y
    return False


@kernel
def first_truth(controller, output):
    """First column of the truth."""
    return 3 * controller.record[0].cascade.current.size + 5 + output.signals


@kernel
def fill_rig_row(run, output, time, current):
    """Fill a rig's row with time, readings and set current; returns its part for the truth, a view."""
    row = output.table[run.row]
    row[0], row[1 : RIG_COLUMNS - 1], row[RIG_COLUMNS - 1] = time, output.readings, current[run.row]
    return row[RIG_COLUMNS:]


@kernel
def keep_pose(run, output, pose):
    """Keep the pose (nq,) of a row where one is wanted."""
    if run.row % output.every == 0 and run.row // output.every < output.poses.shape[0]:
        output.poses[run.row // output.every] = pose


@kernel
def finish_row(run, output, truth):
    """Count a row whose true values are finite and not beyond all bounds; False for another one."""
    for value in truth:
        if not abs(value) <= output.largest:
            return False
    run.row += 1
    run.moves = True
    return True


@kernel
def is_spent(sensors):
    """True if all random numbers of a `SensorChain` are used."""
    return sensors.column[0] >= sensors.noise.shape[1]


class WheelSpeedLoops(NamedTuple):
    """Wheel-speed loops of a robot with n wheels, and their state."""

    gains: SpeedGains
    amplifier: MotorParameters
    """From `amplifier_parameters`."""
    limits: CurrentLimits
    integral: Array
    """Integrals q, shape (n,) [A]."""
    current: Array
    """Last command, shape (n,) [A]."""
    reason: Array
    """Numbers of `limits.Reason`, shape (n,)."""


def wheel_speed_loops(robot: Robot, period: float) -> Record:
    """Packed loops of a robot at a control period [s], at rest."""
    n = robot.wheel_count
    limits = current_limits(robot.control, period)
    states = (np.zeros(n), np.zeros(n), np.zeros(n))
    return packed(WheelSpeedLoops(_stiff_gains(robot, period), amplifier_parameters(robot), limits, *states))


def _stiff_gains(robot: Robot, period: float) -> SpeedGains:
    """Gains that place both poles of a free wheel at `_POLES`.

    The robot's own gains answer demands softly: on a floor that resists, its wheels would reach a measured
    speed a second late, and a run would begin with another motion than the measured one.
    """
    motor = robot.motor
    inertia = robot.wheel.inertia + motor.reflected_inertia
    per_ampere = motor.torque_constant * motor.gear_ratio * motor.gear_efficiency
    proportional = 2.0 * _POLES * inertia / per_ampere
    return SpeedGains(proportional, 0.5 * _POLES * proportional * period)


@inlined
def follow_row(loops, run, output, time, targets):
    """Set the currents of the coming period, and fill a row with time, readings and set currents.

    Returns:
      The part of the row for the truth, a view.
    """
    n, row = loops.current.size, output.table[run.row]
    last, wanted, speed = loops.current.copy(), np.empty(loops.current.size), output.readings[n : 2 * n]
    for i in range(n):
        wanted[i], loops.integral[i] = speed_loop(
            loops.gains, loops.amplifier, targets[run.row, i], speed[i], loops.integral[i], 1.0
        )
    limit_all(loops.limits, wanted, last, speed, True, loops.current, loops.reason)
    row[0], row[1 : 2 * n + 5], row[2 * n + 5 : 3 * n + 5] = time, output.readings, loops.current
    return row[3 * n + 5 :]
