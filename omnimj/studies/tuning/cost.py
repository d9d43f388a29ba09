"""What a candidate costs: terms relative to the gains before, and hard limits that go before all of them.

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
    """One of the cost's terms."""

    group: str
    weight: float
    floor: float
    """Added to the value and to that before, in the value's unit: below it nothing is gained."""


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
"""By the names of `TrialMetrics`, and `margin`: least phase margin before over that now."""
STAYS = 0.002
"""Weight of the mean square of ln(gain/gain before): what makes no difference stays as it is."""
_LEAST = 1.0  # [°] margin below which less of it is no worse to the cost: a limit says no to both
_BROKE = 10.0  # violation of a run that broke down
_OUT, _MOST = 1e3, 999.0  # cost of what breaks a limit, and the most that anything else can


@dataclass(frozen=True)
class Limits:
    """What no candidate may break; no false alarm either."""

    saturation: float = 0.5
    """Longest time at the largest current of a wheel without a fault [s]."""
    phase_margin: float = 40.0
    """Least of all loops [°]."""
    overshoot: float = 0.3
    """Largest of a wheel's speed after a step, linear about rest, as a share."""


@dataclass(frozen=True)
class Score:
    """Of one candidate over a batch of draws."""

    cost: float
    violation: float
    """0: no limit is broken."""
    terms: Mapping[str, float]
    """By name, relative to the gains before."""
    false_alarms: int
    missed: int
    saturation: float
    """Longest [s]."""
    loops: LoopStability
    """Least phase margin, largest overshoot."""
    broke: int
    """Runs that broke down."""

    @property
    def fitness(self) -> float:
        """For an optimiser: the cost, or beyond every cost by the size of the violation."""
        cost = min(self.cost, _MOST)
        return cost if self.violation == 0.0 else _OUT * (1.0 + self.violation) + cost

    def group(self, *names: str) -> float:
        """Weighted mean of the terms of some groups."""
        chosen = [name for name, term in TERMS.items() if term.group in names]
        total = sum(TERMS[name].weight for name in chosen)
        return sum(TERMS[name].weight * self.terms[name] for name in chosen) / total

    def is_better_than(self, other: Score) -> bool:
        """First by what limits are broken, then by the cost."""
        return (self.violation, self.cost) < (other.violation, other.cost)


def stability_violation(loops: LoopStability, limits: Limits) -> float:
    """By how much phase margin and overshoot miss their limits, as shares of them; 0: they do not."""
    missing = max(limits.phase_margin - loops.phase, 0.0) / limits.phase_margin
    return missing + max(loops.overshoot - limits.overshoot, 0.0) / limits.overshoot


def score_unstable(loops: LoopStability, limits: Limits) -> Score:
    """Of a candidate that is not driven, since its loops are not steady enough."""
    # what it would do beside that is not known: it comes after those whose loops are right
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
    """A candidate's score.

    Args:
      found: Facts, one per draw.
      before: The same with the gains before; none of them broke down.
      loops: How steady they are.
      loops_before: The same with the gains before.
      limits: What must hold.
      axes: What is tuned.
      values: The candidate's values along the axes.
    """
    broke = sum(one.broke is not None for one in found)
    terms = {name: _term(name, found, before) for name in TERMS if name != "margin"}
    terms["margin"] = max(loops_before.phase, _LEAST) / max(loops.phase, _LEAST)
    moved = [axis.place(value) ** 2 for axis, value in zip(axes, values, strict=True)]
    cost = sum(TERMS[name].weight * value for name, value in terms.items())
    cost += STAYS * sum(moved) / max(len(moved), 1)
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
