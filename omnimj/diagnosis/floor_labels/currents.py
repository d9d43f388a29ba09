"""Currents that a robot needs in steady driving whose wheels stand on different floors.

Drag under one wheel is borne by the motors of all: along its drive by its own, across it by those of its
neighbours. The currents of every assignment of floors to wheels follow from the balance of all forces.
"""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from omnimj.effects import AppliedEffects, apply_effects
from omnimj.errors import InputError
from omnimj.parameters import Floor, Robot
from omnimj.physics.equilibrium import steady_rows
from omnimj.physics.kinematics import rolling_matrix
from omnimj.physics.motor import driven_by_measured_current, motor_parameters
from omnimj.physics.planar import PlanarModel, planar_constants
from omnimj.physics.wheel import packed
from omnimj.signals import Array

Labels = NDArray[np.int_]
"""Index of the floor under each wheel, shape (..., n)."""
MOST_ASSIGNMENTS = 256
"""Largest number of assignments of floors to wheels."""
_SLIP = 0.85  # body speed over that of rolling, as a first guess


@dataclass(frozen=True)
class FloorPlan:
    """A robot and the floors on which its wheels may stand."""

    robot: Robot
    floors: tuple[Floor, ...]

    def __post_init__(self) -> None:
        """Refuse one floor only, the same twice, and too many assignments.

        Raises:
          InputError: A rule is broken.
        """
        names = [floor.name for floor in self.floors]
        if len(names) < 2 or len(set(names)) < len(names):
            raise InputError("--floor-labels", f"found {', '.join(names)}", "two or more floors are needed")
        count = len(names) ** self.robot.wheel_count
        if count > MOST_ASSIGNMENTS:
            found = f"found {len(names)} floors for {self.robot.wheel_count} wheels"
            rule = f"at most {MOST_ASSIGNMENTS} assignments can be compared"
            raise InputError("--floor-labels", found, rule)

    @property
    def assignments(self) -> Labels:
        """All assignments of floors to wheels, shape (assignments, n)."""
        floors = range(len(self.floors))
        return np.array(list(itertools.product(floors, repeat=self.robot.wheel_count)))

    def index(self, labels: Sequence[int]) -> int:
        """Index of an assignment among `assignments`."""
        found = 0
        for label in labels:
            found = found * len(self.floors) + label
        return found

    def all_on(self, floor: str) -> int:
        """Index of the assignment with all wheels on one floor."""
        names = [one.name for one in self.floors]
        return self.index([names.index(floor)] * self.robot.wheel_count)


def mixed_model(changed: AppliedEffects, floors: Sequence[Floor]) -> PlanarModel:
    """Planar model of a robot whose wheels stand on different floors."""
    robot = changed.machine
    made = planar_constants(
        robot, changed.misalignment, changed.radius_scale, 1.0, changed.payload, changed.slope
    )
    motors = changed.motors([motor_parameters(robot.motor)] * robot.wheel_count)
    return PlanarModel(
        made.body,
        made.wheels,
        np.array([packed(driven_by_measured_current(motor)) for motor in motors]),
        np.array([changed.floor(floor).row for floor in floors]),
        changed.terms,
        False,
    )


def expected_currents(plan: FloorPlan, wheel_speed: Array) -> Array:
    """Currents of every assignment at measured wheel speeds, by `physics.equilibrium.steady_rows`.

    Args:
      plan: Robot and floors.
      wheel_speed: φ̇ in each window, shape (windows, n) [rad/s].

    Returns:
      Shape (assignments, windows, n) [A].
    """
    robot = plan.robot
    changed = apply_effects(robot)
    inverse = np.linalg.pinv(rolling_matrix(robot.wheel_positions, robot.rolling_directions))
    guess = _SLIP * robot.wheel.radius * wheel_speed @ inverse.T
    found = np.empty((len(plan.assignments), *wheel_speed.shape))
    for k, labels in enumerate(plan.assignments):
        rows = np.hstack([guess, np.zeros_like(wheel_speed)])
        model = mixed_model(changed, [plan.floors[label] for label in labels])
        steady_rows(model, wheel_speed, np.zeros(0), rows)
        found[k] = rows[:, 3:]
    return found
