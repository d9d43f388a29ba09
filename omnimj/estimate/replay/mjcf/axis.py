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
from omnimj.physics.native import kernel
from omnimj.plant.mujoco.machine import Machine, Uncertain, apply_part_effects
from omnimj.plant.mujoco.quantities import body_names, is_hinge, read_drives, read_values
from omnimj.recording.dataset import MASS_OF, MJCF, Dataset, Run
from omnimj.resources import models_folder
from omnimj.signals import Array

_NAMES: Mapping[str, Part] = {
    "mass": (BODY, CARRIAGE, "mass"),
    "coulomb": (JOINT, GUIDE, "frictionloss"),
    "viscous": (JOINT, GUIDE, "damping"),
    "force_constant": (ACTUATOR, DRIVE, "gain"),
}
"""Constant of `axis.toml` that may be uncertain → quantity of the MJCF file."""
_REVERSED = (
    "{name} has the opposite sign of the motion that it makes and is taken with its sign reversed; "
    'to mend the dataset: [columns] "{name}" = {{ name = "{name}", scale = -1.0 }}'
)
_DRIVES = 0.5  # share of the force's deviation that the motion must explain


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


class _AxisReplay(MachineReplay):
    """Replay of an axis: the only joint and the only drive need no names in results."""

    def __init__(self, dataset: Dataset, machine: Machine, threads: int | None):
        super().__init__(dataset, machine, threads=threads)
        self.curves = {name.rpartition(" ")[2]: size for name, size in self.curves.items()}
        self.channels = tuple(replace(one, name=one.name.partition(":")[0]) for one in self.channels)

    def _timing_period(self) -> float:
        """Shortest median time between two samples of a run [s]."""
        return min(float(np.median(np.diff(run.time))) for run in self._runs)

    def regimes(self) -> Mapping[str, tuple[str, Array]]:
        """As for any machine, with direction, time since a reversal, force and the stated mass."""
        log, parts = self.log, self._machine.values
        moving = np.abs(log.speed[:, 0]) >= self._maker.rest_speed[0]
        direction = np.where(moving, np.sign(log.speed[:, 0]), 0.0)
        since, mass = np.empty(len(direction)), np.empty(len(direction))
        for (first, last, _, _), run in zip(log.stretches, log.run_of_stretch, strict=True):
            since[first:last] = since_reversal(direction[first:last]) * log.period
            plain = parts[BODY, CARRIAGE, "mass"]
            mass[first:last] = float(self._runs[run].conditions.get(f"{MASS_OF}{CARRIAGE}", plain))
        mass += parts[JOINT, GUIDE, "armature"]
        means = self._means(np.stack([direction, since, log.inputs[:, 0], mass], axis=1)).T
        found = {"direction": ("1", np.rint(means[0])), "reversal": ("s", means[1]), "force": ("N", means[2])}
        found |= {"mass": ("kg", means[3])} if np.ptp(mass) > 0.0 else {}
        return {**super().regimes(), **found}


@kernel
def since_reversal(direction):
    """Rows since a joint last reversed, or since the start of the stretch, shape (n,)."""
    found, last, count = np.empty(direction.size), 0.0, 0.0
    for k in range(direction.size):
        if direction[k] != 0.0 and direction[k] != last:
            if last != 0.0:
                count = 0.0
            last = direction[k]
        found[k] = count
        count += 1.0
    return found


def axis_replay(dataset: Dataset, axis: Axis, threads: int | None = None) -> MachineReplay:
    """Replay of the logs of an axis as those of its MJCF file.

    Args:
      dataset: Runs of a linear axis.
      axis: Its constants and effects.
      threads: Threads for several settings at once; the machine's cores when None.

    Raises:
      InputError: A run has neither force nor current, or none is long enough.
    """
    machine, runs = axis_machine(axis), dataset.runs
    force = "force" if any("force" in run.columns for run in runs) else "current"
    velocity = ("velocity",) if all("velocity" in run.columns for run in runs) else ()
    columns = ("position", force, *velocity)
    on_links = () if axis.sensors.encoder_at_drive else machine.joints
    machine = replace(machine, columns=columns, encoders_on_links=on_links)
    if force == "force":
        kept = tuple(one for one in machine.uncertain if one.name != "force_constant")
        machine = replace(machine, uncertain=kept)
    logs = as_machine_logs(dataset, machine)
    found = _AxisReplay(logs, machine, threads)
    if _is_reversed(found):
        found = _AxisReplay(_reversed(logs), machine, threads)
        found.notes = (*found.notes, _REVERSED.format(name=force))
    return found


def _is_reversed(replay: MachineReplay) -> bool:
    """True if the force is opposite to the motion that it causes: a fit has negative mass and friction."""
    (force, links, speed), *_ = replay.input_balances().values()
    columns = np.stack([links, speed, np.sign(speed), np.ones(len(speed))], axis=1)
    fitted = np.linalg.lstsq(columns, force, rcond=None)[0]
    moved = columns[:, :3] @ fitted[:3]
    return bool(fitted[0] < 0.0 and moved @ speed < 0.0 and moved.std() > _DRIVES * force.std())


def _reversed(logs: Dataset) -> Dataset:
    """Logs with the sign of the force reversed."""
    name = f"force:{DRIVE}"
    runs = (replace(run, columns={**run.columns, name: -run.columns[name]}) for run in logs.runs)
    return replace(logs, runs=tuple(runs))


def as_machine_logs(dataset: Dataset, machine: Machine) -> Dataset:
    """Rename `position`, `velocity`, `force` and `current`, and the moving `mass` of a run.

    The current is the command of the actuator, of an `axis.toml` a declared force over the force constant.
    The mass that moves is that of the body and the armature.

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
