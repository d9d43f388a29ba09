"""Made-up logs of robots whose wheels stand on a hard and a soft floor, by the steady equations."""

from __future__ import annotations

from pathlib import Path
from types import MappingProxyType

import numpy as np

from omnimj.diagnosis.floor_labels.currents import FloorPlan, expected_currents
from omnimj.parameters import Floor, read_robot
from omnimj.physics.kinematics import rolling_matrix
from omnimj.recording.dataset import Dataset, Run

RATE = 32.0
_COMMON = {"V_s": 1.96, "sigma_0": 11.5, "sigma_1": 0.08, "mu_c": 3.1, "mu_s": 3.1}
NUMBERS = {
    "soft": {
        "sigma_2": 0.3,
        "turnover": 18.0,
        "rolling_resistance": 0.11,
        "roller_resistance": 0.198,
    },
    "hard": {"sigma_2": 0.1, "turnover": 1.0, "rolling_resistance": 0.01, "roller_resistance": 0.01},
}


def floor(name):
    numbers = MappingProxyType({**_COMMON, **NUMBERS[name]})
    return Floor(name, f"a {name} floor", "lugre", "made up", numbers)


def plan(model="robotino"):
    return FloorPlan(read_robot(model), (floor("soft"), floor("hard")))


def floors_toml():
    """Both floors as a file for `--floors`."""
    head = 'description = "made up"\nlaw = "lugre"\nsource = "made up"\n'
    tables = []
    for name in NUMBERS:
        values = "".join(f"{key} = {value}\n" for key, value in floor(name).numbers.items())
        tables.append(f"[{name}]\n{head}{values}")
    return "\n".join(tables)


def log(made, name, direction, labels, seed=0, error=0.02, conditions=None, speed=0.15):
    """Run at constant wheel speeds; `labels` are (time from which it holds, floor under each wheel) in order.

    The currents have white noise and, for each wheel, a constant error of the model.
    """
    rng, robot = np.random.default_rng(seed), made.robot
    aim = speed * np.array([np.cos(direction), np.sin(direction), 0.0])
    speeds = rolling_matrix(robot.wheel_positions, robot.rolling_directions) @ aim / robot.wheel.radius
    needed = expected_currents(made, speeds[None])[:, 0]
    time = np.arange(0.0, 14.0, 1.0 / RATE)
    currents = np.empty((len(time), robot.wheel_count))
    for begin, own in labels:
        currents[time >= begin] = needed[made.index(own)]
    currents += error * rng.normal(size=robot.wheel_count) + rng.normal(0.0, 0.1, currents.shape)
    columns = {"time": time, "x": 0.0 * time, "y": 0.0 * time, "heading": 0.0 * time}
    for i in range(robot.wheel_count):
        columns[f"wheel_speed_{i + 1}"] = speeds[i] + rng.normal(0.0, 0.05, len(time))
        columns[f"current_{i + 1}"] = currents[:, i]
    return Run(name, MappingProxyType(columns), MappingProxyType({}), MappingProxyType(conditions or {}))


def one_floor_logs(made, first=0, many=6):
    """Runs on one floor each, in several directions."""
    runs = []
    for k in range(many):
        for index, one in enumerate(made.floors):
            seed = 100 * first + 10 * k + index
            labels = [(0.0, (index,) * made.robot.wheel_count)]
            direction = 0.3 + first + 2.0 * np.pi * k / many
            conditions = {"floor": one.name}
            runs.append(log(made, f"{one.name}_{first}_{k}", direction, labels, seed, conditions=conditions))
    return dataset(made, runs)


def dataset(made, runs):
    return Dataset(Path("made"), "uto_robot", tuple(runs), (), made.robot.wheel_count, True)
