"""Compiled replay of a robot's missions: a follower of the measured wheel speeds.

The wheels turn as measured, traction drives the body (with a time constant m/(2 σ₂ F_N) of 0.1 s,
so that nothing drifts and the body's velocity need not be measured), and inverse dynamics give the current
missing at every wheel,
  Δi_k = I (Δφ̇_k/h − φ̈(i_k, slip, friction))/(K_t G_r E).
Friction sticks and slips: a wheel at rest inside its stiction needs no current.

Step k is the bin of the log around t_k: currents and speeds are means over it, forces those at its middle.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from omnimj.physics.effect_terms import TERM, terms_at
from omnimj.physics.native import kernel
from omnimj.physics.planar import (
    PlanarModel,
    output_size,
    planar_output,
    planar_state,
    state_size,
    step,
)
from omnimj.physics.planar_wheel import POSITION_X, POSITION_Y, planar_wheel_at
from omnimj.signals import Array

START, END, FIRST_BLOCK = range(3)
STRETCH = 3
"""Columns of the table of stretches without gaps: steps start … end − 1, and the first row of blocks."""

WHEELS = 4
CURRENT, SPEED, ACCELERATION, YAW_RATE, YAW = 0, 4, 8, 10, 11
CHANNELS = 12
"""Columns of the blocks, in the order of the robot's channels."""

LATE, SCALE, OFFSET = range(3)
"""Rows of the sensor table: delay [steps], scale and offset of every channel; shape (3, CHANNELS)."""

LOOSE_PARTS = 4
"""Substeps of the follower of a robot with backlash."""

_STATE, _OUTPUT = state_size(WHEELS), output_size(WHEELS)
_BACKLASH = TERM["backlash"]


class Log(NamedTuple):
    """Measured missions, all stretches concatenated."""

    stretches: NDArray[np.int64]
    """Table of stretches, shape (stretches, STRETCH)."""
    start: Array
    """Body twist at each start, shape (stretches, 3)."""
    times: Array
    """Time since the start of the run, shape (steps,) [s]."""
    current: Array
    """Measured currents, shape (steps, 4) [A]."""
    speed: Array
    """Wheel speeds, shape (steps, 4) [rad/s]."""
    yaw: Array
    """Heading, unwrapped, shape (steps, 1) [rad]."""
    heading: Array
    """Measured heading of every block, NaN where masked, shape (blocks,) [rad]."""


class KernelParameters(NamedTuple):
    """Robot with its effects and floors, for every stretch of a log."""

    bodies: Array
    """Packed body of each stretch, shape (stretches, BODY_SIZE)."""
    wheels: Array
    """Packed wheels of each stretch, shape (stretches, 4, PLANAR_WHEEL_SIZE)."""
    motors: Array
    """Packed motors that measured currents pass unclipped, shape (4, MOTOR_SIZE)."""
    floors: Array
    """Packed traction of each stretch, shape (stretches, TRACTION_SIZE)."""
    terms: Array
    """Packed effect terms, shape (4, TERMS)."""
    sensors: Array
    """Delay [steps], scale and offset of every channel, shape (3, CHANNELS)."""
    current_per_torque: Array
    """Current per torque at each wheel, shape (4,) [A/(N.m)]."""


class Rollers(NamedTuple):
    """Rows of rollers under the wheels."""

    table: Array
    """`roller_tables`, shape (3, points); (3, 0) for wheels without rollers."""
    phases: Array
    """Angle of each wheel at the start of each stretch, shape (stretches, 4) [rad]."""


class Sampling(NamedTuple):
    """Time grid of a replay."""

    step: float
    """Time of a step [s]."""
    block: int
    """Steps per block."""
    window: int
    """Steps of a window of the heading, a multiple of `block`."""


class _Stretch(NamedTuple):
    """Log of one stretch, beginning at its first step."""

    block: int
    """First row of blocks."""
    start: Array
    """Body twist at the start, shape (3,)."""
    times: Array
    """Time since the start of the run, shape (steps,) [s]."""
    current: Array
    """Measured currents, shape (steps, 4) [A]."""
    speed: Array
    """Wheel speeds, shape (steps, 4) [rad/s]."""
    yaw: Array
    """Heading, unwrapped, shape (steps, 1) [rad]."""


class _Follower(NamedTuple):
    """Robot on one stretch."""

    model: PlanarModel
    sensors: Array
    current_per_torque: Array
    rollers: Array
    phase: Array
    """Angle of the rollers at the start, shape (4,) [rad]."""


class _Part(NamedTuple):
    """Part of a step, over which the wheels are followed."""

    place: float
    """Place in the log [steps]."""
    share: float
    """Length of the part [steps]."""
    h: float
    """Length of the part [s]."""
    angle: Array
    """Angles of the wheels at the start of the part, shape (4,) [rad]."""
    loose: Array
    """1 for a rotor inside its play at the start, shape (4,)."""


@kernel
def value_at(values, column, place):
    """Interpolate a column of a table, shape (steps, columns), linearly in rows; constant beyond them."""
    place = min(max(place, 0.0), float(len(values) - 1))
    below = min(int(place), max(len(values) - 2, 0))
    share = place - below
    return (1.0 - share) * values[below, column] + share * values[min(below + 1, len(values) - 1), column]


@kernel
def _true_value(values, sensors, channel, column, place):
    """True value behind a channel at a step: delay, scale and offset of the sensor undone."""
    logged = value_at(values, column, place + sensors[LATE, channel])
    return (logged - sensors[OFFSET, channel]) / sensors[SCALE, channel]


@kernel
def _impose_wheel_speeds(state, place, speed, sensors, terms):
    """Set every wheel's speed (the rotor's, inside the play of a gear) to the measured one."""
    for i in range(WHEELS):
        measured = _true_value(speed, sensors, SPEED + i, i, place)
        if terms[i, _BACKLASH] != 0.0 and state.backlash_rate[i] != 0.0:
            state.backlash_rate[i] = measured - state.wheel_speed[i]
        else:
            state.wheel_speed[i] = measured


@kernel
def _add_missing_currents(state, encoder_speed, part, speed, follower, missing):
    """Add the current missing at each wheel over a part of a step; correct the angles of the wheels."""
    model, sensors = follower.model, follower.sensors
    for i in range(WHEELS):
        after = _true_value(speed, sensors, SPEED + i, i, part.place + part.share)
        behind = _true_value(speed, sensors, SPEED + i, i, part.place - part.share)
        measured = _true_value(speed, sensors, SPEED + i, i, part.place)
        rotor, wheel = terms_at(model.terms[i]).rotor_inertia, planar_wheel_at(model.wheels[i]).wheel
        inertia = rotor if part.loose[i] else wheel.inertia
        lacking = 0.5 * (after - behind) - (encoder_speed[i] - measured)
        missing[i] += part.share * inertia * lacking / part.h * follower.current_per_torque[i]
        if model.terms[i, _BACKLASH] == 0.0:
            state.angle[i] = part.angle[i] + part.h * measured


@kernel
def _place_wheels(state, follower, wheels):
    """Move the contact of every wheel to the roller that carries it."""
    for i in range(WHEELS):
        away = _at_roller_angle(follower.rollers, 0, state.angle[i] + follower.phase[i])
        wheel = planar_wheel_at(follower.model.wheels[i])
        wheels[i, POSITION_X] = wheel.position_x - away * wheel.drive_y
        wheels[i, POSITION_Y] = wheel.position_y + away * wheel.drive_x


@kernel
def _at_roller_angle(rollers, row, angle):
    """Row of the roller table at an angle of the wheel [rad]; rollers[2, 0] is the pitch."""
    points = rollers.shape[1]
    place = angle / rollers[2, 0]
    place = (place - np.floor(place)) * points
    below = min(int(place), points - 1)
    share = place - below
    return (1.0 - share) * rollers[row, below] + share * rollers[row, (below + 1) % points]


@kernel
def _follow(stretch, follower, period, followed):
    """Follow the measured wheel speeds over one stretch."""
    n, model, sensors = WHEELS, follower.model, follower.sensors
    row, command, row_out = np.zeros(_STATE), np.empty(n), np.zeros(_OUTPUT)
    state, output = planar_state(row), planar_output(row_out)
    loose, angle = np.zeros(n), np.empty(n)
    has_rollers, under = follower.rollers.shape[1] > 0, model.wheels.copy()
    on_rollers = PlanarModel(model.body, under, model.motors, model.floors, model.terms, False)
    # a wheel inside the play of its gear has little inertia: it comes to rest on the floor within 2 ms
    parts = LOOSE_PARTS if model.terms[:, _BACKLASH].any() else 1
    state.twist[:] = stretch.start
    state.clock[0] = stretch.times[0]
    turned = 0.0
    followed[:, :6] = 0.0
    for k in range(len(stretch.times)):
        heading = _true_value(stretch.yaw, sensors, YAW, 0, k)
        state.pose[2] = heading
        followed[k, 6], followed[k, 7] = state.twist[2], turned
        for j in range(parts):
            part = _Part(k + j / parts, 1.0 / parts, period / parts, angle, loose)
            _impose_wheel_speeds(state, part.place, stretch.speed, sensors, model.terms)
            for i in range(n):
                command[i] = _true_value(stretch.current, sensors, CURRENT + i, i, part.place)
                is_loose = model.terms[i, _BACKLASH] != 0.0 and state.backlash_rate[i] != 0.0
                loose[i] = 1.0 if is_loose else 0.0
                angle[i] = state.angle[i]
            if has_rollers:
                _place_wheels(state, follower, under)
                for i in range(n):  # the torque of the load acts like any other: stiction may hold it
                    torque = _at_roller_angle(follower.rollers, 1, angle[i] + follower.phase[i])
                    command[i] += torque * output.normal[i] * follower.current_per_torque[i]
            step(row, command, on_rollers, part.h, 1, row_out)
            followed[k, 4] += output.acceleration[0] / parts
            followed[k, 5] += output.acceleration[1] / parts
            _add_missing_currents(state, output.encoder_speed, part, stretch.speed, follower, followed[k])
        turned += state.pose[2] - heading


@kernel
def _block_means(stretch, sensors, followed, size, blocks):
    """Average the simulated sensors of one stretch over blocks, from the results of `_follow`.

    The wheel speeds are those measured and stay out.
    """
    row = stretch.block
    for first in range(0, len(stretch.times) - size + 1, size):
        for c in range(CHANNELS):
            if SPEED <= c < ACCELERATION:
                continue
            total, late = 0.0, sensors[LATE, c]
            for k in range(first, first + size):
                if c < SPEED:
                    total += stretch.current[k, c] + sensors[SCALE, c] * value_at(followed, c, k - late)
                else:
                    total += sensors[SCALE, c] * value_at(followed, c - 4, k - late) + sensors[OFFSET, c]
            blocks[row, c] = total / size
        row += 1


@kernel
def turns_in_windows(stretches, window, size, measured, turned):
    """Subtract the mean over each window from the angle turned.

    Args:
      measured: Measured heading, NaN where masked, shape (blocks,) [rad]; masked blocks do not count.
      turned: Angle, changed in place, shape (blocks,) [rad].
    """
    per = window // size
    for s in range(len(stretches)):
        count = (stretches[s, END] - stretches[s, START]) // size
        for first in range(0, count, per):
            a = stretches[s, FIRST_BLOCK] + first
            b = stretches[s, FIRST_BLOCK] + min(first + per, count)
            total, used = 0.0, 0
            for row in range(a, b):
                if np.isfinite(measured[row]):
                    total += turned[row]
                    used += 1
            if used:
                for row in range(a, b):
                    turned[row] -= total / used


@kernel
def replay(log, parameters, rollers, sampling, blocks):
    """Replay all stretches of all runs under one setting.

    Args:
      blocks: Filled with block means except of the wheel speeds, shape (blocks, CHANNELS).
    """
    sensors = parameters.sensors
    for s in range(len(log.stretches)):
        a, b = log.stretches[s, START], log.stretches[s, END]
        floors = np.empty((WHEELS, parameters.floors.shape[1]))
        for i in range(WHEELS):
            floors[i] = parameters.floors[s]
        model = PlanarModel(
            parameters.bodies[s], parameters.wheels[s], parameters.motors, floors, parameters.terms, False
        )
        follower = _Follower(model, sensors, parameters.current_per_torque, rollers.table, rollers.phases[s])
        stretch = _Stretch(
            log.stretches[s, FIRST_BLOCK],
            log.start[s],
            log.times[a:b],
            log.current[a:b],
            log.speed[a:b],
            log.yaw[a:b],
        )
        followed = np.empty((b - a, 8))
        _follow(stretch, follower, sampling.step, followed)
        _block_means(stretch, sensors, followed, sampling.block, blocks)
    turns_in_windows(log.stretches, sampling.window, sampling.block, log.heading, blocks[:, YAW])


@kernel
def drive(current, model, h, substeps, truth):
    """Drive the robot from rest by given currents.

    Args:
      current: Shape (steps, 4) [A].
      model: `PlanarModel`, motors driven by measured currents.
      h: Time of a step [s].
      truth: Filled with the true values of all channels at each step, shape (steps, CHANNELS).
    """
    row, row_out = np.zeros(_STATE), np.zeros(_OUTPUT)
    state, output = planar_state(row), planar_output(row_out)
    for k in range(len(current)):
        for i in range(WHEELS):
            truth[k, CURRENT + i] = current[k, i]
            truth[k, SPEED + i] = state.wheel_speed[i] + state.backlash_rate[i]
        truth[k, YAW_RATE], truth[k, YAW] = state.twist[2], state.pose[2]
        before_x, before_y = 0.0, 0.0
        for _ in range(substeps):
            step(row, current[k], model, h / substeps, 1, row_out)
            before_x += output.acceleration[0] / substeps
            before_y += output.acceleration[1] / substeps
        truth[k, ACCELERATION], truth[k, ACCELERATION + 1] = before_x, before_y
