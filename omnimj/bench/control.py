"""Control step on a recorded mission that is replayed without the plant, and diagnosis of recorded runs."""

from __future__ import annotations

import gc
import math
import time
import tracemalloc
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from omnimj.control.cascade.controller import Controller
from omnimj.control.compiled import CompiledController, CompiledState
from omnimj.control.detection.robust import RobustDetector
from omnimj.control.recovery import Recovery
from omnimj.diagnosis.logs import read_machine
from omnimj.diagnosis.replay import DiagnosisConfig, diagnose
from omnimj.parameters import Robot, read_floors, read_robot
from omnimj.plant.faults import Fault
from omnimj.plant.planar import PlanarRobot
from omnimj.recording.dataset import Dataset, Run
from omnimj.signals import CurrentCommand, Measurement, Target, robot_channels
from omnimj.simulate.driving import drive
from omnimj.simulate.suites.missions import mission as make_mission

FLOOR = "natural_stone"
SEED = 7
PASSING_SLIP = (Fault("slip", 4.0, 6.0, 1, {"grip": 0.1}),)
"""Slip fault that ends within the mission, so that a repeated mission begins without a fault."""
SLIP_AND_WEAK_MOTOR = (*PASSING_SLIP, Fault("motor", 8.0, None, 2, {"loss": 0.57}))
HOUR = 3600.0
WARM_UP_MISSIONS = 10
"""Missions driven before memory is measured, to fill caches and windows."""
_PAGES = Path("/proc/self/smaps_rollup")  # exact, unlike /proc/self/statm
_KB = 1024.0


@dataclass(frozen=True)
class RecordedMission:
    """Mission from rest to rest with one measurement and target per control step."""

    robot: Robot
    measurements: tuple[Measurement, ...]
    targets: tuple[Target, ...]
    last: CompiledState
    """Final state of the controller that drove the mission."""

    @property
    def duration(self) -> float:
        """Time from the first to the last measurement [s]."""
        return self.measurements[-1].time - self.measurements[0].time

    @property
    def turned(self) -> float:
        """Change of heading from the first to the last measurement [rad]."""
        return self.measurements[-1].yaw - self.measurements[0].yaw


class _RecordingController:
    """Wrapper of a controller that records its inputs."""

    def __init__(self, controller: CompiledController):
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


def full_controller(robot: Robot) -> CompiledController:
    """Make the complete controller of a robot: cascade, fault detection and recovery."""
    return CompiledController(Controller(robot), RobustDetector(robot), Recovery(robot))


def record_mission(robot: Robot, duration: float, faults: tuple[Fault, ...] = ()) -> RecordedMission:
    """Drive the planar robot with all sensors and record the inputs of its controller.

    Args:
      robot: Robot to drive.
      duration: Duration of the mission [s].
      faults: Faults during the mission.
    """
    plant = PlanarRobot(robot, FLOOR, faults=faults, seed=SEED)
    recorder = _RecordingController(full_controller(robot))
    drive(plant, recorder, make_mission(np.random.default_rng(SEED), duration, plant.period))
    return RecordedMission(robot, tuple(recorder.measurements), tuple(recorder.targets), recorder.last)


def replay_mission(
    controller: CompiledController, state: CompiledState, mission: RecordedMission, number: int
) -> CompiledState:
    """Replay a mission as number 0, 1, 2, … of a sequence and return the controller's state after it.

    Time continues, and headings and targets are rotated by the preceding missions. Detector and recovery keep
    their state; the cascade is reset for each mission, since its integrators cannot converge on recorded
    measurements, which do not react to its commands.

    Args:
      controller: Controller that receives the recorded inputs.
      state: Its state before the mission.
      mission: Recorded inputs.
      number: Index of the mission in the sequence.
    """
    count = len(mission.measurements)
    offset = number * mission.duration * count / (count - 1)  # one period between two missions
    turned = number * mission.turned
    c, s = math.cos(turned), math.sin(turned)
    turn = np.array([[c, -s], [s, c]])
    for k, (m, t) in enumerate(zip(mission.measurements, mission.targets, strict=True)):
        yaw = (m.yaw + turned) % (2.0 * math.pi)
        measured = Measurement(m.time + offset, m.current, m.wheel_speed, m.acceleration, m.yaw_rate, yaw)
        if k == 0:
            state = controller.reset_cascade(state, measured)
        target = Target(turn @ t.velocity, t.yaw_rate, t.heading + turned)
        _, state = controller.step(state, measured, target)
    return state


def step_times(mission: RecordedMission) -> np.ndarray:
    """Measure each control step of a replayed mission, from measurement to command, shape (k,) [s]."""
    controller = full_controller(mission.robot)
    state = controller.start(mission.measurements[0])
    times = np.empty(len(mission.measurements))
    for k, (measurement, target) in enumerate(zip(mission.measurements, mission.targets, strict=True)):
        begin = time.perf_counter()
        _, state = controller.step(state, measurement, target)
        times[k] = time.perf_counter() - begin
    return times


@dataclass(frozen=True)
class MemoryGrowth:
    """Growth of memory use over many control steps."""

    seconds: float
    """Robot time between the two measurements of memory [s]."""
    grown: float
    """Growth between the two measurements [kB]."""
    diagnoses: int
    """Number of diagnoses at the end."""

    @property
    def per_hour(self) -> float:
        """Growth per hour of robot time [kB]."""
        return self.grown * HOUR / self.seconds


def memory_growth(
    mission: RecordedMission,
    passes: int,
    longest: float = float("inf"),
    memory: Callable[[], float] | None = None,
) -> MemoryGrowth:
    """Replay a mission repeatedly with one controller and measure the growth of memory.

    Each of the up to `verdict.HISTORY_LENGTH` stored diagnoses takes 0.2 kB; without faults, memory must not
    grow.

    Args:
      mission: Mission that begins and ends without a fault.
      passes: Number of replays, after `WARM_UP_MISSIONS` uncounted ones.
      longest: Wall time [s] after which no further replay begins.
      memory: Function that returns memory use [kB]; None counts the allocations of Python and numpy, and
        those that numba has freed itself until another one takes their place: warming up fills most of them.
    """
    measure = _allocated_memory if memory is None else memory
    if memory is None:
        tracemalloc.start()
    try:
        controller = full_controller(mission.robot)
        state = controller.start(mission.measurements[0])
        for number in range(WARM_UP_MISSIONS):
            state = replay_mission(controller, state, mission, number)
        before, done, begin = measure(), 0, time.perf_counter()
        while done < passes and (done == 0 or time.perf_counter() - begin < longest):
            state = replay_mission(controller, state, mission, WARM_UP_MISSIONS + done)
            done += 1
        return MemoryGrowth(done * mission.duration, measure() - before, len(state.diagnoses))
    finally:
        if memory is None:
            tracemalloc.stop()


def _allocated_memory() -> float:
    """Return the memory allocated by Python and numpy [kB], rounded since measuring allocates as well."""
    gc.collect()
    return float(round(tracemalloc.get_traced_memory()[0] / _KB))


def resident_memory() -> float:
    """Return the anonymous memory of this process, native code included [kB]; Linux only."""
    gc.collect()
    (line,) = (line for line in _PAGES.read_text().splitlines() if line.startswith("Anonymous:"))
    return float(line.split()[1])


def measure_control(rounds: int, duration: float, hours: float, longest: float) -> dict[str, float]:
    """Measure the time of a control step [µs] and the growth of memory per hour [kB].

    Args:
      rounds: Number of timed replays; the median over them is taken for each step, which excludes other
        load on the machine.
      duration: Duration of the mission [s].
      hours: Robot time over which memory is measured [h].
      longest: Limit on the wall time of the memory measurement [s].
    """
    robot = read_robot()
    faulty = record_mission(robot, duration, SLIP_AND_WEAK_MOTOR)
    times = 1e6 * np.median([step_times(faulty) for _ in range(rounds)], axis=0)
    healthy, passes = record_mission(robot, duration), max(1, round(hours * HOUR / duration))
    growth = memory_growth(healthy, passes, 0.5 * longest)
    found = {
        "control_step_median_us": float(np.median(times)),
        "control_step_p999_us": float(np.quantile(times, 0.999)),
        "control_growth_kb_per_hour": growth.per_hour,
        "control_growth_hours": growth.seconds / HOUR,
    }
    if _PAGES.exists():
        found["control_pages_kb_per_hour"] = memory_growth(
            healthy, passes, 0.5 * longest, resident_memory
        ).per_hour
    return found


def measure_logs(duration: float) -> dict[str, float]:
    """Measure the diagnosis of a recorded mission without faults.

    Args:
      duration: Duration of the mission [s].

    Returns:
      `log_hours_per_minute`: hours of log that one core diagnoses in a minute of its time.
    """
    robot = read_robot()
    plant = PlanarRobot(robot, FLOOR, seed=SEED)
    reference = make_mission(np.random.default_rng(SEED), duration, plant.period)
    trace = drive(plant, full_controller(robot), reference)
    wheels = len(robot.wheels)
    names = ("time", *robot_channels(wheels), *(f"current_target_{i}" for i in range(1, wheels + 1)))
    columns = {name: trace[name] for name in names}
    run = Run("mission", columns, {}, {"floor": FLOOR})
    dataset = Dataset(Path(), "uto_robot", (run,))
    config = DiagnosisConfig(dataset, read_machine(dataset), "robust", read_floors())
    list(diagnose(config))  # compiles the kernels
    start = time.process_time()
    list(diagnose(config))
    return {"log_hours_per_minute": (duration / 3600.0) / ((time.process_time() - start) / 60.0)}
