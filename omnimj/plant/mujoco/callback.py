"""The native callbacks that MuJoCo calls inside its step, and their installation.

Two C functions compiled by numba, free of the interpreter: passive forces and, later in the same step,
activation rates of the wheel actuators (motor current, bristles). The first computes each contact once and
writes the forces into the wheels' user sensors, from which the second and the readers of the truth take them.
A sensor callback would do no more, but makes MuJoCo compute the momentum of all subtrees in every step.

They act only on models that carry the mark of this package, are pure functions of mjModel and mjData, and
allocate nothing that outlives the call; hence `mj_forward` has no side effect and a batch on many threads
equals a serial loop bit for bit.

In the kernels `m` and `d` are the addresses of mjModel and mjData, `own` and `act` those of a wheel's slots
and activations.
"""

from __future__ import annotations

import ctypes
import math

import mujoco
import numba
from numba import types

from omnimj.errors import OmnimjError
from omnimj.physics.motor import next_current
from omnimj.physics.native import cached, kernel
from omnimj.plant.mujoco import slots
from omnimj.plant.mujoco.contact import (
    COLUMNS,
    CONTACT_BUFFER,
    MAX_CONTACTS,
    gather_contacts,
    read_sensed,
    wheel_contact_forces,
    wheel_frame_force,
    write_sensed,
)
from omnimj.plant.mujoco.forces import (
    AxleLoad,
    add_contact_forces,
    add_drive_torque,
    add_hub_forces,
    add_rail_friction,
    backlash_after,
    coast_rollers,
    motor_with_effects,
)
from omnimj.plant.mujoco.memory import (
    OFFSETS,
    check_offsets,
    is_active,
    load_int,
    load_pointer,
    load_real,
    slots_of,
    stack_reals,
    store_real,
    terms_of,
    wheel_speed_of,
)


@kernel
def wheel_count(m):
    """Number of wheels of a model that carries the mark of this package, 0 for any other."""
    if load_pointer(m + OFFSETS.m_nactuator) == 0 or (
        load_pointer(m + OFFSETS.m_nuser_actuator) != slots.ACTUATOR_SLOTS
    ):
        return 0
    first = load_pointer(m + OFFSETS.m_actuator_user)
    if load_real(first, slots.MAGIC) != slots.MAGIC_NUMBER:
        return 0
    return numba.int64(load_real(first, slots.WHEELS))


@kernel
def add_passive_forces(m, d):
    """Add all forces of motors, wheels and floor to qfrc_passive; write those of contact into the sensors."""
    wheels = wheel_count(m)
    if wheels == 0:
        return
    h = load_real(m + OFFSETS.m_timestep, 0)
    found = numba.carray(stack_reals(CONTACT_BUFFER), (MAX_CONTACTS, COLUMNS))
    count = gather_contacts(m, d, -1, found)
    for wheel in range(wheels):
        own = slots_of(m, wheel)
        forces = wheel_contact_forces(m, d, wheel, found, count, h)
        write_sensed(d, own, forces)
        rail = numba.int64(load_real(own, slots.RAIL_JOINT))
        rail_dof = -1
        if rail >= 0:
            rail_dof = load_int(load_pointer(m + OFFSETS.m_jnt_dofadr), rail)
        torque, pull = add_contact_forces(m, d, wheel, found, count, rail_dof, h)
        coast_rollers(m, d, own, wheel, found, count, h)
        act = load_pointer(d + OFFSETS.d_act) + 8 * load_int(
            load_pointer(m + OFFSETS.m_actuator_actadr), wheel
        )
        load = _axle_load(own, act, forces)
        if rail >= 0:  # in the equations of the rig, rolling resistance acts on the carriage
            on_rail = AxleLoad(load.normal, load.ahead, load.lateral, forces.rolling)
            add_rail_friction(m, d, own, rail, on_rail, forces.lateral_velocity, pull, h)
        elif is_active(own):
            add_hub_forces(m, d, wheels, own, h)
        add_drive_torque(m, d, wheel, own, load, torque, h)


@kernel
def _axle_load(own, act, forces):
    """`AxleLoad` of a wheel; on the rig its lateral load is low-passed and its rolling resistance is zero."""
    ahead, lateral = wheel_frame_force(own, forces.traction, forces.lateral)
    if load_real(own, slots.RAIL_JOINT) >= 0.0:
        return AxleLoad(forces.normal, ahead, load_real(act, slots.LATERAL_LOAD), 0.0)
    return AxleLoad(forces.normal, ahead, lateral, forces.rolling)


@kernel
def set_activation_rates(m, d, actuator):
    """Write act_dot = (next − now)/h of a wheel's current and bristles, exact for constant velocities.

    Args:
      actuator: Index of the actuator; one that is not of a wheel is left alone.
    """
    if actuator >= wheel_count(m):
        return
    h, own = load_real(m + OFFSETS.m_timestep, 0), slots_of(m, actuator)
    forces = read_sensed(d, own)
    address = load_int(load_pointer(m + OFFSETS.m_actuator_actadr), actuator)
    act = load_pointer(d + OFFSETS.d_act) + 8 * address
    rate = load_pointer(d + OFFSETS.d_act_dot) + 8 * address
    command = load_real(
        load_pointer(d + OFFSETS.d_ctrl), load_int(load_pointer(m + OFFSETS.m_actuator_ctrladr), actuator)
    )
    wheel_speed = wheel_speed_of(d, own)
    motor = motor_with_effects(m, d, own, actuator, True)
    now = load_real(act, slots.CURRENT)
    store_real(rate, slots.CURRENT, (next_current(motor, now, command, wheel_speed, h) - now) / h)
    store_real(rate, slots.BRISTLE, (forces.next_bristle - load_real(act, slots.BRISTLE)) / h)
    after = forces.next_lateral_bristle
    store_real(rate, slots.LATERAL_BRISTLE, (after - load_real(act, slots.LATERAL_BRISTLE)) / h)
    if is_active(own) and terms_of(own).backlash != 0.0:
        gap, gap_rate = backlash_after(m, d, own, act, motor, _axle_load(own, act, forces), h)
        store_real(rate, slots.BACKLASH, (gap - load_real(act, slots.BACKLASH)) / h)
        store_real(rate, slots.BACKLASH_RATE, (gap_rate - load_real(act, slots.BACKLASH_RATE)) / h)
    rail = numba.int64(load_real(own, slots.RAIL_JOINT))
    if rail >= 0:
        # the inertia of the tilting body absorbs the alternation between rollers; the rail carries the rest
        user = load_pointer(m + OFFSETS.m_jnt_user) + 8 * slots.JOINT_SLOTS * rail
        share = -math.expm1(-h / load_real(user, slots.RAIL_LOAD_TIME))
        store_real(
            rate, slots.LATERAL_LOAD, share * (forces.lateral - load_real(act, slots.LATERAL_LOAD)) / h
        )


@cached(numba.cfunc, types.void(types.int64, types.int64))
def _passive(m, d):
    add_passive_forces(m, d)


@cached(numba.cfunc, types.float64(types.int64, types.int64, types.int32))
def _activation(m, d, actuator):
    # actuators with several activations write them directly; the value returned is not used
    set_activation_rates(m, d, actuator)
    return 0.0


_CALLBACKS = {
    "passive": ctypes.CFUNCTYPE(None, ctypes.c_void_p, ctypes.c_void_p)(_passive.address),
    "act_dyn": ctypes.CFUNCTYPE(ctypes.c_double, ctypes.c_void_p, ctypes.c_void_p, ctypes.c_int)(
        _activation.address
    ),
}


def install() -> None:
    """Install the native callbacks in this process; a second call does nothing.

    Raises:
      NativeLayoutError: The installed MuJoCo keeps its data elsewhere than expected.
      OmnimjError: A callback of another library is installed already, which ours would replace.
    """
    for name, function in _CALLBACKS.items():
        present = getattr(mujoco, f"get_mjcb_{name}")()
        if present is function:
            continue
        if present is not None:
            raise OmnimjError(
                f"another mjcb_{name} is installed in this process ({present!r}); remove it first"
            )
        check_offsets(OFFSETS)
        getattr(mujoco, f"set_mjcb_{name}")(function)


@kernel
def repeat_callbacks(m, d, times):
    """Repeat the callbacks of one step on a frozen state, to measure their cost.

    Args:
      times: Number of repetitions.
    """
    for _ in range(times):
        add_passive_forces(m, d)
        for wheel in range(wheel_count(m)):
            set_activation_rates(m, d, wheel)
