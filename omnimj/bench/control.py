"""What a robot's sensors say on a mission, kept so that its controller can be driven without the plant."""

from __future__ import annotations

import gc
import math
import time
import tracemalloc
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from omnimj.control.cascade.controller import Controller
from omnimj.control.detection.robust import RobustDetector
from omnimj.control.fault_tolerant import FaultTolerantController, FaultTolerantState
from omnimj.control.recovery import Recovery
from omnimj.parameters import Robot, read_robot
from omnimj.plant.faults import Fault
from omnimj.plant.planar import PlanarRobot
from omnimj.signals import CurrentCommand, Measurement, Target
from omnimj.simulate.loop import drive
from omnimj.simulate.suites.missions import mission

FLOOR = "natural_stone"
SEED = 7
PASSING_SLIP = (Fault("slip", 4.0, 6.0, 1, {"grip": 0.1}),)
"""It comes and goes, so that a mission that follows on begins in health."""
SLIP_AND_WEAK_MOTOR = (*PASSING_SLIP, Fault("motor", 8.0, None, 2, {"loss": 0.57}))


@dataclass(frozen=True)
class RecordedMission:
    """A mission from rest to rest, a measurement and a target per control step."""

    robot: Robot
    measurements: tuple[Measurement, ...]
    targets: tuple[Target, ...]
    last: FaultTolerantState
    """Of the controller that drove."""

    @property
    def duration(self) -> float:
        """Between the first and the last measurement [s]."""
        return self.measurements[-1].time - self.measurements[0].time

    @property
    def turned(self) -> float:
        """From the first heading to the last [rad]."""
        return self.measurements[-1].yaw - self.measurements[0].yaw


class _RecordingController:
    """The controller, with what it was given."""

    def __init__(self, controller: FaultTolerantController):
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


def full_controller(robot: Robot) -> FaultTolerantController:
    """All that runs on a robot: cascade, diagnosis, recovery."""
    return FaultTolerantController(Controller(robot), RobustDetector(robot), Recovery(robot))


def record_mission(robot: Robot, duration: float, faults: tuple[Fault, ...] = ()) -> RecordedMission:
    """Drives the planar robot, with all sensors, and keeps what the controller was given.

    Args:
      robot: The robot.
      duration: Of the mission [s].
      faults: What breaks.
    """
    plant = PlanarRobot(robot, FLOOR, faults=faults, seed=SEED)
    keeping = _RecordingController(full_controller(robot))
    drive(plant, keeping, mission(np.random.default_rng(SEED), duration, plant.period))
    return RecordedMission(robot, tuple(keeping.measurements), tuple(keeping.targets), keeping.last)


def replay_mission(
    controller: FaultTolerantController, state: FaultTolerantState, driven: RecordedMission, number: int
) -> FaultTolerantState:
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


# How long one control step takes, all of it, and what memory an hour of them takes.

HOUR = 3600.0
WARM_UP_MISSIONS = 5
"""Missions before memory is looked at: caches and windows fill."""
_PAGES = Path("/proc/self/smaps_rollup")  # counted one by one; the figures of statm are off by some pages
_KB = 1024.0


def step_times(driven: RecordedMission) -> np.ndarray:
    """Time of each step from measurement to command, over the mission that was driven, shape (k,) [s].

    The plant is not there: what it gave is replayed, and the commands are those of the drive.
    """
    controller = full_controller(driven.robot)
    state = controller.start(driven.measurements[0])
    times = np.empty(len(driven.measurements))
    for k, (measurement, target) in enumerate(zip(driven.measurements, driven.targets, strict=True)):
        begin = time.perf_counter()
        _, state = controller.step(state, measurement, target)
        times[k] = time.perf_counter() - begin
    return times


@dataclass(frozen=True)
class MemoryGrowth:
    """Memory over many steps."""

    seconds: float
    """Of robot time between both looks at memory [s]."""
    grown: float
    """By how much memory was more at the later one [kB]."""
    diagnoses: int
    """That were told in the end."""

    @property
    def per_hour(self) -> float:
        """In proportion [kB]."""
        return self.grown * HOUR / self.seconds


def memory_growth(
    driven: RecordedMission,
    passes: int,
    longest: float = float("inf"),
    memory: Callable[[], float] | None = None,
) -> MemoryGrowth:
    """Drives a mission again and again with one controller, and looks at memory.

    Every diagnosis that is remembered takes 0.2 kB, of up to `verdict.HISTORY_LENGTH`: in health nothing
    may grow.

    Args:
      driven: A mission that begins and ends in health.
      passes: How often, after `WARM_UP_MISSIONS` that are not counted.
      longest: Wall time after which it ends with the pass that is being driven [s].
      memory: What is looked at [kB]; what Python and numpy have allocated when None.
    """
    look = _allocated_memory if memory is None else memory
    if memory is None:
        tracemalloc.start()
    try:
        controller = full_controller(driven.robot)
        state = controller.start(driven.measurements[0])
        for number in range(WARM_UP_MISSIONS):
            state = replay_mission(controller, state, driven, number)
        before, done, begin = look(), 0, time.perf_counter()
        while done < passes and (done == 0 or time.perf_counter() - begin < longest):
            state = replay_mission(controller, state, driven, WARM_UP_MISSIONS + done)
            done += 1
        return MemoryGrowth(done * driven.duration, look() - before, len(state.diagnoses))
    finally:
        if memory is None:
            tracemalloc.stop()


def _allocated_memory() -> float:
    """In whole kB: looking itself takes some bytes."""
    gc.collect()
    return float(round(tracemalloc.get_traced_memory()[0] / _KB))


def resident_memory() -> float:
    """Memory of this process, native code's too, in pages that the heap has touched [kB]; Linux only."""
    gc.collect()
    (line,) = (line for line in _PAGES.read_text().splitlines() if line.startswith("Anonymous:"))
    return float(line.split()[1])


def measure_control(rounds: int, duration: float, hours: float, longest: float) -> dict[str, float]:
    """One control step [µs], and what an hour of them adds to memory [kB].

    Args:
      rounds: How often the mission is timed. Every step counts by its median over them, since the same step
        does the same work: what others do on the machine meanwhile is left out.
      duration: Of the mission [s].
      hours: Robot time over which memory is looked at [h].
      longest: Wall time after which that ends [s].
    """
    robot = read_robot()
    driven = record_mission(robot, duration, SLIP_AND_WEAK_MOTOR)
    times = 1e6 * np.median([step_times(driven) for _ in range(rounds)], axis=0)
    calm, passes = record_mission(robot, duration), max(1, round(hours * HOUR / duration))
    growth = memory_growth(calm, passes, 0.5 * longest)
    found = {
        "control_step_median_us": float(np.median(times)),
        "control_step_p999_us": float(np.quantile(times, 0.999)),
        "control_growth_kb_per_hour": growth.per_hour,
        "control_growth_hours": growth.seconds / HOUR,
    }
    if _PAGES.exists():
        found["control_pages_kb_per_hour"] = memory_growth(
            calm, passes, 0.5 * longest, resident_memory
        ).per_hour
    return found
