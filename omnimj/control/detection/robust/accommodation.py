"""Accommodation of diagnosed faults: weights of the observers, resets after a decision, the fault
estimate."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from omnimj.control.detection.detector import FaultEstimate
from omnimj.control.detection.robust.blocks import Block
from omnimj.control.detection.robust.evidence import Evidence, RobustParameters
from omnimj.control.detection.robust.glr import FILLED, JumpScores
from omnimj.control.detection.robust.thresholds import Thresholds
from omnimj.control.detection.robust.verdict import Verdict, is_stalled
from omnimj.signals import Array, Diagnosis

_DEAD = 0.9  # loss from which a motor counts as dead
_DETECTED, _LEARNT = 0.2, 0.1  # standard deviation of a loss just after it was detected, or learnt
_PART_FRICTION, _PART_LOSS = 1.5, 0.05  # deviation of friction beside a loss, and of a loss beside friction
_RATHER = 2.0  # [nats] by which friction must be more likely than a loss


class Accommodation(NamedTuple):
    """Consequences of the active diagnoses for the observers, n wheels."""

    included: NDArray[np.bool_]
    """Mask of the wheels used by the velocity estimate, shape (n,)."""
    unknown_force: NDArray[np.bool_]
    """Mask of the wheels whose traction does not follow from motor and speed, shape (n,)."""
    excluded_axes: NDArray[np.bool_]
    """Axes x, y whose accelerometer has failed, shape (2,)."""
    degraded: NDArray[np.bool_]
    """Mask of the motors that are known to be degraded, shape (n,)."""
    losses: Array
    """Diagnosed losses of the torque constants, shape (n,) [1]: θ holds the rest."""
    relearning: bool
    """True if a new loss is still being measured: blocks are learnt from at once."""


def accommodation_for(verdict: Verdict, losses: Array, relearning: bool) -> Accommodation:
    """Consequences of a verdict for the observers.

    Args:
      verdict: Active diagnoses.
      losses: Diagnosed losses of the torque constants, shape (n,).
      relearning: Whether a new loss is still being measured; the velocity estimate excludes its wheel
        meanwhile.
    """
    n = len(losses)
    included, unknown, degraded = np.ones(n, bool), np.zeros(n, bool), np.zeros(n, bool)
    for d in verdict.diagnoses:
        if d.cleared is not None:
            continue
        wheels = [w - 1 for w in d.wheels]
        if d.kind == "motor":
            degraded[wheels] = True
        if d.kind == "all_wheel_slip":
            included[:] = False
        elif d.kind in ("slip", "locked", "sensor") or (d.kind == "motor" and relearning):
            included[wheels] = False
        if d.kind == "locked" or d.channel.startswith("wheel_speed") or is_stalled(d):
            unknown[wheels] = True
    axes = np.array([verdict.has_sensor_fault(f"acceleration_{axis}") for axis in "xy"])
    return Accommodation(included, unknown, axes, degraded, losses, relearning)


def substitute_sensors(
    parameters: RobustParameters, block: Block, evidence: Evidence, verdict: Verdict
) -> Block:
    """Replace the channels of failed speed sensors and of a failed gyro by the other sensors' estimate."""
    if not any(d.cleared is None and d.kind == "sensor" for d in verdict.diagnoses):
        return block
    n, forces, velocity = len(block.wheel_speed), parameters.robot.forces, evidence.velocity[-1]
    for i in range(n):
        if verdict.has_sensor_fault(f"wheel_speed_{i + 1}"):
            rolling = forces[0, i] * velocity[0] + forces[1, i] * velocity[1]
            rolling += forces[2, i] * block.yaw_rate
            block.wheel_speed[i], block.wheel_acceleration[i] = rolling / parameters.robot.radius, 0.0
    if verdict.has_sensor_fault("yaw_rate"):
        block = block._replace(
            yaw_rate=float(parameters.turn @ block.wheel_speed),
            yaw_acceleration=float(parameters.turn @ block.wheel_acceleration),
        )
    return block


def estimate_faults(evidence: Evidence, verdict: Verdict, losses: Array) -> FaultEstimate:
    """Fault estimate from the active diagnoses, except those that may be on another wheel.

    Args:
      evidence: Velocity and forces.
      verdict: Active diagnoses.
      losses: Estimated losses of the torque constants, shape (n,).
    """
    n = len(losses)
    lost, decided, force = np.zeros(n), -math.inf, evidence.force.copy()
    dead, runaway, held, slipping = (np.zeros(n, bool) for _ in range(4))
    for d in verdict.diagnoses:
        decided = max(decided, d.time)
        if d.cleared is not None or (d.ambiguous_with and not is_stalled(d)):
            continue
        wheels = [w - 1 for w in d.wheels]
        if is_stalled(d):
            dead[wheels], force[wheels] = True, 0.0
        elif d.kind == "motor":
            lost[wheels] = losses[wheels]
            dead[wheels] = losses[wheels] > _DEAD
        elif d.kind == "free":
            dead[wheels] = True
        elif d.kind == "hard_over":
            runaway[wheels] = True
        elif d.kind == "locked":
            held[wheels] = True
        elif d.kind == "slip":
            slipping[wheels] = True
        elif d.kind == "all_wheel_slip":
            slipping[:] = True
    velocity, gyro = evidence.velocity[n, :2].copy(), not verdict.has_sensor_fault("yaw_rate")
    return FaultEstimate(lost, dead, runaway, held, slipping, velocity, force, decided, gyro)


def accommodate(
    evidence: Evidence, thresholds: Thresholds, before: Verdict, after: Verdict, losses: Array
) -> Array:
    """Reset the evidence after a decision, in place, and take new losses into the motors' laws.

    The velocity is reset too when a slip of all wheels ends: it drifted through it.

    Args:
      evidence: After the block; changed in place.
      thresholds: A loss that was detected, not learnt, has exceeded them.
      before: Verdict before the block.
      after: Verdict after it.
      losses: Diagnosed losses until now, shape (n,).

    Returns:
      Diagnosed losses, shape (n,): the same array where no motor was diagnosed.
    """
    if _all_slip(before) and not _all_slip(after):
        _reset_velocity(evidence)
    decided = _new_diagnoses(before, after)
    if not decided:
        return losses
    scores = JumpScores(*(scores.copy() for scores in evidence.scores))
    evidence.history.cursor[FILLED] = 0
    for own in evidence.scores:
        own[:] = 0.0
    if any(d.kind == "motor" for d in decided):
        losses = losses.copy()
    for d in decided:
        if d.kind == "motor" and not is_stalled(d):
            _reset_motor(d, evidence, thresholds, scores, losses)
        elif d.kind == "sensor":  # the failed sensor has misled the velocity
            _reset_velocity(evidence)
    return losses


def _new_diagnoses(before: Verdict, after: Verdict) -> tuple[Diagnosis, ...]:
    """Decisions of this block: new diagnoses, and a degraded motor whose loss has jumped again."""
    again = after.active_on(after.renewed, ("motor",))
    return (*after.diagnoses[len(before.diagnoses) :], *([again] if again is not None else []))


def _all_slip(verdict: Verdict) -> bool:
    return any(d.kind == "all_wheel_slip" and d.cleared is None for d in verdict.diagnoses)


def _reset_velocity(evidence: Evidence) -> None:
    evidence.velocity_cov[:] = np.eye(evidence.velocity_cov.shape[1])
    evidence.monitors.slipped[:] = 0.0


def _reset_motor(
    motor: Diagnosis, evidence: Evidence, thresholds: Thresholds, scores: JumpScores, losses: Array
) -> None:
    """Restart the estimate of a motor's loss or friction from its jump, in place."""
    if motor.effectiveness is None:
        return
    i, j = motor.wheels[0] - 1, motor.wheels[0] - 1 + len(losses)
    if scores.likelihood[j] > scores.likelihood[i] + _RATHER:  # something brakes the wheel
        evidence.theta[j] += scores.size[j]
        _reset_variance(evidence.cov, j, 0.5 * scores.size[j] + _PART_FRICTION)
        evidence.cov[i, i] += _PART_LOSS**2
        return
    losses[i] = 1.0 - motor.effectiveness - evidence.theta[i]
    detected = scores.likelihood[[i, j]].max() >= min(thresholds.motor, thresholds.drag)
    _reset_variance(evidence.cov, i, _DETECTED if detected else _LEARNT)
    evidence.cov[j, j] += _PART_FRICTION**2


def _reset_variance(cov: Array, j: int, deviation: float) -> None:
    """Restart parameter j of θ with a standard deviation and no correlation, in place."""
    cov[j, :], cov[:, j] = 0.0, 0.0
    cov[j, j] = deviation * deviation
