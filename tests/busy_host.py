"""A robot behind a host that is too busy: a simulated clock with missed deadlines and late readings."""

from __future__ import annotations

from typing import Any

import numpy as np

from omnimj.control.cascade.controller import Controller
from omnimj.control.compiled import CompiledController
from omnimj.control.detection.robust import RobustDetector
from omnimj.control.recovery.recovery import Recovery
from omnimj.parameters import read_robot
from omnimj.plant.faults import Fault
from omnimj.plant.planar import PlanarRobot
from omnimj.signals import CurrentCommand, Measurement, Trace
from omnimj.simulate.driving import drive_stepwise
from omnimj.simulate.suites.missions import mission

MISSED, LATE = 0.16, 0.08
"""Shares of deadlines missed and readings late, as seen over UDP on a machine with other work."""
_STALL = 0.03  # share of the missed deadlines that are stalls of the scheduler
_SHORTEST, _LONGEST = 8, 40  # periods of a stall


class BusyHost:
    """Plant whose host answers late: the robot goes on with the last command meanwhile.

    A missed deadline costs one period or a few, a stall many; the readings in between are lost, the time of
    the next one tells. A late reading is replaced by the previous one, with its time.
    """

    truth_names: tuple[str, ...] = ()

    def __init__(self, plant: Any, seed: int):
        self.period = plant.period
        self._plant, self._draws = plant, np.random.default_rng(seed)

    def reset(self) -> Measurement:
        self._newest, self._command = self._plant.reset(), None
        return self._newest

    def step(self, command: CurrentCommand) -> Measurement:
        draws, before = self._draws, self._newest
        if self._command is not None and draws.random() < MISSED:
            stalls = draws.random() < _STALL
            lost = draws.integers(_SHORTEST, _LONGEST) if stalls else draws.geometric(0.7)
            for _ in range(lost):
                self._plant.step(self._command)
        self._command = command
        self._newest = self._plant.step(command)
        return before if draws.random() < LATE else self._newest

    def truth(self) -> np.ndarray:
        return np.empty(0)


def driven_by_a_busy_host(seed: int, duration: float = 12.0, faults: tuple[Fault, ...] = ()) -> Trace:
    """A mission on natural stone, with the robust method and recovery; its diagnoses are in `about`."""
    robot = read_robot()
    plant: Any = BusyHost(PlanarRobot(robot, "natural_stone", faults=faults, seed=seed), seed)
    controller: Any = CompiledController(
        Controller(robot, period=plant.period), RobustDetector(robot), Recovery(robot)
    )
    return drive_stepwise(plant, controller, mission(np.random.default_rng(seed), duration, plant.period))
