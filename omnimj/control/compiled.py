"""The cascade, with the robust detector and recovery where there are any, as one compiled step.

Does what a `FaultTolerantController` of the same parts does, at a fraction of its cost: the whole state is
one record, one call of a kernel takes it from measurement to command, and only the rare decisions of the
detector are made in Python. The compiled loop (`simulate.compiled_loop`) calls the same kernels.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from omnimj.control.cascade.controller import (
    CascadeInput,
    CascadeParameters,
    CascadeState,
    Controller,
    Reconfiguration,
    advance_cascade,
    is_good_sample,
)
from omnimj.control.cascade.heading import yaw_rate_by_wheels
from omnimj.control.detection.detector import FaultEstimate
from omnimj.control.detection.robust.blocks import (
    Sample,
    Samples,
    SamplingParameters,
    initial_samples,
    take_sample,
)
from omnimj.control.detection.robust.detector import RobustDetector
from omnimj.control.detection.robust.evidence import Evidence, initial_evidence
from omnimj.control.detection.robust.judgement import (
    Decisions,
    Judgement,
    decide_block,
    initial_judgement,
    judge_block,
)
from omnimj.control.detection.robust.verdict import all_diagnoses
from omnimj.control.records import Record, copied, opened, packed, plain_array
from omnimj.control.recovery.recovery import Recovery, shorted_wheels, write_log
from omnimj.control.recovery.step import (
    Demand,
    RecoveryFields,
    RecoveryInput,
    RecoveryParameters,
    advance_recovery,
)
from omnimj.physics.native import kernel
from omnimj.signals import Array, CurrentCommand, Diagnosis, Measurement, Target, compiled_in

RECOVERY_LOG = len(Recovery.log_names)
"""Number of signals that recovery logs."""


class ControlParameters(NamedTuple):
    """Constants of cascade, sampling and recovery."""

    cascade: CascadeParameters
    nominal: Reconfiguration
    """Without a fault."""
    sampling: SamplingParameters
    recovery: RecoveryParameters
    detects: bool
    """False: the cascade alone."""
    recovers: bool
    """False: faults are diagnosed only."""


class ControlFields(NamedTuple):
    """Fields of the record behind `CompiledState`."""

    cascade: CascadeState
    samples: Samples
    judged: Judgement
    recovery: RecoveryFields
    log: Array
    """Signals of the last step by `CompiledController.log_names`, shape (signals,)."""


class Reading(NamedTuple):
    """Measurement and target of one step as the kernels take them."""

    time: float
    """[s]"""
    current: Array
    """Shape (n,) [A]."""
    wheel_speed: Array
    """Shape (n,) [rad/s]."""
    acceleration: Array
    """Shape (2,) [m/s²]."""
    yaw_rate: float
    """Gyro [rad/s]."""
    yaw: float
    """Heading converter [rad]."""
    demand: Demand


@kernel
def take_reading(p, x, now):
    """Take a measurement into the detector's block.

    Args:
      p: `ControlParameters`.
      x: `ControlFields`, changed in place.
      now: `Reading`.

    Returns:
      Whether the measurement is good, and whether the block is full and has to be judged before `respond`.
    """
    n, last = p.cascade.turn.size, x.cascade.current
    good = is_good_sample(n, now.time, now.current, now.wheel_speed, now.acceleration, now.yaw_rate, now.yaw)
    if not good:
        return False, False
    if not p.detects:
        return True, False
    command = last.copy()
    if p.recovers:
        for i in range(n):
            if x.recovery.brake[i]:  # a shorted motor has no set current
                command[i] = now.current[i]
    bias = x.cascade.gyro_bias.bias
    sample = Sample(
        now.time, now.current, now.wheel_speed, now.acceleration, now.yaw_rate, bias, True, command
    )
    return True, take_sample(p.sampling, x.samples, sample)


@kernel
def respond(p, x, now, good):
    """Recovery and cascade after the detector, in place; fills the log.

    Args:
      p: `ControlParameters`.
      x: `ControlFields`, changed in place.
      now: `Reading`.
      good: From `take_reading`.

    Returns:
      Whether any motor is shorted.
    """
    demand, n = now.demand, p.cascade.turn.size
    v_x, v_y, turn, heading = demand.velocity_x, demand.velocity_y, demand.yaw_rate, demand.heading
    judged = p.recovers and x.judged.blocks > 0
    if judged and good:
        yaw_rate = now.yaw_rate - x.cascade.gyro_bias.bias
        if not x.judged.estimate.trusts_gyro:
            yaw_rate = yaw_rate_by_wheels(p.cascade.turn, now.wheel_speed)
        moved = RecoveryInput(now.time, now.wheel_speed, x.cascade.heading, yaw_rate, demand)
        advance_recovery(p.recovery, x.judged.estimate, moved, x.recovery)
        changed = x.recovery.demand
        v_x, v_y, turn, heading = changed.velocity_x, changed.velocity_y, changed.yaw_rate, changed.heading
    wanted = CascadeInput(good, now.wheel_speed, now.yaw_rate, now.yaw, v_x, v_y, turn, heading)
    if judged:
        advance_cascade(p.cascade, x.recovery.reconfiguration, x.cascade, wanted)
    else:
        advance_cascade(p.cascade, p.nominal, x.cascade, wanted)
    own = 5 + 2 * n
    x.log[:own] = x.cascade.log
    if p.detects:
        x.log[own : own + x.judged.log.size] = x.judged.log
    if p.recovers:
        write_log(x.recovery, x.log[x.log.size - RECOVERY_LOG :])
    return p.recovers and x.recovery.brake.any()


_DRIVES, _BRAKES, _BLOCK_IS_FULL, _DECISION_IS_DUE = range(4)  # outcomes of a step or of a part of it


@kernel
def _step(parameters, record, now, is_judged):
    """Step, unless a block is full and not judged yet. Returns an outcome."""
    good, full = (True, False) if is_judged else take_reading(parameters[0], record[0], now)
    if full:
        return _BLOCK_IS_FULL
    return _BRAKES if respond(parameters[0], record[0], now, good) else _DRIVES


@kernel
def _judge_and_end(parameters, constants, record, evidence, now):
    """Judge the full block and end the step, unless a decision is due first. Returns an outcome."""
    x = record[0]
    if judge_block(constants[0], x.samples, evidence[0], x.judged, now.yaw, now.time):
        return _DECISION_IS_DUE
    return _BRAKES if respond(parameters[0], x, now, True) else _DRIVES


class CompiledState(NamedTuple):
    """State of a `CompiledController` between two steps."""

    record: Record
    """Packed `ControlFields`."""
    memory: Record
    """Packed `Evidence`."""
    decisions: Decisions
    estimate: FaultEstimate
    """Estimate that the mode of recovery answers to."""
    signals: int
    """Number of logged signals."""

    @property
    def evidence(self) -> Evidence:
        """Evidence of the force channel and the slip channel, views into the record."""
        return opened(self.memory, Evidence)

    @property
    def log(self) -> Array:
        """Signals of the last step by `CompiledController.log_names`, shape (signals,)."""
        return self.record["log"][0][: self.signals]

    @property
    def time_scaling(self) -> float:
        """Speed of the plan, 1: as planned."""
        return float(self.record["recovery"]["time_scaling"][0])

    @property
    def diagnoses(self) -> tuple[Diagnosis, ...]:
        """Everything decided since the start."""
        return all_diagnoses(self.decisions.verdict, self.decisions.history)


class CompiledController:
    """Controller that detects faults and, with recovery, reconfigures itself; used like `Controller`.

    Args:
      cascade: Drives the robot.
      detector: Robust detector of the same robot and control period; none when None.
      recovery: Acts upon the detector's fault estimate; none when None.
    """

    def __init__(
        self, cascade: Controller, detector: RobustDetector | None = None, recovery: Recovery | None = None
    ):
        robot = cascade.robot
        # records of one shape for all combinations: the kernels are compiled once
        self._cascade, self._recovery = cascade, Recovery(robot) if recovery is None else recovery
        self._detector = RobustDetector(robot, cascade.period) if detector is None else detector
        names = cascade.log_names + tuple(self._detector.log_names) + Recovery.log_names
        self._signals = len(names)
        parts = (
            () if detector is None else self._detector.log_names,
            () if recovery is None else Recovery.log_names,
        )
        self.log_names = (*cascade.log_names, *parts[0], *parts[1])
        self.wheels, self.constants = cascade.wheels, self._detector.packed_constants
        self.parameters = packed(
            ControlParameters(
                cascade.constants,
                cascade.nominal,
                self._detector.sampling,
                self._recovery.constants,
                detector is not None,
                recovery is not None,
            )
        )

    @property
    def detects(self) -> bool:
        """False without a detector: no decision is ever due."""
        return bool(self.parameters["detects"][0])

    def start(self, measurement: Measurement) -> CompiledState:
        """State before the first step."""
        n, judgement = self.wheels, initial_judgement(self.wheels, self._detector.thresholds)
        fields = ControlFields(
            self._cascade.initial_fields(measurement),
            initial_samples(n),
            judgement,
            self._recovery.initial_fields(),
            np.zeros(self._signals),
        )
        return CompiledState(
            packed(fields), packed(initial_evidence(n)), Decisions(), judgement.estimate, len(self.log_names)
        )

    def reset_cascade(self, state: CompiledState, measurement: Measurement) -> CompiledState:
        """State with the cascade as before the first step; detector and recovery keep theirs."""
        record = copied(state.record)
        record["cascade"] = packed(self._cascade.initial_fields(measurement))
        return state._replace(record=record)

    @compiled_in("all")
    def step(
        self, state: CompiledState, measurement: Measurement, target: Target
    ) -> tuple[CurrentCommand, CompiledState]:
        """Currents for the next period; zero current for bad data, never an exception."""
        m, velocity, record = measurement, target.velocity, copied(state.record)
        demand = Demand(float(velocity[0]), float(velocity[1]), float(target.yaw_rate), float(target.heading))
        arrays = plain_array(m.current), plain_array(m.wheel_speed), plain_array(m.acceleration)
        now = Reading(float(m.time), *arrays, float(m.yaw_rate), float(m.yaw), demand)
        after = CompiledState(record, *state[1:])
        outcome = _step(self.parameters, record, now, False)
        if outcome == _BLOCK_IS_FULL:
            after = CompiledState(record, copied(state.memory), *state[2:])
            outcome = _judge_and_end(self.parameters, self.constants, record, after.memory, now)
            if outcome == _DECISION_IS_DUE:
                after = self.decide(after, m.time)
                outcome = _step(self.parameters, record, now, True)
        brake = shorted_wheels(record["recovery"]["brake"][0]) if outcome == _BRAKES else ()
        return CurrentCommand(record["cascade"]["current"][0], brake), after

    def decide(self, state: CompiledState, time: float) -> CompiledState:
        """State after the decisions that a block may lead to; its record and evidence change in place.

        Args:
          state: After `judge_block`.
          time: End of the block [s].
        """
        detector, judged = self._detector, state.record["judged"]
        decisions = decide_block(
            detector.thresholds, state.memory, judged, state.decisions, float(time), detector.channels
        )
        estimate = FaultEstimate.unpack(judged["estimate"])
        if not estimate.same_faults_as(state.estimate):
            self._recovery.choose_mode(state.record["recovery"], estimate)
        return state._replace(decisions=decisions, estimate=estimate)
