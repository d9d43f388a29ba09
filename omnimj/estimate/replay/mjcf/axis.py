"""Linear axis of an `axis.toml`: its MJCF file with the constants of the TOML file, and its replay.

Names of effects, channels and constants are those of the plant `linear_axis`; all else is the replay of any
machine.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import replace

import mujoco
import numpy as np

from omnimj.effects import AXIS
from omnimj.effects.axis import CARRIAGE, DRIVE, GUIDE, part_values
from omnimj.effects.parts import ACTUATOR, BODY, JOINT, Part
from omnimj.errors import InputError
from omnimj.estimate.replay.mjcf.replay import MachineReplay
from omnimj.parameters import Axis
from omnimj.plant.mujoco.machine import Machine, Uncertain, apply_part_effects
from omnimj.plant.mujoco.quantities import body_names, is_hinge, read_drives, read_values
from omnimj.recording.dataset import MASS_OF, MJCF, Dataset, Run
from omnimj.resources import models_folder

_NAMES: Mapping[str, Part] = {
    "mass": (BODY, CARRIAGE, "mass"),
    "coulomb": (JOINT, GUIDE, "frictionloss"),
    "viscous": (JOINT, GUIDE, "damping"),
    "force_constant": (ACTUATOR, DRIVE, "gain"),
}
"""Constant of `axis.toml` that may be uncertain → quantity of the MJCF file."""


def axis_machine(axis: Axis) -> Machine:
    """Machine of the shipped MJCF file with the constants and effects of an axis.

    Raises:
      InputError: An effect is incomplete or acts twice.
    """
    spec = mujoco.MjSpec.from_file(str(models_folder() / "linear_axis" / "linear_axis.xml"))
    body, values = axis.axis, part_values(axis)
    joint, carriage, drive = spec.joint(GUIDE), spec.body(CARRIAGE), spec.actuator(DRIVE)
    joint.frictionloss = values[JOINT, GUIDE, "frictionloss"]
    joint.armature = values[JOINT, GUIDE, "armature"]
    joint.damping[0] = values[JOINT, GUIDE, "damping"]
    joint.range = (-body.travel, body.travel)
    carriage.mass = values[BODY, CARRIAGE, "mass"]
    drive.gainprm[0] = body.force_constant
    drive.forcerange = (-body.force_limit, body.force_limit)
    drive.ctrlrange = np.array(drive.forcerange) / body.force_constant
    model = spec.compile()
    drives = read_drives(model, axis.file)
    uncertain = tuple(_uncertain(axis))
    found = read_values(model, drives)
    machine = Machine(axis.file, model, drives, found, uncertain, axis.effects, axis.provenance, AXIS)
    apply_part_effects(machine)
    return machine


def _uncertain(axis: Axis) -> Iterator[Uncertain]:
    """Yield the constants of an axis that have an uncertainty."""
    for name, part in _NAMES.items():
        origin, beyond = axis.provenance[f"axis.{name}"], 0.0
        if name == "mass":
            beyond = axis.axis.drive_mass
        if origin.uncertainty > 0.0:
            value = float(getattr(axis.axis, name))
            yield Uncertain(part, origin.unit, value, origin.uncertainty, name, beyond)


def axis_replay(dataset: Dataset, axis: Axis) -> MachineReplay:
    """Replay of the logs of an axis as those of its MJCF file.

    Raises:
      InputError: A run has neither force nor current, or none is long enough.
    """
    machine = axis_machine(axis)
    force_only = all("force" in run.columns for run in dataset.runs)
    if force_only:
        kept = tuple(one for one in machine.uncertain if one.name != "force_constant")
        machine = replace(machine, uncertain=kept)
    return MachineReplay(as_machine_logs(dataset, machine), machine)


def as_machine_logs(dataset: Dataset, machine: Machine) -> Dataset:
    """Rename `position`, `velocity`, `force` and `current`, and the moving `mass` of a run.

    The current is the command of the actuator, of an `axis.toml` a declared force over the force constant, and
    the mass that moves is that of the body and the armature.

    Args:
      dataset: Runs of a linear axis.
      machine: The axis by its MJCF file.

    Raises:
      InputError: The machine is no slide with an actuator, or a stated mass is below the armature.
    """
    joints, drives = machine.joints, machine.drives
    if len(joints) != 1 or is_hinge(machine.mj_model, joints[0]) or len(drives) != 1:
        found = f"has {len(joints)} joints and {len(drives)} actuators"
        raise InputError(machine.file, found, "the logs of linear_axis need one slide with one actuator")
    (joint,), (drive,) = joints, drives
    names = {"position": f"position:{joint}", "velocity": f"velocity:{joint}"}
    names |= {"force": f"force:{drive.name}", "current": f"control:{drive.name}"}
    runs = dataset.runs
    if machine.forces_are_declared:
        runs = [_with_force(run, drive.gain) for run in runs]
    runs = tuple(_renamed(run, names, machine) for run in runs)
    return replace(dataset, plant=MJCF, runs=runs, model=machine.file)


def _with_force(run: Run, force_constant: float) -> Run:
    """Run with the declared force instead of the current.

    Raises:
      InputError: The run has neither.
    """
    columns, masked = dict(run.columns), dict(run.masked)
    current, mask = columns.pop("current", None), masked.pop("current", None)
    if "force" not in columns:
        if current is None:
            rule = "a linear axis' log needs one of them"
            raise InputError(run.name, "has neither 'force' nor 'current'", rule)
        columns["force"] = force_constant * current
        if mask is not None:
            masked["force"] = mask
    return replace(run, columns=columns, masked=masked)


def _renamed(run: Run, names: dict[str, str], machine: Machine) -> Run:
    conditions = {key: value for key, value in run.conditions.items() if key != "mass"}
    if "mass" in run.conditions:
        body = body_names(machine.mj_model)[int(machine.mj_model.jnt_bodyid[0]) - 1]
        armature = machine.values[JOINT, machine.joints[0], "armature"]
        mass = float(run.conditions["mass"]) - armature
        if mass <= 0.0:
            found = f"the stated mass is {run.conditions['mass']} kg"
            raise InputError(f"run {run.name!r}", found, f"must be above the armature, {armature:g} kg")
        conditions[f"{MASS_OF}{body}"] = mass
    return replace(
        run,
        columns={names.get(name, name): values for name, values in run.columns.items()},
        masked={names.get(name, name): mask for name, mask in run.masked.items()},
        conditions=conditions,
    )
