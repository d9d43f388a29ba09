"""Carriage on a guide, driven by a force: one mass, or drive and carriage with play between them.

  m v' = k F − D(v) − b(v) v − c v |v| + F_0 − K (x − x_0)
D is dry friction, set-valued at rest; D and b may depend on the direction, and D may grow near standstill and
at one place on the guide. With play the drive's share of the mass crosses the gap alone and lands without
rebound; dry and viscous friction act on the carriage.

Kernels take the axis as a row of numbers, whose columns effects change.
"""

from __future__ import annotations

import math

from numba.np.unsafe.ndarray import to_fixed_tuple

from omnimj.physics.motor import stick_or_slip
from omnimj.physics.native import kernel

# the machine. MASS: all that moves, payload included; DRIVE_MASS: its share before the play; LOOP: lag of the
# amplifier; ENCODER: 1 where the position is taken at the drive, 0 at the carriage
MASS, DRIVE_MASS, COULOMB, VISCOUS, LIMIT, LOOP, ENCODER = range(7)
# what a model may lack, from `plant.axis.axis_row`; sensors: reading = scale × true + bias, later
ASYMMETRIC_COULOMB, ASYMMETRIC_VISCOUS, STRIBECK_FORCE, STRIBECK_VELOCITY = range(7, 11)
PLACE_FORCE, PLACE, PLACE_WIDTH, OFFSET, CABLE_STIFFNESS, CABLE_REST, AIR = range(11, 18)
FORCE_SCALE, PLAY, POSITION_SCALE, VELOCITY_SCALE, MONITOR_SCALE, MONITOR_BIAS = range(18, 24)
POSITION_DELAY, VELOCITY_DELAY, FORCE_DELAY = range(24, 27)
AXIS_ROW = 27

# state of the axis
POSITION, SPEED, GAP, DRIVE_SPEED, CHANGE = range(5)
"""Carriage position and speed; drive − carriage, within ± half the play; drive speed; last speed change."""
AXIS_STATE = 5


@kernel
def frozen(row):
    """Convert to a tuple, with which the kernels below are six times as fast as with an array."""
    return to_fixed_tuple(row, AXIS_ROW)  # type: ignore[reportCallIssue]


@kernel
def dry_friction(row, position, speed):
    """Dry friction in forward and in backward motion, both ≥ 0 [N].

    D± = C ± ΔC/2 + S exp(−(v/v_s)²) + P exp(−((x − x_P)/w)²/2)
    """
    dry = row[COULOMB]
    if row[STRIBECK_FORCE] != 0.0:
        dry += row[STRIBECK_FORCE] * math.exp(-((speed / row[STRIBECK_VELOCITY]) ** 2))
    if row[PLACE_FORCE] != 0.0:
        dry += row[PLACE_FORCE] * math.exp(-0.5 * ((position - row[PLACE]) / row[PLACE_WIDTH]) ** 2)
    half = 0.5 * row[ASYMMETRIC_COULOMB]
    return max(dry + half, 0.0), max(dry - half, 0.0)


@kernel
def damping(row, speed):
    """Damping coefficient b(v) + c |v| [N.s/m]."""
    half = 0.5 * row[ASYMMETRIC_VISCOUS]
    viscous = row[VISCOUS] + (half if speed > 0.0 else (-half if speed < 0.0 else 0.0))
    return viscous + row[AIR] * abs(speed)


@kernel
def steady_force(row, position):
    """Sum of the forces on the carriage that do not depend on its speed [N]."""
    return row[OFFSET] - row[CABLE_STIFFNESS] * (position - row[CABLE_REST])


@kernel
def next_speed(row, mass, push, position, speed, change, h):
    """Speed of a carriage of this mass after h seconds [m/s].

    Viscous friction by the midpoint rule, the other forces at the predicted middle of the step. Where the
    carriage comes to rest within the step, dry friction holds it or releases it for the rest of the step.

    Args:
      row: `plant.axis.axis_row`, as a tuple (see `frozen`).
      mass: Moving mass [kg].
      push: Force of the drive on the carriage [N].
      position: Position before the step [m].
      speed: Speed before the step [m/s].
      change: Change of speed in the previous step [m/s].
      h: Step [s].
    """
    x, v = position + 0.5 * h * speed, speed + 0.5 * change
    if v * speed <= 0.0:  # it rests or may stop before: friction of the speed that it has
        v = speed
    other = push + steady_force(row, x)
    forward, backward = dry_friction(row, x, v)
    rest, half = h, 0.5 * h * damping(row, v)
    if speed != 0.0:
        impulse = h * (other - forward) if speed > 0.0 else h * (other + backward)
        after = (speed * (mass - half) + impulse) / (mass + half)
        if after * speed > 0.0:
            return after
        rest = h * after / (after - speed)  # it comes to rest and has this much of the step left
    held = stick_or_slip(-rest * forward, rest * backward, 0.0, mass, rest * other, 1.0)
    return (rest * other + held) / mass


@kernel
def step(row, state, force, h):
    """State after a step of h seconds.

    Args:
      row: `plant.axis.axis_row`, as a tuple (see `frozen`).
      state: Tuple of AXIS_STATE numbers.
      force: Mean declared force of the drive over the step [N].
      h: Step [s].
    """
    if row[PLAY] > 0.0 and row[DRIVE_MASS] > 0.0:
        return _step_with_play(row, state, force, h)
    x, v = state[POSITION], state[SPEED]
    push = row[FORCE_SCALE] * force
    after = next_speed(row, row[MASS], push, x, v, state[CHANGE], h)
    return x + 0.5 * h * (v + after), after, 0.0, after, after - v


@kernel
def _step_with_play(row, state, force, h):
    x, v, before, drive_mass = state[POSITION], state[SPEED], state[CHANGE], row[DRIVE_MASS]
    on_drive = row[FORCE_SCALE] * force
    half = 0.5 * row[PLAY]
    gap = min(max(state[GAP], -half), half)
    side = 1.0 if gap >= half else (-1.0 if gap <= -half else 0.0)
    if side != 0.0:
        after = next_speed(row, row[MASS], on_drive, x, v, before, h)
        if (on_drive - drive_mass * (after - v) / h) * side >= 0.0:  # drive and carriage press on each other
            return x + 0.5 * h * (v + after), after, gap, after, after - v
    carriage_mass = row[MASS] - drive_mass
    after = next_speed(row, carriage_mass, 0.0, x, v, before, h)
    drive_speed = state[DRIVE_SPEED] if side == 0.0 else v
    drive_after = drive_speed + h * on_drive / drive_mass
    gap += 0.5 * h * (drive_speed + drive_after - v - after)
    if abs(gap) >= half:  # they meet and stay together
        gap = half if gap > 0.0 else -half
        after = (drive_mass * drive_after + carriage_mass * after) / row[MASS]
        drive_after = after
    return x + 0.5 * h * (v + after), after, gap, drive_after, after - v


@kernel
def encoder_position(row, state):
    """Position of the body that carries the encoder [m]."""
    return state[POSITION] + (state[GAP] if row[ENCODER] == 1.0 else 0.0)


@kernel
def encoder_speed(row, state):
    """Speed of the body that carries the encoder [m/s]."""
    return state[DRIVE_SPEED] if row[ENCODER] == 1.0 else state[SPEED]
