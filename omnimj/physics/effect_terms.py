"""Added physics of one driven wheel (or carriage), shared by the equations and the twin.

The terms are added to the physics of the model; zero terms add nothing. Shapes (a speed, a place, a width)
determine where an amplitude acts and have no effect without it. On the rig the guide's terms act on the
carriage; on a robot the forces act at the hub, along the driving direction of the wheel.

Kernels take `EffectTerms`. Per wheel, and in the memory of a compiled MuJoCo model, they are a packed row of
`TERMS` numbers, read with `terms_at`, of a wheel of several with `terms_of_wheel`.
"""

from __future__ import annotations

import math
from types import MappingProxyType
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from omnimj.physics.motor import MotorParameters, achievable_current, stick_or_slip
from omnimj.physics.native import first_numbers, inlined, kernel, row_numbers


class EffectTerms(NamedTuple):
    """Added physics of one wheel, in the form used by the kernels."""

    active: float
    """1 when any amplitude below is not zero; otherwise the rest is ignored."""
    guide_dry: float
    """Dry friction of the guide [N]."""
    guide_viscous: float
    """[N.s/m]"""
    stribeck: float
    """Extra dry friction near standstill [N]."""
    stribeck_speed: float
    """Speed at which 37 % of it is left [m/s]."""
    sticky: float
    """Extra dry friction at one place [N]."""
    sticky_place: float
    """[m]"""
    sticky_width: float
    """Standard deviation of the place along the guide [m]."""
    cable: float
    """Stiffness [N/m]."""
    cable_force: float
    """Force of the cable at position 0 [N]."""
    air: float
    """Force over squared speed [N.s²/m²]."""
    grade: float
    """Gravity along the guide [m/s²]."""
    ripple: float
    """Amplitude of a force on carriage or hub [N]."""
    ripple_order: float
    """Its periods per turn of the wheel."""
    repeating_sine: float
    """Amplitude of a force that repeats with angle or place: its part sin(n φ + k x) [N]."""
    repeating_cosine: float
    """Its part cos(n φ + k x) [N]."""
    repeating_order: float
    """Its periods per turn n of the wheel."""
    repeating_wave: float
    """Its wave number k along the guide [rad/m]."""
    axle_dry: float
    """Dry friction at the axle [N.m]."""
    axle_viscous: float
    """[N.m.s/rad]"""
    gear_load: float
    """Lost share of the motor's torque."""
    cogging: float
    """Amplitude of a torque at the wheel [N.m]."""
    cogging_order: float
    """Its periods per turn of the wheel."""
    backlash: float
    """Width of the dead zone of the gear at the wheel [rad]."""
    rotor_inertia: float
    """Rotor inertia reflected to the wheel [kg.m²]."""
    sag: float
    """Resistance of the supply [ohm]."""
    heating: float
    """Share by which the torque constant falls and the resistance rises [1/s]."""
    patch: float
    """Traction scale on a stretch of floor − 1."""
    patch_start: float
    """[m]"""
    patch_end: float
    """[m]"""
    curve: NDArray[np.float64]
    """Tabulated force: its variable's code, first knot, knots per unit and the values [N]."""


KNOTS = 8
"""Knots of the tabulated force."""
_SCALARS = len(EffectTerms._fields) - 1
TERMS = _SCALARS + 3 + KNOTS
"""Length of a packed row."""
TERM = MappingProxyType({name: k for k, name in enumerate(EffectTerms._fields[:-1])})
"""Place of each scalar in a packed row by name."""
ACTIVE = TERM["active"]
"""Place of the mark that spares kernels a look at the rest."""

CURVE_VARIABLES = ("speed", "position", "time", "lateral_speed", "wheel_angle")
"""Variables of the tabulated force: m/s, m, s, m/s, rad (one turn, closed)."""
_SPEED, _POSITION, _TIME, _LATERAL, _ANGLE = range(1, 6)  # their codes; 0: no curve

_SHAPES = ("active", "stribeck_speed", "sticky_place", "sticky_width", "ripple_order", "repeating_order",
           "repeating_wave", "cogging_order", "rotor_inertia", "patch_start", "patch_end")  # fmt: skip
_AMPLITUDES = (
    *(place for name, place in TERM.items() if name not in _SHAPES),
    _SCALARS,
)

PATCH_EDGE = 0.01
"""Length over which a wheel passes from one floor to the next [m]."""

BISECTIONS = 30
"""Bisections that find the voltage of a supply that several motors share: to 1e-9 of it."""

_LEAST_SHARE = 0.05  # of torque constant and resistance, whatever the heating
_TURN = 2.0 * math.pi


def zero_terms(wheels: int = 1) -> NDArray[np.float64]:
    """Packed rows that add nothing, shape (wheels, TERMS)."""
    return np.zeros((wheels, TERMS))


def write_curve(terms: NDArray[np.float64], over: str, values: ArrayLike, low: float, high: float) -> None:
    """Write the tabulated force into a packed row (or rows), in place.

    Args:
      terms: Shape (TERMS,) or (n, TERMS).
      over: One of `CURVE_VARIABLES`.
      values: Force at `KNOTS` knots from `low` to `high`, straight lines between, constant beyond [N]; over
        the wheel angle the knots divide one turn and the last is joined to the first (`low`, `high` unused).
      low: First knot, in the unit of the variable.
      high: Last knot.
    """
    first = _SCALARS
    if over == "wheel_angle":
        low, high = 0.0, _TURN * (KNOTS - 1) / KNOTS
    terms[..., first] = CURVE_VARIABLES.index(over) + 1
    terms[..., first + 1] = low
    terms[..., first + 2] = (KNOTS - 1) / (high - low)
    terms[..., first + 3 : first + 3 + KNOTS] = np.asarray(values, float)


def mark_active(terms: NDArray[np.float64]) -> None:
    """Set `active` of packed rows, shape (n, TERMS), in place."""
    terms[:, ACTIVE] = terms[:, _AMPLITUDES].any(axis=1)


@kernel
def terms_at(row):
    """`EffectTerms` of a packed row, shape (TERMS,)."""
    scalars = first_numbers(row, _SCALARS)
    return EffectTerms(*(scalars + (row[_SCALARS:],)))  # noqa: RUF005 numba joins tuples this way only


@inlined
def terms_of_wheel(rows, i):
    """`EffectTerms` of row i of packed rows, shape (n, TERMS)."""
    return EffectTerms(*(row_numbers(rows, i, _SCALARS) + (rows[i, _SCALARS:],)))  # noqa: RUF005


@kernel
def _curve(curve, x):
    """Value of the tabulated force at x [N]."""
    if curve[0] == _ANGLE:
        place = (x / _TURN - math.floor(x / _TURN)) * KNOTS
        knot = min(int(place), KNOTS - 1)
        after = (knot + 1) % KNOTS
    else:
        place = min(max((x - curve[1]) * curve[2], 0.0), KNOTS - 1.0)
        knot = min(int(place), KNOTS - 2)
        after = knot + 1
    share = place - knot
    return (1.0 - share) * curve[3 + knot] + share * curve[3 + after]


@kernel
def curve_force(terms, speed, position, time, lateral_speed, angle):
    """Tabulated force [N].

    Args:
      terms: `EffectTerms`.
      speed: Speed along the guide or the driving direction [m/s].
      position: Position along the guide, or world x of the wheel [m].
      time: Time since the start [s].
      lateral_speed: Lateral speed [m/s].
      angle: Wheel angle [rad].
    """
    curve, over = terms.curve, terms.curve[0]
    if over == _SPEED:
        return _curve(curve, speed)
    if over == _POSITION:
        return _curve(curve, position)
    if over == _TIME:
        return _curve(curve, time)
    if over == _LATERAL:
        return _curve(curve, lateral_speed)
    return _curve(curve, angle) if over == _ANGLE else 0.0


@kernel
def mean_ripple(amplitude, order, angle, speed, h):
    """Mean of A sin(n φ) over h seconds at constant speed, free of aliases however fast the wheel turns.

    Args:
      amplitude: A, in the unit of the result.
      order: Periods per turn n.
      angle: Wheel angle φ at the start of the step [rad].
      speed: Wheel speed [rad/s].
      h: Step [s].
    """
    if amplitude == 0.0:
        return 0.0
    half = 0.5 * order * speed * h
    fade = 1.0 if abs(half) < 1e-6 else math.sin(half) / half
    return amplitude * math.sin(order * angle + half) * fade


@kernel
def _repeating_force(terms, position, speed, angle, wheel_speed, h):
    """Mean of a sin ψ + b cos ψ over h seconds at constant speeds, ψ = n φ + k x [N]."""
    rate = terms.repeating_order * wheel_speed + terms.repeating_wave * speed
    half = 0.5 * rate * h
    middle = terms.repeating_order * angle + terms.repeating_wave * position + half
    fade = 1.0 if abs(half) < 1e-6 else math.sin(half) / half
    return fade * (terms.repeating_sine * math.sin(middle) + terms.repeating_cosine * math.cos(middle))


@kernel
def guide_dry_friction(terms, speed, position):
    """Dry friction added on the guide: constant, near standstill, and at one place [N].

    F = F_c + F_s exp(−(v/v_s)²) + F_p exp(−½((x − p)/w)²).
    """
    dry = terms.guide_dry
    if terms.stribeck != 0.0:
        ratio = speed / terms.stribeck_speed
        dry += terms.stribeck * math.exp(-ratio * ratio)
    if terms.sticky != 0.0:
        away = (position - terms.sticky_place) / terms.sticky_width
        dry += terms.sticky * math.exp(-0.5 * away * away)
    return dry


@kernel
def guide_force(terms, speed, position, time, lateral_speed, angle, wheel_speed, h):
    """Force added on the carriage besides dry friction and gravity [N].

    F = −d v − k x + F_0 − c v |v| + A sin(n φ) + a sin ψ + b cos ψ + tabulated; arguments as for
    `curve_force`, ψ as for `_repeating_force`.
    """
    force = -terms.guide_viscous * speed - terms.cable * position + terms.cable_force
    force -= terms.air * speed * abs(speed)
    force += mean_ripple(terms.ripple, terms.ripple_order, angle, wheel_speed, h)
    if terms.repeating_sine != 0.0 or terms.repeating_cosine != 0.0:
        force += _repeating_force(terms, position, speed, angle, wheel_speed, h)
    return force + curve_force(terms, speed, position, time, lateral_speed, angle)


@kernel
def hub_force(terms, speed, position, time, lateral_speed, angle, wheel_speed, h):
    """Force added at a robot's wheel along its driving direction: ripple and tabulated forces [N]."""
    force = mean_ripple(terms.ripple, terms.ripple_order, angle, wheel_speed, h)
    return force + curve_force(terms, speed, position, time, lateral_speed, angle)


@kernel
def widen_friction(low, high, dry):
    """Bounds of set-valued friction widened by `dry`, which may be negative; they never cross."""
    middle = 0.5 * (low + high)
    half = max(0.5 * (high - low) + dry, 0.0)
    return middle - half, middle + half


@kernel
def axle_dry_friction(terms, motor_low, motor_high):
    """Dry torque added at the axle: bearing, and the gear's share of the motor's torque [N.m]."""
    return terms.axle_dry + terms.gear_load * abs(0.5 * (motor_low + motor_high))


@kernel
def axle_torque(terms, angle, wheel_speed, h):
    """Torque added at the axle besides dry friction: viscous and cogging torque [N.m]."""
    cogging = mean_ripple(terms.cogging, terms.cogging_order, angle, wheel_speed, h)
    return cogging - terms.axle_viscous * wheel_speed


@kernel
def traction_scale(terms, position):
    """Ratio of the traction at a place to that of the floor: 1, plus a change within the patch [1]."""
    if terms.patch == 0.0:
        return 1.0
    inside = min(position - terms.patch_start, terms.patch_end - position) / PATCH_EDGE + 0.5
    return 1.0 + terms.patch * min(max(inside, 0.0), 1.0)


@kernel
def has_motor_effects(terms):
    """Return whether supply or heating changes the motor's parameters."""
    return terms.sag != 0.0 or terms.heating != 0.0


@kernel
def apply_motor_effects(motor, terms, time, other_current):
    """`MotorParameters` at a given time and load of the supply.

    K_t (1 − a t), R (1 + a t); the supply delivers V − R_s Σi: this motor's own current sees the additional
    resistance R_s, and the other motors' currents lower the voltage.

    Args:
      motor: `MotorParameters`.
      terms: `EffectTerms`.
      time: Time since the start [s].
      other_current: Current drawn from the supply by the other motors [A].
    """
    heat = terms.heating * time
    return _with_supply(
        motor,
        motor.torque_constant * max(1.0 - heat, _LEAST_SHARE),
        motor.resistance * max(1.0 + heat, _LEAST_SHARE) + terms.sag,
        max(motor.supply - terms.sag * other_current, 0.0),
    )


@kernel
def _with_supply(motor, torque_constant, resistance, supply):
    m = motor
    return MotorParameters(torque_constant, resistance, m.no_load_torque, m.viscous, supply, *m[5:])


@kernel
def supply_current(motor, terms, time, voltage, command, wheel_speed):
    """Current that a motor draws from a supply at a given voltage [A].

    |i| where motor voltage and current have the same sign; a braking motor draws and feeds back nothing.

    Args:
      motor: `MotorParameters`.
      terms: `EffectTerms`.
      time: Time since the start [s].
      voltage: Voltage of the supply [V].
      command: Commanded current [A].
      wheel_speed: φ̇ after the gear [rad/s].
    """
    warm = apply_motor_effects(motor, terms, time, 0.0)
    warm = _with_supply(warm, warm.torque_constant, warm.resistance - terms.sag, voltage)
    current = achievable_current(warm, command, wheel_speed)
    across = warm.resistance * current + warm.torque_constant * warm.gear_ratio * wheel_speed
    return abs(current) if current * across > 0.0 else 0.0


class Backlash(NamedTuple):
    """Gear with a dead zone between rotor and wheel."""

    width: float
    """Width of the dead zone, reflected to the wheel [rad]."""
    rotor_inertia: float
    """J, reflected to the wheel [kg.m²]."""
    angle: float
    """Rotor's angle relative to the wheel, −width/2 … width/2 [rad]."""
    rate: float
    """Rate of that angle [rad/s]."""


class AxleTorque(NamedTuple):
    """Torques on rotor and wheel [N.m]."""

    low: float
    """Motor torque at a wheel that turns forward."""
    high: float
    """Motor torque at a wheel that turns backward."""
    dry: float
    """Dry friction on the wheel's side."""
    other: float
    """T_o, all other torque on the wheel."""


@kernel
def step_backlash(gear, torque, wheel_speed, inertia, h):
    """Advance rotor and wheel, with a dead zone between them, by one step; impact without rebound.

    In contact: I φ̈ = T + T_o with the gear pushing, T − J φ̈ ≥ 0 (or pulling at the other flank). In the gap
    the rotor runs alone, J ρ̇ = T, and the wheel (I − J) φ̈ = T_o; at the end of the gap both continue together
    with their common momentum.

    Args:
      gear: `Backlash`.
      torque: `AxleTorque`.
      wheel_speed: φ̇ [rad/s].
      inertia: I, rotor included [kg.m²].
      h: Step [s].

    Returns:
      Mean acceleration of the wheel over the step [rad/s²], next angle and rate of the rotor relative to the
      wheel [rad, rad/s], whether they touched.
    """
    half, rotor = 0.5 * gear.width, gear.rotor_inertia
    low, high, dry, other = torque.low, torque.high, torque.dry, torque.other
    if gear.rate == 0.0 and abs(gear.angle) >= half:
        both = stick_or_slip(low - dry, high + dry, wheel_speed, inertia, other, h)
        change = (both + other) / inertia
        passed = min(max(both, low), high) - rotor * change
        if (gear.angle > 0.0 and passed >= 0.0) or (gear.angle < 0.0 and passed <= 0.0):
            return change, gear.angle, 0.0, True
    own = inertia - rotor
    change = (stick_or_slip(-dry, dry, wheel_speed, own, other, h) + other) / own
    rotor_speed = wheel_speed + gear.rate
    rotor_change = stick_or_slip(low, high, rotor_speed, rotor, 0.0, h) / rotor
    next_rate = gear.rate + h * (rotor_change - change)
    next_angle = gear.angle + h * next_rate
    if abs(next_angle) < half:
        return change, next_angle, next_rate, False
    together = (own * (wheel_speed + h * change) + rotor * (rotor_speed + h * rotor_change)) / inertia
    return (together - wheel_speed) / h, math.copysign(half, next_angle), 0.0, False
