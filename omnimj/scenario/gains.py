"""A scenario driven with other gains than those of its model file."""

from __future__ import annotations

import dataclasses

from omnimj.control.gains import Gains
from omnimj.errors import InputError
from omnimj.parameters import Robot
from omnimj.scenario.scenario import Scenario


def gains_of(scenario: Scenario) -> Gains:
    """The gains that a robot's scenario is driven with."""
    robot = scenario.constants
    assert isinstance(robot, Robot)
    return Gains(robot.control) if scenario.gains is None else scenario.gains


def require_cascade(scenario: Scenario) -> None:
    """Whether gains act on it.

    Raises:
      InputError: A scenario of the test rig, or of the kinematic level.
    """
    if not isinstance(scenario.constants, Robot):
        raise InputError("--gains", f"{scenario.name} is driven on the test rig", "it has no cascade")
    if scenario.level != "physics":
        raise InputError("--gains", f"{scenario.name} is at the kinematic level", "it has no cascade")


def with_gains(scenario: Scenario, gains: Gains) -> Scenario:
    """The same scenario, driven with these gains.

    Raises:
      InputError: As `require_cascade`.
    """
    require_cascade(scenario)
    robot = scenario.constants
    assert isinstance(robot, Robot)
    return dataclasses.replace(
        scenario, constants=dataclasses.replace(robot, control=gains.control), gains=gains
    )
