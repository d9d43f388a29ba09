"""What the logs of each machine hold for a method, and the method for each run."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path

from omnimj.control.method import Method
from omnimj.control.robust.gains import ObserverGains
from omnimj.control.robust.verdict import Thresholds
from omnimj.errors import InputError, UnknownNameError
from omnimj.parameters import Floor, Rig, Robot, read_rig, read_robot
from omnimj.plant.channels import RIG_CHANNELS, robot_channels
from omnimj.recording.dataset import Dataset, Run
from omnimj.scenario.methods import METHODS, RIG_METHODS, Believed, method_for
from omnimj.signals import Array, Measurement, RigMeasurement

PLANTS = ("uto_robot", "quarter_rig")
"""Machines whose logs can be diagnosed."""


@dataclass(frozen=True)
class Machine:
    """A machine as a method believes it to be, and how its logs become measurements."""

    constants: Robot | Rig
    channels: tuple[str, ...]
    """Columns that a method gets, in this order."""
    targets: tuple[str, ...]
    """Columns of set currents."""
    angles: tuple[str, ...]
    """Channels that may be wrapped into one turn."""
    measurement: Callable[[float, Array], Measurement | RigMeasurement]
    """Time [s] and a row of channels as a measurement."""

    @property
    def period(self) -> float:
        """Of the controller [s]."""
        return 1.0 / self.constants.sensors.sample_rate

    @property
    def has_gyro(self) -> bool:
        """Whether a gyro's bias is to be found."""
        return "yaw_rate" in self.channels


def read_machine(dataset: Dataset, model: Path | None = None) -> Machine:
    """The machine of a dataset.

    Raises:
      InputError: Nothing can be diagnosed on it, or its model file breaks a rule.
    """
    if dataset.plant == "quarter_rig":
        rig = read_rig(model)
        return Machine(rig, RIG_CHANNELS, ("current_target",), (), _rig_measurement)
    if dataset.plant != "uto_robot":
        found = f"plant is {dataset.plant!r}"
        raise InputError(dataset.path, found, "only wheels can be diagnosed", PLANTS)
    robot, n = read_robot(model), dataset.wheels
    if len(robot.wheels) != n:
        found = f"has {len(robot.wheels)} [[wheels]]"
        raise InputError(
            robot.file, found, f"the logs of {dataset.path} have {n}: give --model, e.g. three_wheel"
        )
    targets = tuple(f"current_target_{i}" for i in range(1, n + 1))
    return Machine(robot, robot_channels(n), targets, ("yaw",), _robot_measurement)


def method_name(asked: str | None, machine: Machine) -> str:
    """The method that was asked for, or the usual one.

    Raises:
      UnknownNameError: No such method.
      InputError: It diagnoses nothing, or not this machine.
    """
    is_rig = isinstance(machine.constants, Rig)
    names = tuple(name for name in (RIG_METHODS if is_rig else METHODS) if name != "off")
    if asked is None:
        return names[0]
    if asked in names:
        return asked
    if asked not in METHODS:
        raise UnknownNameError("--method", "method", asked, names)
    rule = "it diagnoses nothing" if asked == "off" else "the rig has one wheel"
    raise InputError("--method", f"found {asked!r}", rule, names)


def method_of(
    name: str,
    machine: Machine,
    run: Run,
    floors: Mapping[str, Floor],
    thresholds: Thresholds | None = None,
    observer: ObserverGains | None = None,
) -> Method:
    """The method for one run: on its floor, with its mass where it states one.

    Raises:
      UnknownNameError: No such method.
      InputError: The method is not for this machine, or the thresholds are not for the method.
    """
    constants, mass = machine.constants, run.conditions.get("mass")
    if isinstance(constants, Robot) and mass is not None:
        body = dataclasses.replace(constants.body, mass=float(mass))
        constants = dataclasses.replace(constants, body=body)
    load = None if mass is None else float(mass)
    floor = floors[str(run.conditions["floor"])]
    believed = Believed(constants, floor, load, thresholds=thresholds, observer=observer)
    method = method_for(name, believed)
    if method is None:
        raise InputError("--method", f"found {name!r}", "it diagnoses nothing")
    return method


def _robot_measurement(time: float, row: Array) -> Measurement:
    n = (len(row) - 4) // 2
    return Measurement(
        time,
        row[:n],
        row[n : 2 * n],
        row[2 * n : 2 * n + 2],
        float(row[2 * n + 2]),
        float(row[2 * n + 3]),
    )


def _rig_measurement(time: float, row: Array) -> RigMeasurement:
    return RigMeasurement(time, *row.tolist())
