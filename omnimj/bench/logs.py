"""Speed of the diagnosis of recorded runs."""

from __future__ import annotations

import time
from pathlib import Path

import numpy as np

from omnimj.bench.control import FLOOR, SEED, full_controller
from omnimj.diagnosis.logs import read_machine
from omnimj.diagnosis.replay import DiagnosisConfig, diagnose
from omnimj.parameters import read_floors, read_robot
from omnimj.plant.planar import PlanarRobot
from omnimj.recording.dataset import Dataset, Run
from omnimj.signals import robot_channels
from omnimj.simulate.driving import drive
from omnimj.simulate.suites.missions import mission


def measure_logs(duration: float) -> dict[str, float]:
    """Measure the diagnosis of a recorded mission without faults.

    Args:
      duration: Duration of the mission [s].

    Returns:
      `log_hours_per_minute`: hours of log that one core diagnoses in a minute of its time.
    """
    robot = read_robot()
    plant = PlanarRobot(robot, FLOOR, seed=SEED)
    trace = drive(plant, full_controller(robot), mission(np.random.default_rng(SEED), duration, plant.period))
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
