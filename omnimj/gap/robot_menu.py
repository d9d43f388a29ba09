"""Runs that a user can make with the robot, to be told which of them would split two rivals."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from omnimj.gap.replay import Experiment
from omnimj.gap.robot_runs import STEP
from omnimj.parameters import Robot
from omnimj.physics.kinematics import rolling_matrix
from omnimj.signals import Array

_PAYLOAD = 2.0
"""Mass that a user can weigh and put on the middle [kg]."""
_SECONDS = 6.0
_LEGS = 1.5  # [s] of driving, coasting, driving back, coasting
_CURRENTS = {"slow": 0.3, "fast": 0.7}
"""Amplitude at the wheels that drive [A]."""
_MOVES = {
    "ahead": ("straight ahead and back", (1.0, 0.0, 0.0)),
    "left": ("sideways to and fro", (0.0, 1.0, 0.0)),
    "diagonal": ("diagonally to and fro", (1.0, 1.0, 0.0)),
    "spin": ("turning on the spot, both ways", (0.0, 0.0, 0.5)),  # light: it soon turns fast
    "arc": ("ahead and back in a curve", (1.0, 0.0, 0.5)),
}


def robot_menu(floors: tuple[str, ...]) -> tuple[Experiment, ...]:
    """Moves × speeds × with and without a known mass on the robot × floors."""
    found = []
    for floor in dict.fromkeys((*floors, "natural_stone")):
        for move, (words, _) in _MOVES.items():
            for pace, current in _CURRENTS.items():
                for added in (0.0, _PAYLOAD):
                    text = f"{words}, {pace} ({current:g} A at most), on {floor.replace('_', ' ')}"
                    text += f", {added:g} kg put on" if added else ""
                    run = {"move": move, "current": current, "added_mass": added, "floor": floor}
                    name = f"{move}_{pace}_{added:g}_{floor}"
                    found.append(Experiment(name, text, run | {"duration": _SECONDS}))
    return tuple(found)


def menu_currents(robot: Robot, experiment: Experiment) -> Array:
    """Currents of such a run, shape (steps, 4) [A]: on, off, on the other way, off."""
    direction = np.array(_MOVES[str(experiment.run["move"])][1])
    rolling = rolling_matrix(robot.wheel_positions, robot.drive_directions)
    per_wheel = rolling @ (direction / np.array([1.0, 1.0, np.hypot(*robot.wheel_positions[0])]))
    per_wheel /= max(1.0, abs(per_wheel).max())
    leg: NDArray[np.int_] = (np.arange(round(_SECONDS / STEP)) * STEP / _LEGS).astype(int)
    size = np.array([1.0, 0.0, -1.0, 0.0])[np.minimum(leg, 3)]
    return float(experiment.run["current"]) * size[:, None] * per_wheel[None, :]
