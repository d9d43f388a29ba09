"""Forces of wheels, motors and rail, including effects, added to MuJoCo's passive forces.

In the kernels `m` and `d` are the addresses of mjModel and mjData, `own` that of a wheel's slots, `act` that
of its activations, `wheel` its index, and h is the step [s]. `found` contains the contact rows after
`wheel_contact_forces`, shape (MAX_CONTACTS, COLUMNS), of which `count` are filled; `load` is the `AxleLoad`,
`motor` the `MotorParameters` of the wheel.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numba

from omnimj.physics.effect_terms import (
    BISECTIONS,
    AxleTorque,
    Backlash,
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
from omnimj.physics.motor import drive_torque_bounds, stick_or_slip
from omnimj.physics.native import kernel
from omnimj.plant.mujoco import slots
from omnimj.plant.mujoco.contact import (
    AHEAD,
    ASIDE,
    DRAG,
    FLOOR_BODY,
    FORCE,
    LATERAL,
    NORMAL,
    POINT,
    PRESSED,
    ROLLER_BODY,
    WHEEL,
    point_velocity,
)
from omnimj.plant.mujoco.memory import (
    OFFSETS,
    axle_inertia,
    elapsed_time,
    is_active,
    load_int,
    load_pointer,
    load_real,
    motor_of,
    slots_of,
    store_real,
    terms_of,
    wheel_angle,
    wheel_speed_of,
)


class AxleLoad(NamedTuple):
    """Load on a wheel's axle [N]."""

    normal: float
    """Normal force F_N."""
    ahead: float
    """Force of the floor along the driving direction."""
    lateral: float
    """Force of the floor along the axle."""
    rolling: float
    """Rolling resistance at the rim."""


# contacts


@kernel
def add_force(m, d, body, point, force, watched):
    """Add a force at a point of a body to qfrc_passive: Jᵀf along the body's chain of joints.

    Args:
      body: Index of the body.
      point: x, y, z in the world [m].
      force: x, y, z in the world [N].
      watched: Indices of two degrees of freedom; −1: none.

    Returns:
      Generalised forces added to the two watched degrees of freedom.
    """
    dof_number = load_pointer(m + OFFSETS.m_body_dofnum)
    parent = load_pointer(m + OFFSETS.m_body_parentid)
    root = load_int(load_pointer(m + OFFSETS.m_body_rootid), body)
    com = load_pointer(d + OFFSETS.d_subtree_com) + 24 * root
    (x, y, z), (fx, fy, fz) = point, force
    rx, ry, rz = x - load_real(com, 0), y - load_real(com, 1), z - load_real(com, 2)
    mx, my, mz = ry * fz - rz * fy, rz * fx - rx * fz, rx * fy - ry * fx
    while body > 0 and load_int(dof_number, body) == 0:
        body = load_int(parent, body)
    if body == 0:
        return 0.0, 0.0
    dof = load_int(load_pointer(m + OFFSETS.m_body_dofadr), body) + load_int(dof_number, body) - 1
    dof_parent = load_pointer(m + OFFSETS.m_dof_parentid)
    axes = load_pointer(d + OFFSETS.d_cdof)
    passive = load_pointer(d + OFFSETS.d_qfrc_passive)
    on_first, on_second = 0.0, 0.0
    while dof >= 0:
        c = axes + 48 * dof
        q = load_real(c, 0) * mx + load_real(c, 1) * my + load_real(c, 2) * mz
        q += load_real(c, 3) * fx + load_real(c, 4) * fy + load_real(c, 5) * fz
        store_real(passive, dof, load_real(passive, dof) + q)
        if dof == watched[0]:
            on_first = q
        if dof == watched[1]:
            on_second = q
        dof = load_int(dof_parent, dof)
    return on_first, on_second


@kernel
def _roller_force(m, d, row, found, count, grip, h):
    """Lateral force of the floor on a roller, and the roller's degree of freedom and lever.

    F = F_lat + I(ω* − ω)/(J h), ω* = −v_c/J, makes the roller roll within this step, bounded by its grip.
    Two contacts of one roller share the change of spin in proportion to their normal force.
    """
    body = numba.int64(row[ROLLER_BODY])
    dof = load_int(load_pointer(m + OFFSETS.m_body_dofadr), body)
    axis = load_pointer(d + OFFSETS.d_cdof) + 48 * dof
    place = load_pointer(d + OFFSETS.d_xpos) + 24 * body
    ax, ay, az = load_real(axis, 0), load_real(axis, 1), load_real(axis, 2)
    rx = row[POINT] - load_real(place, 0)
    ry = row[POINT + 1] - load_real(place, 1)
    rz = row[POINT + 2] - load_real(place, 2)
    lever = row[ASIDE] * (ay * rz - az * ry)
    lever += row[ASIDE + 1] * (az * rx - ax * rz)
    lever += row[ASIDE + 2] * (ax * ry - ay * rx)
    if abs(lever) < 1e-4:  # contact at the end of the roller, where it cannot roll
        return row[DRAG], dof, 0.0
    on_roller = 0.0
    for j in range(count):
        if found[j, ROLLER_BODY] == row[ROLLER_BODY]:
            on_roller += found[j, PRESSED]
    inertia = load_real(load_pointer(m + OFFSETS.m_dof_M0), dof)
    spin = load_real(load_pointer(d + OFFSETS.d_qvel), dof)
    change = inertia * (-row[LATERAL] / lever - spin) / (lever * h)
    force = row[DRAG] + change * row[PRESSED] / on_roller
    most = grip * row[PRESSED]
    return min(max(force, -most), most), dof, lever


@kernel
def add_contact_forces(m, d, wheel, found, count, second, h):
    """Apply normal force, traction and roller friction of one wheel's contacts.

    Args:
      second: Index of a further degree of freedom to report besides the axle; −1: none.

    Returns:
      Torque of the floor about the axle [N.m], and generalised force on `second`.
    """
    own = slots_of(m, wheel)
    axle = numba.int64(load_real(own, slots.WHEEL_DOF))
    passive = load_pointer(d + OFFSETS.d_qfrc_passive)
    torque, pull = 0.0, 0.0
    for i in range(count):
        row = found[i]
        if row[WHEEL] != wheel or row[PRESSED] <= 0.0:
            continue
        side, dof, lever = _roller_force(m, d, row, found, count, load_real(own, slots.ROLLER_GRIP), h)
        fx = row[PRESSED] * row[NORMAL] + row[FORCE] * row[AHEAD] + side * row[ASIDE]
        fy = row[PRESSED] * row[NORMAL + 1] + row[FORCE] * row[AHEAD + 1] + side * row[ASIDE + 1]
        fz = row[PRESSED] * row[NORMAL + 2] + row[FORCE] * row[AHEAD + 2] + side * row[ASIDE + 2]
        point = row[POINT], row[POINT + 1], row[POINT + 2]
        about, along = add_force(m, d, numba.int64(row[ROLLER_BODY]), point, (fx, fy, fz), (axle, second))
        torque, pull = torque + about, pull + along
        if row[FLOOR_BODY] > 0.0:
            add_force(m, d, numba.int64(row[FLOOR_BODY]), point, (-fx, -fy, -fz), (-1, -1))
        # the bearing between roller and wheel brakes the roller
        store_real(passive, dof, load_real(passive, dof) - row[DRAG] * lever)
    return torque, pull


@kernel
def coast_rollers(m, d, own, wheel, found, count, h):
    """Slow lifted rollers down by the grease of their bearings: torque −I ω/τ."""
    first = numba.int64(load_real(own, slots.FIRST_ROLLER_DOF))
    passive = load_pointer(d + OFFSETS.d_qfrc_passive)
    spin = load_pointer(d + OFFSETS.d_qvel)
    inertia = load_pointer(m + OFFSETS.m_dof_M0)
    rate = 1.0 / max(load_real(own, slots.ROLLER_COAST), h)
    for dof in range(first, first + numba.int64(load_real(own, slots.ROLLER_COUNT))):
        drag = load_real(inertia, dof) * load_real(spin, dof) * rate
        store_real(passive, dof, load_real(passive, dof) - drag)
    for i in range(count):  # rollers on the floor roll instead: undo their drag, once each
        if found[i, WHEEL] == wheel and _is_first_of_its_roller(found, i):
            dof = load_int(load_pointer(m + OFFSETS.m_body_dofadr), numba.int64(found[i, ROLLER_BODY]))
            drag = load_real(inertia, dof) * load_real(spin, dof) * rate
            store_real(passive, dof, load_real(passive, dof) + drag)


@kernel
def _is_first_of_its_roller(found, i):
    for j in range(i):  # noqa: SIM110 a loop is what compiles well
        if found[j, ROLLER_BODY] == found[i, ROLLER_BODY]:
            return False
    return True


# motor and axle


@kernel
def _supply_current(m, d, wheel, voltage):
    """Current that the motor of a wheel draws from the supply at a given voltage [A]."""
    own = slots_of(m, wheel)
    place = load_int(load_pointer(m + OFFSETS.m_actuator_ctrladr), wheel)
    command = load_real(load_pointer(d + OFFSETS.d_ctrl), place)
    time = elapsed_time(d)
    return supply_current(motor_of(own), terms_of(own), time, voltage, command, wheel_speed_of(d, own))


@kernel
def _current_of_others(m, d, wheel):
    """Current drawn by the motors of the other wheels at the common voltage of a sagging supply [A].

    As in `planar_wheel.supply_currents`, V = V_0 − R_s Σ i_j(V) is solved by bisection.
    """
    first = slots_of(m, 0)
    wheels = numba.int64(load_real(first, slots.WHEELS))
    sag = terms_of(first).sag
    if wheels == 1 or sag == 0.0:
        return 0.0
    full = motor_of(first).supply
    low, high, others = 0.0, full, 0.0
    for _ in range(BISECTIONS):
        voltage, total = 0.5 * (low + high), 0.0
        others = 0.0
        for i in range(wheels):
            drawn = _supply_current(m, d, i, voltage)
            total += drawn
            if i != wheel:
                others += drawn
        if voltage > full - sag * total:
            high = voltage
        else:
            low = voltage
    return others


@kernel
def motor_with_effects(m, d, own, wheel, limited):
    """`MotorParameters` of a wheel at this time.

    Args:
      limited: Whether current limits, and hence the supply shared by the motors, matter.
    """
    motor = motor_of(own)
    if not is_active(own):
        return motor
    terms = terms_of(own)
    if not has_motor_effects(terms):
        return motor
    others = _current_of_others(m, d, wheel) if limited else 0.0
    return apply_motor_effects(motor, terms, elapsed_time(d), others)


@kernel
def _axle_resistance(own, load, wheel_speed):
    """Dry torque of bearings and rolling [N.m].

    Bearing: (μ_dry + μ_vis |φ̇|)(|F_A| + |F_B|) p_d/2, F_A = (F_N(a + b) − G r)/a, F_B = (F_N b − G r)/a
    (Eqs. 4.37-4.38), G the rollers' resistance to sideways motion.
    """
    a, b = load_real(own, slots.BEARING_SPACING), load_real(own, slots.BEARING_OVERHANG)
    radius = load_real(own, slots.RADIUS)
    tilt = -load.lateral * radius
    pressed = (abs(load.normal * (a + b) - tilt) + abs(load.normal * b - tilt)) / a
    friction = load_real(own, slots.BEARING_DRY) + load_real(own, slots.BEARING_VISCOUS) * abs(wheel_speed)
    return friction * pressed * load_real(own, slots.BEARING_RADIUS) + load.rolling * radius


@kernel
def _axle_torque_with_effects(d, own, act, motor, resistance, h):
    """`AxleTorque` of motor, friction and effects; its `other` excludes the torque of the floor.

    Args:
      resistance: Dry friction of bearings and rolling in the model [N.m].
    """
    terms = terms_of(own)
    gap, rate = load_real(act, slots.BACKLASH), load_real(act, slots.BACKLASH_RATE)
    rotor_speed = wheel_speed_of(d, own) + rate
    low, high = drive_torque_bounds(motor, load_real(act, slots.CURRENT), rotor_speed)
    dry = max(resistance + axle_dry_friction(terms, low, high), 0.0)
    return AxleTorque(low, high, dry, axle_torque(terms, wheel_angle(d, own) + gap, rotor_speed, h))


@kernel
def _step_backlash(m, d, own, act, torque, ahead, h):
    """`effect_terms.step_backlash` of a wheel, which must agree between passive forces and activations.

    Both therefore use −r F as the torque of the floor, although the passive forces have a more exact value.

    Args:
      torque: Torque from `_axle_torque_with_effects`.
      ahead: Force F of the floor along the driving direction [N].
    """
    terms = terms_of(own)
    gap, rate = load_real(act, slots.BACKLASH), load_real(act, slots.BACKLASH_RATE)
    gear = Backlash(terms.backlash, terms.rotor_inertia, gap, rate)
    other = torque.other - load_real(own, slots.RADIUS) * ahead
    torques = AxleTorque(torque.low, torque.high, torque.dry, other)
    return step_backlash(gear, torques, wheel_speed_of(d, own), axle_inertia(m, own), h)


@kernel
def backlash_after(m, d, own, act, motor, load, h):
    """Angle and rate of the rotor relative to the wheel after a step [rad, rad/s]."""
    resistance = _axle_resistance(own, load, wheel_speed_of(d, own))
    torque = _axle_torque_with_effects(d, own, act, motor, resistance, h)
    _, gap, rate, _ = _step_backlash(m, d, own, act, torque, load.ahead, h)
    return gap, rate


@kernel
def add_drive_torque(m, d, wheel, own, load, floor_torque, h):
    """Add motor and gear, no-load, bearing and rolling friction, and brake as one set-valued torque.

    Args:
      floor_torque: Torque of the floor about the axle [N.m].
    """
    act = load_pointer(d + OFFSETS.d_act) + 8 * load_int(load_pointer(m + OFFSETS.m_actuator_actadr), wheel)
    wheel_speed, inertia = wheel_speed_of(d, own), axle_inertia(m, own)
    motor = motor_with_effects(m, d, own, wheel, False)
    resistance = _axle_resistance(own, load, wheel_speed)
    if not is_active(own):
        low, high = drive_torque_bounds(motor, load_real(act, slots.CURRENT), wheel_speed)
        torque = stick_or_slip(low - resistance, high + resistance, wheel_speed, inertia, floor_torque, h)
    else:
        axle = _axle_torque_with_effects(d, own, act, motor, resistance, h)
        low, high, other = axle.low - axle.dry, axle.high + axle.dry, floor_torque + axle.other
        torque = axle.other + stick_or_slip(low, high, wheel_speed, inertia, other, h)
        if terms_of(own).backlash != 0.0:
            change, _, _, touching = _step_backlash(m, d, own, act, axle, load.ahead, h)
            if not touching:  # MuJoCo's axle includes the rotor: the wheel must move as without it
                torque = inertia * change - floor_torque
    dof = numba.int64(load_real(own, slots.WHEEL_DOF))
    passive = load_pointer(d + OFFSETS.d_qfrc_passive)
    store_real(passive, dof, load_real(passive, dof) + torque)


# hub, body and rail


@kernel
def add_hub_forces(m, d, wheels, own, h):
    """Add the effects that act along the driving direction of a wheel, and its share of the air drag.

    Args:
      wheels: Number of wheels.
    """
    body = numba.int64(load_real(own, slots.WHEEL_BODY))
    axes = load_pointer(d + OFFSETS.d_xmat) + 72 * body
    place = load_pointer(d + OFFSETS.d_xpos) + 24 * body
    x, y, z = load_real(place, 0), load_real(place, 1), load_real(place, 2)
    ahead_x, ahead_y = load_real(axes, 4), -load_real(axes, 1)  # axle × vertical; the axle is the wheel's y
    v_x, v_y, _ = point_velocity(m, d, body, x, y, z)
    along, across = v_x * ahead_x + v_y * ahead_y, v_y * ahead_x - v_x * ahead_y
    time, angle, turning = elapsed_time(d), wheel_angle(d, own), wheel_speed_of(d, own)
    force = hub_force(terms_of(own), along, x, time, across, angle, turning, h)
    if force != 0.0:
        add_force(m, d, body, (x, y, z), (force * ahead_x, force * ahead_y, 0.0), (-1, -1))
    _add_air_drag(m, d, own, wheels)


@kernel
def _add_air_drag(m, d, own, wheels):
    """Add one wheel's share of −c |v| v to the free body that carries it."""
    coefficient = terms_of(own).air / wheels
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


@kernel
def _rail_resistance(rail, load, speed):
    """Dry friction of the rail and rolling resistance of the wheel [N]; see `add_rail_friction`."""
    half = load_real(rail, slots.RAIL_HALF_WIDTH)
    resisting = -load.lateral
    moment = load.normal * load_real(rail, slots.RAIL_D) - load_real(rail, slots.RAIL_WEIGHT) * load_real(
        rail, slots.RAIL_E
    )
    moment -= resisting * load_real(rail, slots.RAIL_HEIGHT)
    pressed = (abs(-resisting * half - moment) + abs(-resisting * half + moment)) / (2.0 * half)
    friction = load_real(rail, slots.RAIL_COULOMB) + load.rolling
    return friction + (
        (load_real(rail, slots.RAIL_DRY) + load_real(rail, slots.RAIL_VISCOUS) * abs(speed)) * pressed
    )


@kernel
def add_rail_friction(m, d, own, joint, load, lateral_speed, pull, h):
    """Add friction of the rig's rail and rolling resistance of its wheel, Eqs. 4.12-4.16, with stiction.

    F = F_0 + F_rol + (μ_D,dry + μ_D,vis |ẋ|)(|F_H| + |F_G|), F_H,G = (F_D h ∓ M_D)/(2h), F_D = −G,
    M_D = F_N d − m_T g e − G c.

    Args:
      joint: Index of the rail's joint.
      lateral_speed: Lateral speed of the wheel [m/s].
      pull: Force of the wheel on the carriage [N].
    """
    rail = load_pointer(m + OFFSETS.m_jnt_user) + 8 * load_pointer(m + OFFSETS.m_nuser_jnt) * joint
    dof = load_int(load_pointer(m + OFFSETS.m_jnt_dofadr), joint)
    speed = load_real(load_pointer(d + OFFSETS.d_qvel), dof)
    friction = _rail_resistance(rail, load, speed)
    mass = load_real(load_pointer(m + OFFSETS.m_dof_M0), dof)
    if not is_active(own):
        force = stick_or_slip(-friction, friction, speed, mass, pull, h)
    else:
        terms = terms_of(own)
        place = numba.int64(load_real(own, slots.POSITION_ADDRESS))
        position = load_real(load_pointer(d + OFFSETS.d_qpos), place)
        low, high = widen_friction(-friction, friction, guide_dry_friction(terms, speed, position))
        time, angle, turning = elapsed_time(d), wheel_angle(d, own), wheel_speed_of(d, own)
        added = guide_force(terms, speed, position, time, lateral_speed, angle, turning, h)
        # gravity along the slope is part of MuJoCo; here it matters only for stiction
        other = pull + added + mass * terms.grade
        force = added + stick_or_slip(low, high, speed, mass, other, h)
    passive = load_pointer(d + OFFSETS.d_qfrc_passive)
    store_real(passive, dof, load_real(passive, dof) + force)
