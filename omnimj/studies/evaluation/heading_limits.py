"""Whether recovery keeps the heading: a limit for every case, on the ratio or on what is added.

A ratio is meaningless where the heading hardly moves without recovery; there the added excursion is limited.
Where too few wheels are left to hold it, the recovery gives the heading up for the path by design: such cases
are counted apart, provided that the faults were isolated.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

from omnimj.studies.evaluation.scoring import CaseScore

LARGE = math.radians(0.5)
"""Heading excursion without recovery from which the ratio is limited [rad]."""
MAX_RATIO = 1.05
"""Largest ratio of the excursion with recovery to that without."""
MAX_ADDED = math.radians(0.05)
"""Largest excursion that recovery may add below `LARGE` [rad]."""


@dataclass(frozen=True)
class HeadingLimits:
    """Cases with faults whose heading the recovery should hold."""

    large: int
    """Number of cases with an excursion of `LARGE` or more without recovery."""
    worst_ratio: float | None
    """Largest ratio among them."""
    worst_ratio_case: str
    """Name of that case; empty without any."""
    small: int
    """Number of the other cases."""
    worst_added: float | None
    """Largest added excursion among them; negative if recovery reduces all [rad]."""
    worst_added_case: str
    beyond: tuple[str, ...]
    """Names of the cases beyond either limit."""
    given_up: int
    """Number of cases whose heading is given up by design, excluded from all other numbers."""


def summarize_heading(scores: Sequence[CaseScore]) -> HeadingLimits:
    """Compare the heading of every case with both excursions, with and without recovery, with its limit."""
    ratios, added, given_up = [], [], 0
    for s in scores:
        if s.heading is None or s.heading_off is None:
            continue
        if s.gave_up_heading:
            given_up += 1
        elif s.heading_off >= LARGE:
            ratios.append((s.heading / s.heading_off, s.name))
        else:
            added.append((s.heading - s.heading_off, s.name))
    beyond = [name for value, name in ratios if value > MAX_RATIO]
    beyond += [name for value, name in added if value > MAX_ADDED]
    most, where = max(ratios, default=(None, ""))
    more, place = max(added, default=(None, ""))
    return HeadingLimits(len(ratios), most, where, len(added), more, place, tuple(sorted(beyond)), given_up)
