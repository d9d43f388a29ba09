"""Model of the quarter test rig, Eqs. 4.27-4.40: smooth right-hand side and fixed step.

State of `derivative`: [carriage speed, wheel speed, z], Eqs. 4.27-4.29; or with the motor current behind.
`step` has more (`STATE`): what effects depend on and the play of the gear. The lateral speed of the gantry
(Eq. 4.30) is given, not computed: its own drive holds it.

Corrected against the text: sign of T_nl and of the gear's power flow, viscous motor friction, sign of the
rolling resistance. `published` is as printed. Both carry the linear guide's measured dry friction, which
Eq. 4.16 leaves out (it is zero without lateral motion), and the amplifier's supply limit.

Eq. 4.18 with both rows of rollers on the floor: |F_r1| + |F_r2| = F_N, F_N = m_T g.
"""

from __future__ import annotations

import math

import numba
import numpy as np
from numpy.typing import NDArray

from omnimj.parameters.rig import Rig
from omnimj.physics.effect_terms import (
    ACTIVE,
    BACKLASH,
    GRADE,
    apply_motor_effects,
    axle_dry_friction,
    axle_torque,
    guide_dry_friction,
    guide_force,
    has_motor_effects,
    step_backlash,
    traction_scale,
    widen_friction,
)
from omnimj.physics.motor import LOOP, achievable_current, stick_or_slip
from omnimj.physics.native import cached, kernel
from omnimj.physics.planar import GRAVITY
from omnimj.physics.traction import exact_step, force_ratio, relaxation_rate
from omnimj.physics.wheel import (
    INERTIA,
    RADIUS,
    ROLLER_DRY,
    ROLLER_VISCOUS,
    ROLLING,
    WHEEL_ROW,
    bearing_friction,
    blend_friction,
    mean_deflection,
    motor_torque_bounds,
    wheel_row,
)

# columns that the rig appends to its wheel's row
MASS, GRIP, RAIL, RAIL_DRY, RAIL_VISCOUS = range(WHEEL_ROW, WHEEL_ROW + 5)
HEIGHT, HALF_WIDTH, CONTACT_OFFSET, COM_OFFSET = range(WHEEL_ROW + 5, WHEEL_ROW + 9)
WEIGHT = WHEEL_ROW + 9
RIG_ROW = WHEEL_ROW + 10

# state of `step`: m/s, rad/s, m, A; m from the start, rad, s; angle of the rotor over the wheel and its rate
SPEED, WHEEL_SPEED, BRISTLE, CURRENT, POSITION, ANGLE, TIME, PLAY, PLAY_RATE = range(9)
STATE = 9
"""Length of the state of `step`; all zero is a rig at rest at its start."""

# output of `step`; the last: wheel speed as the motor's encoder has it, with the play of the gear
SLIP, NORMAL, TRACTION, LATERAL, ACCELERATION, ENCODER = range(6)
OUTPUT = 6
"""Length of the output of `step`."""


def rig_row(
    rig: Rig,
    mass: float | None = None,
    radius_scale: float = 1.0,
    grip: float = 1.0,
    slope: float = 0.0,
) -> NDArray[np.float64]:
    """The rig's numbers for the kernels, shape (RIG_ROW,).

    Args:
      rig: The rig.
      mass: m_T [kg]; the first of the rig's masses when None.
      radius_scale: True over nominal wheel radius.
      grip: Factor on the traction.
      slope: Inclination of rail and floor: it lessens the weight on the floor; what pulls along the rail is
        the term `effect_terms.GRADE` [rad].
    """
    mass = rig.rig.masses[0] if mass is None else mass
    row = np.empty(RIG_ROW)
    row[:WHEEL_ROW] = wheel_row(rig.wheel, rig.bearing, rig.motor)
    row[RADIUS] *= radius_scale
    row[WHEEL_ROW:] = (
        mass,
        grip,
        rig.rig.rail_friction,
        rig.rig.rail_dry,
        rig.rig.rail_viscous,
        rig.rig.rail_height,
        rig.rig.rail_half_width,
        rig.rig.contact_offset,
        rig.rig.com_offset,
        mass * GRAVITY * math.cos(slope),
    )
    return row


@kernel
def lateral_force(row, lateral_speed):
    """G = [μ_R,dry sgn(ṡ) + μ_R,vis ṡ] F_N, Eqs. 4.14 and 4.18 [N]; on the wheel it points to −ṡ."""
    ratio = row[ROLLER_VISCOUS] * lateral_speed
    if lateral_speed > 0.0:
        ratio += row[ROLLER_DRY]
    elif lateral_speed < 0.0:
        ratio -= row[ROLLER_DRY]
    return ratio * row[WEIGHT]


@kernel
def rail_friction(row, lateral):
    """Dry friction and viscous coefficient of the rail, Eqs. 4.13-4.16 and the measured constant [N, N.s/m].

    M_D = F_N d − m_T g e − G c, F_D = −G, F_H,G = (F_D h ∓ M_D)/(2 h).

    Args:
      row: The rig's numbers.
      lateral: G [N].
    """
    weight, h = row[WEIGHT], row[HALF_WIDTH]
    moment = weight * (row[CONTACT_OFFSET] - row[COM_OFFSET]) - lateral * row[HEIGHT]
    load = abs((-lateral * h - moment) / (2.0 * h)) + abs((-lateral * h + moment) / (2.0 * h))
    return row[RAIL] + row[RAIL_DRY] * load, row[RAIL_VISCOUS] * load


@kernel
def carriage_friction_bounds(row, lateral, carriage_speed, published):
    """Resistance as a force on the carriage moving forward and backward, −(F_f + F_rol) of Eq. 4.35 [N].

    F_rol = μ_rol m_T g opposes the motion; published: it has no sign, Eq. 4.12.
    """
    dry, viscous = rail_friction(row, lateral)
    rolling = row[ROLLING] * row[WEIGHT]
    if published:
        return -dry - viscous * carriage_speed - rolling, dry - viscous * carriage_speed - rolling
    return -dry - rolling - viscous * carriage_speed, dry + rolling - viscous * carriage_speed


@kernel
def wheel_torque_bounds(row, motor, current, wheel_speed, lateral, published):
    """T_gear − T_friction of Eqs. 4.39-4.40 turning forward and turning backward [N.m]."""
    low, high = motor_torque_bounds(motor, current, wheel_speed, published)
    dry, viscous = bearing_friction(row, row[WEIGHT], lateral)
    return low - dry - viscous * wheel_speed, high + dry - viscous * wheel_speed


@kernel
def derivative(state, command, lateral_speed, row, motor, floor, smoothing, published):
    """Right-hand side of Eqs. 4.32-4.40 for `scipy.integrate.solve_ivp`, sign(v) as tanh(v/smoothing).

    Args:
      state: [carriage speed, wheel speed, z], shape (3,); or with the motor current behind, shape (4,).
      command: Set (or measured) current at this time [A]; what the supply cannot drive is cut off.
      lateral_speed: ṡ_111 of the gantry [m/s].
      row: `rig_row`.
      motor: `motor.motor_row`, shape (MOTOR_ROW,).
      floor: `Floor.row`, shape (ROW,).
      smoothing: Speed over which friction changes its sign, at the rim for the wheel [m/s].
      published: The equations as printed.

    Returns:
      d(state)/dt.
    """
    speed, wheel_speed, z = state[0], state[1], state[2]
    change = np.empty_like(state)
    rim = row[RADIUS] * wheel_speed
    slip = rim - speed
    rate = relaxation_rate(floor, slip, max(abs(rim), abs(speed)))
    traction = row[WEIGHT] * row[GRIP] * force_ratio(floor, z, slip, rate)
    lateral = lateral_force(row, lateral_speed)
    current = achievable_current(motor, command, wheel_speed)
    if state.size > 3:
        change[3] = (current - state[3]) / motor[LOOP]
        current = state[3]
    low, high = carriage_friction_bounds(row, lateral, speed, published)
    change[0] = (traction + blend_friction(low, high, math.tanh(speed / smoothing))) / row[MASS]
    low, high = wheel_torque_bounds(row, motor, current, wheel_speed, lateral, published)
    torque = blend_friction(low, high, math.tanh(rim / smoothing))
    change[1] = (torque - row[RADIUS] * traction) / row[INERTIA]
    change[2] = slip - rate * z
    return change


def _stepper(active: bool):
    """`step` for rows with effects, or without: the constant `active` leaves out what is not needed."""

    @cached(numba.njit, error_model="numpy", nogil=True, inline="always")
    def steps_of(state, command, lateral_speed, row, motor, floor, terms, h, steps, published, output):
        normal, mass, inertia, radius = row[WEIGHT], row[MASS], row[INERTIA], row[RADIUS]
        lateral = lateral_force(row, lateral_speed)
        bearing, bearing_viscous = bearing_friction(row, normal, lateral)
        rail_low, rail_high = carriage_friction_bounds(row, lateral, 0.0, published)
        rail_viscous = rail_friction(row, lateral)[1]
        if active and has_motor_effects(terms):
            changed = np.empty(motor.size)
            apply_motor_effects(motor, terms, state[TIME], 0.0, changed)
            motor = changed
        decay, lag = math.exp(-h / motor[LOOP]), motor[LOOP] / h  # as `next_current` and `mean_current`
        grip, dry, low_guide, high_guide = row[GRIP], bearing, rail_low, rail_high
        speed, wheel_speed, z, current, position, angle, time, play, play_rate = (
            state[0], state[1], state[2], state[3], state[4], state[5], state[6], state[7], state[8]
        )  # fmt: skip
        slip, traction, acceleration = 0.0, 0.0, 0.0
        for _ in range(steps):
            rim = radius * wheel_speed
            slip = rim - speed
            rate = relaxation_rate(floor, slip, max(abs(rim), abs(speed)))
            z_next = exact_step(z, slip, rate, h)
            mean = mean_deflection(z, z_next, slip, rate, h)
            if active:
                grip = row[GRIP] * traction_scale(terms, position)
            traction = normal * grip * force_ratio(floor, mean, slip, rate)
            target = achievable_current(motor, command, wheel_speed)
            current_next = target + (current - target) * decay
            driving = target + (current - current_next) * lag
            low, high = motor_torque_bounds(motor, driving, wheel_speed + play_rate, published)
            other = -radius * traction - bearing_viscous * wheel_speed
            force = traction - rail_viscous * speed
            if active:
                dry = max(bearing + axle_dry_friction(terms, low, high), 0.0)
                other += axle_torque(terms, angle + play, wheel_speed + play_rate, h)
                low_guide, high_guide = widen_friction(
                    rail_low, rail_high, guide_dry_friction(terms, speed, position)
                )
                force += mass * terms[GRADE]
                force += guide_force(terms, speed, position, time, lateral_speed, angle, wheel_speed, h)
            if active and terms[BACKLASH] != 0.0:
                change, play, play_rate, _ = step_backlash(
                    terms, play, play_rate, low, high, dry, wheel_speed, inertia, other, h
                )
            else:
                torque = stick_or_slip(low - dry, high + dry, wheel_speed, inertia, other, h)
                change = (torque + other) / inertia
            acceleration = (stick_or_slip(low_guide, high_guide, speed, mass, force, h) + force) / mass
            position += h * (speed + 0.5 * h * acceleration)
            angle += h * (wheel_speed + 0.5 * h * change)
            speed, wheel_speed = speed + h * acceleration, wheel_speed + h * change
            z, current = z_next, current_next
            time += h
        state[0], state[1], state[2], state[3], state[4] = speed, wheel_speed, z, current, position
        state[5], state[6], state[7], state[8] = angle, time, play, play_rate
        output[SLIP], output[NORMAL], output[TRACTION], output[LATERAL] = slip, normal, traction, lateral
        output[ACCELERATION], output[ENCODER] = acceleration - terms[GRADE], wheel_speed + play_rate

    return steps_of


_with_effects, _without_effects = _stepper(True), _stepper(False)


@kernel
def step(state, command, lateral_speed, row, motor, floor, terms, h, steps, published, output):
    """Advances the state by `steps` steps of h seconds, in place; stable at any slip speed.

    Exact for frozen speeds: bristle, current; set-valued: friction of motor, gear, bearing, brake, rail.

    Args:
      state: `SPEED` … `PLAY_RATE`, shape (STATE,); changed in place.
      command: Current set value, or the measured current where the motor's row says so [A].
      lateral_speed: ṡ_111 of the gantry [m/s].
      row: `rig_row`.
      motor: `motor.motor_row`, shape (MOTOR_ROW,).
      floor: `Floor.row`, shape (ROW,).
      terms: Effects, a row of `effect_terms`, shape (TERMS,); without effects a row of zeros.
      h: Step [s].
      steps: How many.
      published: The equations as printed.
      output: Filled with slip, F_N, F, G, what an accelerometer on the carriage reads along the rail
        (acceleration less gravity) and the wheel speed that the motor's encoder sees, of the last step, shape
        (OUTPUT,).
    """
    if terms[ACTIVE] != 0.0:
        _with_effects(state, command, lateral_speed, row, motor, floor, terms, h, steps, published, output)
    else:
        _without_effects(state, command, lateral_speed, row, motor, floor, terms, h, steps, published, output)
