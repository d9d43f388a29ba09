"""Decisions: from evidence to diagnoses, first detection, then isolation.

Diagnoses are latched; only signs of health withdraw them.

`evidence` is that after the block, which ends at `time` [s], `thresholds` are the values from which a
suspicion becomes a decision, `verdict` holds until now, and `losses` are the estimated losses of the torque
constants, shape (n,) [1].
"""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import numpy as np

from omnimj.control.detection.robust.evidence import CONVERTER, ROLLED, Evidence
from omnimj.control.detection.robust.glr import is_friction
from omnimj.control.detection.robust.parameter_filter import significant_losses
from omnimj.control.detection.robust.thresholds import Thresholds
from omnimj.control.detection.robust.verdict import Verdict, is_degraded, is_stalled, with_diagnosis
from omnimj.control.detection.robust.wheel_monitors import LOADED
from omnimj.physics.native import kernel
from omnimj.signals import Array, Diagnosis

_AFTERMATH = 2.0  # [s] in which the estimated velocity recovers from a slip
EFFECTIVENESS_STEP = 0.02
"""Smallest change of an effectiveness that updates its diagnosis."""
FORGOTTEN_SLIP = 1e-4
"""Way slipped below which a wheel counts as rolling [m]."""


@kernel
def is_uneventful(thresholds, evidence, failed):
    """True if no decision can follow from a block, given that no diagnosis or suspicion was there before it.

    `decide` would return the verdict that it got; the kernels spare themselves the call.

    Args:
      thresholds: `Thresholds` as floats.
      failed: Mask of the channels that are frozen or too noisy, shape (2n+3,).
    """
    n, likelihood, monitors = evidence.force.size, evidence.scores.likelihood, evidence.monitors
    if failed.any() or abs(evidence.yaw[CONVERTER]) > 0.4 * thresholds.turning:
        return False
    if max(likelihood[2 * n], likelihood[2 * n + 1]) >= thresholds.accelerometer:
        return False
    learnt = significant_losses(evidence.theta, evidence.cov, n)
    for i in range(n):
        if likelihood[i] >= thresholds.motor or likelihood[n + i] >= thresholds.drag:
            return False
        if monitors.silent[i] >= thresholds.current or monitors.disobeying[i] >= thresholds.current:
            return False
        if monitors.stuck[i] >= thresholds.stuck or monitors.stalled[i] >= thresholds.stuck:
            return False
        if monitors.slipped[i] >= thresholds.slip or monitors.implausible[i] >= thresholds.odd:
            return False
        if learnt[i] > thresholds.worn:
            return False
    return True


def decide(
    evidence: Evidence,
    thresholds: Thresholds,
    before: Verdict,
    time: float,
    losses: Array,
    failed: tuple[str, ...] = (),
    relearning: bool = False,
) -> Verdict:
    """Verdict after one block.

    Args:
      before: Verdict before the block.
      failed: Channels that are frozen or too noisy.
      relearning: Whether a new loss is still being measured: it does not count as another one meanwhile.
    """
    after = _clear_recovered(evidence, thresholds, before, time)
    after = _judge_channels(failed, after, time)
    known = len(after.diagnoses)
    after = _judge_yaw_sensors(evidence, thresholds, after, time)
    if len(after.diagnoses) > known:
        return after  # the evidence comes from a failed sensor
    after = _judge_currents(evidence, thresholds, after, time)
    after = _judge_standing_wheels(evidence, thresholds, after, time)
    if _is_yaw_ambiguous(evidence, thresholds, after):
        return after
    after = judge_forces(evidence, thresholds, after, time, losses, relearning)
    after = judge_learnt_losses(evidence, thresholds, after, time, losses)
    if math.isnan(after.suspected) or time - after.suspected > thresholds.bodily:
        after = _judge_slip(evidence, thresholds, after, time)
        after = _judge_speed_sensors(evidence, thresholds, after, time)
    return after


def _clear_recovered(evidence: Evidence, thresholds: Thresholds, verdict: Verdict, time: float) -> Verdict:
    """Withdraw a slip once the wheel carries load without slipping, a locked wheel once it turns."""
    monitors = evidence.monitors

    def recovered(d: Diagnosis) -> bool:
        if d.cleared is not None:
            return False
        if d.kind == "locked" or is_stalled(d):
            return bool(monitors.turning[d.wheels[0] - 1] >= thresholds.released)
        if d.kind not in ("slip", "all_wheel_slip"):
            return False
        wheels = [w - 1 for w in d.wheels] or slice(None)
        regained, slipped = monitors.regained[wheels], monitors.slipped[wheels]
        return bool((regained >= thresholds.healthy).any() and (slipped < FORGOTTEN_SLIP).all())

    if any(recovered(d) for d in verdict.diagnoses):
        after = tuple(replace(d, cleared=time) if recovered(d) else d for d in verdict.diagnoses)
        return Verdict(after, verdict.suspected)
    return replace(verdict, renewed=0) if verdict.renewed else verdict


def _judge_channels(failed: tuple[str, ...], verdict: Verdict, time: float) -> Verdict:
    for channel in failed:
        if not verdict.has_sensor_fault(channel):
            wheels = (int(channel[-1]),) if channel[-1].isdigit() else ()
            verdict = with_diagnosis(
                verdict, Diagnosis(time, "sensor", wheels, 0.99, channel=channel, test="readings")
            )
    return verdict


def _has_yaw_fault(verdict: Verdict) -> bool:
    return verdict.has_sensor_fault("yaw_rate") or verdict.has_sensor_fault("yaw")


def _judge_yaw_sensors(evidence: Evidence, thresholds: Thresholds, verdict: Verdict, time: float) -> Verdict:
    """Converter and gyro differ: the one that the wheels contradict is faulty."""
    converter, wheels = float(evidence.yaw[CONVERTER]), float(evidence.yaw[ROLLED])
    if abs(converter) < thresholds.turning or _has_yaw_fault(verdict):
        return verdict
    nearer = abs(wheels) - abs(wheels - converter)  # of the wheels to the converter than to the gyro
    if abs(nearer) < 0.7 * thresholds.turning:
        return verdict
    channel = "yaw_rate" if nearer > 0.0 else "yaw"
    decided = _decided("yaw rates", abs(converter), thresholds.turning)
    return with_diagnosis(verdict, Diagnosis(time, "sensor", (), 0.95, channel=channel, **decided))


def _is_yaw_ambiguous(evidence: Evidence, thresholds: Thresholds, verdict: Verdict) -> bool:
    """True if gyro and converter begin to differ: wheels that follow a faulty one would look like slip."""
    return not _has_yaw_fault(verdict) and abs(evidence.yaw[CONVERTER]) > 0.4 * thresholds.turning


def _judge_currents(evidence: Evidence, thresholds: Thresholds, verdict: Verdict, time: float) -> Verdict:
    """Motors that do not follow their set currents."""
    monitors = evidence.monitors
    for i in range(len(evidence.force)):
        wheel, known = i + 1, verdict.active_on(i + 1)
        if known is not None and known.kind in ("free", "hard_over"):
            continue
        if any(verdict.has_sensor_fault(f"{name}_{wheel}") for name in ("current", "wheel_speed")):
            continue
        if monitors.silent[i] >= thresholds.current:
            decided = _decided("current", monitors.silent[i], thresholds.current)
            verdict = with_diagnosis(verdict, Diagnosis(time, "free", (wheel,), 0.99, (), 0.0, **decided))
        elif monitors.disobeying[i] >= thresholds.current:
            decided = _decided("current", monitors.disobeying[i], thresholds.current)
            verdict = with_diagnosis(verdict, Diagnosis(time, "hard_over", (wheel,), 0.99, **decided))
    return verdict


def _judge_standing_wheels(
    evidence: Evidence, thresholds: Thresholds, verdict: Verdict, time: float
) -> Verdict:
    """Wheels that stand while the floor passes or their motors push."""
    if any(d.cleared is None and d.kind in ("locked", "hard_over") for d in verdict.diagnoses):
        return verdict  # the velocity of a robot that one wheel holds or pushes is not known
    for i in range(len(evidence.force)):
        wheel, known = i + 1, verdict.active_on(i + 1)
        if known is not None and (known.kind == "free" or verdict.has_sensor_fault(f"wheel_speed_{wheel}")):
            continue
        if evidence.monitors.stuck[i] >= thresholds.stuck:
            decided = _decided("standing", evidence.monitors.stuck[i], thresholds.stuck)
            verdict = with_diagnosis(verdict, Diagnosis(time, "locked", (wheel,), 0.99, (), 0.0, **decided))
        elif evidence.monitors.stalled[i] >= thresholds.stuck and known is None:
            # locked, or without torque: the floor will tell which, once it passes below
            locked = (f"locked {wheel}",)
            decided = _decided("standing", evidence.monitors.stalled[i], thresholds.stuck)
            stalled = Diagnosis(time, "motor", (wheel,), 0.9, locked, 0.0, **decided)
            verdict = with_diagnosis(verdict, stalled)
    return verdict


def judge_forces(
    evidence: Evidence,
    thresholds: Thresholds,
    verdict: Verdict,
    time: float,
    losses: Array,
    relearning: bool,
) -> Verdict:
    """Diagnose the motor or accelerometer that explains the missing force best."""
    n, likelihood = len(evidence.force), evidence.scores.likelihood
    excluded = {
        d.wheels[0] - 1 for d in verdict.diagnoses if d.cleared is None and d.kind in ("locked", "hard_over")
    }
    wheel = np.maximum(likelihood[:n], likelihood[n : 2 * n])
    wheel[list(excluded)] = 0.0
    body = likelihood[2 * n :]
    best, axis = int(np.argmax(wheel)), int(np.argmax(body))
    passes = likelihood[best] >= thresholds.motor or likelihood[n + best] >= thresholds.drag
    by_wheel = wheel[best] >= body[axis]
    if by_wheel:
        if not passes or best in excluded:
            return Verdict(verdict.diagnoses, math.nan)
    elif body[axis] < thresholds.accelerometer * (thresholds.other if verdict.has_active() else 1.0):
        return Verdict(verdict.diagnoses, math.nan)
    elif abs(evidence.scores.size[2 * n + axis]) < thresholds.bias:
        return Verdict(verdict.diagnoses, math.nan)  # a wheel may have left the stated floor
    since = time if math.isnan(verdict.suspected) else verdict.suspected
    if evidence.monitors.stuck[best] > 0.0:  # a wheel that may be locked: its monitor decides
        return Verdict(verdict.diagnoses, since)
    others = np.concatenate((np.delete(wheel, best), body)) if by_wheel else wheel
    lead = max(wheel[best], body[axis]) - float(np.max(others, initial=0.0))
    if lead < thresholds.margin and time - since < thresholds.settling:
        return Verdict(verdict.diagnoses, since)
    if not by_wheel:
        if time - since < thresholds.bodily:
            return Verdict(verdict.diagnoses, since)
        return _accelerometer_fault(verdict, time, axis, lead, thresholds, float(body[axis]))
    known = verdict.active_on(best + 1, ("motor",))
    if relearning and known is not None and not known.ambiguous_with:
        return Verdict(verdict.diagnoses, math.nan)
    rivals = tuple(
        f"motor {j + 1}" for j in range(n) if j != best and wheel[best] - wheel[j] < thresholds.margin
    )
    size = evidence.scores.size[best] if likelihood[best] > 0.0 else 0.5
    left = float(min(max(1.0 - losses[best] - size, 0.0), 1.0))
    confidence = 1.0 - math.exp(-max(lead, 0.1))
    loss, friction = float(likelihood[best]), float(likelihood[n + best])
    shown = max(loss, friction * thresholds.motor / thresholds.drag)  # as it is logged
    decided = _decided("loss", shown, thresholds.motor)
    if is_friction(loss, friction):
        decided = _decided("friction", friction, thresholds.drag)
    return with_diagnosis(verdict, Diagnosis(time, "motor", (best + 1,), confidence, rivals, left, **decided))


def _decided(test: str, statistic: float, threshold: float) -> dict[str, Any]:
    """Fields of a diagnosis that say what decided."""
    return {"test": test, "statistic": float(statistic), "threshold": float(threshold)}


def _accelerometer_fault(
    verdict: Verdict, time: float, axis: int, lead: float, thresholds: Thresholds, likelihood: float
) -> Verdict:
    channel = f"acceleration_{'xy'[axis]}"
    if verdict.has_sensor_fault(channel) or lead < thresholds.margin:
        return Verdict(verdict.diagnoses, math.nan)
    limit = thresholds.accelerometer * (thresholds.other if verdict.has_active() else 1.0)
    decided = _decided("accelerometer", likelihood, limit)
    fault = Diagnosis(time, "sensor", (), 1.0 - math.exp(-lead), channel=channel, **decided)
    return with_diagnosis(verdict, fault)


def judge_learnt_losses(
    evidence: Evidence, thresholds: Thresholds, verdict: Verdict, time: float, losses: Array
) -> Verdict:
    """Diagnose losses that were too small to be detected as a jump and have been learnt since."""
    most = thresholds.worn * (thresholds.other if verdict.has_active() else 1.0)
    learnt = significant_losses(evidence.theta, evidence.cov, len(losses))
    for i in range(len(losses)):
        if learnt[i] > most and verdict.active_on(i + 1) is None:
            left = float(max(1.0 - losses[i], 0.0))
            decided = _decided("learnt loss", learnt[i], most)
            verdict = with_diagnosis(verdict, Diagnosis(time, "motor", (i + 1,), 0.9, (), left, **decided))
    return _refine_effectiveness(verdict, losses, time)


def _refine_effectiveness(verdict: Verdict, losses: Array, time: float) -> Verdict:
    """Update the effectiveness of degraded motors, except those that were diagnosed in this block."""

    def refined(d: Diagnosis) -> Diagnosis:
        if (
            d.time == time
            or verdict.renewed in d.wheels
            or d.cleared is not None
            or d.kind != "motor"
            or d.ambiguous_with
            or d.effectiveness is None
        ):
            return d
        left = float(min(max(1.0 - losses[d.wheels[0] - 1], 0.0), 1.0))
        return replace(d, effectiveness=left) if abs(left - d.effectiveness) > EFFECTIVENESS_STEP else d

    after = tuple(refined(d) for d in verdict.diagnoses)
    same = all(a is b for a, b in zip(after, verdict.diagnoses, strict=True))
    return verdict if same else replace(verdict, diagnoses=after)


def _judge_slip(evidence: Evidence, thresholds: Thresholds, verdict: Verdict, time: float) -> Verdict:
    if any(d.kind == "all_wheel_slip" and d.cleared is None for d in verdict.diagnoses):
        return verdict
    way = evidence.monitors.slipped
    enough = thresholds.slip * (thresholds.other if verdict.has_active() else 1.0)
    over = [i for i in range(len(way)) if way[i] >= enough and may_slip(verdict, i + 1)]
    if not over:
        return verdict
    slipping = {d.wheels[0] - 1 for d in verdict.diagnoses if d.cleared is None and d.kind == "slip"}
    slipping |= {i for i in range(len(way)) if way[i] >= 0.5 * thresholds.slip}
    holding = [i for i in range(len(way)) if i not in slipping and abs(evidence.force[i]) > LOADED]
    if len(slipping) >= 2 and not holding:
        return _all_slip(verdict, time, _decided("slip", max(way[i] for i in over), enough))
    for i in over:
        excess = max(float(evidence.monitors.excess[i]), 0.0)
        confidence = 1.0 - math.exp(-excess / 0.02)
        decided = _decided("slip", way[i], enough)
        verdict = with_diagnosis(verdict, Diagnosis(time, "slip", (i + 1,), confidence, **decided))
    return verdict


def may_slip(verdict: Verdict, wheel: int) -> bool:
    """True if no active diagnosis explains the slip of a wheel or is slip itself."""
    return all(is_degraded(d) for d in verdict.diagnoses if d.cleared is None and wheel in d.wheels)


def _all_slip(verdict: Verdict, time: float, decided: dict[str, Any]) -> Verdict:
    """Slip of all wheels, in place of the slips of single ones."""
    ended = [
        replace(d, cleared=time) if d.cleared is None and d.kind == "slip" else d for d in verdict.diagnoses
    ]
    diagnoses = (*ended, Diagnosis(time, "all_wheel_slip", (), 0.9, **decided))
    return replace(verdict, diagnoses=diagnoses, suspected=math.nan)


def _judge_speed_sensors(
    evidence: Evidence, thresholds: Thresholds, verdict: Verdict, time: float
) -> Verdict:
    monitors, likelihood, n = evidence.monitors, evidence.scores.likelihood, len(evidence.force)
    if any(d.cleared is None or time - d.cleared < _AFTERMATH for d in verdict.diagnoses):
        return verdict  # a fault that is already known makes other wheels look implausible
    if (monitors.implausible >= 0.5 * thresholds.odd).sum() > 1:
        return verdict  # when several wheels are implausible, the estimated velocity is wrong
    if monitors.slipped.any():
        return verdict  # a wheel that begins to slip makes the others look implausible
    for i in range(n):
        quiet = max(likelihood[i], likelihood[n + i]) < 0.25 * thresholds.motor
        channel = f"wheel_speed_{i + 1}"
        if monitors.implausible[i] < thresholds.odd or not quiet or verdict.has_sensor_fault(channel):
            continue
        if verdict.active_on(i + 1) is None:
            decided = _decided("wheel speed", monitors.implausible[i], thresholds.odd)
            fault = Diagnosis(time, "sensor", (i + 1,), 0.9, channel=channel, **decided)
            verdict = with_diagnosis(verdict, fault)
    return verdict
