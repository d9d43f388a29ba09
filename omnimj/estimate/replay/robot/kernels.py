"""Replays of a robot's missions: equations that follow the measured wheels, and windows left to themselves.

Following: the wheels turn as measured, traction pulls the body along (with a time constant m/(2 σ₂ F_N) of
0.1 s, so that nothing drifts and the body's velocity need not be measured), and the torque balance of every
wheel says which current it lacks,
  Δi_k = I (Δφ̇_k/h − φ̈(i_k, slip, friction))/(K_t G_r E).
Friction sticks and slips as it would: a wheel at rest inside its stiction lacks nothing.

Left to itself: a window starts from the follower's state and is driven by the measured currents alone.

Step k is the bin of the log around t_k: currents and speeds are means over it, forces those at its middle.
"""

from __future__ import annotations

import numpy as np

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

START, END, FIRST_BLOCK = range(3)
STRETCH = 3
"""Numbers of a stretch without gaps: steps start … end − 1 and its first row of blocks."""

WHEELS = 4
CURRENT, SPEED, ACCELERATION, YAW_RATE, YAW = 0, 4, 8, 10, 11
CHANNELS = 12
"""Columns of the blocks: those of `plant.channels.robot_channels`."""

LATE, SCALE, OFFSET = range(3)
"""What a channel makes of the truth: late by so many steps, scale · truth + offset; shape (3, CHANNELS)."""

LOOSE_PARTS = 4
"""Parts of a step in which a robot with play in its gears is followed."""

_STATE, _OUTPUT = state_size(WHEELS), output_size(WHEELS)
_BACKLASH = TERM["backlash"]


@kernel
def value_at(values, column, place):
    """Linear between rows, constant beyond them."""
    place = min(max(place, 0.0), float(len(values) - 1))
    below = min(int(place), max(len(values) - 2, 0))
    share = place - below
    return (1.0 - share) * values[below, column] + share * values[min(below + 1, len(values) - 1), column]


@kernel
def _read(values, sensors, channel, column, place):
    """Truth behind a channel at a step: what was logged later, scale and offset undone."""
    said = value_at(values, column, place + sensors[LATE, channel])
    return (said - sensors[OFFSET, channel]) / sensors[SCALE, channel]


@kernel
def _impose_wheel_speeds(state, k, speed, sensors, terms):
    """Sets every wheel's speed (the rotor's, inside the play of a gear) to the measured one."""
    for i in range(WHEELS):
        measured = _read(speed, sensors, SPEED + i, i, k)
        if terms[i, _BACKLASH] != 0.0 and state.backlash_rate[i] != 0.0:
            state.backlash_rate[i] = measured - state.wheel_speed[i]
        else:
            state.wheel_speed[i] = measured


@kernel
def _add_missing_currents(
    state, place, ahead, speed, sensors, terms, wheels, before, loose, seen, h, unit, missing
):
    """Adds the current that each wheel lacks in a step of h seconds [A]; puts the wheels' angles right.

    Args:
      place: Where the log is, in steps of the log.
      ahead: How much of such a step h is.
      before: Angles before the step.
      loose: Which rotors were inside their play before it.
      seen: Encoders' speeds after it.
      missing: Shape (4,).
    """
    for i in range(WHEELS):
        after = _read(speed, sensors, SPEED + i, i, place + ahead)
        behind = _read(speed, sensors, SPEED + i, i, place - ahead)
        measured = _read(speed, sensors, SPEED + i, i, place)
        rotor, wheel = terms_at(terms[i]).rotor_inertia, planar_wheel_at(wheels[i]).wheel
        inertia = rotor if loose[i] else wheel.inertia
        missing[i] += ahead * inertia * (0.5 * (after - behind) - (seen[i] - measured)) / h * unit[i]
        if terms[i, _BACKLASH] == 0.0:
            state.angle[i] = before[i] + h * measured


@kernel
def _change_rows(state, wheels, rollers, phase, changed):
    """Puts every wheel where the rollers under it are."""
    for i in range(WHEELS):
        away, wheel = _at_roller_angle(rollers, 0, state.angle[i] + phase[i]), planar_wheel_at(wheels[i])
        changed[i, POSITION_X] = wheel.position_x - away * wheel.drive_y
        changed[i, POSITION_Y] = wheel.position_y + away * wheel.drive_x


@kernel
def _at_roller_angle(rollers, table, angle):
    """A table of the rollers at an angle [rad] of the wheel; rollers[2, 0] is the pitch."""
    points = rollers.shape[1]
    place = angle / rollers[2, 0]
    place = (place - np.floor(place)) * points
    below = min(int(place), points - 1)
    share = place - below
    return (1.0 - share) * rollers[table, below] + share * rollers[table, (below + 1) % points]


@kernel
def _start_free_window(state, k, count, current, sensors, model, h, window, substeps, begin, free):
    """Where a window begins: fills its row of `free` with the encoders' speeds under measured currents."""
    w = 0 if k == 0 else (k + begin) // window
    if (k > 0 and (k + begin) % window > 0) or w >= len(free):
        return
    alone, output, command = state.copy(), np.empty(_OUTPUT), np.empty(WHEELS)
    seen = planar_state(alone)
    row, last = k - w * window + begin, min((w + 1) * window, count)
    for j in range(k, last):
        for i in range(WHEELS):
            free[w, row + j - k, i] = seen.wheel_speed[i] + seen.backlash_rate[i]
        for part in range(substeps):
            for i in range(WHEELS):
                command[i] = _read(current, sensors, CURRENT + i, i, j + (part + 0.5) / substeps)
            step(alone, command, model, h / substeps, 1, output)
    for early in range(row):
        free[w, early] = free[w, row]


@kernel
def _follow(
    stretch, start, times, current, speed, yaw, sensors, model, rollers, phase, unit, h, window, substeps,
    begin, followed, free,
):  # fmt: skip
    """One stretch: fills what the follower lacks and does, and the free windows.

    Args:
      followed: Lacking currents (4), accelerations (2), yaw rate, turn since the start, shape (steps, 8).
      free: Speeds in the windows, `begin` steps before each window first, shape (windows, begin + window, 4).
    """
    n, count = WHEELS, stretch[END] - stretch[START]
    body, wheels, motors, floors, terms, _ = model
    row, command, row_out = np.zeros(_STATE), np.empty(n), np.zeros(_OUTPUT)
    state, output = planar_state(row), planar_output(row_out)
    loose, angle = np.zeros(n), np.empty(n)
    rolls, under = rollers.shape[1] > 0, wheels.copy()
    on_rollers = PlanarModel(body, under, motors, floors, terms, False)
    # a wheel that is loose in its gear is light: on the floor it comes to rest within two milliseconds
    parts = LOOSE_PARTS if terms[:, _BACKLASH].any() else 1
    state.twist[:] = start
    state.clock[0] = times[0]
    turned = 0.0
    followed[:, :6] = 0.0
    for k in range(count):
        heading = _read(yaw, sensors, YAW, 0, k)
        state.pose[2] = heading
        followed[k, 6], followed[k, 7] = state.twist[2], turned
        for part in range(parts):
            place = k + part / parts
            _impose_wheel_speeds(state, place, speed, sensors, terms)
            if part == 0 and substeps > 0:
                _start_free_window(row, k, count, current, sensors, model, h, window, substeps, begin, free)
            for i in range(n):
                command[i] = _read(current, sensors, CURRENT + i, i, place)
                free_rotor = terms[i, _BACKLASH] != 0.0 and state.backlash_rate[i] != 0.0
                loose[i] = 1.0 if free_rotor else 0.0
                angle[i] = state.angle[i]
            if rolls:
                _change_rows(state, wheels, rollers, phase, under)
                for i in range(n):  # the load's push is a torque like any other: stiction may hold it
                    command[i] += (
                        _at_roller_angle(rollers, 1, angle[i] + phase[i]) * output.normal[i] * unit[i]
                    )
            step(row, command, on_rollers, h / parts, 1, row_out)
            followed[k, 4] += output.acceleration[0] / parts
            followed[k, 5] += output.acceleration[1] / parts
            _add_missing_currents(
                state, place, 1.0 / parts, speed, sensors, terms, wheels, angle, loose, output.encoder_speed,
                h / parts, unit, followed[k],
            )  # fmt: skip
        turned += state.pose[2] - heading


@kernel
def _block_means(stretch, current, sensors, followed, free, window, begin, size, blocks):
    """Block means of what the sensors would have said."""
    count = stretch[END] - stretch[START]
    row = stretch[FIRST_BLOCK]
    for first in range(0, count - size + 1, size):
        w = first // window
        for c in range(CHANNELS):
            total, late = 0.0, sensors[LATE, c]
            for k in range(first, first + size):
                if c < SPEED:
                    total += current[k, c] + sensors[SCALE, c] * value_at(followed, c, k - late)
                elif c < ACCELERATION:
                    place = min(k - late, float(min((w + 1) * window, count) - 1)) - w * window + begin
                    total += sensors[SCALE, c] * value_at(free[w], c - SPEED, place) + sensors[OFFSET, c]
                else:
                    total += sensors[SCALE, c] * value_at(followed, c - 4, k - late) + sensors[OFFSET, c]
            blocks[row, c] = total / size
        row += 1


@kernel
def turns_in_windows(stretches, window, size, measured, turned):
    """Takes each window's mean, over the blocks in which `measured` is known, out of `turned`, (blocks,)."""
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
def replay(
    stretches, start, times, current, speed, yaw, heading, sensors, bodies, wheels, motors, floors, terms,
    rollers, phases, unit, h, size, window, substeps, blocks,
):  # fmt: skip
    """All stretches of all runs under one setting.

    Args:
      stretches: Shape (stretches, STRETCH).
      start: Body twist at each start, shape (stretches, 3).
      times: Time since the run's start of every step [s].
      current: Measured currents, shape (steps, 4) [A].
      speed: Measured wheel speeds, shape (steps, 4) [rad/s].
      yaw: Measured heading, unwrapped, shape (steps, 1) [rad].
      heading: What is measured of it, NaN where masked, shape (blocks,) [rad].
      sensors: Shape (3, CHANNELS).
      bodies: `PlanarConstants.body` of each stretch, shape (stretches, BODY_SIZE).
      wheels: `PlanarConstants.wheels` of each stretch, shape (stretches, 4, PLANAR_WHEEL_SIZE).
      motors: Driven by measured currents, shape (4, MOTOR_SIZE).
      floors: `Floor.row` of each stretch, shape (stretches, TRACTION_SIZE).
      terms: Effects, shape (4, TERMS).
      rollers: Tables of `robot_rollers` and in a third row the pitch, shape (3, points); (3, 0): without.
      phases: Angles of the wheels at each start, shape (stretches, 4) [rad].
      unit: Current per torque at each wheel, shape (4,) [A/(N.m)].
      h: Time of a step [s].
      size: Steps per block.
      window: Steps that a window is left to itself, a multiple of `size`.
      substeps: Steps of the free equations per step; 0: no window is left to itself.
      blocks: Filled, shape (blocks, CHANNELS).
    """
    begin = min(max(int(np.ceil(sensors[LATE, SPEED:ACCELERATION].max())), 0), window - 1)
    for s in range(len(stretches)):
        a, b = stretches[s, START], stretches[s, END]
        four = np.empty((WHEELS, floors.shape[1]))
        for i in range(WHEELS):
            four[i] = floors[s]
        model = PlanarModel(bodies[s], wheels[s], motors, four, terms, False)
        followed = np.empty((b - a, 8))
        free = np.zeros(((b - a + window - 1) // window, begin + window, WHEELS))
        log = (current[a:b], speed[a:b], yaw[a:b])
        _follow(
            stretches[s], start[s], times[a:b], log[0], log[1], log[2], sensors, model, rollers, phases[s],
            unit, h, window, substeps, begin, followed, free,
        )  # fmt: skip
        _block_means(stretches[s], log[0], sensors, followed, free, window, begin, size, blocks)
    turns_in_windows(stretches, window, size, heading, blocks[:, YAW])


@kernel
def drive(current, body, wheels, motors, floors, terms, h, substeps, said):
    """Drives the robot from rest by given currents.

    Args:
      current: Shape (steps, 4) [A].
      body: `PlanarConstants.body`.
      wheels: `PlanarConstants.wheels`.
      motors: Driven by measured currents, shape (4, MOTOR_SIZE).
      floors: `Floor.row` of each wheel, shape (4, TRACTION_SIZE).
      terms: Effects, shape (4, TERMS).
      h: Time of a step [s].
      substeps: Steps of the equations per step.
      said: Filled with the true values of all channels at the middle of each step, shape (steps, CHANNELS).
    """
    row, row_out = np.zeros(_STATE), np.zeros(_OUTPUT)
    state, output = planar_state(row), planar_output(row_out)
    model = PlanarModel(body, wheels, motors, floors, terms, False)
    for k in range(len(current)):
        for i in range(WHEELS):
            said[k, CURRENT + i] = current[k, i]
            said[k, SPEED + i] = state.wheel_speed[i] + state.backlash_rate[i]
        said[k, YAW_RATE], said[k, YAW] = state.twist[2], state.pose[2]
        before_x, before_y = 0.0, 0.0
        for _ in range(substeps):
            step(row, current[k], model, h / substeps, 1, row_out)
            before_x += output.acceleration[0] / substeps
            before_y += output.acceleration[1] / substeps
        said[k, ACCELERATION], said[k, ACCELERATION + 1] = before_x, before_y
