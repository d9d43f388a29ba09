"""From evidence to diagnoses: first *that*, then *which*; latched, and cleared by signs of health only."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from omnimj.control.detection.robust.evidence import Evidence
from omnimj.control.detection.robust.glr import LIKELIHOOD, SIZE
from omnimj.control.detection.robust.parameter_filter import significant_losses
from omnimj.control.detection.robust.thresholds import (
    Thresholds,
    Verdict,
    is_degraded,
    is_stalled,
    with_diagnosis,
)
from omnimj.control.detection.robust.wheel_monitors import (
    AGAINST,
    HEALTH,
    LOADED,
    RUNAWAY,
    SHORT,
    SILENT,
    SLIPPING,
    STILL,
    STUCK,
    TURNS,
)
from omnimj.signals import Array, Diagnosis

# From the missing force to diagnoses: motors, accelerometer; and how much of a motor is left.

_EFFECTIVENESS_STEP = 0.02  # by which an effectiveness must differ to be told anew


def judge_forces(
    evidence: Evidence, thresholds: Thresholds, verdict: Verdict, time: float, losses: Array, fresh: bool
) -> Verdict:
    """Motors and accelerometer: who explains the missing force best?

    Args:
      evidence: After the block.
      thresholds: When a suspicion becomes a decision.
      verdict: Until now.
      time: Of the block's end [s].
      losses: Believed losses of the torque constants, shape (n,).
      fresh: As in `decide`.
    """
    n, found = len(evidence.force), evidence.found
    blind = {
        d.wheels[0] - 1 for d in verdict.diagnoses if d.cleared is None and d.kind in ("locked", "hard_over")
    }
    wheel = np.maximum(found[:n, LIKELIHOOD], found[n : 2 * n, LIKELIHOOD])
    wheel[list(blind)] = 0.0
    body = found[2 * n :, LIKELIHOOD]
    best = int(np.argmax(wheel))
    passes = found[best, LIKELIHOOD] >= thresholds.motor or found[n + best, LIKELIHOOD] >= thresholds.drag
    bodily = int(np.argmax(body))
    if wheel[best] >= body[bodily]:
        if not passes or best in blind:
            return Verdict(verdict.diagnoses, math.nan)
    elif body[bodily] < thresholds.accelerometer * (thresholds.other if verdict.has_active() else 1.0):
        return Verdict(verdict.diagnoses, math.nan)
    since = time if math.isnan(verdict.suspected) else verdict.suspected
    if evidence.counters[best, STUCK] > 0.0:  # a wheel that may be locked: its counter decides
        return Verdict(verdict.diagnoses, since)
    others = np.concatenate((np.delete(wheel, best), body)) if wheel[best] >= body[bodily] else wheel
    lead = max(wheel[best], body[bodily]) - float(np.max(others, initial=0.0))
    if lead < thresholds.margin and time - since < thresholds.settling:
        return Verdict(verdict.diagnoses, since)
    if wheel[best] < body[bodily]:
        if time - since < thresholds.bodily:
            return Verdict(verdict.diagnoses, since)
        return _accelerometer_fault(verdict, time, bodily, lead, thresholds.margin)
    known = verdict.standing(best + 1, ("motor",))
    if fresh and known is not None and not known.ambiguous_with:
        return Verdict(verdict.diagnoses, math.nan)
    return _motor_fault(verdict, thresholds, time, best, wheel, lead, found, losses)


def _motor_fault(
    verdict: Verdict,
    thresholds: Thresholds,
    time: float,
    best: int,
    wheel: Array,
    lead: float,
    found: Array,
    losses: Array,
) -> Verdict:
    rivals = tuple(
        f"motor {j + 1}"
        for j in range(len(wheel))
        if j != best and wheel[best] - wheel[j] < thresholds.margin
    )
    size = found[best, SIZE] if found[best, LIKELIHOOD] > 0.0 else 0.5
    left = float(min(max(1.0 - losses[best] - size, 0.0), 1.0))
    confidence = 1.0 - math.exp(-max(lead, 0.1))
    return with_diagnosis(verdict, Diagnosis(time, "motor", (best + 1,), confidence, rivals, left))


def judge_learnt_losses(
    evidence: Evidence, thresholds: Thresholds, verdict: Verdict, time: float, losses: Array
) -> Verdict:
    """A loss too small to be seen when it came, which was learnt since; arguments as for `judge_forces`."""
    most = thresholds.worn * (thresholds.other if verdict.has_active() else 1.0)
    learnt = significant_losses(evidence.theta, evidence.cov, len(losses))
    for i in range(len(losses)):
        if learnt[i] > most and verdict.standing(i + 1) is None:
            left = float(max(1.0 - losses[i], 0.0))
            verdict = with_diagnosis(verdict, Diagnosis(time, "motor", (i + 1,), 0.9, (), left))
    return _refine_effectiveness(verdict, losses, time)


def _refine_effectiveness(verdict: Verdict, losses: Array, time: float) -> Verdict:
    """What is left of weak motors, as it is known by now; one that was found in this moment knows best."""

    def told(d: Diagnosis) -> Diagnosis:
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
        return replace(d, effectiveness=left) if abs(left - d.effectiveness) > _EFFECTIVENESS_STEP else d

    after = tuple(told(d) for d in verdict.diagnoses)
    same = all(a is b for a, b in zip(after, verdict.diagnoses, strict=True))
    return verdict if same else replace(verdict, diagnoses=after)


def _accelerometer_fault(verdict: Verdict, time: float, axis: int, lead: float, margin: float) -> Verdict:
    channel = f"acceleration_{'xy'[axis]}"
    if verdict.has_sensor_fault(channel) or lead < margin:
        return Verdict(verdict.diagnoses, math.nan)
    return with_diagnosis(verdict, Diagnosis(time, "sensor", (), 1.0 - math.exp(-lead), channel=channel))


_AFTERMATH = 2.0  # [s] in which the velocity of the body comes home after a slip


def decide(
    evidence: Evidence,
    thresholds: Thresholds,
    before: Verdict,
    time: float,
    losses: Array,
    frozen: tuple[str, ...] = (),
    fresh: bool = False,
) -> Verdict:
    """The verdict after one block.

    Args:
      evidence: After the block.
      thresholds: When a suspicion becomes a decision.
      before: The verdict until now.
      time: Of the block's end [s].
      losses: Believed losses of the torque constants, shape (n,).
      frozen: Channels that say the same for too long, or nothing but noise.
      fresh: Whether what a motor has lost is still being measured: it is no other one meanwhile.
    """
    after = _clear_recovered(evidence, thresholds, before, time)
    after = _judge_channels(frozen, after, time)
    known = len(after.diagnoses)
    after = _judge_yaw_sensors(evidence, thresholds, after, time)
    if len(after.diagnoses) > known:
        return after  # what was seen until now was seen with a sensor that lies
    after = _judge_currents(evidence, thresholds, after, time)
    after = _judge_standing_wheels(evidence, thresholds, after, time)
    if _is_yaw_ambiguous(evidence, thresholds, after):
        return after
    after = judge_forces(evidence, thresholds, after, time, losses, fresh)
    after = judge_learnt_losses(evidence, thresholds, after, time, losses)
    if math.isnan(after.suspected) or time - after.suspected > thresholds.bodily:
        after = _judge_slip(evidence, thresholds, after, time)
        after = _judge_speed_sensors(evidence, thresholds, after, time)
    return after


def _clear_recovered(evidence: Evidence, thresholds: Thresholds, verdict: Verdict, time: float) -> Verdict:
    """A slip ends when the wheel has carried load without slipping, a lock when it turns; others stay."""

    def healthy(d: Diagnosis) -> bool:
        if d.cleared is not None:
            return False
        if d.kind == "locked" or is_stalled(d):
            return bool(evidence.counters[d.wheels[0] - 1, TURNS] >= thresholds.released)
        if d.kind not in ("slip", "all_wheel_slip"):
            return False
        rows = evidence.counters[[w - 1 for w in d.wheels] or slice(None)]
        return bool((rows[:, HEALTH] >= thresholds.healthy).any() and (rows[:, SLIPPING] < 1e-4).all())

    if any(healthy(d) for d in verdict.diagnoses):
        after = tuple(replace(d, cleared=time) if healthy(d) else d for d in verdict.diagnoses)
        return Verdict(after, verdict.suspected)
    return replace(verdict, renewed=0) if verdict.renewed else verdict


def _judge_channels(frozen: tuple[str, ...], verdict: Verdict, time: float) -> Verdict:
    for channel in frozen:
        if not verdict.has_sensor_fault(channel):
            wheels = (int(channel[-1]),) if channel[-1].isdigit() else ()
            verdict = with_diagnosis(verdict, Diagnosis(time, "sensor", wheels, 0.99, channel=channel))
    return verdict


def _judge_yaw_sensors(evidence: Evidence, thresholds: Thresholds, verdict: Verdict, time: float) -> Verdict:
    """Converter and gyro part: the one that the wheels contradict is wrong."""
    _, converter, wheels = evidence.heading
    if (
        abs(converter) < thresholds.turning
        or verdict.has_sensor_fault("yaw_rate")
        or verdict.has_sensor_fault("yaw")
    ):
        return verdict
    nearer = abs(wheels) - abs(wheels - converter)  # to the converter than to the gyro
    if abs(nearer) < 0.7 * thresholds.turning:
        return verdict
    by_gyro = nearer > 0.0
    return with_diagnosis(
        verdict, Diagnosis(time, "sensor", (), 0.95, channel="yaw_rate" if by_gyro else "yaw")
    )


def _is_yaw_ambiguous(evidence: Evidence, thresholds: Thresholds, verdict: Verdict) -> bool:
    """Whether gyro and converter begin to part: wheels that turn as told would look like slip."""
    known = verdict.has_sensor_fault("yaw_rate") or verdict.has_sensor_fault("yaw")
    return not known and abs(evidence.heading[1]) > 0.4 * thresholds.turning


def _judge_currents(evidence: Evidence, thresholds: Thresholds, verdict: Verdict, time: float) -> Verdict:
    for i, row in enumerate(evidence.counters):
        known = verdict.standing(i + 1)
        lies = verdict.has_sensor_fault(f"current_{i + 1}") or verdict.has_sensor_fault(
            f"wheel_speed_{i + 1}"
        )
        if lies or (known is not None and known.kind in ("free", "hard_over")):
            continue
        if row[SILENT] >= thresholds.current:
            verdict = with_diagnosis(verdict, Diagnosis(time, "free", (i + 1,), 0.99, (), 0.0))
        elif row[RUNAWAY] >= thresholds.current:
            verdict = with_diagnosis(verdict, Diagnosis(time, "hard_over", (i + 1,), 0.99))
    return verdict


def _judge_standing_wheels(
    evidence: Evidence, thresholds: Thresholds, verdict: Verdict, time: float
) -> Verdict:
    if any(d.cleared is None and d.kind in ("locked", "hard_over") for d in verdict.diagnoses):
        return verdict  # a robot that one wheel holds or pushes does not know its own velocity
    for i, row in enumerate(evidence.counters):
        known = verdict.standing(i + 1)
        if known is not None and (known.kind == "free" or verdict.has_sensor_fault(f"wheel_speed_{i + 1}")):
            continue
        if row[STUCK] >= thresholds.stuck:
            verdict = with_diagnosis(verdict, Diagnosis(time, "locked", (i + 1,), 0.99, (), 0.0))
        elif row[STILL] >= thresholds.stuck and known is None:
            # held fast, or given nothing by its motor: the floor will tell, once it passes below
            verdict = with_diagnosis(
                verdict, Diagnosis(time, "motor", (i + 1,), 0.9, (f"locked {i + 1}",), 0.0)
            )
    return verdict


def _judge_slip(evidence: Evidence, thresholds: Thresholds, verdict: Verdict, time: float) -> Verdict:
    if any(d.kind == "all_wheel_slip" and d.cleared is None for d in verdict.diagnoses):
        return verdict
    way = evidence.counters[:, SLIPPING]
    enough = thresholds.slip * (thresholds.other if verdict.has_active() else 1.0)
    over = [i for i in range(len(way)) if way[i] >= enough and _may_slip(verdict, i + 1)]
    if not over:
        return verdict
    slipping = {d.wheels[0] - 1 for d in verdict.diagnoses if d.cleared is None and d.kind == "slip"}
    slipping |= {i for i in range(len(way)) if way[i] >= 0.5 * thresholds.slip}
    holding = [i for i in range(len(way)) if i not in slipping and abs(evidence.force[i]) > LOADED]
    if len(slipping) >= 2 and not holding:
        return _all_slip(verdict, time)
    for i in over:
        slid = max(float(evidence.counters[i, SHORT]), 0.0)
        confidence = 1.0 - math.exp(-slid / 0.02)
        verdict = with_diagnosis(verdict, Diagnosis(time, "slip", (i + 1,), confidence))
    return verdict


def _may_slip(verdict: Verdict, wheel: int) -> bool:
    """Whether nothing is known of a wheel that explains its slip, nor slip itself."""
    return all(is_degraded(d) for d in verdict.diagnoses if d.cleared is None and wheel in d.wheels)


def _all_slip(verdict: Verdict, time: float) -> Verdict:
    """In the place of the wheels that were named until now."""
    ended = [
        replace(d, cleared=time) if d.cleared is None and d.kind == "slip" else d for d in verdict.diagnoses
    ]
    told = (*ended, Diagnosis(time, "all_wheel_slip", (), 0.9))
    return replace(verdict, diagnoses=told, suspected=math.nan)


def _judge_speed_sensors(
    evidence: Evidence, thresholds: Thresholds, verdict: Verdict, time: float
) -> Verdict:
    n = len(evidence.force)
    if any(d.cleared is None or time - d.cleared < _AFTERMATH for d in verdict.diagnoses):
        return verdict  # what is wrong already makes other wheels look odd
    if (evidence.counters[:, AGAINST] >= 0.5 * thresholds.odd).sum() > 1:
        return verdict  # when several wheels are odd, it is the body's velocity that is wrong
    if evidence.counters[:, SLIPPING].any():
        return verdict  # a wheel that begins to slip makes the others look odd
    for i, row in enumerate(evidence.counters):
        quiet = (
            max(evidence.found[i, LIKELIHOOD], evidence.found[n + i, LIKELIHOOD]) < 0.25 * thresholds.motor
        )
        channel = f"wheel_speed_{i + 1}"
        if row[AGAINST] < thresholds.odd or not quiet or verdict.has_sensor_fault(channel):
            continue
        if verdict.standing(i + 1) is None:
            verdict = with_diagnosis(verdict, Diagnosis(time, "sensor", (i + 1,), 0.9, channel=channel))
    return verdict
