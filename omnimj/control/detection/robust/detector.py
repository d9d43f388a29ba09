"""`method = "robust"`: evidence block by block, decisions, and what recovery makes of them."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from omnimj.control.cascade.controller import is_good
from omnimj.control.cascade.heading import yaw_rate_row
from omnimj.control.cascade.wheel_speed import amplifier_row
from omnimj.control.detection.detector import FaultEstimate
from omnimj.control.detection.robust.accommodation import (
    accommodate,
    degraded_motors,
    estimate_faults,
    excluded_axes,
    included_wheels,
    unknown_forces,
)
from omnimj.control.detection.robust.blocks import (
    Samples,
    alignment_delays,
    broken_channels,
    channel_ranges,
    initial_samples,
    take_block,
    take_sample,
)
from omnimj.control.detection.robust.decision import decide
from omnimj.control.detection.robust.evidence import (
    Evidence,
    compare_yaw_rates,
    initial_evidence,
    update_evidence,
)
from omnimj.control.detection.robust.glr import LIKELIHOOD
from omnimj.control.detection.robust.parameter_filter import (
    FAULTY_FRICTION_VARIES,
    FAULTY_LOSS_VARIES,
    FAULTY_LOSS_WALK,
    prior_deviation,
    short_term_deviation,
)
from omnimj.control.detection.robust.thresholds import Thresholds, Verdict
from omnimj.control.detection.robust.verdict import all_diagnoses, archive_cleared
from omnimj.control.detection.robust.wheel_monitors import SLIPPING
from omnimj.control.gains import ObserverGains
from omnimj.control.robot_constants import RADIUS, robot_constants, samples_per_block, wheel_geometry
from omnimj.parameters import Robot
from omnimj.signals import Array, Diagnosis, Measurement

HEALTHY, SUSPECT, FAULTY, BLIND = range(4)
"""`mode` of the log: nothing is wrong, a decision is pending, something is diagnosed, cannot judge."""

_RELEARNING_BLOCKS = 200  # [blocks]


@dataclass(frozen=True, slots=True)
class RobustState:
    """What the method carries from one step to the next."""

    samples: Samples
    """Of the block that is not full yet."""
    evidence: Evidence
    verdict: Verdict
    accepted: Array
    """Diagnosed losses of the torque constants, shape (n,)."""
    fresh: int
    """Blocks for which a new loss is still being measured: they are learnt from at once."""
    fault_estimate: FaultEstimate | None
    log: Array
    past: tuple[Diagnosis, ...] = ()
    """Taken back and out of the verdict."""

    @property
    def reconfiguration(self) -> None:
        """None: recovery acts upon the beliefs."""
        return

    @property
    def diagnoses(self) -> tuple[Diagnosis, ...]:
        """Everything decided since the start, but for what `verdict.HISTORY_LENGTH` leaves out."""
        return all_diagnoses(self.verdict, self.past)


def _with_samples(state: RobustState, samples: Samples) -> RobustState:
    """`dataclasses.replace`, which takes longer than all that is computed for a sample."""
    s = state
    return RobustState(samples, s.evidence, s.verdict, s.accepted, s.fresh, s.fault_estimate, s.log, s.past)


class RobustDetector:
    """The method for a robot with n wheels.

    Args:
      robot: What the controller believes the robot to be.
      period: Control period [s]; that of the robot's sensors when None.
      thresholds: When a suspicion becomes a decision.
      gains: What its observer weighs with; as shipped when None.
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
        own = ObserverGains() if gains is None else gains
        shape = wheel_geometry(robot)
        self._per_block = samples_per_block(self.period)
        self._block = self._per_block * self.period
        walk = prior_deviation(n) ** 2 * (self._block / own.memory)
        low = np.array([0.03] * n + [0.3] * n + [-5.0] * 2)
        high = np.array([1.0] * n + [40.0] * n + [5.0] * 2)
        self._constants = (
            robot_constants(robot, self.period, own),
            shape.forces,
            shape.across,
            walk,
            short_term_deviation(n) ** 2,
            low,
            high,
        )
        self._amplifier, self._turn = amplifier_row(robot), yaw_rate_row(robot)
        each = [f"{name}_{i}" for name in ("current", "wheel_speed") for i in range(1, n + 1)]
        self._waits, self._ranges = alignment_delays(robot, self.period), channel_ranges(robot)
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
        """A robot that is taken to be healthy and at rest."""
        n = self.wheels
        log = np.zeros(len(self.log_names))
        log[3 + n : 3 + 2 * n], log[3 + 3 * n : 3 + 4 * n] = self.thresholds.motor, self.thresholds.slip
        log[3 + 4 * n : 3 + 5 * n] = 1.0
        return RobustState(
            initial_samples(n),
            initial_evidence(n),
            Verdict(),
            np.zeros(n),
            0,
            None,
            log,
        )

    def step(
        self, state: RobustState, measurement: Measurement, command: Array | None = None, bias: float = 0.0
    ) -> RobustState:
        """The state after a measurement; one that is not good changes nothing.

        Args:
          state: From the step before.
          measurement: The newest.
          command: Set currents of the period that it ends, shape (n,) [A]; None where nobody knows.
          bias: Of the gyro [rad/s].
        """
        m = measurement
        if not is_good(self.wheels, m.time, m.current, m.wheel_speed, m.acceleration, m.yaw_rate, m.yaw):
            return state
        before, first = state.samples, math.isnan(state.evidence.heading[0])
        *arrays, now, full = take_sample(
            self._waits, self._ranges, self._amplifier, self._per_block,
            before.sums, before.line, before.repeats, before.wanted, first,
            m.current, m.wheel_speed, m.acceleration, m.yaw_rate, bias,
            command is not None, before.wanted if command is None else command,
        )  # fmt: skip
        samples = Samples(*arrays)
        return self._judge(state, samples, m, now) if full else _with_samples(state, samples)

    def _judge(
        self,
        state: RobustState,
        samples: Samples,
        measurement: Measurement,
        now: Array,
    ) -> RobustState:
        n = self.wheels
        block = np.empty(3 * n + 4)
        take_block(samples.sums, self._block, now[n : 2 * n], now[2 * n + 2], block)
        evidence = state.evidence.copy()
        self._mend(block, evidence, state.verdict)
        c, forces, across, walk, loose, low, high = self._constants
        weak = degraded_motors(state.verdict, n)
        if weak.any():
            walk, loose, low = self._of_broken(weak, walk, loose, low)
        moving = update_evidence(
            c, forces, across, walk, loose, low, high,
            block[:n], block[n : 2 * n], block[2 * n : 2 * n + 2], block[2 * n + 2],
            block[2 * n + 3 : 3 * n + 3], block[3 * n + 3], block[:n] + samples.wanted / self._per_block,
            included_wheels(state.verdict, n, state.fresh), unknown_forces(state.verdict, n),
            excluded_axes(state.verdict), weak, state.accepted, state.fresh > 0,
            evidence.ring, evidence.cursor, evidence.recent, evidence.theta, evidence.cov, evidence.velocity,
            evidence.spread, evidence.counters, evidence.found, evidence.force, evidence.rho,
            evidence.misfit,
        )  # fmt: skip
        speed = block[n : 2 * n]
        compare_yaw_rates(evidence.heading, self._turn, self._block, measurement.yaw, speed, block[2 * n + 2])
        broken = broken_channels(samples.repeats, speed)
        dead = tuple(c for c, lies in zip(self._channels, broken.tolist(), strict=True) if lies)
        losses = state.accepted + evidence.theta[:n]
        verdict = decide(
            evidence, self.thresholds, state.verdict, float(measurement.time), losses, dead, state.fresh > 0
        )
        found = evidence.found.copy()
        accepted = accommodate(evidence, self.thresholds, state.verdict, verdict, state.accepted)
        fresh = _RELEARNING_BLOCKS if accepted is not state.accepted else max(state.fresh - int(moving), 0)
        fault_estimate = estimate_faults(evidence, verdict, accepted + evidence.theta[:n])
        log = self._log(evidence, found, verdict, accepted, fault_estimate, moving)
        samples.wanted[:] = 0.0  # like the sums, of the next block
        verdict, past = archive_cleared(verdict, state.past, float(measurement.time))
        return RobustState(samples, evidence, verdict, accepted, fresh, fault_estimate, log, past)

    def _of_broken(self, weak: Array, walk: Array, loose: Array, low: Array) -> tuple[Array, Array, Array]:
        """The three with broken motors: no law of them is known as well as of healthy ones, nor lasts as
        long, and what is lost may also come back."""
        n = self.wheels
        walk, loose, low = walk.copy(), loose.copy(), low.copy()
        walk[:n] += weak * (FAULTY_LOSS_WALK**2 * self._block / 60.0)
        loose[:n] += weak * FAULTY_LOSS_VARIES**2
        loose[n : 2 * n] += weak * FAULTY_FRICTION_VARIES**2
        low[:n][weak > 0.0] = -1.0
        return walk, loose, low

    def _mend(self, block: Array, evidence: Evidence, verdict: Verdict) -> None:
        """Puts what the other sensors say in the place of one that lies, in place."""
        n = self.wheels
        if not any(d.cleared is None and d.kind == "sensor" for d in verdict.diagnoses):
            return
        velocity, forces = evidence.velocity[n], self._constants[1]
        for i in range(n):
            if verdict.has_sensor_fault(f"wheel_speed_{i + 1}"):
                rolling = forces[0, i] * velocity[0] + forces[1, i] * velocity[1]
                rolling += forces[2, i] * block[2 * n + 2]
                block[n + i], block[2 * n + 3 + i] = rolling / self._constants[0][RADIUS], 0.0
        if verdict.has_sensor_fault("yaw_rate"):
            block[2 * n + 2] = self._turn @ block[n : 2 * n]
            block[3 * n + 3] = self._turn @ block[2 * n + 3 : 3 * n + 3]

    def _log(
        self,
        evidence: Evidence,
        found: Array,
        verdict: Verdict,
        accepted: Array,
        fault_estimate: FaultEstimate,
        moving: bool,
    ) -> Array:
        left = np.minimum(np.maximum(1.0 - accepted - evidence.theta[: self.wheels], 0.0), 1.0)
        left[fault_estimate.dead | fault_estimate.held] = 0.0
        n = self.wheels
        standing = any(d.cleared is None for d in verdict.diagnoses)
        pending = not math.isnan(verdict.suspected)
        mode = FAULTY if standing else SUSPECT if pending else HEALTHY if moving else BLIND
        likelihood = np.maximum(found[:n, LIKELIHOOD], found[n : 2 * n, LIKELIHOOD])
        return np.concatenate(
            (
                evidence.rho,
                likelihood,
                self._limits[0],
                evidence.counters[:, SLIPPING],
                self._limits[1],
                left,
                [float(mode)],
            )
        )
