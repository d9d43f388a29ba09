"""Which way to diagnose a run."""

from __future__ import annotations

from omnimj.control.method import Method
from omnimj.control.published.rig import PublishedRig
from omnimj.control.published.robot import PublishedRobot
from omnimj.control.published.thresholds import chosen_thresholds
from omnimj.errors import UnknownNameError
from omnimj.parameters import Rig
from omnimj.scenario.scenario import RigDrive, Scenario

METHODS = ("off", "published")
"""Ways to diagnose: not at all, or as published."""


def require_method(method: str) -> None:
    """Refuses what this version cannot do.

    Raises:
      UnknownNameError: A method that this version does not have.
    """
    if method not in METHODS:
        raise UnknownNameError("--method", "method", method, METHODS)


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
    choice, floor = scenario.diagnosis, scenario.floors[scenario.floor]
    thresholds = chosen_thresholds(choice)
    if isinstance(scenario.constants, Rig):
        assert isinstance(scenario.drive, RigDrive)
        return PublishedRig(scenario.constants, floor, scenario.drive.mass, thresholds, choice)
    return PublishedRobot(scenario.constants, floor, thresholds, choice)
