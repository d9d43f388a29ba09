"""Writes the parameters of floors, wheels and rail into the `user` arrays of a compiled model."""

from __future__ import annotations

import mujoco
import numpy as np

from omnimj.errors import InputError
from omnimj.parameters import Floor, Rig, Robot
from omnimj.parameters.floor import ROW
from omnimj.parameters.robot import roller_sides
from omnimj.physics.motor import MOTOR_ROW, motor_row
from omnimj.signals import Array
from omnimj.twin import slots


def bind_floor(mj_model: mujoco.MjModel, geom: int, kind: float, floor: Floor) -> None:
    """Makes a geom a floor or a patch with this floor's traction law."""
    mj_model.geom_user[geom, slots.KIND] = kind
    mj_model.geom_user[geom, slots.FLOOR_ROW : slots.FLOOR_ROW + ROW] = floor.row


def wheel_slots(machine: Robot | Rig) -> np.ndarray:
    """A healthy wheel's numbers as they stand in `actuator_user`, shape (ACTUATOR_SLOTS,)."""
    row = np.zeros(slots.ACTUATOR_SLOTS)
    wheel, bearing, contact = machine.wheel, machine.bearing, machine.contact
    row[slots.RAIL_JOINT] = row[slots.FLOOR_OVERRIDE] = row[slots.SENSOR] = -1
    row[slots.GRIP] = row[slots.ROLLER_SIN] = 1.0
    row[slots.RADIUS] = wheel.radius
    row[slots.STIFFNESS], row[slots.DAMPING] = contact.stiffness, contact.damping
    row[slots.ROLLER_DRY : slots.ROLLING_RESISTANCE + 1] = (
        wheel.roller_dry,
        wheel.roller_viscous,
        wheel.roller_bristle_stiffness,
        wheel.roller_bristle_damping,
        wheel.roller_grip,
        wheel.roller_coast_time,
        wheel.rolling_resistance,
    )
    row[slots.BEARING_DRY : slots.BEARING_OVERHANG + 1] = (
        bearing.dry,
        bearing.viscous,
        0.5 * bearing.pitch_diameter,
        bearing.spacing,
        bearing.overhang,
    )
    row[slots.MOTOR : slots.MOTOR + MOTOR_ROW] = motor_row(machine.motor)
    return row


def bind_wheels(mj_model: mujoco.MjModel, machine: Robot | Rig, wheels: int) -> None:
    """Marks the model as ours and fills the actuators `motor_1 … motor_n` and the rollers' geoms.

    Raises:
      InputError: The MJCF lacks a part, or its actuators are not in the order of the wheels.
    """
    for i in range(wheels):
        prefix = f"wheel_{i + 1}_"
        try:
            actuator = mj_model.actuator(f"motor_{i + 1}").id
            axle = mj_model.joint(f"{prefix}axle")
            sensor = int(mj_model.sensor(f"{prefix}contact").adr[0])
        except KeyError as error:
            raise InputError("MJCF", f"wheel {i + 1}: {error.args[0]}") from None
        if actuator != i:
            raise InputError(
                "MJCF", f"motor_{i + 1} is actuator {actuator + 1}", "motors come first, in order"
            )
        rollers = [b for b in range(mj_model.nbody) if mj_model.body(b).name.startswith(f"{prefix}roller_")]
        dofs = mj_model.body_dofadr[rollers]
        if not np.array_equal(dofs, np.arange(dofs[0], dofs[0] + len(rollers))):
            raise InputError("MJCF", f"the rollers of wheel {i + 1} are not consecutive bodies")
        row = wheel_slots(machine)
        if isinstance(machine, Robot):
            row[[slots.ROLLER_SIN, slots.ROLLER_COS]] = roller_sides(machine.wheels[i].roller_angle)
        row[slots.WHEEL_BODY], row[slots.WHEEL_DOF] = axle.bodyid[0], axle.dofadr[0]
        row[slots.FIRST_ROLLER_DOF], row[slots.ROLLER_COUNT] = dofs[0], len(rollers)
        row[slots.SENSOR], row[slots.ANGLE_AT] = sensor, axle.qposadr[0]
        mj_model.actuator_user[i] = row
        for body in rollers:
            geom = mj_model.geom(mj_model.body(body).name).id
            mj_model.geom_user[geom, slots.KIND] = slots.ROLLER
            mj_model.geom_user[geom, slots.ROLLER_WHEEL] = i
    mj_model.actuator_user[0, slots.MAGIC] = slots.MAGIC_NUMBER
    mj_model.actuator_user[0, slots.WHEELS] = wheels


def bind_rail(mj_model: mujoco.MjModel, rig: Rig, weight: float) -> None:
    """Puts the rail's friction into its joint and tells the wheel where it is."""
    body, rail = rig.rig, mj_model.joint("rail").id
    mj_model.jnt_user[rail] = (
        body.rail_friction,
        body.rail_dry,
        body.rail_viscous,
        body.rail_half_width,
        body.rail_height,
        body.contact_offset,
        body.com_offset,
        weight,
        body.rail_load_time,
    )
    mj_model.actuator_user[0, slots.RAIL_JOINT] = rail
    mj_model.actuator_user[0, slots.POSITION_AT] = mj_model.jnt_qposadr[rail]


def bind_effects(mj_model: mujoco.MjModel, terms: Array, measured_current: bool) -> None:
    """Puts effects into the wheels' slots, and takes the limits off commands that were measured.

    Args:
      mj_model: A model that `bind_wheels` has filled.
      terms: Rows of `physics.effect_terms`, shape (wheels, TERMS).
      measured_current: Commands are currents that were measured.
    """
    wheels, columns = terms.shape
    mj_model.actuator_user[:wheels, slots.TERM : slots.TERM + columns] = terms
    if measured_current:
        mj_model.actuator_ctrllimited[:wheels] = 0
