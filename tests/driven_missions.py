"""Short missions on the planar equations, recorded as a logger would: healthy, or with a fault."""

from __future__ import annotations

from functools import cache
from pathlib import Path

import numpy as np

from omnimj.control.cascade.controller import Controller
from omnimj.control.compiled import CompiledController
from omnimj.control.detection.robust import RobustDetector
from omnimj.parameters import read_robot
from omnimj.plant.faults import Fault
from omnimj.plant.interface import robot_channels
from omnimj.plant.planar import PlanarRobot
from omnimj.recording.dataset import Dataset, Run
from omnimj.signals import Trace
from omnimj.simulate.driving import drive
from omnimj.simulate.suites.missions import mission

ONSET = 3.0
WEAK = Fault("motor", ONSET, wheel=2, numbers={"loss": 0.57})
COMMANDS = tuple(f"current_target_{i}" for i in range(1, 5))
MEASURED = ("time", *robot_channels(4))


@cache
def driven(duration: float = 12.0, seed: int = 5, weak: bool = False, watched: bool = False) -> Trace:
    """A mission; with the robust method beside the cascade where it is watched."""
    robot = read_robot()
    faults = (WEAK,) if weak else ()
    plant = PlanarRobot(robot, "natural_stone", faults=faults, seed=seed)
    detector = RobustDetector(robot) if watched else None
    controller = CompiledController(Controller(robot, period=plant.period), detector)
    reference = mission(np.random.default_rng(seed), duration, plant.period)
    return drive(plant, controller, reference)


def as_run(trace: Trace, name: str = "one", commands: bool = True, rows: slice = slice(None)) -> Run:
    """What a logger keeps of it."""
    names = (*MEASURED, *(COMMANDS if commands else ()))
    return Run(name, {key: trace[key][rows] for key in names}, {}, {"floor": "natural_stone"})


def as_dataset(*runs: Run) -> Dataset:
    """As if it had been read."""
    return Dataset(Path("measured"), "uto_robot", runs)
