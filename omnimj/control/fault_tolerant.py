"""The cascade with a diagnosing method beside it: first what has happened, then what to do."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from omnimj.control.cascade.controller import Controller, ControlState
from omnimj.control.cascade.heading import BIAS
from omnimj.control.detection.detector import DetectorState, FaultDetector
from omnimj.control.recovery import Recovery, RecoveryState
from omnimj.signals import Array, CurrentCommand, Diagnosis, Measurement, Target


@dataclass(frozen=True, slots=True)
class FaultTolerantState:
    """Of cascade, method and recovery."""

    control: ControlState
    method: DetectorState
    recovery: RecoveryState | None

    @property
    def log(self) -> Array:
        """Numbers of the last step, aligned with `DiagnosingController.log_names`."""
        if self.recovery is None:
            return np.concatenate((self.control.log, self.method.log))
        return np.concatenate((self.control.log, self.method.log, self.recovery.log))

    @property
    def time_scaling(self) -> float:
        """How fast the plan is to run, 1: as planned."""
        return 1.0 if self.recovery is None else self.recovery.time_scaling

    @property
    def diagnoses(self) -> tuple[Diagnosis, ...]:
        """Everything decided since the start."""
        return self.method.diagnoses


class FaultTolerantController:
    """A controller like `Controller`, which believes its method about what is broken.

    Args:
      cascade: Does the driving.
      method: Does the thinking.
      recovery: Does something about it, for a method that says what it believes; None: the method's own
        advice.
    """

    def __init__(self, cascade: Controller, method: FaultDetector, recovery: Recovery | None = None):
        self._cascade, self._method, self._recovery = cascade, method, recovery
        added = () if recovery is None else recovery.log_names
        self.log_names = cascade.log_names + tuple(method.log_names) + added

    def start(self, measurement: Measurement) -> FaultTolerantState:
        """The state before the first step."""
        recovery = None if self._recovery is None else self._recovery.start()
        return FaultTolerantState(self._cascade.start(measurement), self._method.start(measurement), recovery)

    def step(
        self, state: FaultTolerantState, measurement: Measurement, target: Target
    ) -> tuple[CurrentCommand, FaultTolerantState]:
        """Currents for the next period."""
        control = state.control
        bias = float(control.rest[BIAS])
        asked = _commanded_current(control.current, state.recovery, measurement)
        method: Any = self._method.step(state.method, measurement, asked, bias)
        recovery, reconfiguration, fault_estimate = (
            state.recovery,
            method.reconfiguration,
            method.fault_estimate,
        )
        if self._recovery is not None and recovery is not None and fault_estimate is not None:
            if self._cascade.is_good(measurement):  # from any other no current follows
                turning = self._cascade.turning(measurement, control, fault_estimate.trusts_gyro)
                recovery = self._recovery.step(
                    recovery, fault_estimate, measurement, control.heading, turning, target
                )
                target = recovery.target
            reconfiguration = recovery.reconfiguration
        command, control = self._cascade.step(control, measurement, target, reconfiguration)
        return command, FaultTolerantState(control, method, recovery)


def _commanded_current(current: Array, recovery: RecoveryState | None, measurement: Measurement) -> Array:
    """Set currents of the last period; what a shorted motor drives through itself is as good as asked for."""
    if recovery is None or recovery.reconfiguration is None or not recovery.reconfiguration.brake:
        return current
    asked, own = current.copy(), measurement.current
    for wheel in recovery.reconfiguration.brake:
        if wheel <= len(own):
            asked[wheel - 1] = own[wheel - 1]
    return asked
