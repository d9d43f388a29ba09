"""From evidence to diagnoses: first *that*, then *which*; latched, and cleared by signs of health only."""

from __future__ import annotations

import math
from dataclasses import replace

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
from omnimj.control.robust.decide_forces import judge_forces, judge_learnt
from omnimj.control.robust.evidence import Evidence
from omnimj.control.robust.verdict import Thresholds, Verdict, is_still, is_weak, with_one_more
from omnimj.control.robust.windows import LIKELIHOOD
from omnimj.signals import Array, Diagnosis

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
    after = judge_forces(evidence, thresholds, after, time, losses, fresh)
    after = judge_learnt(evidence, thresholds, after, time, losses)
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

    if any(healthy(d) for d in verdict.diagnoses):
        after = tuple(replace(d, cleared=time) if healthy(d) else d for d in verdict.diagnoses)
        return Verdict(after, verdict.suspected)
    return replace(verdict, renewed=0) if verdict.renewed else verdict


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


def _slips(evidence: Evidence, thresholds: Thresholds, verdict: Verdict, time: float) -> Verdict:
    if any(d.kind == "all_wheel_slip" and d.cleared is None for d in verdict.diagnoses):
        return verdict
    way = evidence.counters[:, SLIPPING]
    enough = thresholds.slip * (thresholds.other if verdict.any_stands() else 1.0)
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
    told = (*ended, Diagnosis(time, "all_wheel_slip", (), 0.9))
    return replace(verdict, diagnoses=told, suspected=math.nan)


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
