"""The cascade with a diagnosing method beside it: first what has happened, then what to do."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from omnimj.control.controller import Controller, ControlState
from omnimj.control.gyro_bias import BIAS
from omnimj.control.method import Method, MethodState
from omnimj.control.target import Target
from omnimj.signals import Array, CurrentCommand, Diagnosis, Measurement


@dataclass(frozen=True, slots=True)
class DiagnosingState:
    """Of cascade and method."""

    control: ControlState
    method: MethodState

    @property
    def log(self) -> Array:
        """Numbers of the last step, aligned with `DiagnosingController.log_names`."""
        return np.concatenate((self.control.log, self.method.log))

    @property
    def diagnoses(self) -> tuple[Diagnosis, ...]:
        """Everything decided since the start."""
        return self.method.diagnoses


class DiagnosingController:
    """A controller like `Controller`, which believes its method about what is broken.

    Args:
      cascade: Does the driving.
      method: Does the thinking.
    """

    def __init__(self, cascade: Controller, method: Method):
        self._cascade, self._method = cascade, method
        self.log_names = cascade.log_names + tuple(method.log_names)

    def start(self, measurement: Measurement) -> DiagnosingState:
        """The state before the first step."""
        return DiagnosingState(self._cascade.start(measurement), self._method.start(measurement))

    def step(
        self, state: DiagnosingState, measurement: Measurement, target: Target
    ) -> tuple[CurrentCommand, DiagnosingState]:
        """Currents for the next period."""
        control = state.control
        bias = float(control.rest[BIAS])
        method: Any = self._method.step(state.method, measurement, control.current, bias)
        command, control = self._cascade.step(control, measurement, target, method.advice)
        return command, DiagnosingState(control, method)
