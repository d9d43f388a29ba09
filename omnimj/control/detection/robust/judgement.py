"""Judgement of a block: evidence, decisions if there may be any, then the fault estimate and the log.

Nearly all blocks are uneventful, or show what is diagnosed already; a kernel judges them alone. The decisions
themselves are rare and written in Python.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from omnimj.control.detection.detector import FaultEstimate
from omnimj.control.detection.robust.accommodation import (
    KnownFaults,
    accommodate,
    accommodation_for,
    estimate_faults,
    known_faults,
    no_known_faults,
    substitute_sensors,
)
from omnimj.control.detection.robust.answered import Answered, answered_by, is_answered, nothing_answered
from omnimj.control.detection.robust.blocks import failed_channels, move_to_centre, take_block
from omnimj.control.detection.robust.decision import decide, is_uneventful
from omnimj.control.detection.robust.evidence import (
    Evidence,
    RobustParameters,
    restart_evidence,
    update_evidence,
)
from omnimj.control.detection.robust.thresholds import Thresholds
from omnimj.control.detection.robust.verdict import Verdict, archive_cleared
from omnimj.control.records import Record, assign, opened
from omnimj.physics.native import kernel
from omnimj.signals import Array, Diagnosis

HEALTHY, SUSPECT, FAULTY, BLIND = range(4)
"""`mode` of the log: no fault, a decision is pending, a fault is diagnosed, cannot judge."""
_RELEARNING_BLOCKS = 200


class Judgement(NamedTuple):
    """Conclusions of the detector from its blocks, n wheels."""

    known: KnownFaults
    answered: Answered
    losses: Array
    """Diagnosed losses of the torque constants, shape (n,)."""
    relearning: int
    """Blocks for which a new loss is still being measured: they are learnt from at once."""
    estimate: FaultEstimate
    log: Array
    """Signals aligned with `RobustDetector.log_names`."""
    likelihood: Array
    """Largest Λ of a loss or a friction of each wheel in the last block, shape (n,) [nats]; that of the
    friction is scaled by the ratio of their thresholds."""
    failed: NDArray[np.bool_]
    """Channels that are frozen or too noisy, shape (2n+3,)."""
    moving: bool = False
    """True if the robot moves enough to be judged."""
    blocks: int = 0
    """Blocks until now, with those that could not be judged."""
    restarted: bool = False
    """True if the last block was the first one after a gap, which cannot be judged."""


def log_names(wheels: int) -> tuple[str, ...]:
    """Names of the logged signals of a robot with n wheels."""
    names = [
        f"{kind}_{what}_{i}"
        for what in ("motor", "slip")
        for kind in ("residual", "threshold")
        for i in range(1, wheels + 1)
    ]
    body = ("residual_force_x", "residual_force_y", "residual_moment")
    return (*body, *names, *(f"effectiveness_{i}" for i in range(1, wheels + 1)), "misfit", "mode")


def initial_judgement(wheels: int, thresholds: Thresholds) -> Judgement:
    """Judgement of a healthy robot before the first block."""
    n, zeros, none = wheels, np.zeros(wheels), np.zeros(wheels, bool)
    log = np.zeros(len(log_names(n)))
    log[3 + n : 3 + 2 * n], log[3 + 3 * n : 3 + 4 * n] = thresholds.motor, thresholds.slip
    log[3 + 4 * n : 3 + 5 * n] = 1.0
    return Judgement(
        known=no_known_faults(n),
        answered=nothing_answered(n),
        losses=zeros,
        relearning=0,
        estimate=FaultEstimate(zeros, none, none, none, none, np.zeros(2), zeros, -np.inf),
        log=log,
        likelihood=zeros,
        failed=np.zeros(2 * n + 3, bool),
    )


@kernel
def judge_block(constants, samples, memory, x, yaw, time):
    """Judge a full block as far as no decision is needed.

    Args:
      constants: Record of `RobustParameters`.
      samples: `Samples` with a full block, emptied in place.
      memory: Record of `Evidence`, changed in place.
      x: `Judgement`, changed in place.
      yaw: Heading at the block's end [rad].
      time: End of the block [s].

    Returns:
      Whether `decide_block` has to follow.
    """
    parameters, evidence = opened(constants, RobustParameters), opened(memory, Evidence)
    n, likelihood, gap = x.losses.size, evidence.scores.likelihood, samples.gap
    block = take_block(samples, parameters.sample_period)
    block = substitute_sensors(parameters, block, evidence, x.known)
    move_to_centre(parameters.robot.accelerometer, block)
    accommodation = accommodation_for(x.known, x.losses, x.relearning > 0)
    x.restarted = gap > 0.0
    if gap > 0.0:
        restart_evidence(parameters.robot, block, gap, accommodation.included, evidence)
        x.moving, x.likelihood[:] = False, 0.0
        x.blocks += 1
        conclude(evidence, x)
        return x.known.pending != 0  # a suspicion does not outlast a gap
    x.moving = update_evidence(parameters, block, accommodation, evidence, yaw)
    failed_channels(samples.steps, block.wheel_speed, x.failed)
    limits, scale = parameters.thresholds, 1.0
    if limits.drag != limits.motor:  # what is logged exceeds the logged threshold wherever a test decides
        scale = limits.motor / limits.drag
    for i in range(n):
        x.likelihood[i] = max(likelihood[i], scale * likelihood[n + i])
    x.blocks += 1
    if x.known.observed:
        if not is_answered(parameters.thresholds, evidence, x, time):
            return True
    elif not is_uneventful(parameters.thresholds, evidence, x.failed):
        return True
    if x.moving:
        x.relearning = max(x.relearning - 1, 0)
    conclude(evidence, x)
    return False


@kernel
def conclude(evidence, x):
    """Fill the fault estimate and the log after a block.

    Args:
      evidence: `Evidence`.
      x: `Judgement`, changed in place.
    """
    n, log, known = x.losses.size, x.log, x.known
    losses = x.losses + evidence.theta[:n]
    estimate_faults(evidence, known, losses, x.estimate)
    log[:3] = evidence.residual
    for i in range(n):
        log[3 + i], log[3 + 2 * n + i] = x.likelihood[i], evidence.monitors.slipped[i]
        gone = x.estimate.dead[i] or x.estimate.held[i]
        log[3 + 4 * n + i] = 0.0 if gone else min(max(1.0 - losses[i], 0.0), 1.0)
    mode = HEALTHY if x.moving else BLIND
    if known.active:
        mode = FAULTY
    elif known.pending:
        mode = SUSPECT
    log[3 + 5 * n], log[4 + 5 * n] = math.sqrt(evidence.misfit[0]) if x.moving else 0.0, mode


@kernel
def _conclude(memory, judged):
    conclude(opened(memory[0], Evidence), judged[0])


class Decisions(NamedTuple):
    """Diagnoses of the detector."""

    verdict: Verdict = Verdict()
    history: tuple[Diagnosis, ...] = ()
    """Withdrawn diagnoses that have left the verdict."""


def decide_block(
    thresholds: Thresholds,
    memory: Record,
    judged: Record,
    before: Decisions,
    time: float,
    channels: Sequence[str],
) -> Decisions:
    """Decide after a block that `judge_block` has left undecided, and finish its judgement.

    Args:
      thresholds: Values from which a suspicion becomes a decision.
      memory: Record of `Evidence` after the block, changed in place.
      judged: Record of `Judgement`, changed in place.
      before: Decisions until now.
      time: End of the block [s].
      channels: Names of the sensor channels.
    """
    x: Any = judged[0]
    losses, relearning = x["losses"], int(x["relearning"])
    n, verdict, evidence = len(losses), before.verdict, opened(memory, Evidence)
    failed = tuple(c for c, has_failed in zip(channels, x["failed"].tolist(), strict=True) if has_failed)
    if x["restarted"]:
        after = replace(verdict, suspected=math.nan)
    else:
        estimated = losses + evidence.theta[:n]
        after = decide(evidence, thresholds, verdict, time, estimated, failed, relearning > 0)
    changed = accommodate(evidence, thresholds, verdict, after, losses)
    if changed is losses:
        x["relearning"] = max(relearning - int(x["moving"]), 0)
    else:
        x["losses"], x["relearning"] = changed, _RELEARNING_BLOCKS
    archived, history = archive_cleared(after, before.history, time)
    assign(judged["known"], known_faults(archived, n))
    assign(judged["answered"], answered_by(archived, n, channels))
    _conclude(memory, judged)
    return Decisions(archived, history)
