"""Contact between one wheel and the floor: a pure function of MuJoCo's state and contact list.

Per contact: depth d and its rate, slip velocity V_r along the driving direction, lateral velocity v_c of the
wheel, without the spin of the roller. Per wheel: the normal force is that of its deepest roller, shared among
rollers with similar normals in proportion to their depth, so that a change of roller reflects the geometry
and not a second spring; traction and roller friction follow with one bristle each.

In the kernels `m` and `d` are the addresses of mjModel and mjData, `own` that of a wheel's slots, `wheel` its
index; x, y, z is a point in the world [m], h the step [s]. `found` contains the contact rows of
`gather_contacts`, shape (MAX_CONTACTS, COLUMNS), of which `count` are filled.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numba

from omnimj.physics.effect_terms import traction_scale
from omnimj.physics.native import kernel
from omnimj.physics.traction import (
    exact_step,
    force_ratio,
    load_factor,
    relaxation_rate,
    rolling_resistance,
    rolling_speed,
)
from omnimj.physics.wheel import passive_roller_damping
from omnimj.plant.mujoco import slots
from omnimj.plant.mujoco.memory import (
    OFFSETS,
    is_active,
    load_int,
    load_pointer,
    load_real,
    slots_of,
    store_real,
    terms_of,
    traction_of,
    wheel_speed_of,
)

# columns of a contact's row
WHEEL, ROLLER_BODY, FLOOR_GEOM, FLOOR_BODY, DEPTH, DEPTH_RATE, SLIP, LATERAL = range(8)
NORMAL, AHEAD, ASIDE, POINT = 8, 11, 14, 17
FORCE, PRESSED, DRAG = 20, 21, 22  # traction, normal force, bearing friction of the rollers
COLUMNS = 23
MAX_CONTACTS = 64
SENSED = len(slots.SENSOR_FIELDS)
CONTACT_BUFFER = MAX_CONTACTS * COLUMNS
"""Number of doubles for the contacts of one call."""


class WheelForces(NamedTuple):
    """Contact forces of one wheel, in the order of `slots.SENSOR_FIELDS`."""

    slip: float
    """Mean slip velocity [m/s]."""
    normal: float
    """Normal force [N]."""
    traction: float
    """Force along the roller axis [N]."""
    lateral: float
    """Force across the roller axis [N]."""
    lateral_velocity: float
    """Mean velocity of the carrier across the roller axis [m/s]."""
    next_bristle: float
    """Bristle deflection of the traction after the step [m]."""
    next_lateral_bristle: float
    """Bristle deflection of the roller bearings after the step [m]."""
    rolling: float
    """Rolling resistance of wheel and floor at the rim [N]."""


@kernel
def write_sensed(d, own, forces):
    """Write the contact forces of a wheel into its user sensor."""
    sensors = load_pointer(d + OFFSETS.d_sensordata)
    first = numba.int64(load_real(own, slots.SENSOR))
    for k in range(SENSED):
        store_real(sensors, first + k, forces[k])


@kernel
def read_sensed(d, own):
    """`WheelForces` of a wheel in this step, from its user sensor."""
    sensors = load_pointer(d + OFFSETS.d_sensordata) + 8 * numba.int64(load_real(own, slots.SENSOR))
    return WheelForces(
        load_real(sensors, 0),
        load_real(sensors, 1),
        load_real(sensors, 2),
        load_real(sensors, 3),
        load_real(sensors, 4),
        load_real(sensors, 5),
        load_real(sensors, 6),
        load_real(sensors, 7),
    )


@kernel
def point_velocity(m, d, body, x, y, z):
    """Compute the velocity of a point fixed to a body, world frame [m/s].

    Args:
      body: Index of the body.
    """
    root = load_int(load_pointer(m + OFFSETS.m_body_rootid), body)
    com = load_pointer(d + OFFSETS.d_subtree_com) + 24 * root
    c = load_pointer(d + OFFSETS.d_cvel) + 48 * body
    rx, ry, rz = x - load_real(com, 0), y - load_real(com, 1), z - load_real(com, 2)
    wx, wy, wz = load_real(c, 0), load_real(c, 1), load_real(c, 2)
    return (
        load_real(c, 3) + wy * rz - wz * ry,
        load_real(c, 4) + wz * rx - wx * rz,
        load_real(c, 5) + wx * ry - wy * rx,
    )


@kernel
def floor_under(m, d, own, geom, x, y, z):
    """Find the geom that is the floor at a point: the wheel's override, a patch, or the geom itself.

    Args:
      geom: Index of the floor's geom that the roller touches.

    Returns:
      Index of a geom.
    """
    override = load_real(own, slots.FLOOR_OVERRIDE)
    if override >= 0.0:
        return numba.int64(override)
    users = load_pointer(m + OFFSETS.m_geom_user)
    floor = users + 8 * load_pointer(m + OFFSETS.m_nuser_geom) * geom
    # patches are in the order of the scenario, the last one on top
    for k in range(numba.int64(load_real(floor, slots.PATCH_COUNT)) - 1, -1, -1):
        patch = numba.int64(load_real(floor, slots.FIRST_PATCH)) + k
        place = load_pointer(d + OFFSETS.d_geom_xpos) + 24 * patch
        axes = load_pointer(d + OFFSETS.d_geom_xmat) + 72 * patch
        half = load_pointer(m + OFFSETS.m_geom_size) + 24 * patch  # half length, half width, …
        rx, ry, rz = x - load_real(place, 0), y - load_real(place, 1), z - load_real(place, 2)
        along = rx * load_real(axes, 0) + ry * load_real(axes, 3) + rz * load_real(axes, 6)
        across = rx * load_real(axes, 1) + ry * load_real(axes, 4) + rz * load_real(axes, 7)
        if abs(along) <= load_real(half, 0) and abs(across) <= load_real(half, 1):
            return patch
    return geom


@kernel
def describe_contact(m, d, contact, own, roller_geom, floor_geom, sign, row):
    """Fill the row of a contact with its geometry and velocities.

    Args:
      contact: Address of mjContact.
      roller_geom: Index of the roller's geom.
      floor_geom: Index of the floor's geom.
      sign: 1 if the normal of the contact points from floor to roller, −1 if from roller to floor.
      row: Row to fill, shape (COLUMNS,); WHEEL and the forces are left alone.

    Returns:
      False if the contact does not touch or has no driving direction.
    """
    depth = -load_real(contact + OFFSETS.c_dist, 0)
    if depth <= 0.0:
        return False
    frame, pos = contact + OFFSETS.c_frame, contact + OFFSETS.c_pos
    nx, ny, nz = sign * load_real(frame, 0), sign * load_real(frame, 1), sign * load_real(frame, 2)
    # surface point of the roller, so that the rolling radius is not reduced by the depth
    x = load_real(pos, 0) - 0.5 * depth * nx
    y = load_real(pos, 1) - 0.5 * depth * ny
    z = load_real(pos, 2) - 0.5 * depth * nz
    wheel_body = numba.int64(load_real(own, slots.WHEEL_BODY))
    axes = load_pointer(d + OFFSETS.d_xmat) + 72 * wheel_body
    ax, ay, az = load_real(axes, 1), load_real(axes, 4), load_real(axes, 7)  # axle: the wheel's y axis
    tx, ty, tz = ay * nz - az * ny, az * nx - ax * nz, ax * ny - ay * nx
    length = math.sqrt(tx * tx + ty * ty + tz * tz)
    if length < 1e-6:  # the wheel lies on its side: no driving direction
        return False
    tx, ty, tz = tx / length, ty / length, tz / length
    sx, sy, sz = ny * tz - nz * ty, nz * tx - nx * tz, nx * ty - ny * tx
    # traction acts along the roller axis, rolling across it: t and s on an omni wheel
    sin, cos = load_real(own, slots.ROLLER_SIN), load_real(own, slots.ROLLER_COS)
    ux, uy, uz = sin * tx + cos * sx, sin * ty + cos * sy, sin * tz + cos * sz
    sx, sy, sz = sin * sx - cos * tx, sin * sy - cos * ty, sin * sz - cos * tz
    tx, ty, tz = ux, uy, uz
    geom_body = load_pointer(m + OFFSETS.m_geom_bodyid)
    floor_body = load_int(geom_body, floor_geom)
    vx, vy, vz = point_velocity(m, d, wheel_body, x, y, z)
    if floor_body > 0:
        ux, uy, uz = point_velocity(m, d, floor_body, x, y, z)
        vx, vy, vz = vx - ux, vy - uy, vz - uz
    row[ROLLER_BODY] = load_int(geom_body, roller_geom)
    row[FLOOR_GEOM] = floor_under(m, d, own, floor_geom, x, y, z)
    row[FLOOR_BODY] = floor_body
    row[DEPTH] = depth
    row[DEPTH_RATE] = -(nx * vx + ny * vy + nz * vz)
    row[SLIP] = -(tx * vx + ty * vy + tz * vz)
    row[LATERAL] = sx * vx + sy * vy + sz * vz
    row[NORMAL], row[NORMAL + 1], row[NORMAL + 2] = nx, ny, nz
    row[AHEAD], row[AHEAD + 1], row[AHEAD + 2] = tx, ty, tz
    row[ASIDE], row[ASIDE + 1], row[ASIDE + 2] = sx, sy, sz
    row[POINT], row[POINT + 1], row[POINT + 2] = x, y, z
    return True


@kernel
def gather_contacts(m, d, only, found):
    """Write the touching contacts of one wheel or all wheels.

    Args:
      only: Index of the wheel; all wheels when negative.
      found: Rows to fill, shape (MAX_CONTACTS, COLUMNS).

    Returns:
      Number of rows written.
    """
    users = load_pointer(m + OFFSETS.m_geom_user)
    width = load_pointer(m + OFFSETS.m_nuser_geom)
    wheels = load_pointer(m + OFFSETS.m_actuator_user)
    wheel_width = 8 * load_pointer(m + OFFSETS.m_nuser_actuator)
    contacts = load_pointer(d + OFFSETS.d_contact)
    count = 0
    for k in range(load_int(d + OFFSETS.d_ncon, 0)):
        contact = contacts + OFFSETS.contact_size * k
        first, second = load_int(contact + OFFSETS.c_geom, 0), load_int(contact + OFFSETS.c_geom, 1)
        if first < 0 or second < 0:  # a flex
            continue
        sign = 1.0  # the frame's normal points from the first geom to the second
        floor_geom, roller_geom = first, second
        if load_real(users, width * first + slots.KIND) == slots.ROLLER:
            floor_geom, roller_geom, sign = second, first, -1.0
        if (
            load_real(users, width * roller_geom + slots.KIND) != slots.ROLLER
            or load_real(users, width * floor_geom + slots.KIND) != slots.FLOOR
        ):
            continue
        wheel = numba.int64(load_real(users, width * roller_geom + slots.ROLLER_WHEEL))
        if (only >= 0 and wheel != only) or count == MAX_CONTACTS:
            continue
        own = wheels + wheel_width * wheel
        if describe_contact(m, d, contact, own, roller_geom, floor_geom, sign, found[count]):
            found[count, WHEEL] = wheel
            count += 1
    return count


@kernel
def share_normal_force(found, count, wheel, stiffness, damping):
    """Share a wheel's normal force among its contacts; fill column PRESSED.

    N_i = w_i (k d_max + c ḋ_i) ≥ 0, w_i = d_i/Σ d_j over rollers with similar normals. Contacts
    with normals 60° apart are separate springs; parallel ones share a single spring.

    Args:
      stiffness: Stiffness k of the contact [N/m].
      damping: Damping c of the contact [N.s/m].

    Returns:
      Normal force of the wheel [N].
    """
    total = 0.0
    for i in range(count):
        if found[i, WHEEL] != wheel:
            continue
        deepest, together = 0.0, 0.0
        for j in range(count):
            if found[j, WHEEL] == wheel:
                agree = 0.0
                for k in range(3):
                    agree += found[i, NORMAL + k] * found[j, NORMAL + k]
                depth = found[j, DEPTH] * max(0.0, 2.0 * agree - 1.0)
                deepest = max(deepest, depth)
                together += depth
        force = found[i, DEPTH] / together * (stiffness * deepest + damping * found[i, DEPTH_RATE])
        found[i, PRESSED] = max(0.0, force)
        total += found[i, PRESSED]
    return total


@kernel
def wheel_contact_forces(m, d, wheel, found, count, h):
    """Compute the contact forces of one wheel; fill columns FORCE, PRESSED and DRAG of its contacts.

    Traction of contact i: N_i (N/F_ref)^(p−1) f(z, V_r,i), N = Σ N_i, on the floor under it, with one bristle
    z for the wheel; bearing friction of the rollers: N_i (σ0 z_l + σ1 ż_l + μ_vis v_c), g = μ_dry, with one
    lateral bristle; `traction.rolling_resistance` of the floor under it, on wheel and rollers.

    Returns:
      `WheelForces`.
    """
    own = slots_of(m, wheel)
    act = load_pointer(d + OFFSETS.d_act) + 8 * load_int(load_pointer(m + OFFSETS.m_actuator_actadr), wheel)
    pressed = share_normal_force(
        found, count, wheel, load_real(own, slots.STIFFNESS), load_real(own, slots.DAMPING)
    )
    if pressed <= 0.0:  # lifted: the bristles relax
        return WheelForces(0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
    users = load_pointer(m + OFFSETS.m_geom_user)
    width = 8 * load_pointer(m + OFFSETS.m_nuser_geom)
    z = load_real(act, slots.BRISTLE)
    turning = load_real(own, slots.RADIUS) * wheel_speed_of(d, own)
    grip, active = load_real(own, slots.GRIP), is_active(own)
    slip, lateral, traction, z_next = 0.0, 0.0, 0.0, 0.0
    rolling, on_rollers = load_real(own, slots.ROLLING_RESISTANCE) * pressed, 0.0
    for i in range(count):
        if found[i, WHEEL] != wheel:
            continue
        share = found[i, PRESSED] / pressed
        v, sideways = found[i, SLIP], found[i, LATERAL]
        floor = traction_of(users + width * numba.int64(found[i, FLOOR_GEOM]))
        rate = relaxation_rate(floor, v, rolling_speed(floor, turning, turning - v, sideways))
        on_wheel, on_roller = rolling_resistance(floor, max(abs(turning), abs(turning - v)), sideways)
        rolling += on_wheel * found[i, PRESSED]
        on_rollers += share * on_roller
        gripping = grip * traction_scale(terms_of(own), found[i, POINT]) if active else grip
        gripping *= load_factor(floor, pressed)  # of the wheel: rollers that share its load grip as one
        found[i, FORCE] = gripping * found[i, PRESSED] * force_ratio(floor, z, v, rate)
        traction += found[i, FORCE]
        slip += share * v
        lateral += share * sideways
        z_next += share * exact_step(z, v, rate, h)
    deflection = load_real(act, slots.LATERAL_BRISTLE)
    ratio, side_next = _roller_friction(own, on_rollers, deflection, lateral, h)
    for i in range(count):
        if found[i, WHEEL] == wheel:
            found[i, DRAG] = -ratio * found[i, PRESSED]
    return WheelForces(slip, pressed, traction, -ratio * pressed, lateral, z_next, side_next, rolling)


@kernel
def wheel_frame_force(own, traction, lateral):
    """Resolve the floor force F a + L b along u and the axle; a: roller axis, b = n × a.

    Args:
      traction: Force F along the roller axis [N].
      lateral: Force L across the roller axis [N].

    Returns:
      Components along u and along the axle [N].
    """
    s, c = load_real(own, slots.ROLLER_SIN), load_real(own, slots.ROLLER_COS)
    return s * traction - c * lateral, c * traction + s * lateral


@kernel
def _roller_friction(own, on_rollers, z, velocity, h):
    """Friction of the rollers over normal force, and the next deflection of its bristle [m].

    That of their bearings, and `on_rollers` of the floor's rolling resistance.
    """
    dry, damping = load_real(own, slots.ROLLER_DRY) + on_rollers, load_real(own, slots.ROLLER_SIGMA_1)
    if on_rollers > 0.0:
        damping = passive_roller_damping(damping, dry, velocity)
    viscous = load_real(own, slots.ROLLER_VISCOUS) * velocity
    if dry <= 0.0:
        return viscous, 0.0
    stiffness = load_real(own, slots.ROLLER_SIGMA_0)
    z_next = exact_step(z, velocity, stiffness * abs(velocity) / dry, h)
    # mean rate over the step, bounded for any bristle stiffness
    ratio = stiffness * z + damping * (z_next - z) / h + viscous
    return ratio, z_next
