"""Model of the quarter test rig, Eqs. 4.27-4.40: smooth right-hand side and fixed step.

State: [carriage speed, wheel speed, z], Eqs. 4.27-4.29; or with the motor current behind. The lateral speed
of the gantry (Eq. 4.30) is given, not computed: its own drive holds it.

Corrected against the text: sign of T_nl and of the gear's power flow, viscous motor friction, sign of the
rolling resistance. `published` is as printed. Both carry the linear guide's measured dry friction, which
Eq. 4.16 leaves out (it is zero without lateral motion), and the amplifier's supply limit.

Eq. 4.18 with both rows of rollers on the floor: |F_r1| + |F_r2| = F_N, F_N = m_T g.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from omnimj.parameters.rig import Rig
from omnimj.physics.motor import LOOP, next_current, set_current, stick_or_slip
from omnimj.physics.native import kernel
from omnimj.physics.planar_constants import GRAVITY
from omnimj.physics.traction import exact_step, force_ratio, relaxation_rate
from omnimj.physics.wheel import (
    INERTIA,
    RADIUS,
    ROLLER_DRY,
    ROLLER_VISCOUS,
    ROLLING,
    WHEEL_ROW,
    bearing_friction,
    between,
    mean_current,
    mean_deflection,
    motor_torque_bounds,
    wheel_row,
)

# columns that the rig appends to its wheel's row
MASS, GRIP, RAIL, RAIL_DRY, RAIL_VISCOUS = range(WHEEL_ROW, WHEEL_ROW + 5)
HEIGHT, HALF_WIDTH, CONTACT_OFFSET, COM_OFFSET = range(WHEEL_ROW + 5, WHEEL_ROW + 9)
RIG_ROW = WHEEL_ROW + 9

OUTPUT = 5
"""Length of the output of `step`: slip, F_N, F, G, acceleration."""


def rig_row(
    rig: Rig, mass: float | None = None, radius_scale: float = 1.0, grip: float = 1.0
) -> NDArray[np.float64]:
    """The rig's numbers for the kernels, shape (RIG_ROW,).

    Args:
      rig: The rig.
      mass: m_T [kg]; the first of the rig's masses when None.
      radius_scale: True over nominal wheel radius.
      grip: Factor on the traction.
    """
    row = np.empty(RIG_ROW)
    row[:WHEEL_ROW] = wheel_row(rig.wheel, rig.bearing, rig.motor)
    row[RADIUS] *= radius_scale
    row[WHEEL_ROW:] = (
        rig.rig.masses[0] if mass is None else mass,
        grip,
        rig.rig.rail_friction,
        rig.rig.rail_dry,
        rig.rig.rail_viscous,
        rig.rig.rail_height,
        rig.rig.rail_half_width,
        rig.rig.contact_offset,
        rig.rig.com_offset,
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
    return ratio * row[MASS] * GRAVITY


@kernel
def rail_friction(row, lateral):
    """Dry friction and viscous coefficient of the rail, Eqs. 4.13-4.16 and the measured constant [N, N.s/m].

    M_D = F_N d − m_T g e − G c, F_D = −G, F_H,G = (F_D h ∓ M_D)/(2 h).

    Args:
      row: The rig's numbers.
      lateral: G [N].
    """
    weight, h = row[MASS] * GRAVITY, row[HALF_WIDTH]
    moment = weight * (row[CONTACT_OFFSET] - row[COM_OFFSET]) - lateral * row[HEIGHT]
    load = abs((-lateral * h - moment) / (2.0 * h)) + abs((-lateral * h + moment) / (2.0 * h))
    return row[RAIL] + row[RAIL_DRY] * load, row[RAIL_VISCOUS] * load


@kernel
def carriage_bounds(row, lateral, carriage_speed, published):
    """Resistance as a force on the carriage moving forward and backward, −(F_f + F_rol) of Eq. 4.35 [N].

    F_rol = μ_rol m_T g opposes the motion; published: it has no sign, Eq. 4.12.
    """
    dry, viscous = rail_friction(row, lateral)
    rolling = row[ROLLING] * row[MASS] * GRAVITY
    if published:
        return -dry - viscous * carriage_speed - rolling, dry - viscous * carriage_speed - rolling
    return -dry - rolling - viscous * carriage_speed, dry + rolling - viscous * carriage_speed


@kernel
def wheel_bounds(row, motor, current, wheel_speed, lateral, published):
    """T_gear − T_friction of Eqs. 4.39-4.40 turning forward and turning backward [N.m]."""
    low, high = motor_torque_bounds(motor, current, wheel_speed, published)
    dry, viscous = bearing_friction(row, row[MASS] * GRAVITY, lateral)
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
    traction = row[MASS] * GRAVITY * row[GRIP] * force_ratio(floor, z, slip, rate)
    lateral = lateral_force(row, lateral_speed)
    current = set_current(motor, command, wheel_speed)
    if state.size > 3:
        change[3] = (current - state[3]) / motor[LOOP]
        current = state[3]
    low, high = carriage_bounds(row, lateral, speed, published)
    change[0] = (traction + between(low, high, math.tanh(speed / smoothing))) / row[MASS]
    low, high = wheel_bounds(row, motor, current, wheel_speed, lateral, published)
    torque = between(low, high, math.tanh(rim / smoothing))
    change[1] = (torque - row[RADIUS] * traction) / row[INERTIA]
    change[2] = slip - rate * z
    return change


@kernel
def step(state, command, lateral_speed, row, motor, floor, h, steps, published, output):
    """Advances the state by `steps` steps of h seconds, in place; stable at any slip speed.

    Exact for frozen speeds: bristle, current; set-valued: friction of motor, gear, bearing, brake, rail.

    Args:
      state: [carriage speed, wheel speed, z, motor current], shape (4,); changed in place.
      command: Current set value [A].
      lateral_speed: ṡ_111 of the gantry [m/s].
      row: `rig_row`.
      motor: `motor.motor_row`, shape (MOTOR_ROW,).
      floor: `Floor.row`, shape (ROW,).
      h: Step [s].
      steps: How many.
      published: The equations as printed.
      output: Filled with slip, F_N, F, G and the carriage's acceleration of the last step, shape (OUTPUT,).
    """
    normal = row[MASS] * GRAVITY
    lateral = lateral_force(row, lateral_speed)
    for _ in range(steps):
        speed, wheel_speed = state[0], state[1]
        rim = row[RADIUS] * wheel_speed
        slip = rim - speed
        rate = relaxation_rate(floor, slip, max(abs(rim), abs(speed)))
        z = exact_step(state[2], slip, rate, h)
        mean = mean_deflection(state[2], z, slip, rate, h)
        traction = normal * row[GRIP] * force_ratio(floor, mean, slip, rate)
        current = next_current(motor, state[3], command, wheel_speed, h)
        driving = mean_current(motor, state[3], current, command, wheel_speed, h)
        low, high = wheel_bounds(row, motor, driving, wheel_speed, lateral, published)
        other = -row[RADIUS] * traction
        torque = stick_or_slip(low, high, wheel_speed, row[INERTIA], other, h)
        low, high = carriage_bounds(row, lateral, speed, published)
        acceleration = (stick_or_slip(low, high, speed, row[MASS], traction, h) + traction) / row[MASS]
        state[0] = speed + h * acceleration
        state[1] = wheel_speed + h * (torque + other) / row[INERTIA]
        state[2], state[3] = z, current
        output[0], output[1], output[2], output[3], output[4] = slip, normal, traction, lateral, acceleration
