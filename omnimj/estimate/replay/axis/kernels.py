"""Replays of a linear axis' logs: the twin that follows the measured position, and windows left alone.

Following: the axis is driven by the measured force and a correction m ω² e, e = measured − simulated
position, while its position is drawn along by √2 ω e. The correction is the force that the equations lack,
low-passed by ω²/(s² + √2 ω s + ω²): no derivative of the measured position is taken, friction sticks and
slips as it would, and where both stand still within the friction there is nothing to correct.
ω² = σ_F/(m σ_x) makes it the steady Kalman filter of a mass under white force noise.
The clock is that of the force; delays of the other channels count against it.
"""

from __future__ import annotations

import math

import numpy as np

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
"""Numbers of a stretch without gaps: samples start … end − 1, its windows, time per sample [s], substeps."""

FIRST, LAST, FIRST_BLOCK = range(3)
WINDOW = 3
"""Numbers of a window: samples first … last − 1 and its first row of blocks."""

FORCE_COLUMN, POSITION_COLUMN, VELOCITY_COLUMN = range(3)

_FIRST_MOTION = 5.0  # plays that a stretch moves before it has shown on which side it began


@kernel
def value_at(values, place, first, last):
    """Linear between samples first … last − 1, constant beyond them."""
    place = min(max(place, float(first)), float(last - 1))
    below = min(int(place), last - 2)
    share = place - below
    return (1.0 - share) * values[below] + share * values[below + 1]


@kernel
def _meet(row, gap, position, speed):
    """State in which the encoder reads this, with the play in this place."""
    place = position - (gap if row[ENCODER] == 1.0 else 0.0)
    return place, speed, gap, speed, 0.0


@kernel
def _drive(row, curve, state, before, after, nudge, time, h, substeps):
    """State after one sample's time under a declared force that goes from `before` to `after`."""
    if substeps == 1:
        return step(row, curve, state, 0.5 * (before + after), nudge, time, h)
    part = h / substeps
    for s in range(substeps):
        mean = before + (after - before) * (s + 0.5) / substeps
        state = step(row, curve, state, mean, nudge, time + s * part, part)
    return state


@kernel
def _follow(row, curve, stretch, times, force, position, rate, start, last, correction, followed, gap):
    """`follow_position` from a given state up to sample `last`; returns Σ correction² [N²]."""
    first, end, h, substeps = int(stretch[START]), int(stretch[END]), stretch[PERIOD], int(stretch[SUBSTEPS])
    late = (row[POSITION_DELAY] - row[FORCE_DELAY]) / h
    drawn, pushed = h * math.sqrt(2.0) * rate, row[MASS] * rate * rate
    unit = row[MONITOR_SCALE] / row[FORCE_SCALE]
    state, total = start, 0.0
    declared = (force[first] - row[MONITOR_BIAS]) / row[MONITOR_SCALE]
    for k in range(first, last):
        error = 0.0
        if first <= k + late <= end - 1:  # beyond its ends a late channel has nothing to follow
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
    """Follows the measured position over one stretch.

    On which side of the play a stretch begins is not measured: it is the one for which its first motion needs
    the smaller correction.

    Args:
      row: `axis_row`, with effects.
      curve: A free curve.
      stretch: Shape (STRETCH,).
      times: Time since the run's start of every sample [s].
      force: Declared force of every sample [N].
      position: Measured position of every sample [m].
      speed: Smoothed measured speed of every sample [m/s].
      rate: ω [rad/s].
      correction: Filled with the missing force at every sample, in the monitor's scale [N].
      followed: Filled with the speed of the encoder's body at every sample [m/s].
      gap: Filled with the play's state at every sample [m].
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
    """A window of a stretch from its smoothed start, driven by the measured force alone.

    Args:
      row: `axis_row`, with effects.
      curve: A free curve.
      stretch: Shape (STRETCH,).
      window: Shape (WINDOW,).
      times: Time since the run's start of every sample [s].
      force: Declared force of every sample [N].
      smooth: Smoothed position, speed and acceleration of every sample, shape (n, 3).
      gap: The play's state at every sample [m].
      size: Samples per block.
      blocks: Its position column is filled from the window's first row on.
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
    """All stretches of all runs under one setting.

    Args:
      rows: `axis_row` of every stretch, with effects, shape (stretches, AXIS_ROW).
      curve: A free curve.
      stretches: Shape (stretches, STRETCH).
      windows: Shape (windows, WINDOW).
      times: Time since the run's start of every sample [s].
      force: Declared force, monitor included [N].
      position: Measured position [m].
      smooth: Smoothed position, speed and acceleration, shape (n, 3).
      rate: ω of the follower [rad/s].
      size: Samples per block.
      free: Whether windows are let go too.
      blocks: Filled: force, position, velocity, shape (blocks, 3).
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
