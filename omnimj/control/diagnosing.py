"""The cascade with a diagnosing method beside it: first what has happened, then what to do."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from omnimj.control.controller import Controller, ControlState
from omnimj.control.gyro_bias import BIAS
from omnimj.control.method import Method, MethodState
from omnimj.control.recovery import Recovery, RecoveryState
from omnimj.control.target import Target
from omnimj.signals import Array, CurrentCommand, Diagnosis, Measurement


@dataclass(frozen=True, slots=True)
class DiagnosingState:
    """Of cascade, method and recovery."""

    control: ControlState
    method: MethodState
    recovery: RecoveryState | None

    @property
    def log(self) -> Array:
        """Numbers of the last step, aligned with `DiagnosingController.log_names`."""
        if self.recovery is None:
            return np.concatenate((self.control.log, self.method.log))
        return np.concatenate((self.control.log, self.method.log, self.recovery.log))

    @property
    def pace(self) -> float:
        """How fast the plan is to run, 1: as planned."""
        return 1.0 if self.recovery is None else self.recovery.pace

    @property
    def diagnoses(self) -> tuple[Diagnosis, ...]:
        """Everything decided since the start."""
        return self.method.diagnoses


class DiagnosingController:
    """A controller like `Controller`, which believes its method about what is broken.

    Args:
      cascade: Does the driving.
      method: Does the thinking.
      recovery: Does something about it, for a method that says what it believes; None: the method's own
        advice.
    """

    def __init__(self, cascade: Controller, method: Method, recovery: Recovery | None = None):
        self._cascade, self._method, self._recovery = cascade, method, recovery
        added = () if recovery is None else recovery.log_names
        self.log_names = cascade.log_names + tuple(method.log_names) + added

    def start(self, measurement: Measurement) -> DiagnosingState:
        """The state before the first step."""
        recovery = None if self._recovery is None else self._recovery.start()
        return DiagnosingState(self._cascade.start(measurement), self._method.start(measurement), recovery)

    def step(
        self, state: DiagnosingState, measurement: Measurement, target: Target
    ) -> tuple[CurrentCommand, DiagnosingState]:
        """Currents for the next period."""
        control = state.control
        bias = float(control.rest[BIAS])
        asked = _asked(control.current, state.recovery, measurement)
        method: Any = self._method.step(state.method, measurement, asked, bias)
        recovery, advice, beliefs = state.recovery, method.advice, method.beliefs
        if self._recovery is not None and recovery is not None and beliefs is not None:
            if self._cascade.is_good(measurement):  # from any other no current follows
                turning = self._cascade.turning(measurement, control, beliefs.trusts_gyro)
                recovery = self._recovery.step(
                    recovery, beliefs, measurement, control.heading, turning, target
                )
                target = recovery.target
            advice = recovery.advice
        command, control = self._cascade.step(control, measurement, target, advice)
        return command, DiagnosingState(control, method, recovery)


def _asked(current: Array, recovery: RecoveryState | None, measurement: Measurement) -> Array:
    """Set currents of the last period; what a shorted motor drives through itself is as good as asked for."""
    if recovery is None or recovery.advice is None or not recovery.advice.brake:
        return current
    asked, own = current.copy(), measurement.current
    for wheel in recovery.advice.brake:
        if wheel <= len(own):
            asked[wheel - 1] = own[wheel - 1]
    return asked
