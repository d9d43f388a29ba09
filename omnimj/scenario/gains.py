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


def with_gains(scenario: Scenario, gains: Gains) -> Scenario:
    """The same scenario, driven with these gains.

    Raises:
      InputError: A scenario without a cascade: of the test rig.
    """
    robot = scenario.constants
    if not isinstance(robot, Robot):
        raise InputError("--gains", f"{scenario.name} is driven on the test rig", "it has no cascade")
    return dataclasses.replace(
        scenario, constants=dataclasses.replace(robot, control=gains.control), gains=gains
    )
