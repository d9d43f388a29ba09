"""Fault-tolerant control: the cascade with a fault detector and a recovery beside it.

In each step the detector takes the measurement first; recovery then turns its fault estimate into a target
and a reconfiguration for the cascade.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from omnimj.control.cascade.controller import Controller, ControlState, is_good
from omnimj.control.detection.detector import DetectorState, FaultDetector
from omnimj.control.recovery import Recovery, RecoveryState
from omnimj.signals import Array, CurrentCommand, Diagnosis, Measurement, Target


class FaultTolerantState(NamedTuple):
    """States of cascade, detector and recovery."""

    control: ControlState
    detector: DetectorState
    recovery: RecoveryState | None

    @property
    def log(self) -> Array:
        """Signals of the last step by `FaultTolerantController.log_names`, shape (len(log_names),)."""
        if self.recovery is None:
            return np.concatenate((self.control.log, self.detector.log))
        return np.concatenate((self.control.log, self.detector.log, self.recovery.log))

    @property
    def time_scaling(self) -> float:
        """Speed of the plan, 1: as planned."""
        return 1.0 if self.recovery is None else self.recovery.time_scaling

    @property
    def diagnoses(self) -> tuple[Diagnosis, ...]:
        """Everything decided since the start."""
        return self.detector.diagnoses


class FaultTolerantController:
    """Controller that detects faults and reconfigures itself; used like `Controller`.

    It takes any detector; with the robust one, `CompiledController` does the same faster.

    Args:
      cascade: Drives the robot.
      detector: Gets every good measurement; its `reconfiguration` is applied where there is no recovery.
      recovery: Acts upon the detector's fault estimate; none when None.
    """

    def __init__(self, cascade: Controller, detector: FaultDetector, recovery: Recovery | None = None):
        self._cascade, self._detector, self._recovery = cascade, detector, recovery
        added = () if recovery is None else recovery.log_names
        self.log_names = cascade.log_names + tuple(detector.log_names) + added

    def start(self, measurement: Measurement) -> FaultTolerantState:
        """State before the first step."""
        recovery = None if self._recovery is None else self._recovery.start()
        return FaultTolerantState(
            self._cascade.start(measurement), self._detector.start(measurement), recovery
        )

    def step(
        self, state: FaultTolerantState, measurement: Measurement, target: Target
    ) -> tuple[CurrentCommand, FaultTolerantState]:
        """Currents for the next period; zero current for bad data, never an exception."""
        control, detected, recovery = state.control, state.detector, state.recovery
        good = is_good(measurement, self._cascade.wheels)
        if good:
            commanded = _commanded_current(control.current, recovery, measurement)
            detected = self._detector.step(detected, measurement, commanded, control.gyro_bias.bias)
        reconfiguration, brake = detected.reconfiguration, ()
        if self._recovery is not None and recovery is not None:
            estimate: Any = detected.fault_estimate
            if estimate is not None and good:
                yaw_rate = self._cascade.yaw_rate(measurement, control, estimate.trusts_gyro)
                recovery = self._recovery.step(
                    recovery, estimate, measurement, control.heading, yaw_rate, target
                )
                target = recovery.target
            if estimate is not None:
                reconfiguration, brake = recovery.reconfiguration, recovery.brake
        command, control = self._cascade.step(control, measurement, target, reconfiguration, good)
        if brake:
            command = CurrentCommand(command.current, brake)
        return command, FaultTolerantState(control, detected, recovery)


def _commanded_current(current: Array, recovery: RecoveryState | None, measurement: Measurement) -> Array:
    """Set currents of the last period; a shorted motor has no set current, so its measured one is taken."""
    if recovery is None or not recovery.brake:
        return current
    commanded = current.copy()
    for wheel in recovery.brake:
        commanded[wheel - 1] = measurement.current[wheel - 1]
    return commanded
