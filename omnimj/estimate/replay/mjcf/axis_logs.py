"""Logs of a linear axis as those of the one joint and the one actuator of an MJCF file."""

from __future__ import annotations

from dataclasses import replace

from omnimj.effects.parts import JOINT
from omnimj.errors import InputError
from omnimj.plant.mujoco.machine import Machine
from omnimj.plant.mujoco.quantities import body_names, is_hinge
from omnimj.recording.dataset import MASS_OF, MJCF, Dataset, Run


def as_machine_logs(dataset: Dataset, machine: Machine) -> Dataset:
    """Rename `position`, `velocity`, `force` and `current`, and the moving `mass` of a run.

    The current is the command of the actuator, and the mass that moves is that of the body and the armature.

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
    runs = tuple(_renamed(run, names, machine) for run in dataset.runs)
    return replace(dataset, plant=MJCF, runs=runs, model=machine.file)


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
