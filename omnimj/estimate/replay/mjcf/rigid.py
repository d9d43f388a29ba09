"""Rigid-body forces along a motion by MuJoCo's inverse dynamics, affine in the masses of the bodies."""

from __future__ import annotations

from collections.abc import Hashable, Mapping, Sequence
from dataclasses import dataclass, field

import mujoco
import numpy as np

from omnimj.effects.parts import BODY, Part
from omnimj.estimate.replay.mjcf import kernels
from omnimj.estimate.replay.mjcf.kernels import Simulation
from omnimj.estimate.replay.mjcf.laws import Laws
from omnimj.estimate.replay.mjcf.one_joint import OneJoint, one_joint
from omnimj.estimate.replay.mjcf.remembered import Remembered
from omnimj.plant.mujoco.machine import Machine
from omnimj.plant.mujoco.quantities import QUANTITIES, with_masses
from omnimj.plant.mujoco.step import function_address
from omnimj.signals import Array

_KEPT = 12  # motions, each with its forces and their slopes over the masses
_OFF = mujoco.mjtDisableBit

Motion = tuple[Array, Array, Array]
"""Position, speed and acceleration, shape (n, j) each."""


@dataclass(frozen=True)
class Load:
    """Stretches whose runs state the same masses."""

    stated: Mapping[Part, float]
    """Masses that they state [kg]."""
    parts: tuple[slice, ...]
    """Their rows."""


@dataclass(frozen=True)
class _Affine:
    """Forces R = R_0 + Σ (m − m_0) ∂R/∂m of one motion."""

    masses: Mapping[Part, float]
    forces: Array
    """At these masses, shape (n, j) [N or N.m]."""
    slopes: dict[Part, Array] = field(default_factory=dict)
    """Over the masses, as far as they are known, shape (n, j) each."""


class RigidBodies:
    """Bodies of a machine along its logs."""

    def __init__(
        self,
        machine: Machine,
        stretches: Sequence[Sequence[int]],
        sensors: Sequence[str],
        stated: Sequence[Mapping[Part, float]],
    ):
        """Prepare the models.

        Args:
          stretches: Table of stretches, see `log.STRETCH`.
          stated: Masses that a run states, for each stretch; those of the model everywhere when empty.
        """
        self._machine = machine
        names = [mujoco.mj_name2id(machine.mj_model, mujoco.mjtObj.mjOBJ_SENSOR, s) for s in sensors]
        self._sensors = np.array([machine.mj_model.sensor_adr[k] for k in names], np.int64)
        found: dict[tuple[tuple[Part, float], ...], list[slice]] = {}
        for k, (first, last, *_) in enumerate(stretches):
            load = tuple(sorted(stated[k].items())) if stated else ()
            found.setdefault(load, []).append(slice(first, last))
        self.loads = tuple(Load(dict(load), tuple(parts)) for load, parts in found.items())
        """Stretches by the masses that their runs state."""
        self._known: Remembered[_Affine] = Remembered(_KEPT)
        self._joints: Remembered[tuple[OneJoint | None]] = Remembered(_KEPT)

    def forces(self, laws: Laws, motion: Motion, key: Hashable = None) -> tuple[Array, Array]:
        """Rigid-body forces along a motion, shape (n, j) [N or N.m], and readings of sensors, shape (n, s).

        Args:
          key: What the motion depends on; None for a motion that will not come again.
        """
        if key is None or len(self._sensors):
            return self._computed(laws, laws.masses, motion)
        key = key, laws.payloads, tuple(laws.gravity.tolist())
        if (known := self._known.get(key)) is None:
            forces, readings = self._computed(laws, laws.masses, motion)
            self._known.keep(key, _Affine(laws.masses, forces))
            return forces, readings
        return self._moved(known, laws, motion), np.empty((len(motion[0]), 0))

    def _moved(self, known: _Affine, laws: Laws, motion: Motion) -> Array:
        """Forces by those at other masses; at most one new slope is computed for it."""
        changes = {part: laws.masses[part] - mass for part, mass in known.masses.items()}
        changes = {part: change for part, change in changes.items() if change != 0.0}
        unknown = [part for part in changes if part not in known.slopes]
        if len(unknown) > 1:
            return self._computed(laws, laws.masses, motion)[0]
        for part in unknown:
            step = max(known.masses[part], 1.0)
            heavier = {**known.masses, part: known.masses[part] + step}
            known.slopes[part] = (self._computed(laws, heavier, motion)[0] - known.forces) / step
        found = known.forces.copy()
        for part, change in changes.items():
            found += change * known.slopes[part]
        return found

    def _computed(self, laws: Laws, masses: Mapping[Part, float], motion: Motion) -> tuple[Array, Array]:
        shape = motion[0].shape
        forces, readings = np.empty(shape), np.empty((shape[0], len(self._sensors)))
        for load in self.loads:
            if not len(self._sensors) and (body := self.one_joint(laws, load.stated, masses)) is not None:
                for part in load.parts:
                    forces[part] = body.force(motion[0][part], motion[2][part])
                continue
            model = self._bare_model(laws, load.stated, masses)
            mj_data = mujoco.MjData(model)
            mujoco.mj_setConst(model, mj_data)  # the inertia of a joint that meets no other is a constant
            simulation = arrays_of(model, mj_data)
            for part in load.parts:
                moved = (values[part] for values in motion)
                kernels.rigid_forces(simulation, *moved, self._sensors, forces[part], readings[part])
        return forces, readings

    def one_joint(
        self, laws: Laws, stated: Mapping[Part, float], masses: Mapping[Part, float] | None = None
    ) -> OneJoint | None:
        """Rigid-body force of a machine with a single joint; None for any other, see `one_joint`."""
        if len(laws.joints) != 1:
            return None
        masses = masses or laws.masses
        key = tuple(masses.items()), tuple(stated.items()), laws.payloads, tuple(laws.gravity.tolist())
        if (known := self._joints.get(key)) is None:
            known = (one_joint(self._bare_model(laws, stated, masses)),)
            self._joints.keep(key, known)
        return known[0]

    def _bare_model(
        self, laws: Laws, stated: Mapping[Part, float], masses: Mapping[Part, float] | None
    ) -> mujoco.MjModel:
        """Model of the bodies alone, without constraints, friction, springs and armature."""
        model = self.model(laws, stated, masses)
        model.opt.disableflags |= int(_OFF.mjDSBL_CONSTRAINT)
        model.dof_damping[:] = model.dof_frictionloss[:] = model.dof_armature[:] = 0.0
        model.dof_dampingpoly[:, 0] = model.jnt_stiffness[:] = 0.0
        return model

    def model(
        self, laws: Laws, stated: Mapping[Part, float], masses: Mapping[Part, float] | None = None
    ) -> mujoco.MjModel:
        """Copy of the model with a setting's gravity and masses, without contacts, limits and islands."""
        masses, lightest = dict(masses or laws.masses), QUANTITIES[BODY]["mass"].lowest
        for part, mass in stated.items():
            masses[part] = max(masses[part] + mass - self._machine.values[part], lightest)
        model = with_masses(self._machine.mj_model, masses, laws.payloads)
        model.opt.gravity[:] = laws.gravity
        for flag in (_OFF.mjDSBL_CONTACT, _OFF.mjDSBL_LIMIT, _OFF.mjDSBL_ACTUATION, _OFF.mjDSBL_ISLAND):
            model.opt.disableflags |= int(flag)
        return model


def arrays_of(model: mujoco.MjModel, mj_data: mujoco.MjData) -> Simulation:
    """Arrays of a model; it and its data must outlive them."""
    d = mj_data
    return Simulation(
        function_address("mj_step"),
        function_address("mj_inverse"),
        model._address,
        d._address,
        model.opt.timestep,
        d.qpos,
        d.qvel,
        d.qacc,
        d.qfrc_applied,
        d.qfrc_passive,
        d.qfrc_constraint,
        d.qfrc_inverse,
        d.qacc_warmstart,
        d.sensordata,
        model.dof_damping,
        model.dof_frictionloss,
    )
