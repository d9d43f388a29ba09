"""Access to MuJoCo's memory inside kernels: byte offsets in mjModel, mjData and mjContact, loads and stores.

The offsets follow from MuJoCo's description of its structs (`mujoco.introspect`) by the rules of C, and are
compared with the addresses of the bound arrays before the native contact may use them.
"""

from __future__ import annotations

import ctypes
from collections.abc import Iterable
from typing import Any, NamedTuple

import mujoco
import numba
import numba.extending
import numpy as np
from llvmlite import ir
from mujoco.introspect import ast_nodes, structs
from numba import types
from numba.core import cgutils

from omnimj.errors import NativeLayoutError
from omnimj.parameters.floor import TRACTION_SIZE
from omnimj.physics.effect_terms import ACTIVE, TERMS, terms_at
from omnimj.physics.motor import MOTOR_SIZE, motor_at
from omnimj.physics.native import kernel
from omnimj.physics.traction import traction_at
from omnimj.plant.mujoco import slots

_SCALARS = {
    "int": 4,
    "float": 4,
    "mjtNum": 8,
    "mjtSize": 8,
    "size_t": 8,
    "uintptr_t": 8,
    "uint64_t": 8,
    "mjtBool": 1,
    "mjtByte": 1,
}


class Offsets(NamedTuple):
    """Byte offsets of the fields that the native contact reads and writes."""

    m_timestep: int
    m_nactuator: int
    m_nuser_geom: int
    m_nuser_actuator: int
    m_nuser_jnt: int
    m_actuator_user: int
    m_actuator_actadr: int
    m_actuator_ctrladr: int
    m_geom_user: int
    m_geom_bodyid: int
    m_geom_size: int
    m_jnt_user: int
    m_jnt_dofadr: int
    m_body_rootid: int
    m_body_parentid: int
    m_body_dofnum: int
    m_body_dofadr: int
    m_dof_parentid: int
    m_dof_M0: int
    d_time: int
    d_ncon: int
    d_contact: int
    d_qpos: int
    d_qvel: int
    d_act: int
    d_act_dot: int
    d_ctrl: int
    d_cvel: int
    d_cdof: int
    d_subtree_com: int
    d_xmat: int
    d_xpos: int
    d_geom_xpos: int
    d_geom_xmat: int
    d_qfrc_passive: int
    d_sensordata: int
    c_dist: int
    c_pos: int
    c_frame: int
    c_geom: int
    contact_size: int


def _size_and_alignment(kind: Any) -> tuple[int, int]:
    if isinstance(kind, ast_nodes.PointerType):
        return 8, 8
    if isinstance(kind, ast_nodes.ArrayType):
        size, alignment = _size_and_alignment(kind.inner_type)
        return size * int(np.prod([int(extent) for extent in kind.extents])), alignment
    if isinstance(kind, ast_nodes.AnonymousStructDecl):
        return _struct(kind.fields)[1:]
    name = str(getattr(kind, "name", ""))
    if name in _SCALARS:
        return _SCALARS[name], _SCALARS[name]
    if name in structs.STRUCTS:
        return _struct(structs.STRUCTS[name].fields)[1:]
    raise NativeLayoutError(f"MuJoCo {mujoco.__version__} describes a field of unknown type {kind}")


def _struct(fields: Iterable[Any]) -> tuple[dict[str, int], int, int]:
    offsets: dict[str, int] = {}
    end, widest = 0, 1
    for field in fields:
        size, alignment = _size_and_alignment(field.type)
        start = -(-end // alignment) * alignment
        offsets[field.name] = start
        end, widest = start + size, max(widest, alignment)
    return offsets, -(-end // widest) * widest, widest


def read_offsets() -> Offsets:
    """Compute offsets by the rules of C from MuJoCo's description of its structs.

    Raises:
      NativeLayoutError: The installed MuJoCo lacks a field that the native contact needs.
    """
    try:
        in_model = _struct(structs.STRUCTS["mjModel"].fields)[0]
        in_data = _struct(structs.STRUCTS["mjData"].fields)[0]
        in_contact, contact_size, _ = _struct(structs.STRUCTS["mjContact"].fields)
        in_option = _struct(structs.STRUCTS["mjOption"].fields)[0]
        found = {"m_timestep": in_model["opt"] + in_option["timestep"], "contact_size": contact_size}
        rooms = {"m": in_model, "d": in_data, "c": in_contact}
        for name in Offsets._fields:
            if name not in found:
                room, _, field = name.partition("_")
                found[name] = rooms[room][field]
    except KeyError as error:
        raise NativeLayoutError(
            f"MuJoCo {mujoco.__version__} has no field {error}; the native contact cannot work with it"
        ) from None
    return Offsets(**found)


_PROBE = """
<mujoco>
  <size nuser_geom="5" nuser_actuator="7" nuser_jnt="6"/>
  <option timestep="0.00123"/>
  <worldbody>
    <geom type="plane" size="1 1 1" user="1 2"/>
    <body pos="0 0 0.09"><freejoint/><geom size="0.1"/>
      <body><joint name="axle" axis="0 1 0"/><geom size="0.02" pos="0.3 0 0"/></body>
    </body>
  </worldbody>
  <actuator><general joint="axle" dyntype="user" actdim="2" user="1 2 3"/></actuator>
  <sensor><jointvel joint="axle"/></sensor>
</mujoco>
"""


def _pointer(address: int) -> int:
    return ctypes.c_int64.from_address(address).value


def check_offsets(offsets: Offsets) -> None:
    """Compare every offset with the addresses in the bindings, on a small model in contact.

    Raises:
      NativeLayoutError: An offset is wrong; the message names the field and the MuJoCo version.
    """
    mj_model = mujoco.MjModel.from_xml_string(_PROBE)
    mj_data = mujoco.MjData(mj_model)
    mujoco.mj_forward(mj_model, mj_data)
    mj_data.time = 0.00321
    wrong = []
    for name, offset in offsets._asdict().items():
        room, _, field = name.partition("_")
        owner = mj_model if room == "m" else mj_data
        if name == "m_timestep":
            good = ctypes.c_double.from_address(mj_model._address + offset).value == mj_model.opt.timestep
        elif name == "d_time":
            good = ctypes.c_double.from_address(mj_data._address + offset).value == mj_data.time
        elif name == "d_contact":
            good = _pointer(mj_data._address + offset) == mj_data.contact.dist.ctypes.data - offsets.c_dist
        elif name == "contact_size":
            good = mj_data.contact.geom.strides[0] == offset
        elif room == "c":
            base = mj_data.contact.dist.ctypes.data - offsets.c_dist
            good = getattr(mj_data.contact, field).ctypes.data - base == offset
        elif isinstance(getattr(owner, field), np.ndarray):
            good = _pointer(owner._address + offset) == getattr(owner, field).ctypes.data
        else:
            width = ctypes.c_int32 if room == "d" else ctypes.c_int64
            good = width.from_address(owner._address + offset).value == getattr(owner, field)
        if not good:
            wrong.append(name)
    if wrong:
        raise NativeLayoutError(
            f"MuJoCo {mujoco.__version__} keeps {', '.join(wrong)} elsewhere than it says; "
            "the native contact refuses to run on it"
        )


OFFSETS = read_offsets()
"""Offsets of the installed MuJoCo: constants of the kernels, whose disk cache is keyed by its version."""

# the decorator removes the argument for the typing context, unseen by type checkers
intrinsic: Any = numba.extending.intrinsic


def _element(builder, address, index, element, width):
    byte = builder.add(address, builder.mul(index, ir.Constant(ir.IntType(64), width)))
    return builder.inttoptr(byte, element.as_pointer())


@intrinsic
def load_pointer(typingctx, address):
    """Load the pointer stored at `address`."""

    def codegen(context, builder, signature, arguments):
        return builder.load(builder.inttoptr(arguments[0], ir.IntType(64).as_pointer()))

    return types.int64(types.int64), codegen


@intrinsic
def load_real(typingctx, address, index):
    """Load an element of an array of doubles.

    Args:
      typingctx: Typing context of Numba; callers leave it out.
      address: Address of the array.
      index: Index of the element.
    """

    def codegen(context, builder, signature, arguments):
        return builder.load(_element(builder, arguments[0], arguments[1], ir.DoubleType(), 8))

    return types.float64(types.int64, types.int64), codegen


@intrinsic
def load_int(typingctx, address, index):
    """Load an element of an array of 32-bit integers, as a 64-bit integer.

    Args:
      typingctx: Typing context of Numba; callers leave it out.
      address: Address of the array.
      index: Index of the element.
    """

    def codegen(context, builder, signature, arguments):
        found = builder.load(_element(builder, arguments[0], arguments[1], ir.IntType(32), 4))
        return builder.sext(found, ir.IntType(64))

    return types.int64(types.int64, types.int64), codegen


@intrinsic
def store_real(typingctx, address, index, value):
    """Store a double in an array.

    Args:
      typingctx: Typing context of Numba; callers leave it out.
      address: Address of the array.
      index: Index of the element.
      value: The double.
    """

    def codegen(context, builder, signature, arguments):
        target = _element(builder, arguments[0], arguments[1], ir.DoubleType(), 8)
        builder.store(arguments[2], target)
        return context.get_dummy_value()

    return types.void(types.int64, types.int64, types.float64), codegen


@intrinsic
def real_pointer(typingctx, address):
    """Convert `address` to a pointer to doubles, for `numba.carray`."""

    def codegen(context, builder, signature, arguments):
        return builder.inttoptr(arguments[0], ir.DoubleType().as_pointer())

    return types.CPointer(types.float64)(types.int64), codegen


@intrinsic
def stack_reals(typingctx, count):
    """Allocate `count` doubles (a constant) on the stack of the calling kernel, valid until it returns."""
    literal = count.literal_value if isinstance(count, types.Literal) else None
    if literal is None:
        return None

    def codegen(context, builder, signature, arguments):
        room = cgutils.alloca_once(builder, ir.ArrayType(ir.DoubleType(), literal))
        return builder.bitcast(room, ir.DoubleType().as_pointer())

    return types.CPointer(types.float64)(count), codegen


@kernel
def motor_of(own):
    """`MotorParameters` of a wheel, given the address of its slots."""
    return motor_at(numba.carray(real_pointer(own + 8 * slots.MOTOR), (MOTOR_SIZE,)))


@kernel
def is_active(own):
    """True if a wheel has any effect terms, given the address of its slots."""
    return load_real(own, slots.EFFECT_TERMS + ACTIVE) != 0.0


@kernel
def terms_of(own):
    """`EffectTerms` of a wheel, given the address of its slots."""
    return terms_at(numba.carray(real_pointer(own + 8 * slots.EFFECT_TERMS), (TERMS,)))


@kernel
def traction_of(own):
    """`TractionParameters` of a floor, given the address of its geom's slots."""
    return traction_at(numba.carray(real_pointer(own + 8 * slots.TRACTION), (TRACTION_SIZE,)))


@kernel
def elapsed_time(d):
    """Time since the start of the run [s]."""
    return load_real(d + OFFSETS.d_time, 0)


@kernel
def wheel_angle(d, own):
    """Angle of a wheel [rad]."""
    return load_real(load_pointer(d + OFFSETS.d_qpos), numba.int64(load_real(own, slots.ANGLE_ADDRESS)))


@kernel
def wheel_speed_of(d, own):
    """Speed of a wheel [rad/s]."""
    return load_real(load_pointer(d + OFFSETS.d_qvel), numba.int64(load_real(own, slots.WHEEL_DOF)))


@kernel
def axle_inertia(m, own):
    """Inertia of wheel and rotor about the axle [kg.m²]."""
    return load_real(load_pointer(m + OFFSETS.m_dof_M0), numba.int64(load_real(own, slots.WHEEL_DOF)))


@kernel
def slots_of(m, wheel):
    """Address of a wheel's slots."""
    return load_pointer(m + OFFSETS.m_actuator_user) + 8 * slots.ACTUATOR_SLOTS * wheel
