"""What a robot's sensors say on a mission, kept so that its controller can be driven without the plant."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from omnimj.control.controller import Controller
from omnimj.control.diagnosing import DiagnosingController, DiagnosingState
from omnimj.control.recovery import Recovery
from omnimj.control.robust import Robust
from omnimj.control.target import Target
from omnimj.loop import drive
from omnimj.parameters import Robot
from omnimj.plant.conditions import Fault
from omnimj.plant.planar import PlanarRobot
from omnimj.scenario.suites.missions import mission
from omnimj.signals import CurrentCommand, Measurement

FLOOR = "natural_stone"
SEED = 7
PASSING_SLIP = (Fault("slip", 4.0, 6.0, 1, {"grip": 0.1}),)
"""It comes and goes, so that a mission that follows on begins in health."""
SLIP_AND_WEAK_MOTOR = (*PASSING_SLIP, Fault("motor", 8.0, None, 2, {"loss": 0.57}))


@dataclass(frozen=True)
class Driven:
    """A mission from rest to rest, a measurement and a target per control step."""

    robot: Robot
    measurements: tuple[Measurement, ...]
    targets: tuple[Target, ...]
    last: DiagnosingState
    """Of the controller that drove."""

    @property
    def duration(self) -> float:
        """Between the first and the last measurement [s]."""
        return self.measurements[-1].time - self.measurements[0].time

    @property
    def turned(self) -> float:
        """From the first heading to the last [rad]."""
        return self.measurements[-1].yaw - self.measurements[0].yaw


class _Keeping:
    """The controller, with what it was given."""

    def __init__(self, controller: DiagnosingController):
        self._controller, self.log_names = controller, controller.log_names
        self.measurements: list[Measurement] = []
        self.targets: list[Target] = []
        self.last: Any = None

    def start(self, measurement: Measurement) -> Any:
        return self._controller.start(measurement)

    def step(self, state: Any, measurement: Measurement, target: Target) -> tuple[CurrentCommand, Any]:
        self.measurements.append(measurement)
        self.targets.append(target)
        command, self.last = self._controller.step(state, measurement, target)
        return command, self.last


def whole_controller(robot: Robot) -> DiagnosingController:
    """All that runs on a robot: cascade, diagnosis, recovery."""
    return DiagnosingController(Controller(robot), Robust(robot), Recovery(robot))


def driven_mission(robot: Robot, duration: float, faults: tuple[Fault, ...] = ()) -> Driven:
    """Drives the planar robot, with all sensors, and keeps what the controller was given.

    Args:
      robot: The robot.
      duration: Of the mission [s].
      faults: What breaks.
    """
    plant = PlanarRobot(robot, FLOOR, faults=faults, seed=SEED)
    keeping = _Keeping(whole_controller(robot))
    drive(plant, keeping, mission(np.random.default_rng(SEED), duration, plant.period))
    return Driven(robot, tuple(keeping.measurements), tuple(keeping.targets), keeping.last)


def once_more(
    controller: DiagnosingController, state: DiagnosingState, driven: Driven, number: int
) -> DiagnosingState:
    """The state after the mission was driven with it as number 0, 1, 2, …: each where the last one ended.

    Time goes on, and headings and demands are turned by what the missions before turned the robot. Method and
    recovery keep everything; the cascade begins each mission as it began the first, since an integral that is
    not the recorded one would never come home with measurements that do not answer it.
    """
    count = len(driven.measurements)
    late = number * driven.duration * count / (count - 1)  # the first comes one period after the last
    turned = number * driven.turned
    c, s = math.cos(turned), math.sin(turned)
    turn = np.array([[c, -s], [s, c]])
    for k, (m, t) in enumerate(zip(driven.measurements, driven.targets, strict=True)):
        yaw = (m.yaw + turned) % (2.0 * math.pi)
        measured = Measurement(m.time + late, m.current, m.wheel_speed, m.acceleration, m.yaw_rate, yaw)
        if k == 0:
            state = replace(state, control=controller.start(measured).control)
        target = Target(turn @ t.velocity, t.yaw_rate, t.heading + turned)
        _, state = controller.step(state, measured, target)
    return state
