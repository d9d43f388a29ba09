"""Quantities of the parts of an MJCF model that the gap workflow can change, as a table of numbers.

A motor driven by a voltage is stated by MJCF as gain K/R and velocity bias −K²/R; both give its constant K
and its resistance R. Any other actuator has its gain.
"""

from __future__ import annotations

import copy
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import mujoco
import numpy as np

from omnimj.effects.parts import ACTUATOR, BODY, JOINT, Part, PartChanges, Payload, joint_unit
from omnimj.errors import InputError
from omnimj.signals import Array


class Quantity(NamedTuple):
    """Quantity of a kind of part."""

    unit: str
    """Unit on a slide joint; see `parts.joint_unit`."""
    lowest: float
    words: str


QUANTITIES: Mapping[str, Mapping[str, Quantity]] = {
    JOINT: {
        "damping": Quantity("N.s/m", 0.0, "viscous friction"),
        "quadratic_damping": Quantity("N.s2/m2", 0.0, "friction quadratic in the speed"),
        "frictionloss": Quantity("N", 0.0, "dry friction"),
        "armature": Quantity("kg", 0.0, "inertia of the drive"),
        "stiffness": Quantity("N/m", 0.0, "stiffness of the joint's spring"),
        "springref": Quantity("m", -np.inf, "position at which the spring is at rest"),
    },
    BODY: {"mass": Quantity("kg", 1e-9, "mass; inertia in proportion")},
    ACTUATOR: {
        "gain": Quantity("1", -np.inf, "force per command; of a motor with a resistance, factor of it"),
        "torque_constant": Quantity("N/A", 1e-9, "force per ampere, voltage per speed"),
        "resistance": Quantity("Ohm", 1e-9, "resistance of the winding"),
        "lag": Quantity("s", 0.0, "time constant between command and force"),
    },
}
"""Kind of part → quantity that may be uncertain."""
BACK_EMF = "back_emf"
"""Factor of the voltage per speed over the force per ampere; an effect, not a quantity of a file."""


@dataclass(frozen=True)
class Drive:
    """Actuator of one joint: force = gain · command + bias + position_gain · l + velocity_gain · dl/dt.

    l is the joint's position times `gear`, the force on the joint is `gear` times that of the actuator.
    """

    name: str
    joint: str
    gear: float
    gain: float
    bias: float
    position_gain: float
    velocity_gain: float
    lag: float
    """First-order lag of the command [s]."""
    command_range: tuple[float, float]
    force_range: tuple[float, float]

    @property
    def has_back_emf(self) -> bool:
        """True for a motor driven by a voltage."""
        return self.velocity_gain < 0.0 and self.position_gain == 0.0 and self.gain > 0.0


def _name(mj_model: mujoco.MjModel, kind: mujoco.mjtObj, index: int) -> str:
    return mujoco.mj_id2name(mj_model, kind, index) or ""


def joint_names(mj_model: mujoco.MjModel) -> tuple[str, ...]:
    """Names of the joints; "" for one without a name."""
    return tuple(_name(mj_model, mujoco.mjtObj.mjOBJ_JOINT, k) for k in range(mj_model.njnt))


def body_names(mj_model: mujoco.MjModel) -> tuple[str, ...]:
    """Names of the bodies that move or have a parent that does, without the world."""
    return tuple(_name(mj_model, mujoco.mjtObj.mjOBJ_BODY, k) for k in range(1, mj_model.nbody))


def sensor_names(mj_model: mujoco.MjModel) -> tuple[str, ...]:
    """Names of the sensors."""
    return tuple(_name(mj_model, mujoco.mjtObj.mjOBJ_SENSOR, k) for k in range(mj_model.nsensor))


def is_hinge(mj_model: mujoco.MjModel, joint: str) -> bool:
    """True for a hinge, False for a slide joint."""
    index = mujoco.mj_name2id(mj_model, mujoco.mjtObj.mjOBJ_JOINT, joint)
    return bool(mj_model.jnt_type[index] == mujoco.mjtJoint.mjJNT_HINGE)


def read_drives(mj_model: mujoco.MjModel, place: object) -> tuple[Drive, ...]:
    """Actuators of a model.

    Args:
      mj_model: The compiled model.
      place: File, for messages.

    Raises:
      InputError: An actuator of a kind that cannot be replayed, or two on one joint; the message names it.
    """
    names = joint_names(mj_model)
    drives = [_drive(mj_model, k, names, place) for k in range(mj_model.nu)]
    taken: dict[str, str] = {}
    for drive in drives:
        if drive.joint in taken:
            found = f"drives joint {drive.joint!r}, which {taken[drive.joint]!r} drives"
            raise InputError(f"{place}: actuator {drive.name!r}", found, "a joint can have one actuator")
        taken[drive.joint] = drive.name
    return tuple(drives)


def _drive(m: mujoco.MjModel, k: int, joints: Sequence[str], place: object) -> Drive:
    name = _name(m, mujoco.mjtObj.mjOBJ_ACTUATOR, k)
    at = f"{place}: actuator {name or k + 1!r}"
    transmissions = (int(mujoco.mjtTrn.mjTRN_JOINT), int(mujoco.mjtTrn.mjTRN_JOINTINPARENT))
    if m.actuator_trntype[k] not in transmissions:
        rule = "the force of a tendon, site or body is shared among joints: let it act on one"
        raise InputError(at, "does not act on a joint", rule)
    gain, dynamics = m.actuator_gaintype[k], m.actuator_dyntype[k]
    filters = (int(mujoco.mjtDyn.mjDYN_FILTER), int(mujoco.mjtDyn.mjDYN_FILTEREXACT))
    if gain == mujoco.mjtGain.mjGAIN_DCMOTOR and not m.actuator_gainprm[k, 2:].any():
        resistance, constant = m.actuator_gainprm[k, :2].tolist()
        law = (constant / resistance, 0.0, 0.0, -constant * constant / resistance)
        lag = 0.0
    elif gain == mujoco.mjtGain.mjGAIN_FIXED and dynamics in (int(mujoco.mjtDyn.mjDYN_NONE), *filters):
        has_bias = m.actuator_biastype[k] == mujoco.mjtBias.mjBIAS_AFFINE
        bias = (m.actuator_biasprm[k, :3] * has_bias).tolist()
        law = (float(m.actuator_gainprm[k, 0]), bias[0], bias[1], bias[2])
        lag = float(m.actuator_dynprm[k, 0]) if dynamics in filters else 0.0
    else:
        rule = "general, motor, position, velocity, damper and dcmotor without dynamics but a filter are"
        raise InputError(at, "is of a kind that cannot be replayed", rule)
    if law[0] == 0.0:
        raise InputError(at, "has gain 0", "it must act on its joint")

    def limits(limited: bool, values: Array) -> tuple[float, float]:
        return (float(values[0]), float(values[1])) if limited else (-np.inf, np.inf)

    return Drive(
        name,
        joints[int(m.actuator_trnid[k, 0])],
        float(m.actuator_gear[k, 0]),
        law[0],
        law[1],
        law[2],
        law[3],
        lag,
        limits(bool(m.actuator_ctrllimited[k]), m.actuator_ctrlrange[k]),
        limits(bool(m.actuator_forcelimited[k]), m.actuator_forcerange[k]),
    )


def read_values(mj_model: mujoco.MjModel, drives: Sequence[Drive]) -> dict[Part, float]:
    """Values of all quantities of a model by part."""
    m, found = mj_model, {}
    for k, name in enumerate(joint_names(m)):
        dof, place = m.jnt_dofadr[k], m.jnt_qposadr[k]
        values = (
            m.dof_damping[dof],
            m.dof_dampingpoly[dof, 0],
            m.dof_frictionloss[dof],
            m.dof_armature[dof],
            m.jnt_stiffness[k],
            m.qpos_spring[place],
        )
        for key, value in zip(QUANTITIES[JOINT], values, strict=True):
            found[JOINT, name, key] = float(value)
    for k, name in enumerate(body_names(m), 1):
        found[BODY, name, "mass"] = float(m.body_mass[k])
    for drive in drives:
        own: dict[str, float] = {"gain": drive.gain}
        if drive.has_back_emf:
            constant = -drive.velocity_gain / drive.gain
            own = {
                "gain": 1.0,
                "torque_constant": constant,
                "resistance": constant / drive.gain,
                BACK_EMF: 1.0,
            }
        for key, value in {**own, "lag": drive.lag}.items():
            found[ACTUATOR, drive.name, key] = value
    return found


def changed_values(
    values: Mapping[Part, float], own: Mapping[Part, float], changes: PartChanges
) -> dict[Part, float]:
    """Values of all quantities with refitted ones and with the changes of effects.

    Args:
      values: Values of the model.
      own: Values that replace some of them.
      changes: Amounts and factors by effects; those of parts without this quantity are left out.
    """
    found = {**values, **own}
    for part, amount in changes.added.items():
        if part in found:
            found[part] += amount
    for part, factor in changes.scales.items():
        if part in found:
            found[part] *= factor
    for part in {**changes.added, **changes.scales}:
        kind, _, key = part
        if part in found and key in QUANTITIES[kind]:
            found[part] = max(found[part], QUANTITIES[kind][key].lowest)
    return found


def changed_drive(drive: Drive, values: Mapping[Part, float], limit: float) -> Drive:
    """Actuator with the values of a table and a limit of its force [N or N.m]."""
    gain = values[ACTUATOR, drive.name, "gain"]
    position_gain, velocity_gain = drive.position_gain, drive.velocity_gain
    if drive.has_back_emf:
        constant = values[ACTUATOR, drive.name, "torque_constant"]
        force_per_volt = constant / values[ACTUATOR, drive.name, "resistance"]
        gain *= force_per_volt
        velocity_gain = -force_per_volt * constant * values[ACTUATOR, drive.name, BACK_EMF]
    elif position_gain == -drive.gain:  # a position servo
        position_gain = -gain
    low, high = drive.force_range
    return Drive(
        drive.name,
        drive.joint,
        drive.gear,
        gain,
        drive.bias,
        position_gain,
        velocity_gain,
        values[ACTUATOR, drive.name, "lag"],
        drive.command_range,
        (max(low, -limit), min(high, limit)),
    )


def unit_of(mj_model: mujoco.MjModel, drives: Sequence[Drive], part: Part) -> str:
    """Unit of a quantity of a part."""
    kind, name, key = part
    if kind == BODY:
        return QUANTITIES[BODY][key].unit
    joint = name if kind == JOINT else next(d.joint for d in drives if d.name == name)
    if key == "torque_constant":
        return "N.m/A" if is_hinge(mj_model, joint) else "N/A"
    return joint_unit(QUANTITIES[kind][key].unit, kind == JOINT and is_hinge(mj_model, joint))


def with_masses(
    mj_model: mujoco.MjModel, values: Mapping[Part, float], payloads: Sequence[Payload]
) -> mujoco.MjModel:
    """Copy of a model with other masses and point masses on its bodies.

    Args:
      mj_model: The compiled model.
      values: Masses among other quantities; inertia changes in proportion.
      payloads: Point masses.
    """
    m = copy.copy(mj_model)
    for k, name in enumerate(body_names(m), 1):
        mass = values[BODY, name, "mass"]
        if m.body_mass[k] > 0.0 and mass != m.body_mass[k]:
            m.body_inertia[k] *= mass / m.body_mass[k]
            m.body_mass[k] = mass
    for payload in payloads:
        if payload.mass != 0.0:
            _add_point(m, payload)
    return m


def joint_to_centre(mj_model: mujoco.MjModel, body: int) -> tuple[Array, Array]:
    """Place of a body's joint and the unit vector from there to its centre of mass, in the body's frame.

    Returns:
      Place [m] and direction [1], shape (3,) each.
    """
    first = int(mj_model.body_jntadr[body])
    anchor = np.array(mj_model.jnt_pos[first]) if first >= 0 else np.zeros(3)
    arm = np.array(mj_model.body_ipos[body]) - anchor
    length = float(np.linalg.norm(arm))
    return anchor, arm / length if length > 1e-6 else np.array([1.0, 0.0, 0.0])


def _add_point(m: mujoco.MjModel, payload: Payload) -> None:
    """Add a point mass to a body: centre of mass, inertia about it, principal axes."""
    k = mujoco.mj_name2id(m, mujoco.mjtObj.mjOBJ_BODY, payload.body)
    anchor, direction = joint_to_centre(m, k)
    place = anchor + payload.distance * direction
    mass, before = float(m.body_mass[k]), np.array(m.body_ipos[k])
    total = max(mass + payload.mass, 1e-9)
    centre = (mass * before + payload.mass * place) / total
    turn = np.empty(9)
    mujoco.mju_quat2Mat(turn, m.body_iquat[k])
    axes = turn.reshape(3, 3)
    inertia = axes @ np.diag(m.body_inertia[k]) @ axes.T
    for weight, at in ((mass, before), (payload.mass, place)):
        arm = at - centre
        inertia = inertia + weight * (arm @ arm * np.eye(3) - np.outer(arm, arm))
    principal, vectors = np.linalg.eigh(inertia)
    if np.linalg.det(vectors) < 0.0:
        vectors[:, 0] *= -1.0
    quaternion = np.empty(4)
    mujoco.mju_mat2Quat(quaternion, np.ascontiguousarray(vectors).ravel())
    m.body_mass[k], m.body_ipos[k] = total, centre
    m.body_inertia[k], m.body_iquat[k] = np.maximum(principal, 1e-12), quaternion
    # its inertial frame is no longer that of the body, so MuJoCo's short cuts for such bodies do not hold
    m.body_simple[k] = m.body_sameframe[k] = 0
    m.dof_simplenum[:] = 0


def tilted_gravity(gravity: Array, tilt: Mapping[str, float]) -> Array:
    """Gravity turned about the world's x and then y axis, shape (3,) [m/s²]."""
    a, b = tilt.get("x", 0.0), tilt.get("y", 0.0)
    x, y, z = gravity
    y, z = np.cos(a) * y - np.sin(a) * z, np.sin(a) * y + np.cos(a) * z
    x, z = np.cos(b) * x + np.sin(b) * z, -np.sin(b) * x + np.cos(b) * z
    return np.array([x, y, z])
