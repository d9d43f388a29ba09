"""Compiled replay of rig runs: equations driven by measured currents, and block means of the sensors."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from omnimj.physics import rig
from omnimj.physics.effect_terms import ACTIVE, TERM, apply_motor_effects, terms_at
from omnimj.physics.motor import TORQUE_SCALE, achievable_current, motor_at
from omnimj.physics.native import kernel
from omnimj.physics.traction import traction_at
from omnimj.signals import Array

WHEEL, CARRIAGE, ACCELERATION = range(3)
_CABLE = TERM["cable_force"]
OUTPUTS = 3
"""Columns of a replay: wheel speed [rad/s], carriage speed [m/s], its acceleration [m/s²]."""


class Log(NamedTuple):
    """Inputs of all runs, concatenated."""

    current: Array
    """Motor current, shape (samples,) [A]."""
    lateral: Array
    """Speed of the gantry, shape (samples,) [m/s]."""
    first: NDArray[np.int_]
    """First sample of every run and the end of the last, shape (runs + 1,)."""
    start: Array
    """Carriage [m/s] and wheel speed [rad/s] at the start, shape (runs, 2)."""
    angle: Array
    """Measured angle of the wheel since the start of its run, shape (samples,), or shape (0,): the simulated
    one [rad]."""


class KernelParameters(NamedTuple):
    """Rig with its effects and floors, for every run."""

    rigs: Array
    """Packed `rig.RigParameters`, shape (runs, RIG_SIZE)."""
    motor: Array
    """Packed motor, shape (MOTOR_SIZE,)."""
    floors: Array
    """Packed traction, shape (runs, TRACTION_SIZE)."""
    terms: Array
    """Packed effect terms, shape (TERMS,)."""
    changes: Array
    """Change of the force per ampere at the axle and on the carriage: at rest, at half of the largest speed
    and at the largest, shape (2, 3) [1]."""
    fastest: float
    """Largest speed [m/s]."""


class BlockLayout(NamedTuple):
    """Samples and blocks of all runs."""

    first: NDArray[np.int_]
    """First sample of every run and the end of the last, shape (runs + 1,)."""
    blocks_first: NDArray[np.int_]
    """First block of every run and the end of the last, shape (runs + 1,)."""
    size: int
    """Samples per block."""


class SensorModel(NamedTuple):
    """y(t) = scale · x_f(t − delay) + offset, ẋ_f = (x − x_f)/lag."""

    lag: float
    """Time constant of the filter [samples]."""
    delay: float
    """Delay [samples]; negative for a channel that leads."""
    scale: float
    offset: float
    """Offset [unit of the channel]."""


@kernel
def replay_runs(log, parameters, h, steps, out):
    """Simulate every run from its start; the current is interpolated linearly between samples.

    What repeats with the turn of the wheel has the phase of the measured angle: after a few turns a simulated
    one would be off by more than a period of the rollers.

    Args:
      h: Step of the integration [s].
      out: Filled with wheel speed, carriage speed and acceleration, shape (samples, OUTPUTS).
    """
    current, first, start = log.current, log.first, log.start
    driving, effects = motor_at(parameters.motor), terms_at(parameters.terms)
    changes = bool(np.any(parameters.changes))
    for k in range(len(start)):
        model = rig.RigModel(
            rig.rig_at(parameters.rigs[k]), driving, traction_at(parameters.floors[k]), effects, False
        )
        state = rig.RigState(start[k, 0], start[k, 1], 0.0, current[first[k]], 0.0, 0.0, 0.0, 0.0, 0.0)
        out[first[k], WHEEL], out[first[k], CARRIAGE] = start[k, 1], start[k, 0]
        out[first[k], ACCELERATION] = 0.0
        for n in range(first[k], first[k + 1] - 1):
            if log.angle.size:
                state = with_angle(state, log.angle[n])
            between = 0.5 * (current[n] + current[n + 1])
            if changes:
                model = with_changed_force(model, parameters, state.speed, between)
            state, output = rig.step(state, between, log.lateral[n], model, h, steps)
            out[n + 1, WHEEL] = output.encoder_speed
            out[n + 1, CARRIAGE] = state.speed
            out[n + 1, ACCELERATION] = output.acceleration


@kernel
def with_changed_force(model, parameters, speed, current):
    """`RigModel` with the force per ampere of a speed.

    Args:
      model: `RigModel`.
      parameters: `KernelParameters`.
      speed: Of the carriage [m/s].
      current: Of the motor [A].
    """
    place = min(2.0 * abs(speed) / parameters.fastest, 2.0)
    below = min(int(place), 1)
    share, changes = place - below, parameters.changes
    axle = (1.0 - share) * changes[0, below] + share * changes[0, below + 1]
    carriage = (1.0 - share) * changes[1, below] + share * changes[1, below + 1]
    own, row, motor = parameters.motor.copy(), parameters.terms.copy(), model.motor
    per_ampere = motor.torque_constant * motor.gear_ratio * motor.gear_efficiency / model.rig.wheel.radius
    row[_CABLE] += carriage * per_ampere * current
    row[ACTIVE] = 1.0
    own[TORQUE_SCALE] *= 1.0 + axle
    return rig.RigModel(model.rig, motor_at(own), model.floor, terms_at(row), model.published)


@kernel
def with_angle(state, angle):
    """`RigState` with another wheel angle [rad]."""
    return rig.RigState(
        state.speed,
        state.wheel_speed,
        state.bristle,
        state.current,
        state.position,
        angle,
        state.time,
        state.backlash,
        state.backlash_rate,
    )


@kernel
def observe(series, layout, sensor, result):
    """Average a simulated sensor over blocks.

    A block's mean comes from the running sum, interpolated linearly between samples, so that a delay need not
    be a whole number of samples.

    Args:
      series: x of all runs, shape (samples,).
      result: Filled with the block means, shape (blocks,).
    """
    first, blocks_first, size = layout.first, layout.blocks_first, layout.size
    lag, delay = sensor.lag, sensor.delay
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
            result[blocks_first[k] + b] = sensor.scale * (high - low) / size + sensor.offset


@kernel
def _running(sums, place, before, after):
    """Running sum at a place between samples; values are constant before the start and after the end."""
    last = len(sums) - 1
    if place <= 0.0:
        return place * before
    if place >= last:
        return sums[last] + (place - last) * after
    n = int(place)
    return sums[n] + (place - n) * (sums[n + 1] - sums[n])


@kernel
def delivered_current(target, wheel_speed, motor, terms, layout, period):
    """Current that the amplifier delivers for a set value at a wheel speed, shape (samples,) [A].

    Args:
      target: Set value, shape (samples,) [A].
      wheel_speed: Shape (samples,) [rad/s].
      motor: Packed motor, shape (MOTOR_SIZE,).
      terms: Packed effect terms, shape (TERMS,): the supply sags, the winding warms up.
      period: Of a sample [s].
    """
    found, cold, effects = np.empty(len(target)), motor_at(motor), terms_at(terms)
    for k in range(len(layout.first) - 1):
        for n in range(layout.first[k], layout.first[k + 1]):
            warm = apply_motor_effects(cold, effects, (n - layout.first[k]) * period, 0.0)
            found[n] = achievable_current(warm, target[n], wheel_speed[n])
    return found
