"""One sample of every channel: the physical chain, then the sensor faults.

A channel comes as its row of numbers (`CHANNEL_ROW`), a fault as its row (`FAULT_ROW`), so that robot and rig
share one kernel. Its cost is far below the rest of a control step.
"""

from __future__ import annotations

import math

import numpy as np

from omnimj.physics.native import kernel

# laws: what lies between the physical quantity and the number
IDEAL, MONITOR, ENCODER, FILTERED, HEADING = range(5)

# numbers of a channel. GAIN: input to sensor's own unit; COUNT, HYSTERESIS: of the encoder; NOISE: standard
# deviation; DECAY: of the first-order filter over one sample; RANGE: ± full scale; STEP: of the sensor's own
# converter and DAQ_STEP: of the analog input (0: none); UPDATES: renewals per sample of a held value;
# TURNS: 1 where the reading is an angle in [0, 2π); PERIOD: of the samples; SPREAD: standard deviation of the
# bias, which is drawn at the start of a run
LAW, GAIN, COUNT, HYSTERESIS, NOISE, DECAY, RANGE, STEP, DAQ_STEP, UPDATES, TURNS, PERIOD, SPREAD = range(13)
CHANNEL_ROW = 13

# state of a channel: motor angle; angle behind the dead band; counted angle; filtered value or value held;
# bias; samples taken; last reading
ANGLE, BEHIND, COUNTED, FILTER, BIAS, SAMPLES, LAST = range(7)
STATE_ROW = 7

# a sensor fault
BIASED, FROZEN, DRIFTING, NOISY, SCALED = range(5)
CHANNEL, MODE, SIZE, ONSET, END, HELD = range(6)
FAULT_ROW = 6

_TURN = 2.0 * math.pi
_TIME_TOLERANCE = 1e-9  # [s], and renewals: a sum of many periods may lie this much early
_MAX_ANGLE_STEP = 1e4  # [rad] per sample: keeps an absurd speed from using up the digits of the angle


@kernel
def wrap(angle):
    """The same angle in [0, 2π)."""
    turned = angle - _TURN * math.floor(angle / _TURN)
    return 0.0 if turned >= _TURN else max(turned, 0.0)


@kernel
def quantise(value, full_scale, step):
    """Nearest code of a two's complement converter: −range … range − step; clipped at the ends."""
    if step > 0.0:
        return min(max(np.rint(value / step) * step, -full_scale), full_scale - step)
    return min(max(value, -full_scale), full_scale)


@kernel
def encoder_speed(row, state, speed, noise):
    """Speed out of an encoder's counts, filtered, in the shaft's unit [rad/s].

    The angle is the sum of speed × period: only its differences matter, so it drifts nowhere.
    Behind the dead band (play of width h) the angle moves only once the shaft has taken up h.
    """
    state[ANGLE] += min(max(speed * row[PERIOD], -_MAX_ANGLE_STEP), _MAX_ANGLE_STEP)
    seen = state[ANGLE] + row[NOISE] * noise
    half = 0.5 * row[HYSTERESIS]
    state[BEHIND] = min(max(state[BEHIND], seen - half), seen + half)
    counted = np.rint(state[BEHIND] / row[COUNT]) * row[COUNT]
    raw = (counted - state[COUNTED]) / row[PERIOD]
    state[COUNTED] = counted
    state[FILTER] = row[DECAY] * state[FILTER] + (1.0 - row[DECAY]) * raw
    return state[FILTER]


@kernel
def held_heading(row, state, yaw):
    """Heading on the grid of its converter, renewed now and then and held in between, in [0, 2π) [rad]."""
    now = math.floor(state[SAMPLES] * row[UPDATES] + _TIME_TOLERANCE)
    before = math.floor((state[SAMPLES] - 1.0) * row[UPDATES] + _TIME_TOLERANCE)
    if now > before:
        state[FILTER] = wrap(np.rint(wrap(yaw) / row[STEP]) * row[STEP])
    state[SAMPLES] += 1.0
    return state[FILTER]


@kernel
def apply_chain(row, state, value, noise):
    """What the sensor makes of the physical quantity; NaN for a quantity that is not finite.

    The state is left alone by a quantity that is not finite, so that one bad sample spoils one reading.
    """
    if not math.isfinite(value):
        return math.nan
    law = row[LAW]
    if law == IDEAL:
        return wrap(value) if row[TURNS] == 1.0 else value
    if law == HEADING:
        return held_heading(row, state, value)
    x = row[GAIN] * value
    if law == ENCODER:
        x = encoder_speed(row, state, x, noise)
    elif law == FILTERED:
        state[FILTER] = row[DECAY] * state[FILTER] + (1.0 - row[DECAY]) * (x + row[NOISE] * noise)
        x = state[FILTER] + state[BIAS]
    else:
        x += row[NOISE] * noise
    return quantise(quantise(x, row[RANGE], row[STEP]), row[RANGE], row[DAQ_STEP]) / row[GAIN]


@kernel
def apply_fault(fault, reading, last, time, noise):
    """The reading with one sensor fault, Fig. 2.14 [1]: bias, freezing, drift, loss of accuracy, scale."""
    if time + _TIME_TOLERANCE < fault[ONSET] or time + _TIME_TOLERANCE >= fault[END]:
        fault[HELD] = math.nan
        return reading
    mode = fault[MODE]
    if mode == BIASED:
        return reading + fault[SIZE]
    if mode == DRIFTING:
        return reading + fault[SIZE] * (time - fault[ONSET])
    if mode == NOISY:
        return reading + fault[SIZE] * noise
    if mode == SCALED:
        return reading * fault[SIZE]
    if math.isnan(fault[HELD]):
        fault[HELD] = reading if math.isnan(last) else last
    return fault[HELD]


@kernel
def sample_channels(rows, states, faults, noise, column, time, values):
    """One reading of every channel.

    Args:
      rows: Channels, shape (c, CHANNEL_ROW).
      states: Shape (c, STATE_ROW), changed in place.
      faults: Shape (f, FAULT_ROW), in the order in which they act; what a frozen one holds changes in place.
      noise: Standard normal numbers, shape (c + f, any).
      column: The column of `noise` to use.
      time: Time of the sample [s].
      values: The physical quantities, shape (c,).

    Returns:
      Readings, a fresh array of shape (c,).
    """
    channels = rows.shape[0]
    readings = np.empty(channels)
    for c in range(channels):
        readings[c] = apply_chain(rows[c], states[c], values[c], noise[c, column])
    for f in range(faults.shape[0]):
        c = int(faults[f, CHANNEL])
        readings[c] = apply_fault(faults[f], readings[c], states[c, LAST], time, noise[channels + f, column])
    for c in range(channels):
        if rows[c, TURNS] == 1.0 and math.isfinite(readings[c]):
            readings[c] = wrap(readings[c])
        states[c, LAST] = readings[c]
    return readings
