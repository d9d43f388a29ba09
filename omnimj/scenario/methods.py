"""Which way to diagnose a run."""

from __future__ import annotations

from dataclasses import dataclass, field

from omnimj.control.method import Method
from omnimj.control.published.choice import Choice
from omnimj.control.published.layout import other_layout
from omnimj.control.published.rig import PublishedRig
from omnimj.control.published.robot import PublishedRobot
from omnimj.control.published.thresholds import chosen_thresholds
from omnimj.control.robust import ObserverGains, Robust
from omnimj.control.robust.verdict import Thresholds
from omnimj.errors import InputError, UnknownNameError
from omnimj.parameters import Floor, Rig, Robot
from omnimj.scenario import checks
from omnimj.scenario.scenario import RigDrive, Scenario

METHODS = checks.METHODS
"""Ways to diagnose: on missions, as published, not at all."""

RIG_METHODS = ("published", "off")
"""The same on the test rig, whose one wheel leaves nothing to decouple."""


def require_method(method: str) -> None:
    """Refuses what this version cannot do.

    Raises:
      UnknownNameError: A method that this version does not have.
    """
    if method not in METHODS:
        raise UnknownNameError("--method", "method", method, METHODS)


def methods_of(scenario: Scenario) -> tuple[str, ...]:
    """The methods that a scenario can be driven with; nothing is diagnosed at the kinematic level.

    The published method is for one layout of wheels.
    """
    if scenario.level == "kinematic":
        return ("off",)
    if isinstance(scenario.constants, Rig):
        return RIG_METHODS
    fits = not other_layout(scenario.constants)
    return tuple(name for name in METHODS if fits or name != "published")


def default_method(scenario: Scenario) -> str:
    """The method of a run that asks for none."""
    return methods_of(scenario)[0]


@dataclass(frozen=True)
class Believed:
    """What a method is told of the machine: nothing of patches and faults."""

    machine: Robot | Rig
    """Constants of the model file; its effects are left out."""
    floor: Floor
    mass: float | None = None
    """That the rig was loaded to [kg]; the first of its masses when None."""
    choice: Choice = field(default_factory=Choice)
    """The form of the published method."""
    thresholds: Thresholds | None = None
    """Of the robust method; the shipped ones when None."""
    observer: ObserverGains | None = None
    """Of the robust method; as shipped when None."""


def make_method(name: str, scenario: Scenario, thresholds: Thresholds | None = None) -> Method | None:
    """The method of that name for the robot or rig of a scenario; None for `off`.

    It believes in the constants of the model file and in the scenario's floor; of patches and faults it knows
    nothing.

    Args:
      name: Of `METHODS`.
      scenario: Its `[diagnosis]` table chooses the method's form.
      thresholds: Of the robust method; the shipped ones when None.

    Raises:
      UnknownNameError: A method that this version does not have.
      InputError: A robot that the method is not for, or thresholds for another method.
    """
    mass = scenario.drive.mass if isinstance(scenario.drive, RigDrive) else None
    floor = scenario.floors[scenario.floor]
    observer = None if scenario.gains is None else scenario.gains.observer
    return method_for(
        name, Believed(scenario.constants, floor, mass, scenario.diagnosis, thresholds, observer)
    )


def method_for(name: str, believed: Believed) -> Method | None:
    """The method of that name for a machine, with or without a scenario; None for `off`.

    Raises:
      UnknownNameError: A method that this version does not have.
      InputError: A machine that the method is not for, or thresholds for another method.
    """
    require_method(name)
    machine, floor, choice = believed.machine, believed.floor, believed.choice
    if believed.thresholds is not None and name != "robust":
        raise InputError("--thresholds", f"the method is {name!r}", "they are those of 'robust'")
    if name == "off":
        return None
    if name == "robust":
        if isinstance(machine, Rig):
            raise InputError("--method", f"found {name!r}", "the rig has one wheel", RIG_METHODS)
        return Robust(machine, thresholds=believed.thresholds, gains=believed.observer)
    limits = chosen_thresholds(choice)
    if isinstance(machine, Rig):
        return PublishedRig(machine, floor, believed.mass, limits, choice)
    return PublishedRobot(machine, floor, limits, choice)
