"""From evidence to diagnoses: first *that*, then *which*; latched, and cleared by signs of health only."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from omnimj.control.robust.counters import (
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
from omnimj.control.robust.evidence import Evidence
from omnimj.control.robust.slow import known_losses
from omnimj.control.robust.verdict import Thresholds, Verdict, is_still, is_weak, with_one_more
from omnimj.control.robust.windows import LIKELIHOOD, SIZE
from omnimj.signals import Array, Diagnosis

_KNOWN_BETTER = 0.02  # by which an effectiveness must differ to be told anew
_AFTERMATH = 2.0  # [s] in which the velocity of the body comes home after a slip


def decide(
    evidence: Evidence,
    thresholds: Thresholds,
    before: Verdict,
    time: float,
    losses: Array,
    frozen: tuple[str, ...] = (),
) -> Verdict:
    """The verdict after one block.

    Args:
      evidence: After the block.
      thresholds: When a suspicion becomes a decision.
      before: The verdict until now.
      time: Of the block's end [s].
      losses: Believed losses of the torque constants, shape (n,).
      frozen: Channels that say the same for too long, or nothing but noise.
    """
    after = _cleared(evidence, thresholds, before, time)
    after = _frozen(frozen, after, time)
    known = len(after.diagnoses)
    after = _turning(evidence, thresholds, after, time)
    if len(after.diagnoses) > known:
        return after  # what was seen until now was seen with a sensor that lies
    after = _currents(evidence, thresholds, after, time)
    after = _stuck(evidence, thresholds, after, time)
    if _turns_unclear(evidence, thresholds, after):
        return after
    after = _forces(evidence, thresholds, after, time, losses)
    after = _worn(evidence, thresholds, after, time, losses)
    if math.isnan(after.suspected) or time - after.suspected > thresholds.bodily:
        after = _slips(evidence, thresholds, after, time)
        after = _odd_speeds(evidence, thresholds, after, time)
    return after


def _cleared(evidence: Evidence, thresholds: Thresholds, verdict: Verdict, time: float) -> Verdict:
    """A slip ends when the wheel has carried load without slipping, a lock when it turns; others stay."""

    def healthy(d: Diagnosis) -> bool:
        if d.cleared is not None:
            return False
        if d.kind == "locked" or is_still(d):
            return bool(evidence.counters[d.wheels[0] - 1, TURNS] >= thresholds.released)
        if d.kind not in ("slip", "all_wheel_slip"):
            return False
        rows = evidence.counters[[w - 1 for w in d.wheels] or slice(None)]
        return bool((rows[:, HEALTH] >= thresholds.healthy).any() and (rows[:, SLIPPING] < 1e-4).all())

    if not any(healthy(d) for d in verdict.diagnoses):
        return verdict
    after = tuple(replace(d, cleared=time) if healthy(d) else d for d in verdict.diagnoses)
    return Verdict(after, verdict.suspected)


def _frozen(frozen: tuple[str, ...], verdict: Verdict, time: float) -> Verdict:
    for channel in frozen:
        if not verdict.has_sensor(channel):
            wheels = (int(channel[-1]),) if channel[-1].isdigit() else ()
            verdict = with_one_more(verdict, Diagnosis(time, "sensor", wheels, 0.99, channel=channel))
    return verdict


def _turning(evidence: Evidence, thresholds: Thresholds, verdict: Verdict, time: float) -> Verdict:
    """Converter and gyro part: the one that the wheels contradict is wrong."""
    _, converter, wheels = evidence.heading
    if abs(converter) < thresholds.turning or verdict.has_sensor("yaw_rate") or verdict.has_sensor("yaw"):
        return verdict
    nearer = abs(wheels) - abs(wheels - converter)  # to the converter than to the gyro
    if abs(nearer) < 0.7 * thresholds.turning:
        return verdict
    by_gyro = nearer > 0.0
    return with_one_more(
        verdict, Diagnosis(time, "sensor", (), 0.95, channel="yaw_rate" if by_gyro else "yaw")
    )


def _turns_unclear(evidence: Evidence, thresholds: Thresholds, verdict: Verdict) -> bool:
    """Whether gyro and converter begin to part: wheels that turn as told would look like slip."""
    known = verdict.has_sensor("yaw_rate") or verdict.has_sensor("yaw")
    return not known and abs(evidence.heading[1]) > 0.4 * thresholds.turning


def _currents(evidence: Evidence, thresholds: Thresholds, verdict: Verdict, time: float) -> Verdict:
    for i, row in enumerate(evidence.counters):
        known = verdict.standing(i + 1)
        lies = verdict.has_sensor(f"current_{i + 1}") or verdict.has_sensor(f"wheel_speed_{i + 1}")
        if lies or (known is not None and known.kind in ("free", "hard_over")):
            continue
        if row[SILENT] >= thresholds.current:
            verdict = with_one_more(verdict, Diagnosis(time, "free", (i + 1,), 0.99, (), 0.0))
        elif row[RUNAWAY] >= thresholds.current:
            verdict = with_one_more(verdict, Diagnosis(time, "hard_over", (i + 1,), 0.99))
    return verdict


def _any(verdict: Verdict) -> bool:
    return any(d.cleared is None for d in verdict.diagnoses)


def _stuck(evidence: Evidence, thresholds: Thresholds, verdict: Verdict, time: float) -> Verdict:
    if any(d.cleared is None and d.kind in ("locked", "hard_over") for d in verdict.diagnoses):
        return verdict  # a robot that one wheel holds or pushes does not know its own velocity
    for i, row in enumerate(evidence.counters):
        known = verdict.standing(i + 1)
        if known is not None and (known.kind == "free" or verdict.has_sensor(f"wheel_speed_{i + 1}")):
            continue
        if row[STUCK] >= thresholds.stuck:
            verdict = with_one_more(verdict, Diagnosis(time, "locked", (i + 1,), 0.99, (), 0.0))
        elif row[STILL] >= thresholds.stuck and known is None:
            # held fast, or given nothing by its motor: the floor will tell, once it passes below
            verdict = with_one_more(
                verdict, Diagnosis(time, "motor", (i + 1,), 0.9, (f"locked {i + 1}",), 0.0)
            )
    return verdict


def _forces(
    evidence: Evidence, thresholds: Thresholds, verdict: Verdict, time: float, losses: Array
) -> Verdict:
    """Motors and accelerometer: who explains the missing force best?"""
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
    elif body[bodily] < thresholds.accelerometer * (thresholds.other if _any(verdict) else 1.0):
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
        return _accelerometer(verdict, time, bodily, lead, thresholds.margin)
    return _motor(verdict, thresholds, time, best, wheel, lead, found, losses)


def _motor(
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
    return with_one_more(verdict, Diagnosis(time, "motor", (best + 1,), confidence, rivals, left))


def _worn(
    evidence: Evidence, thresholds: Thresholds, verdict: Verdict, time: float, losses: Array
) -> Verdict:
    """A loss too small to be seen when it came, which was learnt since."""
    most = thresholds.worn * (thresholds.other if _any(verdict) else 1.0)
    learnt = known_losses(evidence.theta, evidence.cov, len(losses))
    for i in range(len(losses)):
        if learnt[i] > most and verdict.standing(i + 1) is None:
            left = float(max(1.0 - losses[i], 0.0))
            verdict = with_one_more(verdict, Diagnosis(time, "motor", (i + 1,), 0.9, (), left))
    return _known_better(verdict, losses, time)


def _known_better(verdict: Verdict, losses: Array, time: float) -> Verdict:
    """What is left of weak motors, as it is known by now; one that is named at this moment knows best."""

    def told(d: Diagnosis) -> Diagnosis:
        if (
            d.time == time
            or d.cleared is not None
            or d.kind != "motor"
            or d.ambiguous_with
            or d.effectiveness is None
        ):
            return d
        left = float(min(max(1.0 - losses[d.wheels[0] - 1], 0.0), 1.0))
        return replace(d, effectiveness=left) if abs(left - d.effectiveness) > _KNOWN_BETTER else d

    after = tuple(told(d) for d in verdict.diagnoses)
    same = all(a is b for a, b in zip(after, verdict.diagnoses, strict=True))
    return verdict if same else replace(verdict, diagnoses=after)


def _accelerometer(verdict: Verdict, time: float, axis: int, lead: float, margin: float) -> Verdict:
    channel = f"acceleration_{'xy'[axis]}"
    if verdict.has_sensor(channel) or lead < margin:
        return Verdict(verdict.diagnoses, math.nan)
    return with_one_more(verdict, Diagnosis(time, "sensor", (), 1.0 - math.exp(-lead), channel=channel))


def _slips(evidence: Evidence, thresholds: Thresholds, verdict: Verdict, time: float) -> Verdict:
    if any(d.kind == "all_wheel_slip" and d.cleared is None for d in verdict.diagnoses):
        return verdict
    way = evidence.counters[:, SLIPPING]
    enough = thresholds.slip * (thresholds.other if _any(verdict) else 1.0)
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
        verdict = with_one_more(verdict, Diagnosis(time, "slip", (i + 1,), confidence))
    return verdict


def _may_slip(verdict: Verdict, wheel: int) -> bool:
    """Whether nothing is known of a wheel that explains its slip, nor slip itself."""
    return all(is_weak(d) for d in verdict.diagnoses if d.cleared is None and wheel in d.wheels)


def _all_slip(verdict: Verdict, time: float) -> Verdict:
    """In the place of the wheels that were named until now."""
    ended = [
        replace(d, cleared=time) if d.cleared is None and d.kind == "slip" else d for d in verdict.diagnoses
    ]
    return Verdict((*ended, Diagnosis(time, "all_wheel_slip", (), 0.9)), math.nan)


def _odd_speeds(evidence: Evidence, thresholds: Thresholds, verdict: Verdict, time: float) -> Verdict:
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
        if row[AGAINST] < thresholds.odd or not quiet or verdict.has_sensor(channel):
            continue
        if verdict.standing(i + 1) is None:
            verdict = with_one_more(verdict, Diagnosis(time, "sensor", (i + 1,), 0.9, channel=channel))
    return verdict
