"""A flat floor and a robot on it, without a plan: where somebody drives by hand."""

from __future__ import annotations

from pathlib import Path
from types import MappingProxyType

import numpy as np

from omnimj.control.published.choice import Choice
from omnimj.effects import check_effects
from omnimj.parameters import read_robot
from omnimj.parameters.floor import all_floors, find_floor
from omnimj.scenario.drive import Drive
from omnimj.scenario.scenario import Scenario
from omnimj.signals import Reference

FLOOR = "natural_stone"
"""Unless told otherwise."""


def free_drive(
    floor: str = FLOOR, model_file: Path | None = None, floors_file: Path | None = None
) -> Scenario:
    """A scenario without plan, end, faults and checks.

    The heading is held, so that straight is straight; nothing shakes the wheels to ask its motors, since by
    hand nothing moves that nobody asked for.

    Args:
      floor: A name.
      model_file: The robot's; the shipped one when None.
      floors_file: Floors beside the shipped ones, or in their place.

    Raises:
      InputError: A file is wrong.
      UnknownNameError: No such floor.
    """
    robot, floors = read_robot(model_file), all_floors(floors_file)
    check_effects(robot)
    nowhere = Reference(np.zeros(1), np.zeros((1, 2)), np.zeros(1), np.zeros(1), np.zeros((1, 2)))
    return Scenario(
        name="teleop",
        description="Driven by hand",
        constants=robot,
        floor=find_floor(floor, "--floor", floors).name,
        floors=MappingProxyType(floors),
        duration=0.0,
        level="physics",
        drive=Drive(nowhere, yaw_loop=True, heading_hold=True, heading_feedback=True, start=(0.0, 0.0, 0.0)),
        faults=(),
        patches=(),
        kinematics=None,
        checks=(),
        equations="corrected",
        scene=None,
        diagnosis=Choice(dither=False),
        overrides=(),
    )
