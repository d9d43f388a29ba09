"""Simulated robots whose wheels turn at given speeds, as those of a measured run did."""

from __future__ import annotations

from typing import Any

import numpy as np

from omnimj.errors import SimulationError
from omnimj.parameters import Robot
from omnimj.signals import Array, Trace, robot_channels
from omnimj.simulate.compiled.run import CompiledFollowing
from omnimj.simulate.compiled.wheel_speeds import wheel_speed_loops
from omnimj.simulate.loop import LARGEST_TRUTH


def follow_wheel_speeds(plant: Any, robot: Robot, targets: Array) -> Trace:
    """Drive a simulated robot by wheel-speed control alone, stiffer than the robot's own.

    Args:
      plant: `RobotTwin` or `PlanarRobot`; reset by this call.
      robot: Gives inertia, motor and current limits.
      targets: Wheel speeds of every control period, shape (rows, n) [rad/s].

    Returns:
      `time`, readings, set currents and truth of every control period.

    Raises:
      SimulationError: The simulation left finite numbers.
    """
    sets = tuple(f"current_target_{i}" for i in range(1, robot.wheel_count + 1))
    names = ("time", *robot_channels(robot.wheel_count), *sets, *plant.truth_names)
    table = np.full((len(targets), len(names)), np.nan)
    run = CompiledFollowing(plant, wheel_speed_loops(robot, plant.period), targets)
    for _ in run.advance(table, np.empty((0, 0)), 1, LARGEST_TRUTH):
        pass
    if run.done < len(targets):
        raise SimulationError(f"the truth is not finite after {run.done * plant.period:.4g} s")
    return Trace(dict(zip(names, np.ascontiguousarray(table.T), strict=True)), {})
