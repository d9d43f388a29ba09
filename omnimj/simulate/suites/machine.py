"""Test plan of any machine with an MJCF file, such as the linear axis: motions of its joints in a loop."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import mujoco

from omnimj.effects.parts import BODY, JOINT
from omnimj.plant.mujoco.machine import Machine
from omnimj.recording.dataset import MASS_OF, Run
from omnimj.signals import Array
from omnimj.simulate.machine.drive import (
    Motion,
    declared_values,
    logged_run,
    machine_loop,
    planned_rows,
    simulated_rows,
)
from omnimj.simulate.machine.linear_axis import as_axis_log
from omnimj.simulate.machine.truth import machine_truth
from omnimj.simulate.suites.suite import Condition, RunConfig

PAYLOAD_SHARE = 0.1
"""Added mass of one motion relative to that of the bodies."""
_SECONDS = 12.0


@dataclass(frozen=True)
class MachineMotion:
    """Motion of one condition of the plan."""

    motion: Motion
    seed: int
    """Seed of the planned motion."""
    added: float = 0.0
    """Mass put on the last body, which the log declares [kg]."""


MOTIONS: Mapping[str, Motion] = {
    "usual": Motion(_SECONDS),
    "another": Motion(_SECONDS),
    "half_speed": Motion(_SECONDS, 0.5),
    "slow": Motion(_SECONDS, 0.15),
    "short_and_fast": Motion(_SECONDS, 1.5, 0.3),
    "crawl": Motion(_SECONDS, 0.3, 0.1),
}
"""Motions of the plan."""
LOADED = "with_payload"
"""The usual motion with a known mass on the last body."""


def plan_motions(machine: Machine, seed: int) -> list[Condition]:
    """Conditions of all motions, and of one with a known mass on the last body of the driven joints."""
    found = [
        Condition(name, {}, MachineMotion(motion, seed + k))
        for k, (name, motion) in enumerate(MOTIONS.items())
    ]
    body = _loaded_body(machine)
    if body is None:
        return found
    added = round(PAYLOAD_SHARE * float(machine.mj_model.body_mass.sum()), 6)
    stated = {f"{MASS_OF}{body}": round(machine.values[BODY, body, "mass"] + added, 6)}
    loaded = MachineMotion(Motion(_SECONDS), seed + len(found), added)
    return [*found, Condition(LOADED, stated, loaded)]


def _loaded_body(machine: Machine) -> str | None:
    """Last body that a driven joint carries, or the last one where none is driven; None without a body."""
    m, bodies = machine.mj_model, machine.parts(BODY)
    driven = {int(m.jnt_bodyid[machine.joints.index(drive.joint)]) for drive in machine.drives}
    for name in reversed(bodies):
        above = mujoco.mj_name2id(m, mujoco.mjtObj.mjOBJ_BODY, name)
        while above and above not in driven:
            above = int(m.body_parentid[above])
        if above:
            return name
    return bodies[-1] if bodies else None


def plan_axis_motions(axis: Machine, seed: int) -> list[Condition]:
    """Conditions as those of any machine; the mass that a run states is all that moves."""
    armature = axis.values[JOINT, axis.joints[0], "armature"]
    *plain, loaded = plan_motions(axis, seed)
    (carried,) = loaded.conditions.values()
    return [*plain, replace(loaded, conditions={"mass": float(carried) + armature})]


def record_machine(
    machine: Machine, nominal: Machine, condition: Condition, config: RunConfig
) -> Mapping[str, Array]:
    """Record a `MachineMotion` under position control: inputs of the actuators and positions of the joints.

    A `RecordRun`; there is one plant only.
    """
    return drive_motion(machine, nominal, condition.drive, config).columns


def record_axis(
    axis: Machine, nominal: Machine, condition: Condition, config: RunConfig
) -> Mapping[str, Array]:
    """Record as `record_machine`, in the columns of a linear axis."""
    return as_axis_log(drive_motion(axis, nominal, condition.drive, config)).columns


def drive_motion(machine: Machine, nominal: Machine, wanted: MachineMotion, config: RunConfig) -> Run:
    """Log of one motion in the columns of the MJCF file; machines and configuration as for a `RecordRun`."""
    loop = machine_loop(nominal, float(nominal.mj_model.opt.timestep))
    plan = loop.plan(wanted.seed, wanted.motion)
    truth = machine_truth(machine, declared_values(machine))
    body = _loaded_body(machine)
    if wanted.added and body is not None:
        part = (BODY, body, "mass")
        truth = replace(truth, masses={**truth.masses, part: truth.masses[part] + wanted.added})
    rows, usual = simulated_rows(truth, loop.loop, plan), planned_rows(loop.loop, loop.plan(0))
    found = logged_run(LOADED, truth, rows, config.seed, loop.period, usual=usual)
    if config.progress is not None:
        config.progress(1, 1)
    return found
