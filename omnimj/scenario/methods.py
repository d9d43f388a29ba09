"""Which way to diagnose a run."""

from __future__ import annotations

from omnimj.control.method import Method
from omnimj.control.published.rig import PublishedRig
from omnimj.control.published.robot import PublishedRobot
from omnimj.control.published.thresholds import chosen_thresholds
from omnimj.control.robust import Robust
from omnimj.errors import InputError, UnknownNameError
from omnimj.parameters import Rig
from omnimj.scenario.scenario import RigDrive, Scenario

METHODS = ("robust", "published", "off")
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
    """The methods that a scenario can be driven with; nothing is diagnosed at the kinematic level."""
    if scenario.level == "kinematic":
        return ("off",)
    return RIG_METHODS if isinstance(scenario.constants, Rig) else METHODS


def default_method(scenario: Scenario) -> str:
    """The method of a run that asks for none."""
    return methods_of(scenario)[0]


def make_method(name: str, scenario: Scenario) -> Method | None:
    """The method of that name for the robot or rig of a scenario; None for `off`.

    It believes in the constants of the model file and in the scenario's floor; of patches and faults it knows
    nothing.

    Args:
      name: Of `METHODS`.
      scenario: Its `[diagnosis]` table chooses the method's form.

    Raises:
      UnknownNameError: A method that this version does not have.
      InputError: A robot that the method is not for.
    """
    require_method(name)
    if name == "off":
        return None
    if name == "robust":
        if isinstance(scenario.constants, Rig):
            raise InputError("--method", f"found {name!r}", "the rig has one wheel", RIG_METHODS)
        return Robust(scenario.constants, scenario.period)
    choice, floor = scenario.diagnosis, scenario.floors[scenario.floor]
    thresholds = chosen_thresholds(choice)
    if isinstance(scenario.constants, Rig):
        assert isinstance(scenario.drive, RigDrive)
        return PublishedRig(scenario.constants, floor, scenario.drive.mass, thresholds, choice)
    return PublishedRobot(scenario.constants, floor, thresholds, choice)
