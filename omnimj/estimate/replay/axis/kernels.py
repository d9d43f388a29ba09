"""Compiled replay of a linear axis' logs: a follower of the measured position, and free windows.

Follower: an observer of the axis, driven by the measured force plus a correction m ω² e, where e = measured −
simulated position; its position is corrected at the rate √2 ω e. The correction is the force missing from the
equations, low-passed by ω²/(s² + √2 ω s + ω²). No derivative of the measured position is taken, friction
sticks and slips as in the equations, and an axis at rest within its stiction needs no correction.
With ω² = σ_F/(m σ_x) this is the steady-state Kalman filter of a mass under white force noise.

Free window: it starts from the measured state and is driven by the measured force alone.

Time is that of the force channel; delays of the other channels are relative to it.
"""

from __future__ import annotations

import math

import numpy as np

from omnimj.estimate.replay.stretches import FIRST, FIRST_BLOCK, LAST, value_at
from omnimj.physics.axis import (
    CHANGE,
    DRIVE_SPEED,
    ENCODER,
    FORCE_DELAY,
    FORCE_SCALE,
    GAP,
    MASS,
    MONITOR_BIAS,
    MONITOR_SCALE,
    PLAY,
    POSITION,
    POSITION_DELAY,
    POSITION_SCALE,
    SPEED,
    VELOCITY_DELAY,
    VELOCITY_SCALE,
    encoder_position,
    encoder_speed,
    frozen,
    step,
)
from omnimj.physics.native import kernel

START, END, FIRST_WINDOW, WINDOWS, PERIOD, SUBSTEPS = range(6)
STRETCH = 6
"""Columns of the table of stretches without gaps: samples start … end − 1, its first window and number of
windows, sample period [s], substeps per sample."""

FORCE_COLUMN, POSITION_COLUMN, VELOCITY_COLUMN = range(3)

_FIRST_MOTION = 5.0  # travel, in plays, over which the initial side of the play is determined


@kernel
def _meet(row, gap, position, speed):
    """State with a given encoder position and speed and a given gap of the play [m, m/s, m]."""
    place = position - (gap if row[ENCODER] == 1.0 else 0.0)
    return place, speed, gap, speed, 0.0


@kernel
def _drive(row, curve, state, before, after, nudge, time, h, substeps):
    """Integrate the state over one sample period; the force changes linearly from `before` to `after` [N]."""
    if substeps == 1:
        return step(row, curve, state, 0.5 * (before + after), nudge, time, h)
    part = h / substeps
    for s in range(substeps):
        mean = before + (after - before) * (s + 0.5) / substeps
        state = step(row, curve, state, mean, nudge, time + s * part, part)
    return state


@kernel
def _follow(row, curve, stretch, times, force, position, rate, start, last, correction, followed, gap):
    """Run the follower from a given state up to sample `last`; return Σ correction² [N²]."""
    first, end, h, substeps = int(stretch[START]), int(stretch[END]), stretch[PERIOD], int(stretch[SUBSTEPS])
    late = (row[POSITION_DELAY] - row[FORCE_DELAY]) / h
    drawn, pushed = h * math.sqrt(2.0) * rate, row[MASS] * rate * rate
    unit = row[MONITOR_SCALE] / row[FORCE_SCALE]
    state, total = start, 0.0
    declared = (force[first] - row[MONITOR_BIAS]) / row[MONITOR_SCALE]
    for k in range(first, last):
        error = 0.0
        if first <= k + late <= end - 1:  # a delayed channel has no samples beyond its ends
            measured = value_at(position, k + late, first, end) / row[POSITION_SCALE]
            error = measured - encoder_position(row, state)
        nudge = pushed * error
        correction[k], followed[k], gap[k] = nudge * unit, encoder_speed(row, state), state[GAP]
        total += correction[k] * correction[k]
        if k + 1 == last:
            break
        after = (force[k + 1] - row[MONITOR_BIAS]) / row[MONITOR_SCALE]
        state = (state[POSITION] + drawn * error, state[SPEED], state[GAP], state[DRIVE_SPEED], state[CHANGE])
        state = _drive(row, curve, state, declared, after, nudge, times[k], h, substeps)
        declared = after
    return total


@kernel
def follow_position(row, curve, stretch, times, force, position, speed, rate, correction, followed, gap):
    """Follow the measured position over one stretch.

    The initial side of the play is not measured; the follower takes the side for which the first motion needs
    the smaller correction.

    Args:
      row: Axis with its effects, the numbers of `axis_row`.
      curve: Free curve, CURVE_ROW numbers.
      stretch: Row of the table of stretches, shape (STRETCH,).
      times: Time since the start of the run, shape (n,) [s].
      force: Force reported by the drive, shape (n,) [N].
      position: Measured position, shape (n,) [m].
      speed: Smoothed measured speed, shape (n,) [m/s].
      rate: Bandwidth ω of the follower [rad/s].
      correction: Filled with the missing force in the scale of the force channel, shape (n,) [N].
      followed: Filled with the speed of the encoder's body, shape (n,) [m/s].
      gap: Filled with the gap of the play, shape (n,) [m].
    """
    first, last = int(stretch[START]), int(stretch[END])
    late = (row[POSITION_DELAY] - row[FORCE_DELAY]) / stretch[PERIOD]
    x = value_at(position, first + late, first, last) / row[POSITION_SCALE]
    v = value_at(speed, first + late, first, last) / row[POSITION_SCALE]
    start = _meet(row, 0.5 * row[PLAY], x, v)
    if row[PLAY] > 0.0:
        moved = first + 2
        while moved < last and abs(position[moved] - position[first]) < _FIRST_MOTION * row[PLAY]:
            moved += 1
        forward = _follow(
            row, curve, stretch, times, force, position, rate, start, moved, correction, followed, gap
        )
        other = _meet(row, -0.5 * row[PLAY], x, v)
        backward = _follow(
            row, curve, stretch, times, force, position, rate, other, moved, correction, followed, gap
        )
        if backward < forward:
            start = other
    _follow(row, curve, stretch, times, force, position, rate, start, last, correction, followed, gap)


@kernel
def free_window(row, curve, stretch, window, times, force, smooth, gap, size, blocks):
    """Run a free window from the smoothed measured state, driven by the measured force alone.

    Args:
      row: Axis with its effects, the numbers of `axis_row`.
      curve: Free curve, CURVE_ROW numbers.
      stretch: Row of the table of stretches, shape (STRETCH,).
      window: Row of the table of windows, shape (WINDOW,).
      times: Time since the start of the run, shape (n,) [s].
      force: Force reported by the drive, shape (n,) [N].
      smooth: Smoothed position, speed and acceleration, shape (n, 3) [m, m/s, m/s²].
      gap: Gap of the play, shape (n,) [m].
      size: Samples per block.
      blocks: Position column filled with block means from the window's first row on, shape (blocks, 3).
    """
    first, last, h, substeps = window[FIRST], window[LAST], stretch[PERIOD], int(stretch[SUBSTEPS])
    late = row[POSITION_DELAY] - row[FORCE_DELAY]
    scale = row[POSITION_SCALE]
    x, v, a = smooth[first, 0] / scale, smooth[first, 1] / scale, smooth[first, 2] / scale
    state = _meet(row, gap[first], x + late * v + 0.5 * late * late * a, v + late * a)
    total, at = 0.0, window[FIRST_BLOCK]
    bend = 0.5 * late * late * substeps / h
    declared = (force[first] - row[MONITOR_BIAS]) / row[MONITOR_SCALE]
    for k in range(first, last):
        x = encoder_position(row, state) - late * encoder_speed(row, state)
        total += scale * (x + bend * state[CHANGE])
        if (k - first) % size == size - 1:
            blocks[at, POSITION_COLUMN] = total / size
            total, at = 0.0, at + 1
        if k + 1 == last:
            break
        after = (force[k + 1] - row[MONITOR_BIAS]) / row[MONITOR_SCALE]
        state = _drive(row, curve, state, declared, after, 0.0, times[k], h, substeps)
        declared = after


@kernel
def replay(rows, curve, stretches, windows, times, force, position, smooth, rate, size, free, blocks):
    """Replay all stretches of all runs under one setting.

    Args:
      rows: Axis with its effects for every stretch, shape (stretches, AXIS_ROW).
      curve: Free curve, CURVE_ROW numbers.
      stretches: Table of stretches, shape (stretches, STRETCH).
      windows: Table of windows, shape (windows, WINDOW).
      times: Time since the start of the run, shape (n,) [s].
      force: Force reported by the drive, shape (n,) [N].
      position: Measured position, shape (n,) [m].
      smooth: Smoothed position, speed and acceleration, shape (n, 3) [m, m/s, m/s²].
      rate: Bandwidth ω of the follower [rad/s].
      size: Samples per block.
      free: True to run the free windows, too.
      blocks: Filled with block means of force, position and velocity, shape (blocks, 3) [N, m, m/s].
    """
    count = len(times)
    correction, followed, gap = np.empty(count), np.empty(count), np.empty(count)
    for s in range(len(stretches)):
        stretch = stretches[s]
        row, table = frozen(rows[s], curve)
        follow_position(
            row, table, stretch, times, force, position, smooth[:, 1], rate, correction, followed, gap
        )
        first, last = int(stretch[START]), int(stretch[END])
        late = (row[VELOCITY_DELAY] - row[FORCE_DELAY]) / stretch[PERIOD]
        begin = int(stretch[FIRST_WINDOW])
        for w in range(begin, begin + int(stretch[WINDOWS])):
            window = windows[w]
            at = window[FIRST_BLOCK]
            for start in range(window[FIRST], window[LAST], size):
                effort, speed = 0.0, 0.0
                for k in range(start, start + size):
                    effort += force[k] + correction[k]
                    speed += value_at(followed, k - late, first, last)
                blocks[at, FORCE_COLUMN] = effort / size
                blocks[at, VELOCITY_COLUMN] = row[VELOCITY_SCALE] * speed / size
                at += 1
            if free:
                free_window(row, table, stretch, window, times, force, smooth, gap, size, blocks)
