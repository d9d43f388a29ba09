"""Columns of a dataset as measured joints, inputs of actuators and sensors of a machine."""

from __future__ import annotations

from dataclasses import dataclass

import mujoco

from omnimj.effects.parts import ACTUATOR, BODY, Part
from omnimj.errors import InputError, UnknownNameError
from omnimj.plant.mujoco.machine import Machine, channel_names
from omnimj.plant.mujoco.quantities import Drive
from omnimj.recording.dataset import MASS_OF, MJCF, Dataset, Run, plant_columns

_KINEMATIC = {
    mujoco.mjtSensor.mjSENS_JOINTPOS,
    mujoco.mjtSensor.mjSENS_JOINTVEL,
    mujoco.mjtSensor.mjSENS_ACTUATORPOS,
    mujoco.mjtSensor.mjSENS_ACTUATORVEL,
}
"""Sensors of one number that follow from the measured motion."""


@dataclass(frozen=True)
class Input:
    """Measured input of a joint."""

    drive: Drive
    column: str
    is_force: bool
    """True if the actuator's force was measured, False if its command was."""


@dataclass(frozen=True)
class MeasuredParts:
    """Channels of a machine that a dataset holds; joints in the order of the model."""

    joints: tuple[str, ...]
    inputs: tuple[Input | None, ...]
    """Input of each joint; None for a joint without actuator."""
    has_velocity: tuple[bool, ...]
    sensors: tuple[str, ...]
    """Measured sensors that follow from the motion."""
    notes: tuple[str, ...]


def measured_parts(dataset: Dataset, machine: Machine) -> MeasuredParts:
    """Assign the columns of a dataset to the parts of a machine.

    Raises:
      InputError: A joint is not measured, or an actuator has no input.
      UnknownNameError: A column names a part that the MJCF file does not have; the message lists the choices.
    """
    for run in dataset.runs:
        _require_names(dataset, machine, run)
    first = set.intersection(*(set(run.columns) for run in dataset.runs))
    missing = [f"position:{name}" for name in machine.joints if f"position:{name}" not in first]
    if missing:
        found = f"has no {', '.join(missing)} in every run"
        raise InputError(dataset.path, found, "the position of every joint is needed")
    notes: list[str] = []
    drives = {drive.joint: drive for drive in machine.drives}
    inputs = tuple(
        _input(dataset, drives[name], first, notes) if name in drives else None for name in machine.joints
    )
    return MeasuredParts(
        machine.joints,
        inputs,
        tuple(f"velocity:{name}" in first for name in machine.joints),
        tuple(_sensors(machine, first, notes)),
        tuple(notes),
    )


def stated_masses(run: Run, machine: Machine, place: object) -> dict[Part, float]:
    """Masses of bodies that a run states by its conditions `mass:BODY` [kg].

    Raises:
      UnknownNameError: The MJCF file has no such body; the message lists its bodies.
    """
    found = {}
    for key, value in run.conditions.items():
        if key.startswith(MASS_OF):
            body, known = key.removeprefix(MASS_OF), machine.parts(BODY)
            if body not in known:
                where = f"{place}: run {run.name!r}: {key!r}"
                raise UnknownNameError(where, f"body of {machine.file.name}", body, known)
            found[BODY, body, "mass"] = float(value)
    return found


def _require_names(dataset: Dataset, machine: Machine, run: Run) -> None:
    known = channel_names(machine)
    for name in run.columns:
        kind, colon, part = name.partition(":")
        choices = [k for k in known if k.startswith(f"{kind}:")]
        if colon and plant_columns(MJCF).has(name) and name not in known:
            place = f"{dataset.path}: run {run.name!r}: column {name!r}"
            where = {"position": "joint", "velocity": "joint", "sensor": "sensor"}.get(kind, ACTUATOR)
            names = [k.partition(":")[2] for k in choices]
            raise UnknownNameError(place, f"{where} of {machine.file.name}", part, names)


def _input(dataset: Dataset, drive: Drive, columns: set[str], notes: list[str]) -> Input:
    force, control = f"force:{drive.name}", f"control:{drive.name}"
    if force in columns:
        if control in columns:
            notes.append(f"{control} is not used: {force} was measured")
        return Input(drive, force, True)
    if control in columns:
        return Input(drive, control, False)
    found = f"actuator {drive.name!r} moves joint {drive.joint!r}, and no run tells its input"
    raise InputError(dataset.path, found, f"a column {control!r} or {force!r} is needed in every run")


def _sensors(machine: Machine, columns: set[str], notes: list[str]):
    m = machine.mj_model
    for column in sorted(columns):
        kind, _, name = column.partition(":")
        if kind != "sensor":
            continue
        index = mujoco.mj_name2id(m, mujoco.mjtObj.mjOBJ_SENSOR, name)
        if mujoco.mjtSensor(m.sensor_type[index]) in _KINEMATIC:
            yield name
        else:
            what = mujoco.mjtSensor(m.sensor_type[index]).name.removeprefix("mjSENS_").lower()
            notes.append(f"{column} is not compared: sensors of kind {what} are not supported")
