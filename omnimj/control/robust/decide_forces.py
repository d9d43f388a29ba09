"""From the missing force to diagnoses: motors, accelerometer; and how much of a motor is left."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from omnimj.control.robust.counters import STUCK
from omnimj.control.robust.evidence import Evidence
from omnimj.control.robust.slow import known_losses
from omnimj.control.robust.verdict import Thresholds, Verdict, with_one_more
from omnimj.control.robust.windows import LIKELIHOOD, SIZE
from omnimj.signals import Array, Diagnosis

_KNOWN_BETTER = 0.02  # by which an effectiveness must differ to be told anew


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
    elif body[bodily] < thresholds.accelerometer * (thresholds.other if verdict.any_stands() else 1.0):
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
    known = verdict.standing(best + 1, ("motor",))
    if fresh and known is not None and not known.ambiguous_with:
        return Verdict(verdict.diagnoses, math.nan)
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


def judge_learnt(
    evidence: Evidence, thresholds: Thresholds, verdict: Verdict, time: float, losses: Array
) -> Verdict:
    """A loss too small to be seen when it came, which was learnt since; arguments as for `judge_forces`."""
    most = thresholds.worn * (thresholds.other if verdict.any_stands() else 1.0)
    learnt = known_losses(evidence.theta, evidence.cov, len(losses))
    for i in range(len(losses)):
        if learnt[i] > most and verdict.standing(i + 1) is None:
            left = float(max(1.0 - losses[i], 0.0))
            verdict = with_one_more(verdict, Diagnosis(time, "motor", (i + 1,), 0.9, (), left))
    return _known_better(verdict, losses, time)


def _known_better(verdict: Verdict, losses: Array, time: float) -> Verdict:
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
        return replace(d, effectiveness=left) if abs(left - d.effectiveness) > _KNOWN_BETTER else d

    after = tuple(told(d) for d in verdict.diagnoses)
    same = all(a is b for a, b in zip(after, verdict.diagnoses, strict=True))
    return verdict if same else replace(verdict, diagnoses=after)


def _accelerometer(verdict: Verdict, time: float, axis: int, lead: float, margin: float) -> Verdict:
    channel = f"acceleration_{'xy'[axis]}"
    if verdict.has_sensor(channel) or lead < margin:
        return Verdict(verdict.diagnoses, math.nan)
    return with_one_more(verdict, Diagnosis(time, "sensor", (), 1.0 - math.exp(-lead), channel=channel))
