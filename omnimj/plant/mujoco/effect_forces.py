"""The terms of `physics.effect_terms` in the twin: motor, axle, guide, hub and air, beside what wheels feel.

Everything here is asked for only where a wheel's row is active, except `motor_with_effects`.
"""

from __future__ import annotations

import math

import numba

from omnimj.physics.effect_terms import (
    AIR,
    BISECTIONS,
    GRADE,
    SAG,
    TERMS,
    apply_motor_effects,
    axle_dry_friction,
    axle_torque,
    guide_dry_friction,
    guide_force,
    has_motor_effects,
    hub_force,
    step_backlash,
    supply_current,
    widen_friction,
)
from omnimj.physics.motor import MOTOR_ROW, SUPPLY, drive_torque_bounds
from omnimj.physics.native import kernel
from omnimj.plant.mujoco import slots
from omnimj.plant.mujoco.memory import OFFSETS, load_int, load_pointer, load_real, real_pointer, store_real


@kernel
def terms_of(own):
    """The effects' row of a wheel."""
    return numba.carray(real_pointer(own + 8 * slots.EFFECT_TERMS), (TERMS,))


@kernel
def elapsed_time(d):
    """Time since the start of the run [s]."""
    return load_real(d + OFFSETS.d_time, 0)


@kernel
def wheel_angle(d, own):
    """Angle of the wheel [rad]."""
    return load_real(load_pointer(d + OFFSETS.d_qpos), numba.int64(load_real(own, slots.ANGLE_ADDRESS)))


@kernel
def _own(m, wheel):
    return load_pointer(m + OFFSETS.m_actuator_user) + 8 * slots.ACTUATOR_SLOTS * wheel


@kernel
def _draw(m, d, wheel, voltage, room):
    """Current that a wheel's motor takes from a supply at a voltage [A]."""
    own = _own(m, wheel)
    motor = numba.carray(real_pointer(own + 8 * slots.MOTOR), (MOTOR_ROW,))
    place = load_int(load_pointer(m + OFFSETS.m_actuator_ctrladr), wheel)
    command = load_real(load_pointer(d + OFFSETS.d_ctrl), place)
    turning = load_real(load_pointer(d + OFFSETS.d_qvel), numba.int64(load_real(own, slots.WHEEL_DOF)))
    return supply_current(motor, terms_of(own), elapsed_time(d), voltage, command, turning, room)


@kernel
def _current_of_others(m, d, wheel, room):
    """What the other wheels' motors take at the voltage that all leave of a sagging supply [A].

    As `planar.supply_currents`: V = V_0 − R_s Σ i_j(V) by bisection.
    """
    first = _own(m, 0)
    wheels = numba.int64(load_real(first, slots.WHEELS))
    sag = terms_of(first)[SAG]
    if wheels == 1 or sag == 0.0:
        return 0.0
    full = load_real(first, slots.MOTOR + SUPPLY)
    low, high, others = 0.0, full, 0.0
    for _ in range(BISECTIONS):
        voltage, total = 0.5 * (low + high), 0.0
        others = 0.0
        for i in range(wheels):
            taken = _draw(m, d, i, voltage, room)
            total += taken
            if i != wheel:
                others += taken
        if voltage > full - sag * total:
            high = voltage
        else:
            low = voltage
    return others


@kernel
def motor_with_effects(m, d, own, wheel, limited, room):
    """The motor's row at this time; `room`, shape (MOTOR_ROW,), takes it where supply or heat change it.

    Only where the current is `limited` does the supply that motors share matter.
    """
    motor = numba.carray(real_pointer(own + 8 * slots.MOTOR), (MOTOR_ROW,))
    terms = terms_of(own)
    if not has_motor_effects(terms):
        return motor
    others = _current_of_others(m, d, wheel, room) if limited else 0.0
    apply_motor_effects(motor, terms, elapsed_time(d), others, room)
    return room


@kernel
def drive_with_effects(d, own, act, motor, wheel_speed, resistance, h):
    """Motor's bounds, dry friction and further torque at an axle with effects [N.m].

    Args:
      d: mjData.
      own: The wheel's slots.
      act: Its activations.
      motor: Its motor's row.
      wheel_speed: φ̇ [rad/s].
      resistance: Dry friction of bearings and rolling that the model has [N.m].
      h: Step [s].

    Returns:
      Turning forward, turning backward, dry friction, further torque.
    """
    terms = terms_of(own)
    play, rate = load_real(act, slots.PLAY), load_real(act, slots.PLAY_RATE)
    low, high = drive_torque_bounds(motor, load_real(act, slots.CURRENT), wheel_speed + rate)
    dry = max(resistance + axle_dry_friction(terms, low, high), 0.0)
    return low, high, dry, axle_torque(terms, wheel_angle(d, own) + play, wheel_speed + rate, h)


@kernel
def step_gear_backlash(own, act, low, high, dry, more, wheel_speed, inertia, traction, h):
    """`effect_terms.step_backlash` of a wheel; passive forces and activations must come to the same answer.

    Hence the floor's torque is −r F for both, which the one knows more exactly than the other.
    """
    other = more - load_real(own, slots.RADIUS) * traction
    play, rate = load_real(act, slots.PLAY), load_real(act, slots.PLAY_RATE)
    return step_backlash(terms_of(own), play, rate, low, high, dry, wheel_speed, inertia, other, h)


@kernel
def guide_with_effects(d, own, friction, speed, lateral_speed, mass, pull, h):
    """Bounds of the rail's friction with effects, what else they add, and all that pulls on the carriage [N].

    Args:
      d: mjData.
      own: The wheel's slots.
      friction: Dry friction that the model has [N].
      speed: Of the carriage [m/s].
      lateral_speed: Of the wheel sideways [m/s].
      mass: That moves along the rail [kg].
      pull: What the wheel does to the carriage [N].
      h: Step [s].

    Returns:
      Moving forward, moving backward, added force, everything but friction.
    """
    terms = terms_of(own)
    position = load_real(
        load_pointer(d + OFFSETS.d_qpos), numba.int64(load_real(own, slots.POSITION_ADDRESS))
    )
    turning = load_real(load_pointer(d + OFFSETS.d_qvel), numba.int64(load_real(own, slots.WHEEL_DOF)))
    low, high = widen_friction(-friction, friction, guide_dry_friction(terms, speed, position))
    added = guide_force(
        terms, speed, position, elapsed_time(d), lateral_speed, wheel_angle(d, own), turning, h
    )
    # MuJoCo's own gravity pulls down the slope; here it matters for sticking only
    return low, high, added, pull + added + mass * terms[GRADE]


@kernel
def force_at_hub(m, d, own, velocity, across, h):
    """Force along the driving direction at a robot's wheel, its velocity along it being given [N]."""
    terms = terms_of(own)
    place = load_pointer(d + OFFSETS.d_xpos) + 24 * numba.int64(load_real(own, slots.WHEEL_BODY))
    turning = load_real(load_pointer(d + OFFSETS.d_qvel), numba.int64(load_real(own, slots.WHEEL_DOF)))
    return hub_force(
        terms, velocity, load_real(place, 0), elapsed_time(d), across, wheel_angle(d, own), turning, h
    )


@kernel
def add_air_drag(m, d, own, wheels):
    """One wheel's share of −c |v| v on the free body that carries it."""
    coefficient = terms_of(own)[AIR] / wheels
    if coefficient == 0.0:
        return
    body = load_int(load_pointer(m + OFFSETS.m_body_rootid), numba.int64(load_real(own, slots.WHEEL_BODY)))
    if load_int(load_pointer(m + OFFSETS.m_body_dofnum), body) != 6:
        return
    dof = load_int(load_pointer(m + OFFSETS.m_body_dofadr), body)
    speed = load_pointer(d + OFFSETS.d_qvel)
    passive = load_pointer(d + OFFSETS.d_qfrc_passive)
    x, y = load_real(speed, dof), load_real(speed, dof + 1)
    pull = -coefficient * math.sqrt(x * x + y * y)
    store_real(passive, dof, load_real(passive, dof) + pull * x)
    store_real(passive, dof + 1, load_real(passive, dof + 1) + pull * y)
