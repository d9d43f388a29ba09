"""Currents that a robot needs in steady driving whose wheels stand on different floors.

Drag under one wheel is borne by the motors of all: along its drive by its own, across it by those of its
neighbours. The currents of every assignment of floors to wheels follow from the balance of all forces.
Measured ones are means over windows of steady driving.
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
from omnimj.recording.dataset import Run
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


WINDOW = 0.3
"""Length of a window [s]."""
START = 1.0
"""Time after the first motion from which a run is judged [s]: starting currents tell nothing of the floor."""
_AROUND = 1.0  # window of the wheel speeds, whose ticks come in packets [s]
_MOVING = 0.02  # [m/s] at the rim
_TURNS = 0.3  # [rad/s] the gear's friction holds a slower wheel, whose current then tells nothing
_UNSTEADY = 0.25  # change of a wheel's speed between the halves of `_AROUND`, over the fastest wheel's
_FEWEST = 3  # samples of a window


@dataclass(frozen=True)
class Windows:
    """Windows of one run, w of them."""

    time: Array
    """Centres, shape (w,) [s]."""
    wheel_speed: Array
    """Mean wheel speeds about each window, shape (w, n) [rad/s]."""
    current: Array
    """Mean currents; NaN where a wheel stands, or nothing is known, shape (w, n) [A]."""


def steady_windows(run: Run, radius: float, wheels: int) -> Windows:
    """Windows of steady driving of a run; masked samples are left out.

    Args:
      run: Run with wheel speeds and currents.
      radius: Wheel radius r [m].
      wheels: Number of wheels n.
    """
    time = run.time
    speeds = run.unmasked([f"wheel_speed_{i + 1}" for i in range(wheels)])
    currents = run.unmasked([f"current_{i + 1}" for i in range(wheels)])
    moving = np.flatnonzero(radius * np.nan_to_num(np.abs(speeds)).max(axis=1) > _MOVING)
    found: list[tuple[float, Array, Array]] = []
    start = float(time[moving[0]]) + START if len(moving) else np.inf
    for k in range(int(max(time[-1] - start, 0.0) / WINDOW + 0.05)):
        middle = start + (k + 0.5) * WINDOW
        inside = _between(time, middle, WINDOW)
        around = _steady_speed(time, speeds, middle)
        if around is None or radius * np.abs(around).max() < _MOVING:
            continue
        known = np.isfinite(currents[inside]).sum(axis=0) >= _FEWEST
        if not (known & (np.abs(around) > _TURNS)).any():
            continue
        drawn = np.full(wheels, np.nan)
        for i in np.flatnonzero(known & (np.abs(around) > _TURNS)):
            drawn[i] = np.nanmean(currents[inside, i])
        found.append((middle, around, drawn))
    if not found:
        return Windows(np.zeros(0), np.zeros((0, wheels)), np.zeros((0, wheels)))
    times, means, drawn = (np.array(column) for column in zip(*found, strict=True))
    return Windows(times, means, drawn)


def _between(time: Array, middle: float, width: float) -> slice:
    first, last = np.searchsorted(time, [middle - 0.5 * width, middle + 0.5 * width])
    return slice(int(first), int(last))


def _steady_speed(time: Array, speeds: Array, middle: float) -> Array | None:
    """Mean wheel speeds about a time, shape (n,); None if unknown or changing."""
    halves = [speeds[_between(time, middle + side * _AROUND, 0.5 * _AROUND)] for side in (-0.25, 0.25)]
    if any(not np.isfinite(half).any(axis=0).all() if len(half) else True for half in halves):
        return None
    before, after = (np.nanmean(half, axis=0) for half in halves)
    if np.abs(after - before).max() > _UNSTEADY * max(np.abs([before, after]).max(), 1e-9):
        return None
    return 0.5 * (before + after)
