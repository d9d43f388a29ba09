"""What a decision does to the evidence: a new loss is believed in, what was seen before it is forgotten."""

from __future__ import annotations

import numpy as np

from omnimj.control.robust.counters import SLIPPING
from omnimj.control.robust.evidence import FILLED, Evidence
from omnimj.control.robust.verdict import Thresholds, Verdict, is_still
from omnimj.control.robust.windows import LIKELIHOOD, SIZE
from omnimj.signals import Array, Diagnosis

_FOUND_AGAIN, _LEARNT_AGAIN = 0.2, 0.1  # standard deviation of a loss just after it was seen, or learnt
_PART_FRICTION, _PART_LOSS = 1.5, 0.05  # of it that may be friction, and loss where friction was seen
_RATHER = 2.0  # [nats] by which friction must be more likely than a loss


def accept(
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
        _forget_velocity(evidence)
    news = _news(before, after)
    if not news:
        return accepted
    found = evidence.found.copy()
    evidence.cursor[FILLED] = 0
    evidence.found[:] = 0.0
    if any(d.kind == "motor" for d in news):
        accepted = accepted.copy()
    for d in news:
        if d.kind == "motor" and not is_still(d):
            _begin_anew(d, evidence, thresholds, found, accepted)
        elif d.kind == "sensor":  # what it made up is forgotten
            _forget_velocity(evidence)
    return accepted


def _news(before: Verdict, after: Verdict) -> tuple[Diagnosis, ...]:
    """What was decided in this block: new diagnoses, and a weak motor that is another one by now."""
    again = after.standing(after.renewed, ("motor",))
    return (*after.diagnoses[len(before.diagnoses) :], *([again] if again is not None else []))


def _all_slip(verdict: Verdict) -> bool:
    return any(d.kind == "all_wheel_slip" and d.cleared is None for d in verdict.diagnoses)


def _forget_velocity(evidence: Evidence) -> None:
    evidence.spread[:] = np.eye(evidence.spread.shape[1])
    evidence.counters[:, SLIPPING] = 0.0


def _begin_anew(
    motor: Diagnosis, evidence: Evidence, thresholds: Thresholds, found: Array, accepted: Array
) -> None:
    """What is wrong of a motor, loss or friction, is learnt from what was found on, in place."""
    if motor.effectiveness is None:
        return
    i, j = motor.wheels[0] - 1, motor.wheels[0] - 1 + len(accepted)
    if found[j, LIKELIHOOD] > found[i, LIKELIHOOD] + _RATHER:  # something brakes the wheel
        evidence.theta[j] += found[j, SIZE]
        _renew(evidence.cov, j, 0.5 * found[j, SIZE] + _PART_FRICTION)
        evidence.cov[i, i] += _PART_LOSS**2
        return
    accepted[i] = 1.0 - motor.effectiveness - evidence.theta[i]
    seen = found[[i, j], LIKELIHOOD].max() >= min(thresholds.motor, thresholds.drag)
    _renew(evidence.cov, i, _FOUND_AGAIN if seen else _LEARNT_AGAIN)
    evidence.cov[j, j] += _PART_FRICTION**2


def _renew(cov: Array, j: int, deviation: float) -> None:
    """Number j of θ begins anew, in place."""
    cov[j, :], cov[:, j] = 0.0, 0.0
    cov[j, j] = deviation * deviation
