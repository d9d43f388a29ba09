"""One sample of every channel: the physical chain, then the sensor faults.

A channel is described by `ChannelParameters` and carries a `ChannelState` from sample to sample; a sensor
fault is a `SensorFault`. Packed rows of them let robot and rig share one kernel, whose cost is far below the
rest of a control step.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from omnimj.physics.native import first_numbers, kernel
from omnimj.physics.wheel import store
from omnimj.signals import Array

IDEAL, MONITOR, ENCODER, FILTERED, HEADING = 0.0, 1.0, 2.0, 3.0, 4.0
"""Types of channel: the chain from the physical quantity to the reading."""
BIASED, FROZEN, DRIFTING, NOISY, SCALED = 0.0, 1.0, 2.0, 3.0, 4.0
"""Modes of a sensor fault."""

_TURN = 2.0 * math.pi
_TIME_TOLERANCE = 1e-9  # [s] and updates by which a sum of many periods may fall short
_MAX_ANGLE_STEP = 1e4  # [rad] per sample, so that an absurd speed does not exhaust the precision of the angle


class ChannelParameters(NamedTuple):
    """Constants of one channel."""

    law: float
    """`IDEAL`, `MONITOR`, `ENCODER`, `FILTERED` or `HEADING`."""
    period: float
    """Sample period [s]."""
    gain: float = 1.0
    """Sensor unit per unit of the physical quantity."""
    count: float = 0.0
    """Angle of one count of the encoder [rad]."""
    hysteresis: float = 0.0
    """Dead band of the encoder [rad]."""
    noise: float = 0.0
    """Standard deviation of the noise, in the sensor unit."""
    decay: float = 0.0
    """Decay factor of the first-order filter over one sample, 0…1."""
    full_scale: float = math.inf
    """Range (±), in the sensor unit."""
    step: float = 0.0
    """Resolution of the sensor's converter; 0: none."""
    daq_step: float = 0.0
    """Resolution of the analog input; 0: none."""
    updates: float = 0.0
    """Number of updates of a held value per sample."""
    turns: float = 0.0
    """1 if the reading is an angle in [0, 2π), otherwise 0."""
    spread: float = 0.0
    """Standard deviation of the bias, drawn at the start of a run."""


class ChannelState(NamedTuple):
    """Memory of a channel between samples."""

    angle: float = 0.0
    """Shaft angle [rad]."""
    behind: float = 0.0
    """Shaft angle behind the dead band [rad]."""
    counted: float = 0.0
    """Shaft angle rounded to counts [rad]."""
    filtered: float = 0.0
    """Filtered or held value."""
    bias: float = 0.0
    samples: float = 0.0
    """Number of samples taken so far."""
    last: float = math.nan
    """Last reading; NaN before the first sample."""


class SensorFault(NamedTuple):
    """A fault of one channel."""

    channel: float
    """Index of the channel."""
    mode: float
    """`BIASED`, `FROZEN`, `DRIFTING`, `NOISY` or `SCALED`."""
    size: float
    onset: float
    """Time of the onset [s]."""
    end: float
    """Time of the end [s]."""
    held: float = math.nan
    """Frozen reading; NaN before the onset."""


class ReadingEffect(NamedTuple):
    """Scale, offset and pure delay behind the chain; a delay need not be a whole number of samples."""

    channel: float
    """Index of the channel."""
    scale: float
    offset: float
    late: float
    """Delay [samples]."""
    turns: float
    """1 if the reading is an angle in [0, 2π), otherwise 0."""


class DelayLine(NamedTuple):
    """Last readings of the channels with effects, before which each is taken to have read its first value."""

    past: Array
    """Readings, oldest first, shape (m, longest delay + 2)."""
    filled: Array
    """Number of readings in each row, shape (m,), integers."""


class SensorChain(NamedTuple):
    """Arrays of all channels of a machine, c channels, f faults, m channels with effects."""

    channels: Array
    """Packed `ChannelParameters`, shape (c, CHANNEL_SIZE)."""
    states: Array
    """Packed `ChannelState`, shape (c, STATE_SIZE)."""
    faults: Array
    """Packed `SensorFault`, shape (f, FAULT_SIZE), in the order in which they act."""
    noise: Array
    """Standard normal numbers, shape (c + f, any)."""
    column: Array
    """Column of `noise` that is used next, shape (1,), integer."""
    effects: Array
    """Packed `ReadingEffect`, shape (m, EFFECT_SIZE)."""
    line: DelayLine


CHANNEL_SIZE, STATE_SIZE = len(ChannelParameters._fields), len(ChannelState._fields)
FAULT_SIZE, EFFECT_SIZE = len(SensorFault._fields), len(ReadingEffect._fields)
_TURNS = ChannelParameters._fields.index("turns")


@kernel
def wrap(angle):
    """Wrap an angle to [0, 2π) [rad]."""
    turned = angle - _TURN * math.floor(angle / _TURN)
    return 0.0 if turned >= _TURN else max(turned, 0.0)


@kernel
def quantise(value, full_scale, step):
    """Round to the nearest code of a two's complement converter, clipped to −range … range − step.

    Args:
      value: Input.
      full_scale: Range (±), in the unit of the input.
      step: Resolution, in the unit of the input; 0: none, the value is only clipped.
    """
    if step > 0.0:
        return min(max(np.rint(value / step) * step, -full_scale), full_scale - step)
    return min(max(value, -full_scale), full_scale)


@kernel
def step_encoder(channel, state, speed, noise):
    """Take one sample of an encoder; `filtered` is then the speed from its counts [rad/s].

    The angle is the sum of speed × period; its drift is irrelevant, since only differences are used. Behind
    the dead band (play of width h) the angle moves only once the shaft has taken up h.

    Args:
      channel: `ChannelParameters`.
      state: `ChannelState` before the sample.
      speed: Speed of the shaft [rad/s].
      noise: Standard normal number.

    Returns:
      `ChannelState` after the sample.
    """
    angle = state.angle + min(max(speed * channel.period, -_MAX_ANGLE_STEP), _MAX_ANGLE_STEP)
    seen = angle + channel.noise * noise
    half = 0.5 * channel.hysteresis
    behind = min(max(state.behind, seen - half), seen + half)
    counted = np.rint(behind / channel.count) * channel.count
    raw = (counted - state.counted) / channel.period
    filtered = channel.decay * state.filtered + (1.0 - channel.decay) * raw
    return ChannelState(angle, behind, counted, filtered, state.bias, state.samples, state.last)


@kernel
def hold_heading(channel, state, yaw):
    """Take one sample of the heading; `filtered` is then the held angle, rounded by the converter [rad].

    Args:
      channel: `ChannelParameters`.
      state: `ChannelState` before the sample.
      yaw: True heading, wrapped or not [rad].

    Returns:
      `ChannelState` after the sample.
    """
    now = math.floor(state.samples * channel.updates + _TIME_TOLERANCE)
    before = math.floor((state.samples - 1.0) * channel.updates + _TIME_TOLERANCE)
    held = state.filtered
    if now > before:
        held = wrap(np.rint(wrap(yaw) / channel.step) * channel.step)
    return _with_filtered(state, held, state.samples + 1.0)


@kernel
def _with_filtered(state, filtered, samples):
    return ChannelState(state.angle, state.behind, state.counted, filtered, state.bias, samples, state.last)


@kernel
def apply_chain(channel, state, value, noise):
    """Reading of a sensor before its faults, and the channel's next state.

    A quantity that is not finite yields NaN and leaves the state unchanged, so that it affects one reading
    only.

    Args:
      channel: `ChannelParameters`.
      state: `ChannelState`.
      value: Physical quantity.
      noise: Standard normal number.
    """
    if not math.isfinite(value):
        return math.nan, state
    law = channel.law
    if law == IDEAL:
        return wrap(value) if channel.turns == 1.0 else value, state
    if law == HEADING:
        state = hold_heading(channel, state, value)
        return state.filtered, state
    x = channel.gain * value
    if law == ENCODER:
        state = step_encoder(channel, state, x, noise)
        x = state.filtered
    elif law == FILTERED:
        share = 1.0 - channel.decay
        x = channel.decay * state.filtered + share * (x + channel.noise * noise)
        state = _with_filtered(state, x, state.samples)
        x += state.bias
    else:
        x += channel.noise * noise
    x = quantise(quantise(x, channel.full_scale, channel.step), channel.full_scale, channel.daq_step)
    return x / channel.gain, state


@kernel
def apply_fault(fault, reading, last, time, noise):
    """Apply a sensor fault, Fig. 2.14: bias, freezing, drift, loss of accuracy, or wrong scale.

    Args:
      fault: `SensorFault`.
      reading: Reading of the channel without the fault.
      last: Reading of the previous sample.
      time: Time of the sample [s].
      noise: Standard normal number.
    """
    if time + _TIME_TOLERANCE < fault.onset or time + _TIME_TOLERANCE >= fault.end:
        return reading, math.nan
    mode = fault.mode
    if mode == BIASED:
        return reading + fault.size, fault.held
    if mode == DRIFTING:
        return reading + fault.size * (time - fault.onset), fault.held
    if mode == NOISY:
        return reading + fault.size * noise, fault.held
    if mode == SCALED:
        return reading * fault.size, fault.held
    held = fault.held
    if math.isnan(held):
        held = reading if math.isnan(last) else last
    return held, held


def empty_delay_line(effects: Array) -> DelayLine:
    """Delay line before the first sample.

    Args:
      effects: Packed `ReadingEffect`, shape (m, EFFECT_SIZE).
    """
    late = effects[:, ReadingEffect._fields.index("late")]
    return DelayLine(np.zeros((len(effects), int(late.max(initial=0.0)) + 2)), np.zeros(len(effects), int))


@kernel
def _delayed(effect, past, filled):
    """Reading of the delay line, interpolated between samples; an angle along the shorter arc."""
    whole = int(effect.late)
    newer, older = past[max(filled - 1 - whole, 0)], past[max(filled - 2 - whole, 0)]
    step = older - newer
    if effect.turns == 1.0 and math.isfinite(step):
        step -= _TURN * np.rint(step / _TURN)
        return wrap(newer + (effect.late - whole) * step)
    return newer + (effect.late - whole) * step if effect.late > whole else newer


@kernel
def apply_effects(effects, line, readings):
    """Apply the effects to one sample of all channels, in place.

    Args:
      effects: Packed `ReadingEffect`, shape (m, EFFECT_SIZE).
      line: `DelayLine`, changed in place.
      readings: Shape (c,).
    """
    for k in range(effects.shape[0]):
        effect = ReadingEffect(*first_numbers(effects[k], EFFECT_SIZE))
        c, past, kept = int(effect.channel), line.past[k], int(effect.late) + 2
        value = effect.scale * readings[c] + effect.offset
        if effect.turns == 1.0 and math.isfinite(value):
            value = wrap(value)
        if effect.late > 0.0:
            if line.filled[k] == kept:
                past[: kept - 1] = past[1:kept].copy()
            else:
                line.filled[k] += 1
            past[line.filled[k] - 1] = value
            value = _delayed(effect, past, line.filled[k])
        readings[c] = value


@kernel
def read_sensors(sensors, time, values):
    """Take one reading of every channel, with faults and effects, and move on to the next random numbers.

    Args:
      sensors: `SensorChain`, changed in place.
      time: Time of the sample [s].
      values: Physical quantities, shape (c,).

    Returns:
      Readings, a new array of shape (c,).
    """
    channels, states, faults, noise = sensors.channels, sensors.states, sensors.faults, sensors.noise
    column = sensors.column[0]
    sensors.column[0] = column + 1
    count = channels.shape[0]
    readings, last = np.empty(count), STATE_SIZE - 1
    for c in range(count):
        channel = ChannelParameters(*first_numbers(channels[c], CHANNEL_SIZE))
        state = ChannelState(*first_numbers(states[c], STATE_SIZE))
        readings[c], state = apply_chain(channel, state, values[c], noise[c, column])
        store(state, states[c])
    for f in range(faults.shape[0]):
        fault = SensorFault(*first_numbers(faults[f], FAULT_SIZE))
        c = int(fault.channel)
        found = apply_fault(fault, readings[c], states[c, last], time, noise[count + f, column])
        readings[c], faults[f, FAULT_SIZE - 1] = found
    for c in range(count):
        if channels[c, _TURNS] == 1.0 and math.isfinite(readings[c]):
            readings[c] = wrap(readings[c])
        states[c, last] = readings[c]
    apply_effects(sensors.effects, sensors.line, readings)
    return readings
