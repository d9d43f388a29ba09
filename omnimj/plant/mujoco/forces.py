"""Applies what the wheels feel to MuJoCo's passive forces: contacts, rollers, motors, rail."""

from __future__ import annotations

import numba

from omnimj.physics.effect_terms import ACTIVE, BACKLASH
from omnimj.physics.motor import MOTOR_ROW, drive_torque_bounds, stick_or_slip
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
from omnimj.plant.mujoco.effect_forces import (
    add_air_drag,
    drive_with_effects,
    force_at_hub,
    guide_with_effects,
    motor_with_effects,
    step_gear_backlash,
    terms_of,
)
from omnimj.plant.mujoco.memory import OFFSETS, load_int, load_pointer, load_real, stack_reals, store_real


@kernel
def add_force(m, d, body, x, y, z, fx, fy, fz, watched, second):
    """Adds a force at a point of a body to qfrc_passive: Jᵀf along the body's chain of joints.

    Returns:
      What it added to the degrees of freedom `watched` and `second`.
    """
    dof_number = load_pointer(m + OFFSETS.m_body_dofnum)
    parent = load_pointer(m + OFFSETS.m_body_parentid)
    root = load_int(load_pointer(m + OFFSETS.m_body_rootid), body)
    com = load_pointer(d + OFFSETS.d_subtree_com) + 24 * root
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
    on_watched, on_second = 0.0, 0.0
    while dof >= 0:
        c = axes + 48 * dof
        q = load_real(c, 0) * mx + load_real(c, 1) * my + load_real(c, 2) * mz
        q += load_real(c, 3) * fx + load_real(c, 4) * fy + load_real(c, 5) * fz
        store_real(passive, dof, load_real(passive, dof) + q)
        if dof == watched:
            on_watched = q
        if dof == second:
            on_second = q
        dof = load_int(dof_parent, dof)
    return on_watched, on_second


@kernel
def _roller_force(m, d, row, found, count, grip, h):
    """Lateral force of the floor on a roller, and the roller's dof and lever.

    F = F_lat + I(ω* − ω)/(J h), ω* = −v_c/J: what makes the roller roll in this step, bounded by its grip.
    Two contacts of one roller share the change of spin by their normal force.
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
    if abs(lever) < 1e-4:  # touching with its end: it cannot roll there
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
    """Applies normal force, traction and roller friction of one wheel's contacts.

    Returns:
      Torque of the floor about the axle, and force on the degree of freedom `second`.
    """
    own = load_pointer(m + OFFSETS.m_actuator_user) + 8 * load_pointer(m + OFFSETS.m_nuser_actuator) * wheel
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
        x, y, z = row[POINT], row[POINT + 1], row[POINT + 2]
        about, along = add_force(m, d, numba.int64(row[ROLLER_BODY]), x, y, z, fx, fy, fz, axle, second)
        torque, pull = torque + about, pull + along
        if row[FLOOR_BODY] > 0.0:
            add_force(m, d, numba.int64(row[FLOOR_BODY]), x, y, z, -fx, -fy, -fz, -1, -1)
        # the bearing between roller and wheel holds the roller back
        store_real(passive, dof, load_real(passive, dof) - row[DRAG] * lever)
    return torque, pull


@kernel
def coast_rollers(m, d, own, wheel, found, count, h):
    """Lifted rollers lose their spin in the bearing's grease: torque −I ω/τ."""
    first = numba.int64(load_real(own, slots.FIRST_ROLLER_DOF))
    passive = load_pointer(d + OFFSETS.d_qfrc_passive)
    spin = load_pointer(d + OFFSETS.d_qvel)
    inertia = load_pointer(m + OFFSETS.m_dof_M0)
    rate = 1.0 / max(load_real(own, slots.ROLLER_COAST), h)
    for dof in range(first, first + numba.int64(load_real(own, slots.ROLLER_COUNT))):
        drag = load_real(inertia, dof) * load_real(spin, dof) * rate
        store_real(passive, dof, load_real(passive, dof) - drag)
    for i in range(count):  # rollers on the floor roll instead: give them their drag back, once each
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


@kernel
def axle_resistance(own, pressed, lateral_force, rolling, wheel_speed):
    """Dry torque of bearings and rolling [N.m].

    Bearing: (μ_dry + μ_vis |φ̇|)(|F_A| + |F_B|) p_d/2, F_A = (F_N(a + b) − G r)/a, F_B = (F_N b − G r)/a
    (Eqs. 4.37-4.38), G the rollers' resistance to sideways motion.
    """
    a, b = load_real(own, slots.BEARING_SPACING), load_real(own, slots.BEARING_OVERHANG)
    tilt = -lateral_force * load_real(own, slots.RADIUS)
    load = (abs(pressed * (a + b) - tilt) + abs(pressed * b - tilt)) / a
    friction = load_real(own, slots.BEARING_DRY) + load_real(own, slots.BEARING_VISCOUS) * abs(wheel_speed)
    return friction * load * load_real(own, slots.BEARING_RADIUS) + rolling * load_real(own, slots.RADIUS)


@kernel
def add_drive_torque(m, d, wheel, own, pressed, traction, lateral_force, rolling, floor_torque, h):
    """Motor through gear, no-load, bearing and rolling friction, brake: one set-valued torque on the axle."""
    dof = numba.int64(load_real(own, slots.WHEEL_DOF))
    act = load_pointer(d + OFFSETS.d_act) + 8 * load_int(load_pointer(m + OFFSETS.m_actuator_actadr), wheel)
    wheel_speed = load_real(load_pointer(d + OFFSETS.d_qvel), dof)
    motor = motor_with_effects(m, d, own, wheel, False, numba.carray(stack_reals(MOTOR_ROW), (MOTOR_ROW,)))
    resistance = axle_resistance(own, pressed, lateral_force, rolling, wheel_speed)
    inertia = load_real(load_pointer(m + OFFSETS.m_dof_M0), dof)
    terms = terms_of(own)
    if terms[ACTIVE] == 0.0:
        low, high = drive_torque_bounds(motor, load_real(act, slots.CURRENT), wheel_speed)
        torque = stick_or_slip(low - resistance, high + resistance, wheel_speed, inertia, floor_torque, h)
    else:
        low, high, dry, more = drive_with_effects(d, own, act, motor, wheel_speed, resistance, h)
        other = floor_torque + more
        torque = more + stick_or_slip(low - dry, high + dry, wheel_speed, inertia, other, h)
        if terms[BACKLASH] != 0.0:
            change, _, _, touching = step_gear_backlash(
                own, act, low, high, dry, more, wheel_speed, inertia, traction, h
            )
            if not touching:  # MuJoCo's axle carries the rotor: what makes the wheel do as if it did not
                torque = inertia * change - floor_torque
    passive = load_pointer(d + OFFSETS.d_qfrc_passive)
    store_real(passive, dof, load_real(passive, dof) + torque)


@kernel
def add_hub_forces(m, d, wheels, own, h):
    """Effects that push a robot's wheel along its driving direction, and its share of the air's drag."""
    body = numba.int64(load_real(own, slots.WHEEL_BODY))
    axes = load_pointer(d + OFFSETS.d_xmat) + 72 * body
    place = load_pointer(d + OFFSETS.d_xpos) + 24 * body
    x, y, z = load_real(place, 0), load_real(place, 1), load_real(place, 2)
    ahead_x, ahead_y = (
        load_real(axes, 4),
        -load_real(axes, 1),
    )  # axle × vertical; the axle: the wheel's y axis
    v_x, v_y, _ = point_velocity(m, d, body, x, y, z)
    along, across = v_x * ahead_x + v_y * ahead_y, v_y * ahead_x - v_x * ahead_y
    force = force_at_hub(m, d, own, along, across, h)
    if force != 0.0:
        add_force(m, d, body, x, y, z, force * ahead_x, force * ahead_y, 0.0, -1, -1)
    add_air_drag(m, d, own, wheels)


@kernel
def add_rail_friction(m, d, own, joint, pressed, lateral_force, lateral_speed, rolling, pull, h):
    """Friction of the rig's rail and rolling resistance of its wheel, Eqs. 4.12-4.16, with stiction.

    F = F_0 + F_rol + (μ_D,dry + μ_D,vis |ẋ|)(|F_H| + |F_G|), F_H,G = (F_D h ∓ M_D)/(2h), F_D = −G,
    M_D = F_N d − m_T g e − G c.
    """
    rail = load_pointer(m + OFFSETS.m_jnt_user) + 8 * load_pointer(m + OFFSETS.m_nuser_jnt) * joint
    dof = load_int(load_pointer(m + OFFSETS.m_jnt_dofadr), joint)
    speed = load_real(load_pointer(d + OFFSETS.d_qvel), dof)
    half = load_real(rail, slots.RAIL_HALF_WIDTH)
    resisting = -lateral_force
    moment = pressed * load_real(rail, slots.RAIL_D) - load_real(rail, slots.RAIL_WEIGHT) * load_real(
        rail, slots.RAIL_E
    )
    moment -= resisting * load_real(rail, slots.RAIL_HEIGHT)
    load = (abs(-resisting * half - moment) + abs(-resisting * half + moment)) / (2.0 * half)
    friction = load_real(rail, slots.RAIL_COULOMB) + rolling
    friction += (load_real(rail, slots.RAIL_DRY) + load_real(rail, slots.RAIL_VISCOUS) * abs(speed)) * load
    mass = load_real(load_pointer(m + OFFSETS.m_dof_M0), dof)
    if terms_of(own)[ACTIVE] == 0.0:
        force = stick_or_slip(-friction, friction, speed, mass, pull, h)
    else:
        low, high, added, other = guide_with_effects(d, own, friction, speed, lateral_speed, mass, pull, h)
        force = added + stick_or_slip(low, high, speed, mass, other, h)
    passive = load_pointer(d + OFFSETS.d_qfrc_passive)
    store_real(passive, dof, load_real(passive, dof) + force)
