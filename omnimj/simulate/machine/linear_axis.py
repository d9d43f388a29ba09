"""Linear axis of an `axis.toml` as a machine with an MJCF file, and its logs in the columns of that file."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import mujoco
import numpy as np

from omnimj.effects import AXIS
from omnimj.effects.axis import CARRIAGE, CHANNELS, DRIVE, GUIDE
from omnimj.effects.parts import ACTUATOR, BODY, JOINT, Part
from omnimj.errors import InputError
from omnimj.parameters.mjcf_model import read_model_tree
from omnimj.parameters.model_file import read_effects
from omnimj.parameters.reading import Provenance, positive, quantity, read_table, require_keys
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
_FOLDER = "linear_axis"


@dataclass(frozen=True)
class AxisBody:
    """Table `[axis]`: carriage, guide and drive; motor and gear are included as equivalent moving mass."""

    mass: float = positive("kg")
    """Total moving mass, including the reflected inertia of motor and screw."""
    drive_mass: float = quantity("kg", 0.0)
    """Part of that mass on the motor side of the play in the drive train."""
    coulomb: float = quantity("N", 0.0)
    viscous: float = quantity("N.s/m", 0.0)
    force_constant: float = positive("N/A")
    """Force at the carriage per motor current."""
    force_limit: float = positive("N")
    force_loop: float = quantity("s", 0.0, 0.1)
    """Time constant of the amplifier's force (current) loop."""
    travel: float = positive("m")
    """Travel to either side of the middle of the guide."""


@dataclass(frozen=True)
class AxisSensors:
    """Table `[sensors]`: encoder, tachometer, force (or current) monitor; noise is RMS before rounding."""

    sample_rate: float = quantity("Hz", 10.0, 100_000.0)
    position_resolution: float = quantity("m", 0.0)
    position_noise: float = quantity("m", 0.0)
    velocity_noise: float = quantity("m/s", 0.0)
    force_noise: float = quantity("N", 0.0)
    force_resolution: float = quantity("N", 0.0)
    encoder_at_drive: int = quantity("1", 0, 1)
    """1: the encoder is on the motor, 0: it is on the carriage."""


def read_axis(path: Path | None = None) -> Machine:
    """Machine of an `axis.toml`: the shipped MJCF file with the constants and effects of the TOML file.

    Raises:
      InputError: A value is missing or breaks its rule; the message names file, key, value and rule.
      UnknownNameError: An unknown table, key or effect.
    """
    path = models_folder() / _FOLDER / "axis.toml" if path is None else path
    tree = read_model_tree(path)
    if tree.get("plant") != AXIS:
        found = f"found {tree.get('plant')!r}"
        raise InputError(f"{path}: plant", found, f"this file must say {AXIS!r}")
    provenance: dict[str, Provenance] = {}
    body, sensors = _tables(tree, path, provenance)
    model = _model(body, sensors)
    drives = read_drives(model, path)
    machine = Machine(
        path,
        model,
        drives,
        read_values(model, drives),
        tuple(_uncertain(body, provenance)),
        read_effects(tree, path, provenance),
        provenance,
        AXIS,
        encoders_on_links=() if sensors.encoder_at_drive else (GUIDE,),
        forces_are_declared=True,
    )
    apply_part_effects(machine)
    return machine


def _tables(
    tree: Mapping[str, Any], path: Path, provenance: dict[str, Provenance]
) -> tuple[AxisBody, AxisSensors]:
    require_keys(path, tree, ("plant", "axis", "sensors", "effects"), "table")
    kinds, found = {"axis": AxisBody, "sensors": AxisSensors}, []
    for name, kind in kinds.items():
        if name not in tree:
            raise InputError(path, f"[{name}] is missing")
        found.append(read_table(kind, tree[name], lambda _: path, provenance, name))
    body, sensors = found
    if body.drive_mass >= body.mass:
        value = f"found {body.drive_mass:g}"
        raise InputError(f"{path}: axis.drive_mass", value, f"must be below axis.mass, {body.mass:g}")
    return body, sensors


def _model(body: AxisBody, sensors: AxisSensors) -> mujoco.MjModel:
    """The shipped MJCF file with the constants of the tables; what lies before the play is the armature."""
    spec = mujoco.MjSpec.from_file(str(models_folder() / _FOLDER / f"{_FOLDER}.xml"))
    joint, drive = spec.joint(GUIDE), spec.actuator(DRIVE)
    joint.frictionloss, joint.armature, joint.damping[0] = body.coulomb, body.drive_mass, body.viscous
    joint.range = (-body.travel, body.travel)
    spec.body(CARRIAGE).mass = body.mass - body.drive_mass
    drive.gainprm[0] = body.force_constant
    drive.forcerange = (-body.force_limit, body.force_limit)
    drive.ctrlrange = np.array(drive.forcerange) / body.force_constant
    if body.force_loop > 0.0:
        drive.dyntype, drive.dynprm[0] = mujoco.mjtDyn.mjDYN_FILTEREXACT, body.force_loop
    noise = {
        "encoder": _rounded(sensors.position_noise, sensors.position_resolution),
        "tachometer": sensors.velocity_noise,
        "force_monitor": _rounded(sensors.force_noise, sensors.force_resolution),
    }
    for name, value in noise.items():
        spec.sensor(name).noise = value
    spec.option.timestep = 1.0 / sensors.sample_rate
    return spec.compile()


def _rounded(noise: float, step: float) -> float:
    """RMS of noise and of rounding to steps."""
    return math.hypot(noise, step / math.sqrt(12.0))


def _uncertain(body: AxisBody, provenance: Mapping[str, Provenance]) -> Iterator[Uncertain]:
    """Yield the constants that have an uncertainty."""
    for name, part in _NAMES.items():
        origin = provenance[f"axis.{name}"]
        if origin.uncertainty > 0.0:
            beyond = body.drive_mass if name == "mass" else 0.0
            value = float(getattr(body, name))
            yield Uncertain(part, origin.unit, value, origin.uncertainty, name, beyond)


def named_as_logged(axis: Machine, dataset: Dataset) -> Machine:
    """The machine with the channels' names in the logs, `force` or `current`.

    A measured force needs no force constant, which is certain then.

    Args:
      axis: From `read_axis`.
      dataset: Runs of a linear axis.
    """
    columns, known = {c for run in dataset.runs for c in run.columns}, axis.uncertain
    absent = "force"
    if absent in columns:
        absent, known = "current", tuple(one for one in known if one.name != "force_constant")
    names = {channel: name for name, channel in CHANNELS.items() if name != absent}
    return replace(axis, uncertain=known, column_names=names)


def as_axis_log(run: Run) -> Run:
    """Run of the axis' MJCF file in the columns of a linear axis: `position`, `velocity`, `force`."""
    names = {channel: name for name, channel in CHANNELS.items() if name != "current"}
    return replace(run, columns={names.get(name, name): values for name, values in run.columns.items()})


def as_machine_logs(dataset: Dataset, machine: Machine) -> Dataset:
    """Rename `position`, `velocity`, `force` and `current`, and the moving `mass` of a run.

    The current is the command of the actuator, of an `axis.toml` a declared force over the force constant.
    The mass that moves is that of the body and the armature.

    Args:
      dataset: Runs of a linear axis.
      machine: The axis by its MJCF file.

    Raises:
      InputError: The machine is no slide with an actuator, a run has neither force nor current, or a stated
        mass is below the armature.
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
    """Run with the declared force instead of the current."""
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
