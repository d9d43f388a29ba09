"""Blocks beside known diagnoses that change none of them, recognised without the decisions themselves.

Every diagnosis makes the decisions look at each following block, and nearly all of these blocks change
nothing. What the verdict means for each test is kept as masks, so that a kernel recognises such a block; it
leaves a block to the decisions whenever it is not sure.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from omnimj.control.detection.robust.accommodation import DEAD, mark_wheels
from omnimj.control.detection.robust.decision import EFFECTIVENESS_STEP, FORGOTTEN_SLIP, may_slip
from omnimj.control.detection.robust.evidence import CONVERTER
from omnimj.control.detection.robust.parameter_filter import significant_losses
from omnimj.control.detection.robust.verdict import LOOKBACK, Verdict, is_stalled
from omnimj.physics.native import kernel
from omnimj.signals import Array, Diagnosis


class Answered(NamedTuple):
    """Tests that active diagnoses already explain, n wheels; masks have shape (n,) unless noted."""

    channels: NDArray[np.bool_]
    """Diagnosed sensor channels, shape (2n+3,)."""
    yaw: bool
    """True if gyro or converter is diagnosed."""
    amplifier: NDArray[np.bool_]
    """Wheels whose currents are judged no further."""
    standing: NDArray[np.bool_]
    """Wheels that may stand."""
    stalled: NDArray[np.bool_]
    """Wheels that may stand while their motors push."""
    held: NDArray[np.bool_]
    """Locked or pushed by their motors: no motor is blamed on their missing force."""
    diagnosed: NDArray[np.bool_]
    """Wheels with any active diagnosis."""
    slip: NDArray[np.bool_]
    """Wheels whose slip is explained."""
    regains: NDArray[np.bool_]
    """Slipping wheels, whose grip may return."""
    turns: NDArray[np.bool_]
    """Standing wheels, which may turn again."""
    effectiveness: Array
    """Diagnosed effectiveness that the estimated loss refines; NaN: none. Shape (n,)."""
    cleared: float = math.inf
    """Time at which the oldest of the withdrawn diagnoses was withdrawn [s]; ∞: none."""
    changing: bool = False
    """True if the next block must be decided whatever it shows."""


def nothing_answered(wheels: int) -> Answered:
    """Answers of a verdict without diagnoses."""
    masks = {name: np.zeros(wheels, bool) for name in Answered._fields[2:10]}
    channels, unknown = np.zeros(2 * wheels + 3, bool), np.full(wheels, np.nan)
    return Answered(**{**masks, "channels": channels, "effectiveness": unknown, "yaw": False})


def answered_by(verdict: Verdict, wheels: int, channels: Sequence[str]) -> Answered:
    """Answers of a verdict for a robot with the given sensor channels."""
    found, failed = nothing_answered(wheels), verdict.failed_channels()
    found.channels[:] = [channel in failed for channel in channels]
    active = [d for d in verdict.diagnoses if d.cleared is None]
    for d in active:
        _mark(found, d)
    everywhere = any(d.kind == "all_wheel_slip" for d in active)
    holds = bool(found.held.any())
    for i in range(wheels):
        newest = verdict.active_on(i + 1)
        kind = "" if newest is None else newest.kind
        speed = f"wheel_speed_{i + 1}" in failed
        found.amplifier[i] = kind in ("free", "hard_over") or speed or f"current_{i + 1}" in failed
        found.standing[i] = holds or kind == "free" or (kind != "" and speed)
        found.stalled[i], found.diagnosed[i] = found.standing[i] or kind != "", kind != ""
        found.slip[i] = everywhere or not may_slip(verdict, i + 1)
    withdrawn = [d.cleared for d in verdict.diagnoses if d.cleared is not None]
    return found._replace(
        yaw="yaw_rate" in failed or "yaw" in failed,
        cleared=min(withdrawn, default=math.inf),
        changing=verdict.renewed != 0 or not math.isnan(verdict.suspected),
    )


def _mark(found: Answered, d: Diagnosis) -> None:
    """Mark the wheels of an active diagnosis, in place."""
    if d.kind == "all_wheel_slip":
        found.regains[:] = True
    marked = (
        (found.regains, d.kind == "slip"),
        (found.turns, d.kind == "locked" or is_stalled(d)),
        (found.held, d.kind in ("locked", "hard_over")),
    )
    mark_wheels(d, marked)
    if d.kind == "motor" and not d.ambiguous_with and d.effectiveness is not None:
        found.effectiveness[d.wheels[0] - 1] = d.effectiveness


@kernel
def is_answered(thresholds, evidence, x, time):
    """True if `decide` would return the verdict that it got and leave the mode of recovery alone.

    Args:
      thresholds: `Thresholds` as floats.
      evidence: `Evidence` after the block.
      x: `Judgement` before the conclusions of the block.
      time: End of the block [s].
    """
    known, answered, n = x.known, x.answered, x.losses.size
    likelihood, other = evidence.scores.likelihood, thresholds.other if known.active else 1.0
    if answered.changing or time - answered.cleared > LOOKBACK:
        return False
    for k in range(x.failed.size):
        if x.failed[k] and not answered.channels[k]:
            return False
    if not answered.yaw and not abs(evidence.yaw[CONVERTER]) <= 0.4 * thresholds.turning:
        return False
    if not max(likelihood[2 * n], likelihood[2 * n + 1]) < other * thresholds.accelerometer:
        return False
    learnt = significant_losses(evidence.theta, evidence.cov, n)
    for i in range(n):
        if not answered.held[i] and not (
            likelihood[i] < thresholds.motor and likelihood[n + i] < thresholds.drag
        ):
            return False
        if learnt[i] > other * thresholds.worn and not answered.diagnosed[i]:
            return False
        if _wheel_asks(thresholds, evidence.monitors, known, answered, i, other):
            return False
        if _loss_asks(known, answered, x.estimate, x.losses[i] + evidence.theta[i], i):
            return False
    return True


@kernel
def _wheel_asks(thresholds, monitors, known, answered, i, other):
    """True if what the monitors say of wheel i may begin or end a diagnosis."""
    if not answered.amplifier[i] and (
        monitors.silent[i] >= thresholds.current or monitors.disobeying[i] >= thresholds.current
    ):
        return True
    if not answered.standing[i] and monitors.stuck[i] >= thresholds.stuck:
        return True
    if not answered.stalled[i] and monitors.stalled[i] >= thresholds.stuck:
        return True
    if answered.turns[i] and monitors.turning[i] >= thresholds.released:
        return True
    if answered.regains[i] and (
        monitors.regained[i] >= thresholds.healthy and monitors.slipped[i] < FORGOTTEN_SLIP
    ):
        return True
    if not answered.slip[i] and monitors.slipped[i] >= other * thresholds.slip:
        return True
    return not known.active and monitors.implausible[i] >= thresholds.odd


@kernel
def _loss_asks(known, answered, estimate, loss, i):
    """True if the estimated loss of motor i refines its diagnosis or makes a dead motor of it, or no more."""
    left = min(max(1.0 - loss, 0.0), 1.0)
    if abs(left - answered.effectiveness[i]) > EFFECTIVENESS_STEP:  # never with NaN: nothing to refine
        return True
    weak = known.weak[i] != 0
    dead = known.powerless[i] != 0 or (weak and loss > DEAD)
    lost = weak and loss != 0.0
    return dead != (estimate.dead[i] != 0) or lost != (estimate.losses[i] != 0.0)
