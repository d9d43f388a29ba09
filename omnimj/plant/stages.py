"""Parts common to the simulated plants, and stages of a planar run.

The conditions of a planar run change at few times and are constant in between.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any, Protocol

from omnimj.effects import AppliedEffects
from omnimj.parameters import Rig, Robot
from omnimj.plant.faults import Conditions, Fault, conditions_at, conditions_with_effects, event_times
from omnimj.signals import Array

TIME_TOLERANCE = 1e-9
"""Time by which a time accumulated over steps may fall short of an event [s]."""


def timeline(
    machine: Robot | Rig, faults: Sequence[Fault], effects: AppliedEffects, measured_current: bool
) -> list[tuple[float, Conditions]]:
    """List the conditions of a run, each with the time from which it holds [s].

    Args:
      machine: Machine with its nominal constants.
      faults: Faults of the run.
      effects: Effects of the machine.
      measured_current: Whether commands are measured currents, exempt from limits and current loop.
    """
    found = []
    for begin in (0.0, *event_times(faults)):
        by_faults = conditions_at(faults, begin, machine.motor, machine.wheel_count)
        found.append((begin, conditions_with_effects(by_faults, effects, measured_current)))
    return found


class Stage(Protocol):
    """Constants of the equations while the conditions stay constant."""

    @property
    def begin(self) -> float:
        """Time of the beginning [s]."""
        ...


class KernelPlant:
    """Simulated plant whose kernels read and change a tuple of arrays."""

    period: float
    """Control period [s]."""
    _arrays: Any
    """Arrays of the plant, with `steps`, the control periods since the start, shape (1,), integer."""
    _sensors: Any
    """`RigSensors` or `RobotSensors`."""

    def arrays(self) -> Any:
        """Arrays for kernels that step the plant in a loop, once `prepare_step` has been called."""
        return self._arrays

    def close(self) -> None:
        """Do nothing: there is nothing to release."""

    def _measured(self, readings: Array) -> Any:
        """Readings now as `Measurement` or `RigMeasurement`."""
        return self._sensors.as_measurement(int(self._arrays.steps[0]) * self.period, readings)


class StagedPlant(KernelPlant):
    """Planar plant whose conditions change from stage to stage."""

    _stages: Sequence[Stage]
    _at: int
    """Present stage."""
    _steps: Array
    """Control periods since the start, shape (1,), integer."""

    @property
    def next_change(self) -> float:
        """Time from which `prepare_step` has conditions to change [s]."""
        later = self._at + 1
        return self._stages[later].begin - TIME_TOLERANCE if later < len(self._stages) else math.inf

    def prepare_step(self) -> None:
        """Apply the conditions that begin with the coming period, and keep the sensors' noise coming."""
        while int(self._steps[0]) * self.period >= self.next_change:
            self._enter(self._at + 1)
        self._sensors.refill()

    def _enter(self, stage: int) -> None:
        """Begin a stage."""
        raise NotImplementedError
