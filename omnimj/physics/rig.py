"""Model of the quarter test rig, Eqs. 4.27-4.40, by a fixed step.

The state (`RigState`) is that of Eqs. 4.27-4.29, the motor current, and variables of the effects and of the
backlash of the gear. The lateral speed of the gantry (Eq. 4.30) is an input, since its own drive holds it.

Corrections to the text: sign of T_nl and of the gear's power flow, viscous motor friction, sign of the
rolling resistance; `published` is as printed. Both include the linear guide's measured dry friction, which
Eq. 4.16 leaves out (there it is zero without lateral motion), and the amplifier's supply limit.

Eq. 4.18 with both rows of rollers on the floor: |F_r1| + |F_r2| = F_N, F_N = m_T g.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numba

from omnimj.parameters.floor import TractionParameters
from omnimj.parameters.parts import GRAVITY
from omnimj.parameters.rig import Rig
from omnimj.physics.effect_terms import (
    AxleTorque,
    Backlash,
    EffectTerms,
    apply_motor_effects,
    axle_dry_friction,
    axle_torque,
    guide_dry_friction,
    guide_force,
    has_motor_effects,
    step_backlash,
    terms_at,
    traction_scale,
    widen_friction,
)
from omnimj.physics.motor import (
    MotorParameters,
    achievable_current,
    motor_at,
    motor_torque_bounds,
    stick_or_slip,
)
from omnimj.physics.native import cached, first_numbers, inlined, kernel
from omnimj.physics.traction import (
    exact_step,
    force_ratio,
    load_factor,
    mean_deflection,
    relaxation_rate,
    rolling_speed,
    traction_at,
)
from omnimj.physics.wheel import (
    WHEEL_SIZE,
    WheelParameters,
    bearing_friction,
    wheel_on_floor,
    wheel_parameters,
)


class RigParameters(NamedTuple):
    """Wheel, carriage and rail of the rig."""

    wheel: WheelParameters
    mass: float
    """m_T [kg]."""
    grip: float
    """Factor on the traction."""
    rail_friction: float
    """Measured dry friction of the rail [N]."""
    rail_dry: float
    """μ_D,dry of the linear guide."""
    rail_viscous: float
    """μ_D,vis [s/m]."""
    rail_height: float
    """Height c of the rail above the floor [m]."""
    rail_half_width: float
    """h [m]."""
    contact_offset: float
    """d [m]."""
    com_offset: float
    """e [m]."""
    weight: float
    """Weight on the floor [N]."""


RIG_SIZE = WHEEL_SIZE + len(RigParameters._fields) - 1
"""Numbers of packed rig parameters."""


class RigModel(NamedTuple):
    """Parameters that determine the rig's motion."""

    rig: RigParameters
    motor: MotorParameters
    floor: TractionParameters
    terms: EffectTerms
    published: bool
    """The equations as printed."""


class RigState(NamedTuple):
    """State of `step`; all zero is a rig at rest at its start."""

    speed: float
    """Carriage speed [m/s]."""
    wheel_speed: float
    """φ̇ after the gear [rad/s]."""
    bristle: float
    """z [m]."""
    current: float
    """Motor current [A]."""
    position: float
    """Carriage position from the start [m]."""
    angle: float
    """Wheel angle [rad]."""
    time: float
    """[s]"""
    backlash: float
    """Angle of the rotor relative to the wheel within the gear's dead zone [rad]."""
    backlash_rate: float
    """[rad/s]"""


class RigOutput(NamedTuple):
    """Result of the last step."""

    slip: float
    """V_r [m/s]."""
    normal: float
    """F_N [N]."""
    traction: float
    """F [N]."""
    lateral: float
    """G [N]."""
    acceleration: float
    """Reading of an ideal accelerometer along the rail: acceleration minus gravity [m/s²]."""
    encoder_speed: float
    """Wheel speed measured by the motor's encoder [rad/s]."""


STATE, OUTPUT = len(RigState._fields), len(RigOutput._fields)
"""Lengths of packed state and output."""


def rig_parameters(
    rig: Rig,
    mass: float | None = None,
    radius_scale: float = 1.0,
    grip: float = 1.0,
    slope: float = 0.0,
) -> RigParameters:
    """Parameters of the rig for the kernels.

    Args:
      rig: The rig.
      mass: m_T [kg]; the first of the rig's masses when None.
      radius_scale: True over nominal wheel radius.
      grip: Factor on the traction.
      slope: Inclination of rail and floor [rad], which reduces the weight on the floor; the force along the
        rail is the effect term `grade`.
    """
    mass = rig.rig.masses[0] if mass is None else mass
    return RigParameters(
        wheel_parameters(rig.wheel, rig.bearing, rig.motor, radius_scale),
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


@kernel
def rig_at(row):
    """`RigParameters` of a packed row, shape (RIG_SIZE,)."""
    numbers = first_numbers(row, RIG_SIZE)
    return RigParameters(WheelParameters(*numbers[:WHEEL_SIZE]), *numbers[WHEEL_SIZE:])


@kernel
def rig_model_at(rows, published):
    """`RigModel` of packed rows.

    Args:
      rows: Rig, motor, floor and effect terms, shapes (RIG_SIZE,), (MOTOR_SIZE,), (TRACTION_SIZE,), (TERMS,).
      published: The equations as printed.
    """
    return RigModel(rig_at(rows[0]), motor_at(rows[1]), traction_at(rows[2]), terms_at(rows[3]), published)


@kernel
def rig_state_at(row):
    """`RigState` of the first `STATE` numbers of a row."""
    return RigState(*first_numbers(row, STATE))


@kernel
def rig_output_at(row):
    """`RigOutput` of the first `OUTPUT` numbers of a row."""
    return RigOutput(*first_numbers(row, OUTPUT))


@inlined
def rig_on_floor(rig, floor, rim, speed, lateral_speed):
    """`RigParameters` with the rolling resistance of the floor, on the carriage and on the rollers.

    Args:
      rig: `RigParameters`.
      floor: `TractionParameters`.
      rim: r φ̇ [m/s].
      speed: Of the carriage [m/s].
      lateral_speed: ṡ of the gantry [m/s].
    """
    return RigParameters(wheel_on_floor(rig.wheel, floor, rim, speed, lateral_speed), *rig[1:])


@kernel
def lateral_force(rig, lateral_speed):
    """Friction of the rollers G = [μ_R,dry sgn(ṡ) + μ_R,vis ṡ] F_N, Eqs. 4.14 and 4.18 [N]."""
    ratio = rig.wheel.roller_viscous * lateral_speed
    if lateral_speed > 0.0:
        ratio += rig.wheel.roller_dry
    elif lateral_speed < 0.0:
        ratio -= rig.wheel.roller_dry
    return ratio * rig.weight


@kernel
def rail_friction(rig, lateral):
    """Dry friction and viscous coefficient of the rail, Eqs. 4.13-4.16 and the measured constant [N, N.s/m].

    M_D = F_N d − m_T g e − G c, F_D = −G, F_H,G = (F_D h ∓ M_D)/(2 h).

    Args:
      rig: `RigParameters`.
      lateral: G [N].
    """
    h = rig.rail_half_width
    moment = rig.weight * (rig.contact_offset - rig.com_offset) - lateral * rig.rail_height
    load = abs((-lateral * h - moment) / (2.0 * h)) + abs((-lateral * h + moment) / (2.0 * h))
    return rig.rail_friction + rig.rail_dry * load, rig.rail_viscous * load


@kernel
def carriage_friction_bounds(rig, lateral, carriage_speed, published):
    """Resistance as a force on the carriage moving forward and backward, −(F_f + F_rol) of Eq. 4.35 [N].

    F_rol = μ_rol m_T g opposes the motion; published: it has no sign, Eq. 4.12.

    Args:
      rig: `RigParameters`.
      lateral: G [N].
      carriage_speed: [m/s]
      published: The equations as printed.
    """
    dry, viscous = rail_friction(rig, lateral)
    rolling = rig.wheel.rolling * rig.weight
    if published:
        return -dry - viscous * carriage_speed - rolling, dry - viscous * carriage_speed - rolling
    return -dry - rolling - viscous * carriage_speed, dry + rolling - viscous * carriage_speed


@kernel
def wheel_torque_bounds(model, current, wheel_speed, lateral):
    """T_gear − T_friction of Eqs. 4.39-4.40 for a wheel turning forward and turning backward [N.m].

    Args:
      model: `RigModel`.
      current: Motor current [A].
      wheel_speed: φ̇ [rad/s].
      lateral: G [N].
    """
    low, high = motor_torque_bounds(model.motor, current, wheel_speed, model.published)
    dry, viscous = bearing_friction(model.rig.wheel, model.rig.weight, lateral)
    return low - dry - viscous * wheel_speed, high + dry - viscous * wheel_speed


@kernel
def _resistances(rig, lateral_speed, published):
    """G; dry and viscous friction of the wheel's bearings; bounds and viscous friction of the carriage."""
    lateral = lateral_force(rig, lateral_speed)
    dry, viscous = bearing_friction(rig.wheel, rig.weight, lateral)
    low, high = carriage_friction_bounds(rig, lateral, 0.0, published)
    return lateral, dry, viscous, low, high, rail_friction(rig, lateral)[1]


def _stepper(active: bool):
    """Compile `step` with effects or without; the constant `active` removes unneeded code."""

    @cached(numba.njit, error_model="numpy", nogil=True, inline="always")
    def steps_of(state, command, lateral_speed, model, h, steps):
        rig, motor, floor, terms, published = (
            model.rig,
            model.motor,
            model.floor,
            model.terms,
            model.published,
        )
        normal, mass, inertia, radius = rig.weight, rig.mass, rig.wheel.inertia, rig.wheel.radius
        resisting = _resistances(rig, lateral_speed, published)
        if active and has_motor_effects(terms):
            motor = apply_motor_effects(motor, terms, state.time, 0.0)
        # as in `next_current` and `mean_current`
        decay, lag = math.exp(-h / motor.current_loop), motor.current_loop / h
        gripping = rig.grip * load_factor(floor, normal)
        lateral, bearing, bearing_viscous, rail_low, rail_high, rail_viscous = resisting
        grip, dry, low_guide, high_guide = gripping, bearing, rail_low, rail_high
        speed, wheel_speed, z, current, position, angle, time, gap, gap_rate = state
        slip, traction, acceleration = 0.0, 0.0, 0.0
        for _ in range(steps):
            rim = radius * wheel_speed
            slip = rim - speed
            rate = relaxation_rate(floor, slip, rolling_speed(floor, rim, speed, lateral_speed))
            z_next = exact_step(z, slip, rate, h)
            mean = mean_deflection(z, z_next, slip, rate, h)
            if active:
                grip = gripping * traction_scale(terms, position)
            traction = normal * grip * force_ratio(floor, mean, slip, rate)
            # its direction changes with the speed
            if floor.rolling_resistance + floor.roller_resistance + floor.roller_dry != 0.0:
                soft = rig_on_floor(rig, floor, rim, speed, lateral_speed)
                resisting = _resistances(soft, lateral_speed, published)
                lateral, bearing, bearing_viscous, rail_low, rail_high, rail_viscous = resisting
                dry, low_guide, high_guide = bearing, rail_low, rail_high
            target = achievable_current(motor, command, wheel_speed)
            current_next = target + (current - target) * decay
            driving = target + (current - current_next) * lag
            low, high = motor_torque_bounds(motor, driving, wheel_speed + gap_rate, published)
            other = -radius * traction - bearing_viscous * wheel_speed
            force = traction - rail_viscous * speed
            if active:
                dry = max(bearing + axle_dry_friction(terms, low, high), 0.0)
                other += axle_torque(terms, angle + gap, wheel_speed + gap_rate, h)
                added = guide_dry_friction(terms, speed, position)
                low_guide, high_guide = widen_friction(rail_low, rail_high, added)
                force += mass * terms.grade
                force += guide_force(terms, speed, position, time, lateral_speed, angle, wheel_speed, h)
            if active and terms.backlash != 0.0:
                gear = Backlash(terms.backlash, terms.rotor_inertia, gap, gap_rate)
                torques = AxleTorque(low, high, dry, other)
                change, gap, gap_rate, _ = step_backlash(gear, torques, wheel_speed, inertia, h)
            else:
                torque = stick_or_slip(low - dry, high + dry, wheel_speed, inertia, other, h)
                change = (torque + other) / inertia
            acceleration = (stick_or_slip(low_guide, high_guide, speed, mass, force, h) + force) / mass
            position += h * (speed + 0.5 * h * acceleration)
            angle += h * (wheel_speed + 0.5 * h * change)
            speed, wheel_speed = speed + h * acceleration, wheel_speed + h * change
            z, current = z_next, current_next
            time += h
        after = RigState(speed, wheel_speed, z, current, position, angle, time, gap, gap_rate)
        felt, seen = acceleration - terms.grade, wheel_speed + gap_rate
        return after, RigOutput(slip, normal, traction, lateral, felt, seen)

    return steps_of


_with_effects, _without_effects = _stepper(True), _stepper(False)


@kernel
def step(state, command, lateral_speed, model, h, steps):
    """State and output after `steps` steps of h seconds; stable at any slip velocity.

    Exact for frozen speeds: bristle, current; set-valued: friction of motor, gear, bearing, brake, rail.

    Args:
      state: `RigState`.
      command: Commanded current, or the measured one if `motor.measured` is 1 [A].
      lateral_speed: ṡ_111 of the gantry [m/s].
      model: `RigModel`.
      h: Step [s].
      steps: Number of steps.

    Returns:
      `RigState` and `RigOutput` of the last step.
    """
    if model.terms.active != 0.0:
        return _with_effects(state, command, lateral_speed, model, h, steps)
    return _without_effects(state, command, lateral_speed, model, h, steps)
