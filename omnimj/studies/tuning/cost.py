"""Cost of a candidate: terms relative to the gains before, and hard limits with priority over all terms.

Each term is the mean over the draws of (value + floor)/(value before + floor), so that every draw counts
alike and the gains before cost the sum of the weights, 1. A candidate that breaks a limit is worse than every
one that breaks none; among those that do, the smaller violation is better.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from types import MappingProxyType

from omnimj.studies.tuning.margins import LoopStability
from omnimj.studies.tuning.search import GainAxis
from omnimj.studies.tuning.trial import TrialMetrics

TRACKING, EFFORT, SLIP, DETECTION, MARGINS = "tracking", "effort", "slip", "detection", "margins"


@dataclass(frozen=True)
class Term:
    """Term of the cost."""

    group: str
    weight: float
    floor: float
    """Offset of both values, in their unit; improvements of values far below it count little."""


TERMS: Mapping[str, Term] = MappingProxyType(
    {
        "path": Term(TRACKING, 0.15, 0.005),
        "velocity": Term(TRACKING, 0.10, 0.005),
        "heading": Term(TRACKING, 0.15, 0.0015),
        "current": Term(EFFORT, 0.10, 0.02),
        "current_rate": Term(EFFORT, 0.10, 2.0),
        "slip": Term(SLIP, 0.10, 0.005),
        "delay": Term(DETECTION, 0.15, 0.05),
        "margin": Term(MARGINS, 0.15, 0.0),
    }
)
"""Terms by the names of `TrialMetrics`, and `margin`: smallest phase margin before over that now."""
MOVE_WEIGHT = 0.002
"""Weight of the mean square of ln(gain/gain before), which keeps gains without effect unchanged."""
_MIN_MARGIN = 1.0  # [°] smallest margin in the cost term; a limit rejects smaller ones anyway
_BROKE = 10.0  # violation of a run that failed
_INFEASIBLE, _MAX_COST = 1e3, 999.0  # fitness from which a limit is violated; largest other cost


@dataclass(frozen=True)
class Limits:
    """Limits of a candidate; a false alarm violates them too."""

    saturation: float = 0.5
    """Longest time at the current limit of a wheel without a fault [s]."""
    phase_margin: float = 40.0
    """Smallest phase margin of all loops [°]."""
    overshoot: float = 0.3
    """Largest overshoot of the wheel speed after a step, linear about rest, relative to the step."""


@dataclass(frozen=True)
class Score:
    """Score of one candidate over a batch of draws."""

    cost: float
    violation: float
    """Violation of the limits; 0: none."""
    terms: Mapping[str, float]
    """Terms by name, relative to the gains before."""
    false_alarms: int
    missed: int
    saturation: float
    """Longest time at the current limit [s]."""
    loops: LoopStability
    """Smallest phase margin and largest overshoot."""
    broke: int
    """Number of runs that failed."""

    @property
    def fitness(self) -> float:
        """Scalar for the optimiser: the cost; with a violation, larger than every cost by the violation."""
        cost = min(self.cost, _MAX_COST)
        return cost if self.violation == 0.0 else _INFEASIBLE * (1.0 + self.violation) + cost

    def group(self, *names: str) -> float:
        """Return the weighted mean of the terms in some groups."""
        chosen = [name for name, term in TERMS.items() if term.group in names]
        total = sum(TERMS[name].weight for name in chosen)
        return sum(TERMS[name].weight * self.terms[name] for name in chosen) / total

    def is_better_than(self, other: Score) -> bool:
        """Compare by the violation first, then by the cost."""
        return (self.violation, self.cost) < (other.violation, other.cost)


def stability_violation(loops: LoopStability, limits: Limits) -> float:
    """Return the violation of the limits of phase margin and overshoot, relative to the limits; 0: none."""
    missing = max(limits.phase_margin - loops.phase, 0.0) / limits.phase_margin
    return missing + max(loops.overshoot - limits.overshoot, 0.0) / limits.overshoot


def score_unstable(loops: LoopStability, limits: Limits) -> Score:
    """Return the score of a candidate that is not driven, since its loops violate the limits."""
    # its other violations are unknown, so it ranks behind all candidates with stable loops
    violation = _BROKE + stability_violation(loops, limits)
    terms = dict.fromkeys(TERMS, math.inf)
    return Score(math.inf, violation, MappingProxyType(terms), 0, 0, 0.0, loops, 0)


def score(
    found: Sequence[TrialMetrics],
    before: Sequence[TrialMetrics],
    loops: LoopStability,
    loops_before: LoopStability,
    limits: Limits,
    axes: Sequence[GainAxis] = (),
    values: Sequence[float] = (),
) -> Score:
    """Score a candidate by its metrics and those of the gains before, one each per draw."""
    broke = sum(one.broke is not None for one in found)
    terms = {name: _term(name, found, before) for name in TERMS if name != "margin"}
    terms["margin"] = max(loops_before.phase, _MIN_MARGIN) / max(loops.phase, _MIN_MARGIN)
    moved = [axis.place(value) ** 2 for axis, value in zip(axes, values, strict=True)]
    cost = sum(TERMS[name].weight * value for name, value in terms.items())
    cost += MOVE_WEIGHT * sum(moved) / max(len(moved), 1)
    over = [
        max(one.saturation - limits.saturation, 0.0) / limits.saturation for one in found if one.broke is None
    ]
    alarms = sum(one.false_alarms for one in found)
    violation = _BROKE * broke + sum(over) + alarms + stability_violation(loops, limits)
    return Score(
        cost,
        violation,
        MappingProxyType(terms),
        alarms,
        sum(one.missed for one in found),
        max((one.saturation for one in found), default=0.0),
        loops,
        broke,
    )


def _term(name: str, found: Sequence[TrialMetrics], before: Sequence[TrialMetrics]) -> float:
    floor, ratios = TERMS[name].floor, []
    for now, then in zip(found, before, strict=True):
        value, usual = getattr(now, name), getattr(then, name)
        if now.broke is not None:
            ratios.append(math.inf)
        elif value is not None and usual is not None:
            ratios.append((value + floor) / (usual + floor))
    return sum(ratios) / len(ratios) if ratios else 1.0
