"""The robust detector, `method = "robust"`: samples, evidence block by block, decisions, accommodation."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from omnimj.control.cascade.heading import REST_WHEEL_SPEED
from omnimj.control.detection.detector import FaultEstimate
from omnimj.control.detection.robust.blocks import (
    Sample,
    initial_samples,
    sampling_parameters,
    take_sample,
)
from omnimj.control.detection.robust.evidence import (
    Evidence,
    initial_evidence,
    robust_parameters,
    roll_velocities,
)
from omnimj.control.detection.robust.judgement import (
    BLIND,
    Decisions,
    decide_block,
    initial_judgement,
    judge_block,
    log_names,
)
from omnimj.control.detection.robust.parameter_filter import significant_losses
from omnimj.control.detection.robust.thresholds import Thresholds
from omnimj.control.detection.robust.verdict import all_diagnoses
from omnimj.control.expected_floor import largest_drag
from omnimj.control.gains import ObserverGains
from omnimj.control.records import Record, copied, opened, packed, plain_array
from omnimj.parameters import Floor, Robot
from omnimj.physics.native import kernel
from omnimj.signals import Array, Diagnosis, Measurement, compiled_in, robot_channels


class Statistics(NamedTuple):
    """Test statistics of the last block, to be compared with the thresholds of the same names."""

    motor: float
    """Largest Λ of a loss of torque constant [nats]."""
    drag: float
    """Largest Λ of an added friction [nats]."""
    accelerometer: float
    """Largest Λ of a jump of the accelerometer's bias [nats]."""
    slip: float
    """Longest way slipped beyond the allowed creep [m]."""
    worn: float
    """Largest significant loss of torque constant that was learnt [1]."""


class RobustState(NamedTuple):
    """State of the robust detector between two steps."""

    samples: Record
    """Packed `Samples`."""
    memory: Record
    """Packed `Evidence`."""
    judged: Record
    """Packed `Judgement`."""
    decisions: Decisions
    fault_estimate: FaultEstimate | None = None
    """None before the first block."""

    @property
    def evidence(self) -> Evidence:
        """Evidence of the force channel and the slip channel, views into the record."""
        return opened(self.memory, Evidence)

    @property
    def reconfiguration(self) -> None:
        """Always None: recovery acts upon the fault estimate."""
        return

    @property
    def diagnoses(self) -> tuple[Diagnosis, ...]:
        """Everything decided since the start, but for what `verdict.HISTORY_LENGTH` drops."""
        return all_diagnoses(self.decisions.verdict, self.decisions.history)

    @property
    def log(self) -> Array:
        """Signals of the last block, aligned with `RobustDetector.log_names`."""
        return self.judged["log"][0]

    @property
    def blocks(self) -> int:
        """Blocks judged so far."""
        return int(self.judged["blocks"][0])

    @property
    def statistics(self) -> Statistics:
        """Test statistics of the last block."""
        evidence = self.evidence
        n = len(evidence.force)
        likelihood = evidence.scores.likelihood
        return Statistics(
            float(likelihood[:n].max()),
            float(likelihood[n : 2 * n].max()),
            float(likelihood[2 * n :].max()),
            float(evidence.monitors.slipped.max()),
            float(significant_losses(evidence.theta, evidence.cov, n).max()),
        )


class RobustDetector:
    """Robust detector for a robot with n wheels.

    Args:
      robot: Nominal robot.
      period: Control period [s]; that of the robot's sensors when None.
      thresholds: Values from which a suspicion becomes a decision; as shipped when None.
      gains: Of the observer; as shipped when None.
      floor: Floor that the controller expects, whose creep and drag no healthy wheel is blamed for; None:
        nothing is known of it.
    """

    def __init__(
        self,
        robot: Robot,
        period: float | None = None,
        thresholds: Thresholds | None = None,
        gains: ObserverGains | None = None,
        floor: Floor | None = None,
    ):
        self.period = 1.0 / robot.sensors.sample_rate if period is None else period
        n = self.wheels = len(robot.wheels)
        self.robot, self.thresholds = robot, Thresholds() if thresholds is None else thresholds
        if floor is not None:
            self.thresholds = self.thresholds._replace(bias=largest_drag(robot, floor) / robot.body.mass)
        self.constants = robust_parameters(robot, self.period, self.thresholds, gains, floor)
        self.sampling = sampling_parameters(robot, self.period)
        self.packed_sampling, self.packed_constants = packed(self.sampling), packed(self.constants)
        self.channels = robot_channels(n)[:-1]
        self.log_names = log_names(n)

    def start(self, measurement: Measurement) -> RobustState:
        """State of a robot that is healthy and at rest."""
        n = self.wheels
        judged = packed(initial_judgement(n, self.thresholds))
        return RobustState(packed(initial_samples(n)), packed(initial_evidence(n)), judged, Decisions())

    def begin(self, measurement: Measurement, bias: float = 0.0) -> RobustState:
        """State of a healthy robot that may already be moving: its velocity by the wheels.

        Args:
          measurement: The first, good.
          bias: Reading of the gyro at rest [rad/s].
        """
        state = self.start(measurement)
        if np.abs(measurement.wheel_speed).max() > REST_WHEEL_SPEED:
            rolling, turning = measurement.wheel_speed, float(measurement.yaw_rate - bias)
            included = np.ones(self.wheels, bool)
            _roll_velocities(self.constants.robot, rolling, turning, included, state.memory)
        return state

    def resume(self, state: RobustState, measurement: Measurement, bias: float, is_long: bool) -> RobustState:
        """State before the first measurement after a gap: the same, since its time tells of the gap."""
        return state

    def cannot_judge(self, state: RobustState) -> bool:
        """True if the robot moves too slowly for the last block to reveal anything about its motors."""
        return bool(state.log[-1] == BLIND)

    @compiled_in("recorded")
    def step(
        self, state: RobustState, measurement: Measurement, command: Array | None = None, bias: float = 0.0
    ) -> RobustState:
        """State after a good measurement.

        Args:
          state: From the step before.
          measurement: The newest, checked by `is_good`.
          command: Set currents of the period that it ends, shape (n,) [A]; None: unknown.
          bias: Reading of the gyro at rest [rad/s].
        """
        m, known = measurement, command is not None
        command = m.current if command is None else command
        arrays = plain_array(m.current), plain_array(m.wheel_speed), plain_array(m.acceleration)
        sample = Sample(float(m.time), *arrays, float(m.yaw_rate), float(bias), known, plain_array(command))
        samples = copied(state.samples)
        if _take_sample(self.packed_sampling, samples, sample):
            return self._judge(state, samples, m)
        return RobustState(samples, *state[1:])

    def _judge(self, state: RobustState, samples: Record, measurement: Measurement) -> RobustState:
        """State after a full block."""
        evidence, judged, decisions = copied(state.memory), copied(state.judged), state.decisions
        time = float(measurement.time)
        if _judge_block(self.packed_constants, samples, evidence, judged, float(measurement.yaw), time):
            decisions = decide_block(self.thresholds, evidence, judged, decisions, time, self.channels)
        estimate = FaultEstimate.unpack(judged["estimate"])
        return RobustState(samples, evidence, judged, decisions, estimate)


@kernel
def _take_sample(parameters, samples, sample):
    return take_sample(parameters[0], samples[0], sample)


@kernel
def _judge_block(parameters, samples, evidence, judged, yaw, time):
    return judge_block(parameters[0], samples[0], evidence[0], judged[0], yaw, time)


@kernel
def _roll_velocities(robot, wheel_speed, yaw_rate, included, evidence):
    roll_velocities(robot, wheel_speed, yaw_rate, included, opened(evidence[0], Evidence))
