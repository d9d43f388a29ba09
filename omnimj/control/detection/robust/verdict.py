"""Diagnoses that were taken back leave the verdict, so that neither deciding nor memory grows with time."""

from __future__ import annotations

from dataclasses import replace

from omnimj.control.detection.robust.thresholds import Verdict
from omnimj.signals import Diagnosis

LOOKBACK = 10.0
"""Time for which a decision may look at a diagnosis that was taken back [s]."""
HISTORY_LENGTH = 1000
"""Diagnoses that were taken back and are still told; of more the oldest are forgotten."""


def archive_cleared(
    verdict: Verdict, past: tuple[Diagnosis, ...], time: float
) -> tuple[Verdict, tuple[Diagnosis, ...]]:
    """Verdict and past, with what was taken back more than `LOOKBACK` ago in the past.

    Args:
      verdict: After a block.
      past: What left it before.
      time: Of the block's end [s].
    """
    old = tuple(d for d in verdict.diagnoses if d.cleared is not None and time - d.cleared > LOOKBACK)
    if not old:
        return verdict, past
    left = tuple(d for d in verdict.diagnoses if d.cleared is None or time - d.cleared <= LOOKBACK)
    return replace(verdict, diagnoses=left), (*past, *old)[-HISTORY_LENGTH:]


def all_diagnoses(verdict: Verdict, past: tuple[Diagnosis, ...]) -> tuple[Diagnosis, ...]:
    """Both in the order in which they were decided."""
    return tuple(sorted((*past, *verdict.diagnoses), key=lambda d: d.time)) if past else verdict.diagnoses
