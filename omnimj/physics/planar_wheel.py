"""One wheel of the planar robot in one step: bristles, current, speed, angle and the backlash of its gear."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from omnimj.parameters.floor import TractionParameters
from omnimj.physics.effect_terms import (
    ACTIVE,
    BISECTIONS,
    AxleTorque,
    Backlash,
    axle_dry_friction,
    axle_torque,
    hub_force,
    step_backlash,
    supply_current,
    terms_at,
    terms_of_wheel,
    traction_scale,
)
from omnimj.physics.motor import (
    MotorParameters,
    mean_current,
    motor_at,
    motor_torque_bounds,
    next_current,
    stick_or_slip,
)
from omnimj.physics.native import first_numbers, inlined, kernel
from omnimj.physics.traction import (
    exact_step,
    force_ratio,
    load_factor,
    mean_deflection,
    relaxation_rate,
    rolling_speed,
)
from omnimj.physics.wheel import (
    WHEEL_SIZE,
    WheelParameters,
    bearing_friction,
    roller_friction,
    wheel_on_floor,
)


class PlanarWheel(NamedTuple):
    """Wheel of the planar robot: its parameters, its position and its static load."""

    wheel: WheelParameters
    position_x: float
    """x of the centre in the body frame [m]."""
    position_y: float
    """y of the centre [m]."""
    drive_x: float
    """Driving direction u."""
    drive_y: float
    grip: float
    """Factor on the traction."""
    normal: float
    """F_N on level floor [N]."""
    normal_x: float
    """Change of F_N per m/s² of gravity along the body's x [kg]."""
    normal_y: float
    """[kg]"""
    roller_sin: float
    """sin γ, with γ the angle from the axle to the roller's axis."""
    roller_cos: float


PLANAR_WHEEL_SIZE = WHEEL_SIZE + len(PlanarWheel._fields) - 1
"""Numbers of a packed wheel."""
POSITION_X, POSITION_Y = WHEEL_SIZE, WHEEL_SIZE + 1
"""Places of the centre in a packed wheel, which the contact under a row of rollers moves."""


class DrivenWheel(NamedTuple):
    """Wheel with its motor and the floor under it."""

    wheel: PlanarWheel
    motor: MotorParameters
    floor: TractionParameters
    published: bool
    """The equations as printed."""


class WheelLoad(NamedTuple):
    """Forces between floor and wheel [N]."""

    normal: float
    """F_N."""
    ahead: float
    """Force on the wheel along its driving direction u."""
    aside: float
    """Force on the wheel against its axle z × u."""


class PlanarState(NamedTuple):
    """State of the planar robot, views into one row; n wheels."""

    bristle: np.ndarray
    """z, shape (n,) [m]."""
    wheel_speed: np.ndarray
    """φ̇ after the gear, shape (n,) [rad/s]."""
    twist: np.ndarray
    """v_x, v_y, yaw rate in the body frame at the robot's centre, shape (3,) [m/s, m/s, rad/s]."""
    current: np.ndarray
    """Motor currents, shape (n,) [A]."""
    roller: np.ndarray
    """Micro-slip deflection of the rollers' bearings, shape (n,) [m]."""
    angle: np.ndarray
    """Wheel angles, shape (n,) [rad]."""
    backlash: np.ndarray
    """Angle of the rotor relative to the wheel within the gear's dead zone, shape (n,) [rad]."""
    backlash_rate: np.ndarray
    """Its rate, shape (n,) [rad/s]."""
    clock: np.ndarray
    """Time since the start, shape (1,) [s]."""
    pose: np.ndarray
    """x, y, yaw in the world, shape (3,) [m, m, rad]."""


class PlanarOutput(NamedTuple):
    """Result of the last step, views into one row; n wheels."""

    slip: np.ndarray
    """V_r, shape (n,) [m/s]."""
    normal: np.ndarray
    """F_N, shape (n,) [N]."""
    traction: np.ndarray
    """F along the roller's axis, shape (n,) [N]."""
    drag: np.ndarray
    """G, friction of the rollers' bearings, shape (n,) [N]."""
    acceleration: np.ndarray
    """Reading of an ideal accelerometer at the centre, shape (2,) [m/s²]."""
    encoder_speed: np.ndarray
    """Wheel speeds measured by the motors' encoders, shape (n,) [rad/s]."""


@kernel
def planar_wheel_at(row):
    """`PlanarWheel` of a packed row, shape (PLANAR_WHEEL_SIZE,)."""
    numbers = first_numbers(row, PLANAR_WHEEL_SIZE)
    return PlanarWheel(WheelParameters(*numbers[:WHEEL_SIZE]), *numbers[WHEEL_SIZE:])


@kernel
def wheel_velocity(wheel, v_x, v_y, yaw_rate):
    """Velocity of the wheel's centre along u (V_i, Eqs. 3.50-3.53) and along its axle z × u [m/s]."""
    x = v_x - yaw_rate * wheel.position_y
    y = v_y + yaw_rate * wheel.position_x
    return x * wheel.drive_x + y * wheel.drive_y, y * wheel.drive_x - x * wheel.drive_y


@kernel
def contact_velocity(wheel, rim, along, across):
    """Slip V_r along the roller's axis a, and the velocity along z × a that turns the roller [m/s].

    V_r = a·(r φ̇ u − V), the other (z × a)·(V − r φ̇ u), with a = sin γ u + cos γ (z × u). For an omni wheel,
    γ = 90°, these are r φ̇ − V_i and the velocity along the axle.

    Args:
      wheel: `PlanarWheel`.
      rim: r φ̇ [m/s].
      along: Velocity of the centre along u [m/s].
      across: Velocity of the centre along the axle z × u [m/s].
    """
    s, c = wheel.roller_sin, wheel.roller_cos
    return s * (rim - along) - c * across, s * across + c * (rim - along)


@kernel
def contact_force(wheel, traction, drag):
    """Force F a − G (z × a) of the floor on the wheel along u, and against z × u [N].

    Args:
      wheel: `PlanarWheel`.
      traction: F [N].
      drag: G, friction of the roller's bearing [N].
    """
    s, c = wheel.roller_sin, wheel.roller_cos
    return s * traction + c * drag, s * drag - c * traction


@inlined
def on_its_floor(driven, rim, along, sideways):
    """`DrivenWheel` with the rolling resistance of its floor, which the equations as printed leave out.

    Args:
      driven: `DrivenWheel`.
      rim: r φ̇ [m/s].
      along: Velocity of the centre along u [m/s].
      sideways: Velocity that turns the roller [m/s].
    """
    if driven.published:
        return driven
    wheel, floor = driven.wheel, driven.floor
    resisted = wheel_on_floor(wheel.wheel, floor, rim, along, sideways)
    return DrivenWheel(PlanarWheel(resisted, *wheel[1:]), driven.motor, floor, driven.published)


@inlined
def wheel_torque_bounds(driven, current, wheel_speed, load):
    """Torque on the wheel except traction, turning forward and turning backward [N.m].

    Args:
      driven: `DrivenWheel`.
      current: Motor current [A].
      wheel_speed: φ̇ [rad/s].
      load: `WheelLoad`.
    """
    low, high = motor_torque_bounds(driven.motor, current, wheel_speed, driven.published)
    if driven.published:
        return low, high
    wheel = driven.wheel.wheel
    dry, viscous = bearing_friction(wheel, load.normal, load.aside)
    dry += wheel.rolling * load.normal * wheel.radius
    return low - dry - viscous * wheel_speed, high + dry - viscous * wheel_speed


@kernel
def _world_x(wheel, pose):
    """World x of the wheel's centre [m]."""
    return pose[0] + math.cos(pose[2]) * wheel.position_x - math.sin(pose[2]) * wheel.position_y


@inlined
def _turn_wheel(i, state, driven, packed_terms, current, load, h):
    """Advance speed, angle and backlash of wheel i under its torques and the floor's force."""
    wheel = driven.wheel.wheel
    wheel_speed, gap, rate = state.wheel_speed[i], state.backlash[i], state.backlash_rate[i]
    other = -wheel.radius * load.ahead
    if packed_terms[i, ACTIVE] == 0.0:
        low, high = wheel_torque_bounds(driven, current, wheel_speed, load)
        change = (stick_or_slip(low, high, wheel_speed, wheel.inertia, other, h) + other) / wheel.inertia
    else:
        terms = terms_of_wheel(packed_terms, i)
        low, high = motor_torque_bounds(driven.motor, current, wheel_speed + rate, driven.published)
        dry = axle_dry_friction(terms, low, high)
        other += axle_torque(terms, state.angle[i] + gap, wheel_speed + rate, h)
        if not driven.published:
            bearing, viscous = bearing_friction(wheel, load.normal, load.aside)
            dry += bearing + wheel.rolling * load.normal * wheel.radius
            other -= viscous * wheel_speed
        dry = max(dry, 0.0)
        if terms.backlash != 0.0:
            gear = Backlash(terms.backlash, terms.rotor_inertia, gap, rate)
            torques = AxleTorque(low, high, dry, other)
            change, gap, rate, _ = step_backlash(gear, torques, wheel_speed, wheel.inertia, h)
            state.backlash[i], state.backlash_rate[i] = gap, rate
        else:
            torque = stick_or_slip(low - dry, high + dry, wheel_speed, wheel.inertia, other, h)
            change = (torque + other) / wheel.inertia
    state.wheel_speed[i] = wheel_speed + h * change
    state.angle[i] += 0.5 * h * (wheel_speed + state.wheel_speed[i])


@inlined
def step_wheel(i, state, command, driven, packed_terms, normal, h, output):
    """Advance the whole state of wheel i; return its force along u, and against z × u [N].

    Args:
      i: Index of the wheel.
      state: `PlanarState`, changed in place.
      command: Commanded current [A].
      driven: `DrivenWheel`.
      packed_terms: `EffectTerms` of all wheels, read only where they are active, shape (n, TERMS).
      normal: F_N [N].
      h: Step [s].
      output: `PlanarOutput`, filled in place.
    """
    wheel, wheel_speed = driven.wheel, state.wheel_speed[i]
    along, across = wheel_velocity(wheel, state.twist[0], state.twist[1], state.twist[2])
    rim = wheel.wheel.radius * wheel_speed
    slip, sideways = contact_velocity(wheel, rim, along, across)
    rate = relaxation_rate(driven.floor, slip, rolling_speed(driven.floor, rim, along, sideways))
    z = exact_step(state.bristle[i], slip, rate, h)
    mean = mean_deflection(state.bristle[i], z, slip, rate, h)
    grip = wheel.grip * load_factor(driven.floor, normal)
    traction = normal * grip * force_ratio(driven.floor, mean, slip, rate)
    added = 0.0
    if packed_terms[i, ACTIVE] != 0.0:
        terms = terms_of_wheel(packed_terms, i)
        place, time = _world_x(wheel, state.pose), state.clock[0]
        traction *= traction_scale(terms, place)
        added = hub_force(terms, along, place, time, across, state.angle[i], wheel_speed, h)
    driven = on_its_floor(driven, rim, along, sideways)
    roller, drag = roller_friction(driven.wheel.wheel, state.roller[i], sideways, normal, h)
    ahead, aside = contact_force(wheel, traction, drag)
    before = state.current[i]
    current = next_current(driven.motor, before, command, wheel_speed, h)
    mean = mean_current(driven.motor, before, current, command, wheel_speed, h)
    _turn_wheel(i, state, driven, packed_terms, mean, WheelLoad(normal, ahead, aside), h)
    state.bristle[i], state.roller[i], state.current[i] = z, roller, current
    output.slip[i], output.normal[i], output.traction[i], output.drag[i] = slip, normal, traction, drag
    output.encoder_speed[i] = state.wheel_speed[i] + state.backlash_rate[i]
    return ahead + added, aside


@kernel
def supply_currents(state, command, motors, terms, draws):
    """Currents drawn by the motors from a sagging supply at the voltage that results, and their sum [A].

    V = V_0 − R_s Σ i_j(V) has one solution, since no current falls with the voltage.

    Args:
      state: `PlanarState`.
      command: Commanded currents, shape (n,) [A].
      motors: Packed motors, shape (n, MOTOR_SIZE).
      terms: Packed effect terms, shape (n, TERMS).
      draws: Filled with each motor's current, shape (n,) [A].
    """
    full, sag = motor_at(motors[0]).supply, terms_at(terms[0]).sag
    low, high = 0.0, full
    for _ in range(BISECTIONS):
        voltage, total = 0.5 * (low + high), 0.0
        for i in range(command.size):
            motor, own = motor_at(motors[i]), terms_at(terms[i])
            draws[i] = supply_current(motor, own, state.clock[0], voltage, command[i], state.wheel_speed[i])
            total += draws[i]
        if voltage > full - sag * total:
            high = voltage
        else:
            low = voltage
    return total
