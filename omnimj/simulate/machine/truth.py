"""True machine of a benchmark case: an MJCF machine with hidden effects and physics outside the library.

Written apart from the replay, which has laws of its own: what both have in common is the meaning of an
effect, `PartChanges`.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import mujoco
import numpy as np

from omnimj.effects import ChannelEffect
from omnimj.effects.mjcf import NO_LIMIT
from omnimj.effects.parts import ACTUATOR, JOINT, PartChanges
from omnimj.errors import InputError
from omnimj.physics.native import kernel
from omnimj.plant.mujoco.machine import Machine, apply_part_effects
from omnimj.plant.mujoco.quantities import (
    Drive,
    changed_drive,
    changed_values,
    tilted_gravity,
    with_masses,
)
from omnimj.signals import Array

CONTACT = 1500.0
"""Natural frequency of the motor against a link with play [rad/s]."""
_TERMS = {
    "asymmetric_dry": "asymmetric_coulomb",
    "asymmetric_viscous": "asymmetric_viscous",
    "stribeck_force": "stribeck_force",
    "stribeck_velocity": "stribeck_velocity",
    "place_force": "place_force",
    "place": "place_position",
    "place_width": "place_width",
    "load_share": "load_share",
    "hose": "spring",
    "hose_rest": "spring_rest",
    "offset": "offset",
    "compliance": "compliance",
    "play": "play",
}


class JointTruth(NamedTuple):
    """Forces that act on one joint beside those of the rigid bodies."""

    viscous: float
    quadratic: float
    dry: float
    armature: float
    spring: float
    spring_rest: float
    asymmetric_dry: float
    asymmetric_viscous: float
    stribeck_force: float
    stribeck_velocity: float
    place_force: float
    place: float
    place_width: float
    load_share: float
    hose: float
    hose_rest: float
    offset: float
    compliance: float
    play: float
    gear: float
    gain: float
    bias: float
    position_gain: float
    velocity_gain: float
    weakest: float
    strongest: float
    lowest: float
    """Least command."""
    highest: float
    lag: float
    """Time constant of the actuator [s]."""
    fading: float
    """Loss c of the force F of its actuator, F/(1 + c |F|) [1/N or 1/(N.m)]."""
    braking: float
    """Relative change 1/η − 1 of the motor's force by its gear where the links drive the motor."""
    on_link: bool
    """True if the position is measured on the link, behind spring and play; otherwise on the motor."""
    growing_dry: float = 0.0
    """Dry friction that builds up with speed and saturates, outside the library."""
    growing_speed: float = 1.0
    ripple: float = 0.0
    """Force that repeats with the position, outside the library."""
    ripple_waves: float = 0.0
    """Its waves per radian or metre."""
    ripple_phase: float = 0.0
    fast_loss: float = 0.0
    """Share of the actuator's force that the gear wastes at the speed `loss_speed`, outside the library."""
    loss_speed: float = 1.0


@kernel
def friction_bounds(joint, position, speed, load):
    """Largest dry friction against forward and against backward motion, and the smooth friction force.

    Args:
      joint: `JointTruth`.
      position: [rad or m]
      speed: [rad/s or m/s]
      load: Force that the joint transmits [N.m or N].
    """
    dry = joint.dry + joint.load_share * abs(load)
    if joint.stribeck_force != 0.0:
        dry += joint.stribeck_force * np.exp(-((speed / joint.stribeck_velocity) ** 2))
    if joint.place_force != 0.0:
        dry += joint.place_force * np.exp(-0.5 * ((position - joint.place) / joint.place_width) ** 2)
    dry += joint.growing_dry * abs(speed) / (abs(speed) + joint.growing_speed)
    smooth = joint.viscous * speed + joint.quadratic * speed * abs(speed)
    smooth += 0.5 * joint.asymmetric_viscous * abs(speed)
    half = 0.5 * joint.asymmetric_dry
    return max(dry + half, 0.0), max(dry - half, 0.0), smooth


@kernel
def outer_force(joint, position):
    """Force of springs, hoses, offset and ripple on the joint [N.m or N]."""
    force = joint.offset - joint.spring * (position - joint.spring_rest)
    force -= joint.hose * (position - joint.hose_rest)
    return force + joint.ripple * np.sin(joint.ripple_waves * position + joint.ripple_phase)


@kernel
def actuator_force(joint, command, position, speed):
    """Force of the actuator on its joint [N.m or N]."""
    force = joint.gain * command + joint.bias
    force += joint.gear * (joint.position_gain * position + joint.velocity_gain * speed)
    force /= 1.0 + joint.fading * abs(force)
    force = joint.gear * min(max(force, joint.weakest), joint.strongest)
    return force * (1.0 - min(joint.fast_loss * abs(speed) / joint.loss_speed, 1.0))


@kernel
def behind_gear(joint, force, speed):
    """Force behind the gear of an actuator, and the gear's dry friction [N or N.m].

    A loss at braking (η < 1) acts as dry friction. With η > 1 there is none, and the force jumps at
    standstill.
    """
    if joint.braking > 0.0:
        half = 0.5 * joint.braking
        return (1.0 + half) * force, half * abs(force)
    return (1.0 + joint.braking) * force if force * speed < 0.0 else force, 0.0


@kernel
def is_apart(joint):
    """True if the motor turns beside the link, behind a spring or with play."""
    return joint.compliance > 0.0 or joint.play > 0.0


@kernel
def play_force(joint, gap, gap_rate):
    """Force of a motor on its link across the play, which they close without rebound [N.m or N].

    The contact is critically damped for the inertia of the motor and never pulls.

    Args:
      joint: `JointTruth`.
      gap: Position of the motor relative to the link [rad or m].
      gap_rate: [rad/s or m/s]
    """
    beyond = abs(gap) - 0.5 * joint.play
    if beyond <= 0.0:
        return 0.0
    side = 1.0 if gap > 0.0 else -1.0
    damping = 2.0 * joint.armature * CONTACT
    return side * max(joint.armature * CONTACT * CONTACT * beyond + damping * side * gap_rate, 0.0)


@dataclass(frozen=True)
class MachineTruth:
    """True machine: its laws, its rigid bodies and how its logs distort the channels."""

    machine: Machine
    """The nominal machine."""
    joints: tuple[JointTruth, ...]
    masses: Mapping[tuple[str, str, str], float]
    changes: PartChanges
    drives: tuple[Drive | None, ...]
    """Actuator of each joint, None without one."""

    @property
    def gravity(self) -> Array:
        """Shape (3,) [m/s²]."""
        return tilted_gravity(self.machine.mj_model.opt.gravity, self.changes.tilt)

    def channel(self, name: str) -> ChannelEffect:
        """Change of the readings of a channel."""
        return self.changes.channels.get(name, ChannelEffect())

    def delay(self, joint: int) -> float:
        """Time by which the actuator of a joint answers late [s]."""
        drive = self.drives[joint]
        return 0.0 if drive is None else self.changes.terms.get((ACTUATOR, drive.name, "delay"), 0.0)

    def rigid_model(self, step: float) -> mujoco.MjModel:
        """The bodies alone, without forces of joints and actuators.

        Args:
          step: Time step [s].
        """
        model = with_masses(self.machine.mj_model, self.masses, self.changes.payloads)
        off = mujoco.mjtDisableBit
        for flag in (off.mjDSBL_CONTACT, off.mjDSBL_LIMIT, off.mjDSBL_ACTUATION, off.mjDSBL_SENSOR):
            model.opt.disableflags |= int(flag)
        model.opt.gravity[:] = self.gravity
        model.opt.timestep, model.opt.integrator = step, mujoco.mjtIntegrator.mjINT_IMPLICITFAST
        model.dof_damping[:] = model.dof_frictionloss[:] = model.jnt_stiffness[:] = 0.0
        model.dof_dampingpoly[:, 0] = 0.0
        # a motor behind a spring or with play turns beside MuJoCo's joint
        model.dof_armature[:] = [0.0 if is_apart(j) else j.armature for j in self.joints]
        return model


def machine_truth(
    machine: Machine,
    base: Mapping[str, float],
    foreign: Sequence[Mapping[str, float]] = (),
) -> MachineTruth:
    """True machine with the effects of its file.

    Args:
      machine: The nominal machine with hidden effects.
      base: Name of each uncertain quantity → its true value.
      foreign: Fields of `JointTruth` outside the library, for each joint; none when empty.

    Raises:
      InputError: Play behind a motor without inertia.
    """
    changes = apply_part_effects(machine)
    true = {one.part: base[one.name] - one.beyond for one in machine.uncertain}
    values = changed_values(machine.values, true, changes)
    by_joint = {drive.joint: drive for drive in machine.drives}
    drives = tuple(by_joint.get(name) for name in machine.joints)
    joints = []
    for j, (name, drive) in enumerate(zip(machine.joints, drives, strict=True)):
        own = foreign[j] if foreign else {}
        numbers = {key: changes.terms.get((JOINT, name, term), 0.0) for key, term in _TERMS.items()}
        numbers["stribeck_velocity"] = numbers["stribeck_velocity"] or 1.0
        numbers["place_width"] = numbers["place_width"] or 1.0
        keys = ("damping", "quadratic_damping", "frictionloss", "armature", "stiffness", "springref")
        fields = ("viscous", "quadratic", "dry", "armature", "spring", "spring_rest")
        numbers |= {field: values[JOINT, name, key] for field, key in zip(fields, keys, strict=True)}
        if numbers["play"] > 0.0 and numbers["armature"] <= 0.0:
            rule = "an inertia of the drive (armature) is needed before it"
            raise InputError(machine.file, f"joint {name!r} has play", rule)
        actuator = _actuator(drive, values, changes)
        on_link = name in machine.encoders_on_links
        joints.append(JointTruth(**numbers, **actuator, on_link=on_link, **own))
    return MachineTruth(machine, tuple(joints), values, changes, drives)


def _actuator(drive: Drive | None, values: Mapping, changes: PartChanges) -> dict[str, float]:
    """Fields of `JointTruth` that describe its actuator."""
    if drive is None:
        names = (
            "gain",
            "bias",
            "position_gain",
            "velocity_gain",
            "weakest",
            "strongest",
            "lowest",
            "highest",
        )
        return {"gear": 1.0, "lag": 0.0, "fading": 0.0, "braking": 0.0} | dict.fromkeys(names, 0.0)
    limit = changes.limits.get(drive.name, NO_LIMIT)
    true = changed_drive(drive, values, np.inf if limit >= NO_LIMIT else limit)
    return {
        "gear": true.gear,
        "gain": true.gain,
        "bias": true.bias,
        "position_gain": true.position_gain,
        "velocity_gain": true.velocity_gain,
        "weakest": true.force_range[0],
        "strongest": true.force_range[1],
        "lowest": true.command_range[0],
        "highest": true.command_range[1],
        "lag": true.lag,
        **{key: changes.terms.get((ACTUATOR, drive.name, key), 0.0) for key in ("fading", "braking")},
    }
