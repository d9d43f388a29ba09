"""The native callbacks that MuJoCo calls inside its step, and their installation.

Three C functions compiled by numba, free of the interpreter: passive forces, activation rates of the wheel
actuators (motor current, bristles), truth sensors. They act on models that carry our mark and on no other,
are pure functions of mjModel and mjData, and allocate nothing that outlives the call; hence `mj_forward` has
no side effect and a batch on many threads equals a serial loop bit for bit.
"""

from __future__ import annotations

import ctypes
import math

import mujoco
import numba
from numba import types

from omnimj.errors import OmnimjError
from omnimj.physics.effect_terms import ACTIVE, BACKLASH
from omnimj.physics.motor import MOTOR_ROW, next_current
from omnimj.physics.native import cached, kernel
from omnimj.plant.mujoco import slots
from omnimj.plant.mujoco.contact import (
    COLUMNS,
    CONTACT_BUFFER,
    MAX_CONTACTS,
    gather_contacts,
    wheel_contact_forces,
    wheel_frame_force,
)
from omnimj.plant.mujoco.effect_forces import (
    drive_with_effects,
    motor_with_effects,
    step_gear_backlash,
    terms_of,
)
from omnimj.plant.mujoco.forces import (
    add_contact_forces,
    add_drive_torque,
    add_hub_forces,
    add_rail_friction,
    axle_resistance,
    coast_rollers,
)
from omnimj.plant.mujoco.memory import (
    OFFSETS,
    check_offsets,
    load_int,
    load_pointer,
    load_real,
    stack_reals,
    store_real,
)

_STAGE_VELOCITY = int(mujoco.mjtStage.mjSTAGE_VEL)


@kernel
def wheel_count(m):
    """Number of wheels of a model that is ours, 0 for any other."""
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
    """Everything between motor, wheel and floor, added to qfrc_passive."""
    wheels = wheel_count(m)
    if wheels == 0:
        return
    h = load_real(m + OFFSETS.m_timestep, 0)
    found = numba.carray(stack_reals(CONTACT_BUFFER), (MAX_CONTACTS, COLUMNS))
    count = gather_contacts(m, d, -1, found)
    for wheel in range(wheels):
        own = load_pointer(m + OFFSETS.m_actuator_user) + 8 * slots.ACTUATOR_SLOTS * wheel
        grip = wheel_contact_forces(m, d, wheel, found, count, h)
        rail = numba.int64(load_real(own, slots.RAIL_JOINT))
        rail_dof = -1
        if rail >= 0:
            rail_dof = load_int(load_pointer(m + OFFSETS.m_jnt_dofadr), rail)
        torque, pull = add_contact_forces(m, d, wheel, found, count, rail_dof, h)
        coast_rollers(m, d, own, wheel, found, count, h)
        ahead, side = wheel_frame_force(own, grip[2], grip[3])
        rolling = load_real(own, slots.ROLLING_RESISTANCE) * grip[1]
        if rail >= 0:  # the rig's equations put rolling resistance on the carriage
            address = load_int(load_pointer(m + OFFSETS.m_actuator_actadr), wheel)
            side = load_real(load_pointer(d + OFFSETS.d_act), address + slots.LATERAL_LOAD)
            add_rail_friction(m, d, own, rail, grip[1], side, grip[4], rolling, pull, h)
            rolling = 0.0
        elif terms_of(own)[ACTIVE] != 0.0:
            add_hub_forces(m, d, wheels, own, h)
        add_drive_torque(m, d, wheel, own, grip[1], ahead, side, rolling, torque, h)


@kernel
def _set_play_rates(m, d, own, act, rate, motor, wheel_speed, grip, h):
    """act_dot of the gear's play, from the same numbers as the torque on the axle."""
    ahead, side = wheel_frame_force(own, grip[2], grip[3])
    rolling = load_real(own, slots.ROLLING_RESISTANCE) * grip[1]
    if load_real(own, slots.RAIL_JOINT) >= 0.0:
        side, rolling = load_real(act, slots.LATERAL_LOAD), 0.0
    resistance = axle_resistance(own, grip[1], side, rolling, wheel_speed)
    low, high, dry, more = drive_with_effects(d, own, act, motor, wheel_speed, resistance, h)
    inertia = load_real(load_pointer(m + OFFSETS.m_dof_M0), numba.int64(load_real(own, slots.WHEEL_DOF)))
    _, play, play_rate, _ = step_gear_backlash(own, act, low, high, dry, more, wheel_speed, inertia, ahead, h)
    store_real(rate, slots.PLAY, (play - load_real(act, slots.PLAY)) / h)
    store_real(rate, slots.PLAY_RATE, (play_rate - load_real(act, slots.PLAY_RATE)) / h)


@kernel
def set_activation_rates(m, d, actuator):
    """act_dot = (next − now)/h of a wheel's current and bristles: exact for the frozen velocities."""
    if actuator >= wheel_count(m):
        return
    h = load_real(m + OFFSETS.m_timestep, 0)
    found = numba.carray(stack_reals(CONTACT_BUFFER), (MAX_CONTACTS, COLUMNS))
    count = gather_contacts(m, d, actuator, found)
    grip = wheel_contact_forces(m, d, actuator, found, count, h)
    own = load_pointer(m + OFFSETS.m_actuator_user) + 8 * slots.ACTUATOR_SLOTS * actuator
    address = load_int(load_pointer(m + OFFSETS.m_actuator_actadr), actuator)
    act = load_pointer(d + OFFSETS.d_act) + 8 * address
    rate = load_pointer(d + OFFSETS.d_act_dot) + 8 * address
    command = load_real(
        load_pointer(d + OFFSETS.d_ctrl), load_int(load_pointer(m + OFFSETS.m_actuator_ctrladr), actuator)
    )
    wheel_speed = load_real(load_pointer(d + OFFSETS.d_qvel), numba.int64(load_real(own, slots.WHEEL_DOF)))
    motor = motor_with_effects(m, d, own, actuator, True, numba.carray(stack_reals(MOTOR_ROW), (MOTOR_ROW,)))
    now = load_real(act, slots.CURRENT)
    store_real(rate, slots.CURRENT, (next_current(motor, now, command, wheel_speed, h) - now) / h)
    store_real(rate, slots.BRISTLE, (grip[5] - load_real(act, slots.BRISTLE)) / h)
    store_real(rate, slots.LATERAL_BRISTLE, (grip[6] - load_real(act, slots.LATERAL_BRISTLE)) / h)
    if terms_of(own)[BACKLASH] != 0.0:
        _set_play_rates(m, d, own, act, rate, motor, wheel_speed, grip, h)
    rail = numba.int64(load_real(own, slots.RAIL_JOINT))
    if rail >= 0:
        # the tilting body's inertia carries what alternates with the rollers; the rail feels the rest
        user = load_pointer(m + OFFSETS.m_jnt_user) + 8 * slots.JOINT_SLOTS * rail
        share = -math.expm1(-h / load_real(user, slots.RAIL_LOAD_TIME))
        store_real(rate, slots.LATERAL_LOAD, share * (grip[3] - load_real(act, slots.LATERAL_LOAD)) / h)


@kernel
def write_truth(m, d):
    """Slip, normal, traction and lateral force, lateral velocity of each wheel into its user sensor."""
    wheels = wheel_count(m)
    if wheels == 0:
        return
    h = load_real(m + OFFSETS.m_timestep, 0)
    found = numba.carray(stack_reals(CONTACT_BUFFER), (MAX_CONTACTS, COLUMNS))
    count = gather_contacts(m, d, -1, found)
    sensors = load_pointer(d + OFFSETS.d_sensordata)
    for wheel in range(wheels):
        own = load_pointer(m + OFFSETS.m_actuator_user) + 8 * slots.ACTUATOR_SLOTS * wheel
        grip = wheel_contact_forces(m, d, wheel, found, count, h)
        address = numba.int64(load_real(own, slots.SENSOR))
        if address >= 0:
            for k in range(5):
                store_real(sensors, address + k, grip[k])


@cached(numba.cfunc, types.void(types.int64, types.int64))
def _passive(m, d):
    add_passive_forces(m, d)


@cached(numba.cfunc, types.float64(types.int64, types.int64, types.int32))
def _activation(m, d, actuator):
    # actuators with several activations write them directly; the value returned is not used
    set_activation_rates(m, d, actuator)
    return 0.0


@cached(numba.cfunc, types.void(types.int64, types.int64, types.int32))
def _sensor(m, d, stage):
    if stage == _STAGE_VELOCITY:
        write_truth(m, d)


_CALLBACKS = {
    "passive": ctypes.CFUNCTYPE(None, ctypes.c_void_p, ctypes.c_void_p)(_passive.address),
    "act_dyn": ctypes.CFUNCTYPE(ctypes.c_double, ctypes.c_void_p, ctypes.c_void_p, ctypes.c_int)(
        _activation.address
    ),
    "sensor": ctypes.CFUNCTYPE(None, ctypes.c_void_p, ctypes.c_void_p, ctypes.c_int)(_sensor.address),
}


def install() -> None:
    """Installs the native callbacks in this process; a second call does nothing.

    Raises:
      NativeLayoutError: The installed MuJoCo keeps its data elsewhere than expected.
      OmnimjError: Another library's callback is installed already; ours would silence it.
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
    """Calls on one frozen state what one step calls, again and again: for measuring its cost only."""
    for _ in range(times):
        add_passive_forces(m, d)
        for wheel in range(wheel_count(m)):
            set_activation_rates(m, d, wheel)
        write_truth(m, d)
