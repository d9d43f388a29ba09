"""One driven omni wheel, the same on the robot and on the rig: its numbers, bearings and rollers.

A wheel comes as its row of numbers (`wheel_row`); a plant may append columns of its own.
"""

from __future__ import annotations

import numpy as np

from omnimj.parameters.parts import Bearing, Motor, Wheel
from omnimj.physics.motor import (
    BRAKE,
    EFFICIENCY,
    KT_SCALE,
    LOOP,
    NO_LOAD,
    RATIO,
    TORQUE_CONSTANT,
    achievable_current,
    drive_torque_bounds,
    winding_current,
)
from omnimj.physics.native import kernel
from omnimj.physics.traction import exact_step

RADIUS, INERTIA, ROLLER_DRY, ROLLER_VISCOUS, ROLLER_STIFFNESS, ROLLER_DAMPING, ROLLING = range(7)
BEARING_DRY, BEARING_VISCOUS, PITCH_RADIUS, SPACING, OVERHANG = range(7, 12)
WHEEL_ROW = 12


def wheel_row(wheel: Wheel, bearing: Bearing, motor: Motor) -> np.ndarray:
    """A wheel's numbers for the kernels, shape (WHEEL_ROW,); inertia is I + (J_r + J_g) E G_r²."""
    row = np.empty(WHEEL_ROW)
    row[:] = (
        wheel.radius,
        wheel.inertia + motor.reflected_inertia,
        wheel.roller_dry,
        wheel.roller_viscous,
        wheel.roller_bristle_stiffness,
        wheel.roller_bristle_damping,
        wheel.rolling_resistance,
        bearing.dry,
        bearing.viscous,
        0.5 * bearing.pitch_diameter,
        bearing.spacing,
        bearing.overhang,
    )
    return row


@kernel
def mean_deflection(z, z_next, slip, rate, h):
    """Mean of the bristle over an exact step, (V_r h − (z⁺ − z))/(λ h) [m].

    With it σ0 z + σ1 (V_r − λ z) is the mean force of the step, however fast the bristle is.
    """
    x = rate * h
    if x < 1e-3:  # a series, where the difference below would lose its digits
        return z + (slip - rate * z) * h * (0.5 - x / 6.0 + x * x / 24.0)
    return (slip * h - (z_next - z)) / x


@kernel
def mean_current(motor, current, next_current, command, wheel_speed, h):
    """Mean of the motor current over a step of `motor.next_current`, i∞ + (i − i⁺) τ/h [A]."""
    return achievable_current(motor, command, wheel_speed) + (current - next_current) * motor[LOOP] / h


@kernel
def roller_friction(wheel, z, lateral_speed, normal_force, h):
    """Next micro-slip deflection of the rollers' bearings and the friction F_f they make, Eqs. 3.32-3.35.

    A bristle with g = μ_R,dry stands for sign(v): it holds at rest without creeping or chattering and is
    F_N [μ_R,dry sign(v) + μ_R,vis v] once v has passed μ_R,dry over its stiffness [m, N].

    Args:
      wheel: The wheel's numbers.
      z: Deflection [m].
      lateral_speed: Of the wheel's centre along its axle [m/s].
      normal_force: F_N [N].
      h: Step [s].
    """
    viscous = wheel[ROLLER_VISCOUS] * lateral_speed
    if wheel[ROLLER_DRY] <= 0.0:
        return 0.0, normal_force * viscous
    rate = wheel[ROLLER_STIFFNESS] * abs(lateral_speed) / wheel[ROLLER_DRY]
    z_next = exact_step(z, lateral_speed, rate, h)
    mean = mean_deflection(z, z_next, lateral_speed, rate, h)
    ratio = wheel[ROLLER_STIFFNESS] * mean + wheel[ROLLER_DAMPING] * (z_next - z) / h
    return z_next, normal_force * (ratio + viscous)


@kernel
def bearing_friction(wheel, normal_force, lateral_force):
    """Dry torque and viscous coefficient of the wheel's bearings, Eqs. 4.37-4.38 [N.m, N.m.s/rad].

    F_A = (F_N (a + b) − G r)/a, F_B = (F_N b − G r)/a; G > 0 is the rollers' friction on a wheel that moves
    away from its bearings (outward on the robot, along +z × u).
    """
    a, b = wheel[SPACING], wheel[OVERHANG]
    tilting = lateral_force * wheel[RADIUS]
    load = abs((normal_force * (a + b) - tilting) / a) + abs((normal_force * b - tilting) / a)
    return (
        wheel[BEARING_DRY] * load * wheel[PITCH_RADIUS],
        wheel[BEARING_VISCOUS] * load * wheel[PITCH_RADIUS],
    )


@kernel
def motor_torque_bounds(motor, current, wheel_speed, published):
    """Torque at the wheel turning forward and turning backward, brake included [N.m].

    Corrected: `motor.drive_torque_bounds`. Published: (K_t i − T_nl) E G_r either way, Eqs. 3.80-3.85.
    """
    if not published:
        return drive_torque_bounds(motor, current, wheel_speed)
    electric = motor[KT_SCALE] * motor[TORQUE_CONSTANT] * winding_current(motor, current, wheel_speed)
    torque = (electric - motor[NO_LOAD]) * motor[EFFICIENCY] * motor[RATIO]
    return torque - motor[BRAKE], torque + motor[BRAKE]


@kernel
def blend_friction(low, high, direction):
    """`low` for direction 1, `high` for −1, linear between: a smooth stand-in for set-valued friction."""
    return 0.5 * ((1.0 + direction) * low + (1.0 - direction) * high)
