"""Kernels of the linear axis as a plant: amplifier, sensors, a run under position control."""

from __future__ import annotations

import math

import numpy as np

from omnimj.physics.axis import (
    ENCODER,
    FORCE_DELAY,
    LIMIT,
    LOOP,
    MONITOR_BIAS,
    MONITOR_SCALE,
    PLAY,
    POSITION_DELAY,
    POSITION_SCALE,
    VELOCITY_DELAY,
    VELOCITY_SCALE,
    encoder_position,
    encoder_speed,
    frozen,
    step,
)
from omnimj.physics.native import kernel

POSITION_NOISE, POSITION_STEP, VELOCITY_NOISE, FORCE_NOISE, FORCE_STEP = range(5)
SENSOR_ROW = 5
"""Numbers of the sensors."""

STIFFNESS, GAIN, FEED_MASS, FEED_VISCOUS, FEED_COULOMB, FEED_SPEED, SPEED_FILTER = range(7)
"""Numbers of the controller."""

READ_FORCE, READ_POSITION, READ_VELOCITY, TRUE_FORCE, TRUE_POSITION, TRUE_SPEED = range(6)
COLUMNS = 6
"""Columns of a run."""

TRUE_COLUMNS = 3
"""Declared force of the drive, position and speed of what the encoder sits on."""


@kernel
def _stepped(value, size):
    return np.rint(value / size) * size if size > 0.0 else value


@kernel
def _late(truth, column, k, delay, period):
    """A true value as it was `delay` before sample k; before the run it was as at its start."""
    place = min(max(k - delay / period, 0.0), float(k))
    below = min(int(place), max(k - 1, 0))
    share = place - below
    if share == 0.0:
        return truth[below, column]
    return (1.0 - share) * truth[below, column] + share * truth[below + 1, column]


@kernel
def read_sensors(row, sensors, truth, k, noise, column, period, reading):
    """What force monitor, encoder and tachometer say at sample k.

    Args:
      row: `axis_row`, with effects.
      sensors: `sensor_row`.
      truth: Declared force, encoder's position and speed so far, shape (more than k, TRUE_COLUMNS).
      k: Sample.
      noise: Standard normal numbers, shape (3, any).
      column: The column of `noise` to use.
      period: [s]
      reading: Filled: force, position, velocity, shape (3,).
    """
    force = row[MONITOR_SCALE] * _late(truth, 0, k, row[FORCE_DELAY], period) + row[MONITOR_BIAS]
    position = row[POSITION_SCALE] * _late(truth, 1, k, row[POSITION_DELAY], period)
    velocity = row[VELOCITY_SCALE] * _late(truth, 2, k, row[VELOCITY_DELAY], period)
    reading[0] = _stepped(force + sensors[FORCE_NOISE] * noise[0, column], sensors[FORCE_STEP])
    reading[1] = _stepped(position + sensors[POSITION_NOISE] * noise[1, column], sensors[POSITION_STEP])
    reading[2] = velocity + sensors[VELOCITY_NOISE] * noise[2, column]


@kernel
def one_period(row, curve, state, force, command, time, period, substeps):
    """State and the drive's declared force [N] a period later; the amplifier lags behind the command."""
    h = period / substeps
    target = min(max(command, -row[LIMIT]), row[LIMIT])
    keep = math.exp(-h / row[LOOP]) if row[LOOP] > 0.0 else 0.0
    for s in range(substeps):
        after = target + (force - target) * keep
        mean = target + (force - after) * row[LOOP] / h
        state = step(row, curve, state, mean, 0.0, time + s * h, h)
        force = after
    return state, force


@kernel
def at_rest(row, position):
    """State at rest with the encoder at this position, drive pressing forward."""
    gap = 0.5 * row[PLAY]
    return position - (gap if row[ENCODER] == 1.0 else 0.0), 0.0, gap, 0.0, 0.0


@kernel
def follow_target(row, curve, target, gains, sensors, noise, period, substeps, columns):
    """One run under position control.

    Args:
      row: `axis_row`, with effects.
      curve: A free curve.
      target: Position, speed, acceleration at every sample, shape (n, 3).
      gains: `AxisController.row`.
      sensors: `sensor_row`.
      noise: Standard normal numbers, shape (3, n).
      period: Of controller and log [s].
      substeps: Steps of the equations per period.
      columns: Filled: force, position, velocity as read; the same as they are, shape (n, 6).
    """
    reading = np.zeros(3)
    numbers, table = frozen(row, curve)
    state = at_rest(numbers, target[0, 0] / row[POSITION_SCALE])
    truth = columns[:, READ_VELOCITY + 1 :]
    share = 1.0 - math.exp(-period / gains[SPEED_FILTER]) if gains[SPEED_FILTER] > 0.0 else 1.0
    force, speed, last = 0.0, 0.0, target[0, 0]
    for k in range(len(target)):
        truth[k, 0], truth[k, 1] = force, encoder_position(numbers, state)
        truth[k, 2] = encoder_speed(numbers, state)
        read_sensors(numbers, sensors, truth, k, noise, k, period, reading)
        columns[k, :3] = reading
        if k > 0:
            speed += share * ((reading[1] - last) / period - speed)
        last = reading[1]
        v = target[k, 1]
        command = gains[FEED_MASS] * target[k, 2] + gains[FEED_VISCOUS] * v
        command += gains[FEED_COULOMB] * math.tanh(v / gains[FEED_SPEED])
        command += gains[STIFFNESS] * (target[k, 0] - last) + gains[GAIN] * (v - speed)
        state, force = one_period(numbers, table, state, force, command, k * period, period, substeps)
