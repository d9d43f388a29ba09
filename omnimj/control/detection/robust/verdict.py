"""The verdict: active and recent diagnoses, on which decisions depend, and the history of older ones.

Withdrawn diagnoses leave the verdict after a while, so that neither deciding nor memory grows with time.
"""

from __future__ import annotations

import math
from collections.abc import Collection
from dataclasses import dataclass, replace

from omnimj.signals import KINDS_OF_DIAGNOSIS, Diagnosis

LOOKBACK = 10.0
"""Time for which a decision may look at a withdrawn diagnosis [s]."""
HISTORY_LENGTH = 1000
"""Withdrawn diagnoses that are kept; of more the oldest are dropped."""


@dataclass(frozen=True)
class Verdict:
    """Active and recently withdrawn diagnoses, and a pending suspicion."""

    diagnoses: tuple[Diagnosis, ...] = ()
    """In the order of their decision."""
    suspected: float = math.nan
    """Beginning of the force channel's present suspicion [s]; NaN: none."""
    renewed: int = 0
    """Wheel 1…n of a known degraded motor whose loss has jumped again in this block; 0: none."""

    def has_active(self) -> bool:
        """True if any diagnosis is active."""
        return any(d.cleared is None for d in self.diagnoses)

    def active_on(self, wheel: int, kinds: Collection[str] = KINDS_OF_DIAGNOSIS) -> Diagnosis | None:
        """Newest active diagnosis of some kinds on a wheel 1…n."""
        for diagnosis in reversed(self.diagnoses):
            if diagnosis.cleared is None and wheel in diagnosis.wheels and diagnosis.kind in kinds:
                return diagnosis
        return None

    def failed_channels(self) -> set[str]:
        """Sensor channels that are diagnosed."""
        return {d.channel for d in self.diagnoses if d.channel and d.cleared is None}

    def has_sensor_fault(self, channel: str) -> bool:
        """True if a sensor channel is diagnosed."""
        return channel in self.failed_channels()


def is_stalled(diagnosis: Diagnosis) -> bool:
    """True if a diagnosis says that a wheel stands, locked or for lack of torque."""
    return diagnosis.kind == "motor" and diagnosis.ambiguous_with == (f"locked {diagnosis.wheels[0]}",)


def is_degraded(diagnosis: Diagnosis) -> bool:
    """True if a diagnosis says that a motor has lost torque only: its wheel may slip as well."""
    return diagnosis.kind == "motor" and not is_stalled(diagnosis)


def _can_coexist(known: Diagnosis, new: Diagnosis) -> bool:
    """True if a known diagnosis stays active beside a new one on the same wheel."""
    two_sensors = known.kind == new.kind == "sensor" and known.channel != new.channel
    return two_sensors or (is_degraded(known) and new.kind == "slip")


def with_diagnosis(verdict: Verdict, diagnosis: Diagnosis) -> Verdict:
    """Add a diagnosis; it replaces a lesser one on the same wheel, but a degraded motor's wheel may slip."""
    known = verdict.active_on(diagnosis.wheels[0], ("motor",)) if diagnosis.wheels else None
    if known is not None and diagnosis.kind == "motor" and not known.ambiguous_with:
        same = replace(known, effectiveness=diagnosis.effectiveness)
        diagnoses = tuple(same if d is known else d for d in verdict.diagnoses)
        return Verdict(diagnoses, math.nan, diagnosis.wheels[0])
    kept = [
        replace(d, cleared=diagnosis.time)
        if d.cleared is None and d.wheels == diagnosis.wheels != () and not _can_coexist(d, diagnosis)
        else d
        for d in verdict.diagnoses
    ]
    return replace(verdict, diagnoses=(*kept, diagnosis), suspected=math.nan)


def archive_cleared(
    verdict: Verdict, history: tuple[Diagnosis, ...], time: float
) -> tuple[Verdict, tuple[Diagnosis, ...]]:
    """Move diagnoses that were withdrawn more than `LOOKBACK` ago from the verdict to the history.

    Args:
      verdict: After a block.
      history: Withdrawn diagnoses that left it before.
      time: End of the block [s].
    """
    old = tuple(d for d in verdict.diagnoses if d.cleared is not None and time - d.cleared > LOOKBACK)
    if not old:
        return verdict, history
    left = tuple(d for d in verdict.diagnoses if d.cleared is None or time - d.cleared <= LOOKBACK)
    return replace(verdict, diagnoses=left), (*history, *old)[-HISTORY_LENGTH:]


def all_diagnoses(verdict: Verdict, history: tuple[Diagnosis, ...]) -> tuple[Diagnosis, ...]:
    """Diagnoses of verdict and history in the order of their decision."""
    if not history:
        return verdict.diagnoses
    return tuple(sorted((*history, *verdict.diagnoses), key=lambda d: d.time))
