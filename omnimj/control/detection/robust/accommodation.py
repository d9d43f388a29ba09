"""Accommodation of diagnosed faults: weights of the observers, resets, and the fault estimate."""

from __future__ import annotations

import math
from collections.abc import Iterable
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from omnimj.control.cascade.heading import yaw_rate_by_wheels
from omnimj.control.detection.robust.blocks import Block
from omnimj.control.detection.robust.evidence import Evidence
from omnimj.control.detection.robust.glr import FILLED, JumpScores, is_friction
from omnimj.control.detection.robust.thresholds import Thresholds
from omnimj.control.detection.robust.verdict import Verdict, is_stalled
from omnimj.physics.native import kernel
from omnimj.signals import Array, Diagnosis

DEAD = 0.9
"""Loss from which a motor counts as dead."""
_DETECTED, _LEARNT = 0.2, 0.1  # standard deviation of a loss just after it was detected, or learnt
_PART_FRICTION, _PART_LOSS = 1.5, 0.05  # deviation of friction beside a loss, and of a loss beside friction


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


class KnownFaults(NamedTuple):
    """Active diagnoses as masks of wheels, shape (n,) each, for the kernels."""

    unrolling: NDArray[np.bool_]
    """Slipping, locked, or with a failed sensor: not used by the velocity estimate."""
    degraded: NDArray[np.bool_]
    """Motors that are known to be degraded."""
    unknown_force: NDArray[np.bool_]
    """Traction does not follow from motor and speed."""
    failed_speed: NDArray[np.bool_]
    """Failed speed sensors."""
    excluded_axes: NDArray[np.bool_]
    """Axes x, y whose accelerometer has failed, shape (2,)."""
    failed_gyro: bool
    weak: NDArray[np.bool_]
    """Motors that have surely lost torque: the diagnosis is not ambiguous."""
    powerless: NDArray[np.bool_]
    """Motors without any torque."""
    stalled: NDArray[np.bool_]
    """Wheels that stand, locked or for lack of torque."""
    runaway: NDArray[np.bool_]
    """Motors that do not follow their set currents."""
    held: NDArray[np.bool_]
    """Wheels that do not turn."""
    slipping: NDArray[np.bool_]
    """Slipping wheels; all of them when the whole floor gives way."""
    decided: float = -math.inf
    """Time of the newest decision [s]; −∞: none."""
    active: bool = False
    """True if any diagnosis is active."""
    pending: bool = False
    """True if a suspicion is pending."""
    observed: bool = False
    """True if the decisions must look at every block: a diagnosis or a suspicion may change."""


def no_known_faults(wheels: int) -> KnownFaults:
    """Masks of a healthy robot."""
    masks = {name: np.zeros(wheels, bool) for name in KnownFaults._fields[:12]}
    return KnownFaults(**{**masks, "excluded_axes": np.zeros(2, bool), "failed_gyro": False})


def known_faults(verdict: Verdict, wheels: int) -> KnownFaults:
    """Masks of the active diagnoses; those that may be on another wheel do not count for the estimate."""
    known, decided = no_known_faults(wheels), -math.inf
    for d in verdict.diagnoses:
        decided = max(decided, d.time)
        if d.cleared is None:
            _mark(known, d)
    failed = verdict.failed_channels()
    for k, axis in enumerate("xy"):
        known.excluded_axes[k] = f"acceleration_{axis}" in failed
    pending = not math.isnan(verdict.suspected)
    return known._replace(
        failed_gyro="yaw_rate" in failed,
        decided=decided,
        active=verdict.has_active(),
        pending=pending,
        observed=pending or bool(verdict.diagnoses),
    )


def _mark(known: KnownFaults, d: Diagnosis) -> None:
    """Mark the wheels of an active diagnosis, in place."""
    if d.kind == "all_wheel_slip":
        known.unrolling[:] = known.slipping[:] = True
    stalled, certain, failed_speed = is_stalled(d), not d.ambiguous_with, d.channel.startswith("wheel_speed")
    marked = (
        (known.unrolling, d.kind in ("slip", "locked", "sensor")),
        (known.degraded, d.kind == "motor"),
        (known.failed_speed, failed_speed),
        (known.unknown_force, d.kind == "locked" or failed_speed or stalled),
        (known.stalled, stalled),
        (known.weak, d.kind == "motor" and certain),
        (known.powerless, stalled or (d.kind == "free" and certain)),
        (known.runaway, d.kind == "hard_over" and certain),
        (known.held, d.kind == "locked" and certain),
        (known.slipping, d.kind == "slip" and certain),
    )
    mark_wheels(d, marked)


def mark_wheels(diagnosis: Diagnosis, marked: Iterable[tuple[NDArray[np.bool_], bool]]) -> None:
    """Mark the wheels of a diagnosis in masks, in place.

    Args:
      diagnosis: Its wheels are 1…n.
      marked: Masks, shape (n,), and whether the diagnosis belongs to each.
    """
    for mask, belongs in marked:
        if belongs:  # item by item: a list of indices costs ten times as much
            for wheel in diagnosis.wheels:
                mask[wheel - 1] = True


@kernel
def accommodation_for(known, losses, relearning):
    """`Accommodation` of the known faults.

    Args:
      known: `KnownFaults`.
      losses: Diagnosed losses of the torque constants, shape (n,).
      relearning: Whether a new loss is still being measured; the velocity estimate excludes its wheel
        meanwhile.
    """
    included = np.empty(losses.size, np.bool_)
    for i in range(losses.size):
        included[i] = not (known.unrolling[i] or (known.degraded[i] and relearning))
    return Accommodation(
        included, known.unknown_force, known.excluded_axes, known.degraded, losses, relearning
    )


@kernel
def substitute_sensors(parameters, block, evidence, known):
    """Block whose failed speed sensors and failed gyro are replaced by the other sensors' estimate.

    Args:
      parameters: `RobustParameters`.
      block: `Block`; its wheel speeds and accelerations are changed in place.
      evidence: `Evidence` before the block.
      known: `KnownFaults`.
    """
    forces, velocity = parameters.robot.forces, evidence.velocity[-1]
    for i in range(block.wheel_speed.size):
        if known.failed_speed[i]:
            rolling = forces[0, i] * velocity[0] + forces[1, i] * velocity[1]
            rolling += forces[2, i] * block.yaw_rate
            block.wheel_speed[i], block.wheel_acceleration[i] = rolling / parameters.robot.radius[i], 0.0
    if not known.failed_gyro:
        return block
    return Block(
        block.current,
        block.wheel_speed,
        block.acceleration,
        yaw_rate_by_wheels(parameters.turn, block.wheel_speed),
        block.wheel_acceleration,
        yaw_rate_by_wheels(parameters.turn, block.wheel_acceleration),
        block.commanded,
        block.duration,
    )


@kernel
def estimate_faults(evidence, known, losses, estimate):
    """Fill a `FaultEstimate` from the known faults.

    Args:
      evidence: `Evidence`, with velocity and forces.
      known: `KnownFaults`.
      losses: Estimated losses of the torque constants, shape (n,).
      estimate: Fields of a `FaultEstimate`, filled in place.
    """
    n = losses.size
    for i in range(n):
        estimate.losses[i] = losses[i] if known.weak[i] else 0.0
        estimate.dead[i] = known.powerless[i] or (known.weak[i] and losses[i] > DEAD)
        estimate.force[i] = 0.0 if known.stalled[i] else evidence.force[i]
    estimate.runaway[:], estimate.held[:] = known.runaway, known.held
    estimate.slipping[:], estimate.velocity[:] = known.slipping, evidence.velocity[n, :2]
    estimate.decided, estimate.trusts_gyro = known.decided, not known.failed_gyro


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
    if is_friction(scores.likelihood[i], scores.likelihood[j]):  # something brakes the wheel
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
