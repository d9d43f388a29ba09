"""The loop that drives a robot for as long as somebody asks for motion."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np

from omnimj.control.heading import wrapped
from omnimj.control.target import Target
from omnimj.errors import OmnimjError
from omnimj.loop import Controller, fill_row, row_names
from omnimj.plant.interface import Plant
from omnimj.signals import Diagnosis, Measurement
from omnimj.stepping import SNAPSHOT_PERIOD, Rows, Snapshot, check_truth

ASKED_NAMES = ("target_heading", "target_velocity_x", "target_velocity_y")
"""Columns of what was asked for, world frame: rad, m/s, m/s."""
HEADING = "heading_estimate"
"""Column of the controller's log that says how the robot is turned."""

_BLOCK = 100  # rows that are handed on together


class Asks(Protocol):
    """Who asks for motion: `Operator`."""

    def target(self, heading: float, pace: float) -> Target | None:
        """The target of the coming control period; None to end.

        Args:
          heading: Of the robot, as the controller believes [rad].
          pace: Share of the demand that recovery allows, 0…1.
        """
        ...


@dataclass(frozen=True)
class Driven:
    """How it ended; the rows went to those who look on."""

    steps: int
    interrupted: bool
    """By Ctrl-C."""
    failure: str | None
    """When and how the plant failed."""
    diagnoses: tuple[Diagnosis, ...]
    """Everything decided since the start."""


@dataclass(frozen=True)
class Onlookers:
    """Who looks on while the robot is driven; nothing is kept here."""

    rows: tuple[Rows, ...] = ()
    """Each is called with the columns' names and the newest rows, which it may not keep."""
    snapshot: Snapshot | None = None
    before_step: Callable[[], object] | None = None
    """Called before every step of the plant, to hold a simulation to the wall clock."""
    diagnosed: Callable[[tuple[Diagnosis, ...]], object] | None = None
    """Called when what is believed has changed."""


_NOBODY = Onlookers()


def drive_by_hand(plant: Plant, controller: Controller, asks: Asks, watch: Onlookers = _NOBODY) -> Driven:
    """Drives a robot until nobody asks any more, or Ctrl-C, or the plant fails.

    A failure is a value, as in `loop.drive`: what was recorded is not lost, the outermost call raises.

    Args:
      plant: Reset by this call; the caller closes it, and with that stops a real robot.
      controller: Gets measurements and targets, never the truth.
      asks: For every step's target.
      watch: Gets the rows.
    """
    measurement: Any = plant.reset()
    assert isinstance(measurement, Measurement)
    state = controller.start(measurement)
    own = row_names(len(measurement.current), controller.log_names)
    names = (*own, *plant.truth_names, *ASKED_NAMES)
    at = controller.log_names.index(HEADING)
    block = np.empty((_BLOCK, len(names)))
    heading = wrapped(measurement.yaw) if math.isfinite(measurement.yaw) else 0.0
    pose, each = getattr(plant, "pose", None), max(1, round(SNAPSHOT_PERIOD / plant.period))
    steps, interrupted, failure, known = 0, False, None, ()
    try:
        while (target := asks.target(heading, state.pace)) is not None:
            command, state = controller.step(state, measurement, target)
            heading = float(state.log[at])
            row, truth = block[steps % _BLOCK], plant.truth()
            fill_row(row, measurement, command, state.log)
            row[len(own) : len(own) + len(truth)] = truth
            row[-3:] = target.heading, *target.velocity
            check_truth(plant.truth_names, truth.tolist())
            if watch.snapshot is not None and pose is not None and steps % each == 0:
                watch.snapshot(measurement.time, pose())
            steps += 1
            if steps % _BLOCK == 0:
                _hand_on(watch, names, block)
            if watch.diagnosed is not None and state.diagnoses is not known:
                known = state.diagnoses
                watch.diagnosed(known)
            if watch.before_step is not None:
                watch.before_step()
            measurement = plant.step(command)
    except KeyboardInterrupt:
        interrupted = True
    except (OmnimjError, ArithmeticError) as error:
        failure = f"after {steps * plant.period:.3f} s: {error}"
    _hand_on(watch, names, block[: steps % _BLOCK])
    return Driven(steps, interrupted, failure, state.diagnoses)


def _hand_on(watch: Onlookers, names: tuple[str, ...], rows: np.ndarray) -> None:
    if len(rows):
        for take in watch.rows:
            take(names, rows)
