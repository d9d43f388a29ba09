"""Replays of rig runs in compiled code: equations driven by measured currents, and what sensors say."""

from __future__ import annotations

import math

import numpy as np

from omnimj.physics import rig
from omnimj.physics.effect_terms import terms_at
from omnimj.physics.motor import achievable_current, motor_at
from omnimj.physics.native import kernel
from omnimj.physics.traction import traction_at

WHEEL, CARRIAGE, ACCELERATION = range(3)
OUTPUTS = 3
"""Columns of a replay: wheel speed [rad/s], carriage speed [m/s], its acceleration [m/s²]."""


@kernel
def replay_runs(current, lateral, first, rows, motor, floors, terms, start, h, steps, out):
    """Drives every run from its start with the current that the next sample shows.

    Args:
      current: Measured current of all runs, one behind the other, shape (samples,) [A].
      lateral: Speed of the gantry, shape (samples,) [m/s].
      first: First sample of every run and the end of the last, shape (runs + 1,).
      rows: Packed `rig.RigParameters` of every run, shape (runs, RIG_SIZE).
      motor: Packed motor that a measured current passes unclipped, shape (MOTOR_SIZE,).
      floors: Packed traction of every run, shape (runs, TRACTION_SIZE).
      terms: Packed effect terms, shape (TERMS,).
      start: Carriage and wheel speed at the start, shape (runs, 2).
      h: Step [s].
      steps: Steps per sample.
      out: Filled, shape (samples, OUTPUTS).
    """
    driving, effects = motor_at(motor), terms_at(terms)
    for k in range(len(rows)):
        model = rig.RigModel(rig.rig_at(rows[k]), driving, traction_at(floors[k]), effects, False)
        state = rig.RigState(start[k, 0], start[k, 1], 0.0, current[first[k]], 0.0, 0.0, 0.0, 0.0, 0.0)
        out[first[k], WHEEL], out[first[k], CARRIAGE] = start[k, 1], start[k, 0]
        out[first[k], ACCELERATION] = 0.0
        for n in range(first[k], first[k + 1] - 1):
            between = 0.5 * (current[n] + current[n + 1])
            state, output = rig.step(state, between, lateral[n], model, h, steps)
            out[n + 1, WHEEL] = output.encoder_speed
            out[n + 1, CARRIAGE] = state.speed
            out[n + 1, ACCELERATION] = output.acceleration


@kernel
def observe(series, first, blocks_first, size, lag, delay, scale, offset, result):
    """Block means of what a sensor says: first-order lag, pure delay, scale, offset.

    y(t) = scale · x_f(t − delay) + offset, ẋ_f = (x − x_f)/lag; a block's mean comes from the running sum,
    straight between samples, so that a delay need not be a whole number of samples.

    Args:
      series: x of all runs, shape (samples,).
      first: First sample of every run and the end of the last, shape (runs + 1,).
      blocks_first: First block of every run and the end of the last, shape (runs + 1,).
      size: Samples per block.
      lag: In samples.
      delay: In samples; a negative one reads ahead.
      scale: Factor.
      offset: In the unit of the channel.
      result: Filled, shape (blocks,).
    """
    keep = math.exp(-1.0 / lag) if lag > 0.0 else 0.0
    for k in range(len(first) - 1):
        begin, count = first[k], first[k + 1] - first[k]
        sums = np.empty(count + 1)
        sums[0], filtered = 0.0, series[begin]
        for n in range(count):
            filtered = keep * filtered + (1.0 - keep) * series[begin + n]
            sums[n + 1] = sums[n] + filtered
        for b in range(blocks_first[k + 1] - blocks_first[k]):
            low = _running(sums, b * size - delay, series[begin], filtered)
            high = _running(sums, (b + 1) * size - delay, series[begin], filtered)
            result[blocks_first[k] + b] = scale * (high - low) / size + offset


@kernel
def _running(sums, place, before, after):
    """The running sum at a place between samples; constant values before the start and behind the end."""
    last = len(sums) - 1
    if place <= 0.0:
        return place * before
    if place >= last:
        return sums[last] + (place - last) * after
    n = int(place)
    return sums[n] + (place - n) * (sums[n + 1] - sums[n])


@kernel
def delivered_current(target, wheel_speed, motor):
    """What the amplifier drives of a set value at a wheel speed, shape (samples,) [A]."""
    found, driving = np.empty(len(target)), motor_at(motor)
    for n in range(len(target)):
        found[n] = achievable_current(driving, target[n], wheel_speed[n])
    return found
