"""What follows from a verdict: who has a say, whose force is known, what recovery is to act upon."""

from __future__ import annotations

import math

import numpy as np

from omnimj.control.detection.detector import FaultEstimate
from omnimj.control.detection.robust.evidence import FILLED, Evidence
from omnimj.control.detection.robust.glr import LIKELIHOOD, SIZE
from omnimj.control.detection.robust.thresholds import Thresholds, Verdict, is_stalled
from omnimj.control.detection.robust.wheel_monitors import SLIPPING
from omnimj.signals import Array, Diagnosis

_DEAD = 0.9  # loss from which a motor is not counted upon


def estimate_faults(evidence: Evidence, verdict: Verdict, losses: Array) -> FaultEstimate:
    """What stands, wheel by wheel; what might be another wheel is not acted upon.

    Args:
      evidence: Velocity and forces.
      verdict: What stands.
      losses: Believed losses of the torque constants, shape (n,).
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


def included_wheels(verdict: Verdict, wheels: int, fresh: int) -> Array:
    """Wheels that have a say about the body's velocity, 1 or 0, shape (wheels,).

    Args:
      verdict: What stands.
      wheels: n.
      fresh: Blocks for which a new loss is still measured: its wheel has a say once its force is known again.
    """
    believed = np.ones(wheels)
    for d in verdict.diagnoses:
        if d.cleared is not None or (d.kind == "motor" and fresh == 0):
            continue
        if d.kind in ("slip", "motor", "locked", "sensor"):
            believed[[w - 1 for w in d.wheels]] = 0.0
        elif d.kind == "all_wheel_slip":
            believed[:] = 0.0
    return believed


def excluded_axes(verdict: Verdict) -> Array:
    """Axes along which the accelerometer lies, shape (2,)."""
    return np.array([float(verdict.has_sensor_fault(f"acceleration_{axis}")) for axis in "xy"])


def unknown_forces(verdict: Verdict, wheels: int) -> Array:
    """Wheels whose force on the floor the motor, or its speed, does not tell, 1 or 0, shape (wheels,)."""
    unknown = np.zeros(wheels)
    for d in verdict.diagnoses:
        lies = d.channel.startswith("wheel_speed")
        if d.cleared is None and (d.kind == "locked" or lies or is_stalled(d)):
            unknown[[w - 1 for w in d.wheels]] = 1.0
    return unknown


def degraded_motors(verdict: Verdict, wheels: int) -> Array:
    """Wheels whose motor is known to be broken, 1 or 0, shape (wheels,)."""
    weak = np.zeros(wheels)
    for d in verdict.diagnoses:
        if d.cleared is None and d.kind == "motor":
            weak[[w - 1 for w in d.wheels]] = 1.0
    return weak


# What a decision does to the evidence: a new loss is believed in, what was seen before it is forgotten.

_FOUND_AGAIN, _LEARNT_AGAIN = 0.2, 0.1  # standard deviation of a loss just after it was seen, or learnt
_PART_FRICTION, _PART_LOSS = 1.5, 0.05  # of it that may be friction, and loss where friction was seen
_RATHER = 2.0  # [nats] by which friction must be more likely than a loss


def accommodate(
    evidence: Evidence, thresholds: Thresholds, before: Verdict, after: Verdict, accepted: Array
) -> Array:
    """Losses that are believed in after a block, shape (n,): the same array where no motor is news.

    The velocity is forgotten too when a slip of all wheels is over: it drifted through it.

    Args:
      evidence: After the block; changed in place.
      thresholds: What a loss that was seen, not learnt, must have passed.
      before: The verdict before the block.
      after: And after it.
      accepted: Losses believed in until now, shape (n,).
    """
    if _all_slip(before) and not _all_slip(after):
        _reset_velocity(evidence)
    news = _new_diagnoses(before, after)
    if not news:
        return accepted
    found = evidence.found.copy()
    evidence.cursor[FILLED] = 0
    evidence.found[:] = 0.0
    if any(d.kind == "motor" for d in news):
        accepted = accepted.copy()
    for d in news:
        if d.kind == "motor" and not is_stalled(d):
            _reset_motor(d, evidence, thresholds, found, accepted)
        elif d.kind == "sensor":  # what it made up is forgotten
            _reset_velocity(evidence)
    return accepted


def _new_diagnoses(before: Verdict, after: Verdict) -> tuple[Diagnosis, ...]:
    """What was decided in this block: new diagnoses, and a weak motor that is another one by now."""
    again = after.standing(after.renewed, ("motor",))
    return (*after.diagnoses[len(before.diagnoses) :], *([again] if again is not None else []))


def _all_slip(verdict: Verdict) -> bool:
    return any(d.kind == "all_wheel_slip" and d.cleared is None for d in verdict.diagnoses)


def _reset_velocity(evidence: Evidence) -> None:
    evidence.spread[:] = np.eye(evidence.spread.shape[1])
    evidence.counters[:, SLIPPING] = 0.0


def _reset_motor(
    motor: Diagnosis, evidence: Evidence, thresholds: Thresholds, found: Array, accepted: Array
) -> None:
    """What is wrong of a motor, loss or friction, is learnt from what was found on, in place."""
    if motor.effectiveness is None:
        return
    i, j = motor.wheels[0] - 1, motor.wheels[0] - 1 + len(accepted)
    if found[j, LIKELIHOOD] > found[i, LIKELIHOOD] + _RATHER:  # something brakes the wheel
        evidence.theta[j] += found[j, SIZE]
        _reset_variance(evidence.cov, j, 0.5 * found[j, SIZE] + _PART_FRICTION)
        evidence.cov[i, i] += _PART_LOSS**2
        return
    accepted[i] = 1.0 - motor.effectiveness - evidence.theta[i]
    seen = found[[i, j], LIKELIHOOD].max() >= min(thresholds.motor, thresholds.drag)
    _reset_variance(evidence.cov, i, _FOUND_AGAIN if seen else _LEARNT_AGAIN)
    evidence.cov[j, j] += _PART_FRICTION**2


def _reset_variance(cov: Array, j: int, deviation: float) -> None:
    """Number j of θ begins anew, in place."""
    cov[j, :], cov[:, j] = 0.0, 0.0
    cov[j, j] = deviation * deviation
