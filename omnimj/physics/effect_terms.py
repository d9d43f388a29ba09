"""Added physics of one driven wheel (or carriage) as one row of numbers, for equations and twin alike.

The terms come on top of what the model has; a row of zeros adds nothing. Shapes (a speed, a place, a width)
say where an amplitude acts; without the amplitude they do nothing. On the rig the guide's terms act on the
carriage; on a robot the forces act at the hub, along the driving direction of the wheel.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import ArrayLike, NDArray

from omnimj.physics.motor import RATIO, RESISTANCE, SUPPLY, TORQUE_CONSTANT, achievable_current, stick_or_slip
from omnimj.physics.native import kernel

ACTIVE = 0  # 1 when any amplitude below is not zero: everything else is then worth looking at
# guide: dry [N], viscous [N.s/m], Stribeck [N] and its speed [m/s], sticky place [N], where and how wide [m]
DRY, VISCOUS, STRIBECK, STRIBECK_SPEED, STICKY, STICKY_PLACE, STICKY_WIDTH = range(1, 8)
# cable: stiffness [N/m] and the force at position 0 [N]; air [N.s²/m²]; gravity along the guide [m/s²]
CABLE, CABLE_FORCE, AIR, GRADE = range(8, 12)
# ripple on carriage or hub [N] and its periods per turn of the wheel over 2π
RIPPLE, RIPPLE_ORDER = 12, 13
# axle: dry [N.m], viscous [N.m.s/rad], share of the motor's torque lost; cogging at the wheel [N.m], order
AXLE_DRY, AXLE_VISCOUS, GEAR_LOAD, COGGING, COGGING_ORDER = range(14, 19)
# backlash: width at the wheel [rad], inertia of the rotor seen at the wheel [kg.m2]
BACKLASH, ROTOR = 19, 20
# supply's resistance [ohm]; share per second by which torque constant falls and resistance rises [1/s]
SAG, HEATING = 21, 22
# stretch of floor: traction scale − 1 [1], start and end [m]
PATCH, PATCH_START, PATCH_END = 23, 24, 25
# tabulated forces: over what, first knot, knots per unit, then the values at the knots [N]
KNOTS = 8
CURVE = 26
CURVE_SIZE = 3 + KNOTS
CURVES = 2
TERMS = CURVE + CURVES * CURVE_SIZE

CURVE_VARIABLES = ("speed", "position", "time", "lateral_speed", "wheel_angle")
"""What a tabulated force may depend on: m/s, m, s, m/s, rad (one turn, closed)."""
_SPEED, _POSITION, _TIME, _LATERAL, _ANGLE = range(1, 6)  # codes in the row; 0: no curve

AMPLITUDES = (
    *(DRY, VISCOUS, STRIBECK, STICKY, CABLE, CABLE_FORCE, AIR, GRADE, RIPPLE, AXLE_DRY, AXLE_VISCOUS),
    *(GEAR_LOAD, COGGING, BACKLASH, SAG, HEATING, PATCH, *(CURVE + k * CURVE_SIZE for k in range(CURVES))),
)
"""Columns that must not all be zero for the row to do anything."""

PATCH_EDGE = 0.01
"""A wheel passes from one floor to the next over this length [m]."""

BISECTIONS = 30
"""Bisections that find the voltage of a supply that several motors share: to 1e-9 of it."""

_LEAST_WARM = 0.05  # share of the torque constant that no heating takes away
_TURN = 2.0 * math.pi


def zero_terms(wheels: int = 1) -> NDArray[np.float64]:
    """Rows that add nothing, shape (wheels, TERMS)."""
    return np.zeros((wheels, TERMS))


def write_curve(
    terms: NDArray[np.float64], slot: int, over: str, values: ArrayLike, low: float, high: float
) -> None:
    """Puts a tabulated force into a row (or rows), in place.

    Args:
      terms: Shape (TERMS,) or (n, TERMS).
      slot: Which of the `CURVES` places.
      over: One of `CURVE_VARIABLES`.
      values: Force at `KNOTS` knots from `low` to `high`, straight lines between, constant beyond [N]; over
        the wheel angle the knots divide one turn and the last is joined to the first (`low`, `high` unused).
      low: First knot.
      high: Last knot.
    """
    first = CURVE + slot * CURVE_SIZE
    if over == "wheel_angle":
        low, high = 0.0, _TURN * (KNOTS - 1) / KNOTS
    terms[..., first] = CURVE_VARIABLES.index(over) + 1
    terms[..., first + 1] = low
    terms[..., first + 2] = (KNOTS - 1) / (high - low)
    terms[..., first + 3 : first + 3 + KNOTS] = np.asarray(values, float)


def mark_active(terms: NDArray[np.float64]) -> None:
    """Sets `ACTIVE` of rows, shape (n, TERMS), in place."""
    terms[:, ACTIVE] = terms[:, AMPLITUDES].any(axis=1)


@kernel
def _curve(terms, first, x):
    """One tabulated force at x [N]."""
    if terms[first] == _ANGLE:
        place = (x / _TURN - math.floor(x / _TURN)) * KNOTS
        knot = min(int(place), KNOTS - 1)
        after = (knot + 1) % KNOTS
    else:
        place = min(max((x - terms[first + 1]) * terms[first + 2], 0.0), KNOTS - 1.0)
        knot = min(int(place), KNOTS - 2)
        after = knot + 1
    share = place - knot
    return (1.0 - share) * terms[first + 3 + knot] + share * terms[first + 3 + after]


@kernel
def curve_force(terms, speed, position, time, lateral_speed, angle):
    """Sum of the tabulated forces [N]."""
    force = 0.0
    for k in range(CURVES):
        first = CURVE + k * CURVE_SIZE
        over = terms[first]
        if over == _SPEED:
            force += _curve(terms, first, speed)
        elif over == _POSITION:
            force += _curve(terms, first, position)
        elif over == _TIME:
            force += _curve(terms, first, time)
        elif over == _LATERAL:
            force += _curve(terms, first, lateral_speed)
        elif over == _ANGLE:
            force += _curve(terms, first, angle)
    return force


@kernel
def mean_ripple(amplitude, order, angle, speed, h):
    """Mean of A sin(n φ) over h seconds of constant speed: no aliases, however fast the wheel turns."""
    if amplitude == 0.0:
        return 0.0
    half = 0.5 * order * speed * h
    fade = 1.0 if abs(half) < 1e-6 else math.sin(half) / half
    return amplitude * math.sin(order * angle + half) * fade


@kernel
def guide_dry_friction(terms, speed, position):
    """Dry friction added on the guide: constant, near standstill, at a place [N].

    F = F_c + F_s exp(−(v/v_s)²) + F_p exp(−½((x − p)/w)²).
    """
    dry = terms[DRY]
    if terms[STRIBECK] != 0.0:
        ratio = speed / terms[STRIBECK_SPEED]
        dry += terms[STRIBECK] * math.exp(-ratio * ratio)
    if terms[STICKY] != 0.0:
        away = (position - terms[STICKY_PLACE]) / terms[STICKY_WIDTH]
        dry += terms[STICKY] * math.exp(-0.5 * away * away)
    return dry


@kernel
def guide_force(terms, speed, position, time, lateral_speed, angle, wheel_speed, h):
    """Force added on the carriage besides dry friction and gravity [N].

    F = −d v − k x + F_0 − c v |v| + A sin(n φ) + tabulated.
    """
    force = -terms[VISCOUS] * speed - terms[CABLE] * position + terms[CABLE_FORCE]
    force -= terms[AIR] * speed * abs(speed)
    force += mean_ripple(terms[RIPPLE], terms[RIPPLE_ORDER], angle, wheel_speed, h)
    return force + curve_force(terms, speed, position, time, lateral_speed, angle)


@kernel
def hub_force(terms, speed, position, time, lateral_speed, angle, wheel_speed, h):
    """Force added at a robot's wheel along its driving direction: ripple and tabulated [N]."""
    force = mean_ripple(terms[RIPPLE], terms[RIPPLE_ORDER], angle, wheel_speed, h)
    return force + curve_force(terms, speed, position, time, lateral_speed, angle)


@kernel
def widen_friction(low, high, dry):
    """Bounds of set-valued friction with more (or less) of it: never less than none."""
    middle = 0.5 * (low + high)
    half = max(0.5 * (high - low) + dry, 0.0)
    return middle - half, middle + half


@kernel
def axle_dry_friction(terms, motor_low, motor_high):
    """Dry torque added at the axle: bearing, and the gear's share of the motor's torque [N.m]."""
    return terms[AXLE_DRY] + terms[GEAR_LOAD] * abs(0.5 * (motor_low + motor_high))


@kernel
def axle_torque(terms, angle, wheel_speed, h):
    """Torque added at the axle besides dry friction: viscous and cogging [N.m]."""
    cogging = mean_ripple(terms[COGGING], terms[COGGING_ORDER], angle, wheel_speed, h)
    return cogging - terms[AXLE_VISCOUS] * wheel_speed


@kernel
def traction_scale(terms, position):
    """Traction at a place over that of the floor: 1 + change between start and end [1]."""
    if terms[PATCH] == 0.0:
        return 1.0
    inside = min(position - terms[PATCH_START], terms[PATCH_END] - position) / PATCH_EDGE + 0.5
    return 1.0 + terms[PATCH] * min(max(inside, 0.0), 1.0)


@kernel
def has_motor_effects(terms):
    """Whether supply or heat change the motor's numbers."""
    return terms[SAG] != 0.0 or terms[HEATING] != 0.0


@kernel
def apply_motor_effects(motor, terms, time, other_current, changed):
    """Fills `changed` with the motor's numbers at a time and a load of the supply, shape (MOTOR_ROW,).

    K_t(1 − a t), R(1 + a t); the supply gives V − R_s Σi, where this motor's own current is R_s more
    resistance and the other motors' current less voltage.

    Args:
      motor: `motor.motor_row`.
      terms: The wheel's row.
      time: Since the start [s].
      other_current: That the other motors on the supply take [A].
      changed: Filled.
    """
    for k in range(motor.size):
        changed[k] = motor[k]
    heat = terms[HEATING] * time
    changed[TORQUE_CONSTANT] *= max(1.0 - heat, _LEAST_WARM)
    changed[RESISTANCE] = motor[RESISTANCE] * max(1.0 + heat, _LEAST_WARM) + terms[SAG]
    changed[SUPPLY] = max(motor[SUPPLY] - terms[SAG] * other_current, 0.0)


@kernel
def supply_current(motor, terms, time, voltage, command, wheel_speed, room):
    """Current that a motor takes from a supply at a voltage [A]; `room`, shape (MOTOR_ROW,), is used up.

    |i| where motor voltage and current have one sign; a braking motor takes nothing and feeds nothing back.
    """
    apply_motor_effects(motor, terms, time, 0.0, room)
    room[RESISTANCE] -= terms[SAG]
    room[SUPPLY] = voltage
    current = achievable_current(room, command, wheel_speed)
    across = room[RESISTANCE] * current + room[TORQUE_CONSTANT] * room[RATIO] * wheel_speed
    return abs(current) if current * across > 0.0 else 0.0


@kernel
def step_backlash(terms, lash, rate, low, high, dry, wheel_speed, inertia, other, h):
    """One step of rotor and wheel with a dead zone between them, impact without rebound.

    Touching: I φ̈ = T + T_o with the gear pushing, T − J φ̈ ≥ 0 (or pulling at the other flank). In the gap the
    rotor runs alone, J ρ̇ = T, and the wheel (I − J) φ̈ = T_o; at the end of the gap both go on together with
    their momentum.

    Args:
      terms: The wheel's row: width of the dead zone, J.
      lash: Rotor's angle over the wheel's, −width/2 … width/2 [rad].
      rate: Its rate [rad/s].
      low: Motor's torque at the wheel, turning forward [N.m].
      high: The same turning backward.
      dry: Dry friction of the wheel's own side [N.m].
      wheel_speed: φ̇ [rad/s].
      inertia: I, rotor included [kg.m2].
      other: T_o, all other torque on the wheel [N.m].
      h: Step [s].

    Returns:
      Mean acceleration of the wheel over the step [rad/s²], next lash, next rate, whether they touched.
    """
    half, rotor = 0.5 * terms[BACKLASH], terms[ROTOR]
    if rate == 0.0 and abs(lash) >= half:
        torque = stick_or_slip(low - dry, high + dry, wheel_speed, inertia, other, h)
        change = (torque + other) / inertia
        passed = min(max(torque, low), high) - rotor * change
        if (lash > 0.0 and passed >= 0.0) or (lash < 0.0 and passed <= 0.0):
            return change, lash, 0.0, True
    own = inertia - rotor
    change = (stick_or_slip(-dry, dry, wheel_speed, own, other, h) + other) / own
    rotor_speed = wheel_speed + rate
    rotor_change = stick_or_slip(low, high, rotor_speed, rotor, 0.0, h) / rotor
    next_rate = rate + h * (rotor_change - change)
    next_lash = lash + h * next_rate
    if abs(next_lash) < half:
        return change, next_lash, next_rate, False
    together = (own * (wheel_speed + h * change) + rotor * (rotor_speed + h * rotor_change)) / inertia
    return (together - wheel_speed) / h, math.copysign(half, next_lash), 0.0, False
