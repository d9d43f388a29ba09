"""The robust detector, `method = "robust"`: samples, evidence block by block, decisions, accommodation."""

from __future__ import annotations

import dataclasses
import math
from typing import NamedTuple

import numpy as np

from omnimj.control.cascade.heading import REST_WHEEL_SPEED
from omnimj.control.detection.detector import FaultEstimate
from omnimj.control.detection.robust.accommodation import (
    accommodate,
    accommodation_for,
    estimate_faults,
    substitute_sensors,
)
from omnimj.control.detection.robust.blocks import (
    Sample,
    failed_channels,
    initial_samples,
    samples_per_block,
    sampling_parameters,
    take_block,
    take_sample,
)
from omnimj.control.detection.robust.decision import decide
from omnimj.control.detection.robust.evidence import (
    Evidence,
    YawComparison,
    compare_yaw_rates,
    initial_evidence,
    robust_parameters,
    update_evidence,
)
from omnimj.control.detection.robust.parameter_filter import significant_losses, with_degraded_motors
from omnimj.control.detection.robust.thresholds import Thresholds
from omnimj.control.detection.robust.verdict import Verdict, all_diagnoses, archive_cleared
from omnimj.control.detection.robust.wheel_monitors import restarted_monitors
from omnimj.control.gains import ObserverGains
from omnimj.control.records import Record
from omnimj.parameters import Robot
from omnimj.signals import Array, Diagnosis, Measurement

HEALTHY, SUSPECT, FAULTY, BLIND = range(4)
"""`mode` of the log: no fault, a decision is pending, a fault is diagnosed, cannot judge."""

_RELEARNING_BLOCKS = 200
_ROLLING_DOUBT = 0.05  # [m/s] standard deviation of a velocity that only wheels measure, which may slip


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
    evidence: Evidence
    verdict: Verdict
    losses: Array
    """Diagnosed losses of the torque constants, shape (n,)."""
    relearning: int
    """Blocks for which a new loss is still being measured: they are learnt from at once."""
    fault_estimate: FaultEstimate | None
    log: Array
    history: tuple[Diagnosis, ...] = ()
    """Withdrawn diagnoses that have left the verdict."""
    blocks: int = 0
    """Blocks judged so far."""

    @property
    def reconfiguration(self) -> None:
        """Always None: recovery acts upon the fault estimate."""
        return

    @property
    def diagnoses(self) -> tuple[Diagnosis, ...]:
        """Everything decided since the start, but for what `verdict.HISTORY_LENGTH` drops."""
        return all_diagnoses(self.verdict, self.history)

    @property
    def statistics(self) -> Statistics:
        """Test statistics of the last block."""
        n, evidence = len(self.losses), self.evidence
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
    """

    def __init__(
        self,
        robot: Robot,
        period: float | None = None,
        thresholds: Thresholds | None = None,
        gains: ObserverGains | None = None,
    ):
        self.period = 1.0 / robot.sensors.sample_rate if period is None else period
        n = self.wheels = len(robot.wheels)
        self.thresholds = Thresholds() if thresholds is None else thresholds
        self._limits = np.full(n, self.thresholds.motor), np.full(n, self.thresholds.slip)
        self._parameters = robust_parameters(robot, self.period, gains)
        self._sampling, self._per_block = (
            sampling_parameters(robot, self.period),
            samples_per_block(self.period),
        )
        each = [f"{name}_{i}" for name in ("current", "wheel_speed") for i in range(1, n + 1)]
        self._channels = (*each, "acceleration_x", "acceleration_y", "yaw_rate")
        names = [
            f"{kind}_{what}_{i}"
            for what in ("motor", "slip")
            for kind in ("residual", "threshold")
            for i in range(1, n + 1)
        ]
        self.log_names = (
            "residual_force_x",
            "residual_force_y",
            "residual_moment",
            *names,
            *(f"effectiveness_{i}" for i in range(1, n + 1)),
            "mode",
        )

    def start(self, measurement: Measurement) -> RobustState:
        """State of a robot that is healthy and at rest."""
        n = self.wheels
        log = np.zeros(len(self.log_names))
        log[3 + n : 3 + 2 * n], log[3 + 3 * n : 3 + 4 * n] = self.thresholds.motor, self.thresholds.slip
        log[3 + 4 * n : 3 + 5 * n] = 1.0
        return RobustState(initial_samples(n), initial_evidence(n), Verdict(), np.zeros(n), 0, None, log)

    def begin(self, measurement: Measurement, bias: float = 0.0) -> RobustState:
        """State of a healthy robot that may already be moving: its velocity by the wheels.

        Args:
          measurement: The first, good.
          bias: Reading of the gyro at rest [rad/s].
        """
        state = self.start(measurement)
        if np.abs(measurement.wheel_speed).max() <= REST_WHEEL_SPEED:
            return state
        return self._rolling(state, measurement, bias)

    def resume(self, state: RobustState, measurement: Measurement, bias: float, is_long: bool) -> RobustState:
        """State after a gap: decisions and learnt parameters stay, since a gap repairs nothing.

        Block, counts of the monitors and velocity start anew, after a long gap the history of blocks too.

        Args:
          state: Before the gap.
          measurement: The first after it, good.
          bias: Reading of the gyro at rest [rad/s].
          is_long: Whether the gap is too long for the history of blocks.
        """
        n = self.wheels
        empty, before = initial_evidence(n), state.evidence
        evidence = before._replace(monitors=restarted_monitors(before.monitors), yaw=YawComparison())
        if is_long:
            history = before.history._replace(cursor=empty.history.cursor)
            evidence = evidence._replace(history=history, scores=empty.scores, recent_row=empty.recent_row)
        verdict = dataclasses.replace(state.verdict, suspected=math.nan)
        state = state._replace(samples=initial_samples(n), evidence=evidence, verdict=verdict)
        return self._rolling(state, measurement, bias)

    def cannot_judge(self, state: RobustState) -> bool:
        """True if the robot moves too slowly for the last block to reveal anything about its motors."""
        return bool(state.log[-1] == BLIND)

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
        sample = Sample(m.current, m.wheel_speed, m.acceleration, m.yaw_rate, bias, known, command)
        first = math.isnan(state.evidence.yaw.yaw)
        samples = take_sample(self._sampling, state.samples, sample, first)
        if samples["number"][0] >= self._per_block:
            return self._judge(state, samples, m)
        s = state
        return RobustState(
            samples,
            s.evidence,
            s.verdict,
            s.losses,
            s.relearning,
            s.fault_estimate,
            s.log,
            s.history,
            s.blocks,
        )

    def _judge(self, state: RobustState, samples: Record, measurement: Measurement) -> RobustState:
        """State after a full block."""
        n, time, parameters = self.wheels, float(measurement.time), self._parameters
        block = take_block(samples, parameters.period)
        evidence, relearning = state.evidence.copy(), state.relearning > 0
        block = substitute_sensors(parameters, block, evidence, state.verdict)
        accommodation = accommodation_for(state.verdict, state.losses, relearning)
        if accommodation.degraded.any():
            model = with_degraded_motors(parameters.model, accommodation.degraded, parameters.period)
            parameters = parameters._replace(model=model)
        moving = update_evidence(parameters, block, accommodation, evidence)
        evidence = evidence._replace(yaw=compare_yaw_rates(evidence.yaw, parameters, block, measurement.yaw))
        frozen = failed_channels(samples["steps"][0], block.wheel_speed)
        failed = tuple(c for c, has_failed in zip(self._channels, frozen.tolist(), strict=True) if has_failed)
        estimated = state.losses + evidence.theta[:n]
        verdict = decide(evidence, self.thresholds, state.verdict, time, estimated, failed, relearning)
        likelihood = np.maximum(evidence.scores.likelihood[:n], evidence.scores.likelihood[n : 2 * n])
        losses = accommodate(evidence, self.thresholds, state.verdict, verdict, state.losses)
        left = _RELEARNING_BLOCKS if losses is not state.losses else max(state.relearning - int(moving), 0)
        estimated = losses + evidence.theta[:n]
        estimate = estimate_faults(evidence, verdict, estimated)
        log = self._log(evidence, likelihood, verdict, estimated, estimate, moving)
        verdict, history = archive_cleared(verdict, state.history, time)
        return RobustState(samples, evidence, verdict, losses, left, estimate, log, history, state.blocks + 1)

    def _rolling(self, state: RobustState, measurement: Measurement, bias: float) -> RobustState:
        """State with the body velocity by the wheels: each filter without its own, none by a diagnosed
        one."""
        robot, n = self._parameters.robot, self.wheels
        directions = robot.forces.T
        rolling = robot.radius * measurement.wheel_speed - directions[:, 2] * (measurement.yaw_rate - bias)
        faulty = {w - 1 for d in state.diagnoses if d.cleared is None for w in d.wheels}
        evidence = state.evidence.copy()
        for q in range(n + 1):
            used = [i for i in range(n) if i != q and i not in faulty]
            if np.linalg.matrix_rank(directions[used, :2]) < 2:
                used = [i for i in range(n) if i != q]
            velocity = np.linalg.lstsq(directions[used, :2], rolling[used], rcond=None)[0]
            evidence.velocity[q, :2] = velocity
            cov = evidence.velocity_cov[q]
            cov[:2, :] = cov[:, :2] = 0.0
            cov[0, 0] = cov[1, 1] = _ROLLING_DOUBT**2
        return state._replace(evidence=evidence)

    def _log(
        self,
        evidence: Evidence,
        likelihood: Array,
        verdict: Verdict,
        losses: Array,
        estimate: FaultEstimate,
        moving: bool,
    ) -> Array:
        left = np.minimum(np.maximum(1.0 - losses, 0.0), 1.0)
        left[estimate.dead | estimate.held] = 0.0
        pending = not math.isnan(verdict.suspected)
        mode = FAULTY if verdict.has_active() else SUSPECT if pending else HEALTHY if moving else BLIND
        return np.concatenate(
            (
                evidence.residual,
                likelihood,
                self._limits[0],
                evidence.monitors.slipped,
                self._limits[1],
                left,
                [float(mode)],
            )
        )
