"""The published method on the test rig: section 5.2."""

from __future__ import annotations

import dataclasses
import math
from dataclasses import dataclass

import numpy as np

from omnimj.control.cascade.heading import REST_WHEEL_SPEED
from omnimj.control.detection.detector import DetectorOptions
from omnimj.control.detection.published import rig_residuals
from omnimj.control.detection.published.decision import MOTOR, SLIP, PublishedThresholds, isolate_rig_fault
from omnimj.control.detection.published.residuals import bounded_time_step, matching_lags
from omnimj.parameters import Floor, Rig
from omnimj.physics import rig as physics_rig
from omnimj.physics.effect_terms import zero_terms
from omnimj.physics.motor import driven_by_measured_current, motor_parameters
from omnimj.physics.rig import rig_parameters
from omnimj.physics.wheel import packed
from omnimj.signals import Array, Diagnosis, RigMeasurement

_MODES = {None: 0, SLIP: 1, MOTOR: 2}


@dataclass(frozen=True, slots=True)
class PublishedRigState:
    """State of the detector between two steps."""

    time: float
    """Time of the last good measurement [s]."""
    observer: Array
    """A row of `rig_residuals`."""
    log: Array
    """Aligned with `PublishedRig.log_names`."""
    diagnoses: tuple[Diagnosis, ...] = ()
    fault: str | None = None
    """`slip`, `motor` or none: the last row of Table 5.1; a motor's stays."""

    @property
    def reconfiguration(self) -> None:
        """None: the rig's currents are given."""
        return

    @property
    def fault_estimate(self) -> None:
        """None: nothing is recovered."""
        return


class PublishedRigDetector:
    """Table 5.1 beside a test with given currents.

    Args:
      rig: Nominal rig; effects of its model file are left out.
      floor: Nominal floor.
      mass: m_T that it was loaded to [kg]; the first of the rig's masses when None.
      thresholds: Thresholds of the residuals.
      choice: Variant, printed or repaired.
    """

    log_names = (
        "residual_wheel_speed",
        "residual_force",
        "threshold_wheel_speed",
        "threshold_force",
        "mode",
    )

    def __init__(
        self,
        rig: Rig,
        floor: Floor,
        mass: float | None,
        thresholds: PublishedThresholds,
        choice: DetectorOptions,
    ):
        motor = np.array(driven_by_measured_current(motor_parameters(rig.motor)))
        lags = matching_lags(rig.sensors)
        machine = packed(rig_parameters(rig, mass)), motor, floor.row, zero_terms()[0]
        self._numbers = machine, lags, choice.printed
        self._thresholds, self._most_current = thresholds, rig.sensors.current_monitor_range

    def start(self, measurement: RigMeasurement) -> PublishedRigState:
        """State before the first step of a rig at rest."""
        time = measurement.time if math.isfinite(measurement.time) else 0.0
        return PublishedRigState(time, rig_residuals.initial_observer(), np.zeros(len(self.log_names)))

    def begin(self, measurement: RigMeasurement, bias: float = 0.0) -> PublishedRigState:
        """State of a rig that may already be moving.

        Args:
          measurement: The first, good.
          bias: Not used.
        """
        state = self.start(measurement)
        if abs(measurement.wheel_speed) <= REST_WHEEL_SPEED:
            return state
        observer = state.observer.copy()
        moving = physics_rig.RigState(*observer[: physics_rig.STATE].tolist())._replace(
            speed=measurement.carriage_speed,
            wheel_speed=measurement.wheel_speed,
            current=measurement.current,
        )
        observer[: physics_rig.STATE], observer[rig_residuals.BEFORE] = moving, measurement.wheel_speed
        return dataclasses.replace(state, observer=observer)

    def resume(
        self, state: PublishedRigState, measurement: RigMeasurement, bias: float, is_long: bool
    ) -> PublishedRigState:
        """State after a gap: the next step bridges a short one; after a long one the detector starts anew."""
        return self.begin(measurement) if is_long else state

    def cannot_judge(self, state: PublishedRigState) -> bool:
        """Always False: the published method judges every measurement."""
        return False

    def step(
        self,
        state: PublishedRigState,
        measurement: RigMeasurement,
        command: Array | None = None,
        bias: float = 0.0,
    ) -> PublishedRigState:
        """State after a measurement; one that is not good changes nothing.

        Args:
          state: State before it.
          measurement: Newest measurement.
          command: Command of the period before it, shape (1,) [A]; not used.
          bias: Not used.
        """
        m = measurement
        numbers = (m.current, m.wheel_speed, m.carriage_speed, m.carriage_acceleration, m.lateral_speed)
        # beyond any machine: squares of it must still be numbers
        if not all(abs(number) < 1e6 for number in numbers) or not math.isfinite(m.time):
            return state
        passed = bounded_time_step(state.time, m.time)
        observer = state.observer.copy()
        current = min(max(m.current, -self._most_current), self._most_current)
        rig_residuals.update_observer(observer, (current, *numbers[1:]), passed, *self._numbers)
        return self._judge(dataclasses.replace(state, time=m.time, observer=observer))

    def _judge(self, state: PublishedRigState) -> PublishedRigState:
        """Figs. 5.3 and 5.10; what is more than slip ends it, and a motor stays faulty."""
        limits = self._thresholds
        speed, force = float(state.observer[rig_residuals.R1]), float(state.observer[rig_residuals.R2])
        found = isolate_rig_fault(speed > limits.rig_wheel_speed, force > limits.rig_force)
        diagnoses = state.diagnoses
        if state.fault != MOTOR and found != state.fault:
            if state.fault == SLIP:
                diagnoses = (*diagnoses[:-1], dataclasses.replace(diagnoses[-1], cleared=state.time))
            if found is not None:
                diagnoses = (*diagnoses, Diagnosis(state.time, found, (1,), 1.0))
        fault = MOTOR if state.fault == MOTOR else found
        log = np.array([speed, force, limits.rig_wheel_speed, limits.rig_force, _MODES[fault]])
        return dataclasses.replace(state, log=log, diagnoses=diagnoses, fault=fault)
