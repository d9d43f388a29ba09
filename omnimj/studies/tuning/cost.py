"""Cost of a candidate: terms relative to the gains before, and hard limits with priority over all terms.

Each term is the mean over the draws of (value + floor)/(value before + floor), so that every draw counts
alike and the gains before cost the sum of the weights, 1. A candidate that breaks a limit is worse than every
one that breaks none; among those that do, the smaller violation is better.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from types import MappingProxyType

import numpy as np

from omnimj.signals import Array
from omnimj.studies.tuning.margins import LoopStability
from omnimj.studies.tuning.search import Candidate, GainAxis
from omnimj.studies.tuning.trial import TrialMetrics

TRACKING, EFFORT, SLIP, DETECTION, MARGINS = "tracking", "effort", "slip", "detection", "margins"
MOVE_WEIGHT = 0.002
"""Weight of the mean square of ln(gain/gain before), which keeps gains without effect unchanged."""
_MIN_MARGIN = 1.0  # [°] smallest margin in the cost term; a limit rejects smaller ones anyway
_BROKE = 10.0  # violation of a run that failed
_INFEASIBLE, _MAX_COST = 1e3, 999.0  # fitness from which a limit is violated; largest other cost
REACH = 1.5
"""Factor by which a grid extends above and below the result."""
_PAIRS = 2


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


@dataclass(frozen=True)
class Landscape:
    """Scores on a grid over two gains."""

    across: GainAxis
    up: GainAxis
    x: tuple[float, ...]
    """Values of the gain `across`."""
    y: tuple[float, ...]
    """Values of the gain `up`."""
    scores: tuple[tuple[Score, ...], ...]
    """Scores, one row per value of `up`."""
    found: tuple[float, float]
    """Values of both gains in the result."""


def survey_landscape(
    axes: Sequence[GainAxis],
    values: Candidate,
    tried: Sequence,
    points: int,
    scores_of: Callable[[Sequence[Candidate]], list[Score]],
) -> tuple[Landscape, ...]:
    """Survey the cost around the result over the pairs of the most important gains."""
    slices = [
        (a, b, _around(axes[a], values[a], points), _around(axes[b], values[b], points))
        for a, b in most_important_pairs(importance(axes, tried))
    ]
    grids = [[tuple(_replaced(values, a, x, b, y) for x in xs) for y in ys] for a, b, xs, ys in slices]
    flat = [one for grid in grids for row in grid for one in row]
    scores = dict(zip(flat, scores_of(flat), strict=True)) if flat else {}
    return tuple(
        Landscape(
            axes[a],
            axes[b],
            xs,
            ys,
            tuple(tuple(scores[one] for one in row) for row in grid),
            (values[a], values[b]),
        )
        for (a, b, xs, ys), grid in zip(slices, grids, strict=True)
    )


def importance(axes: Sequence[GainAxis], tried: Sequence) -> Array:
    """Return |Spearman's ρ| of each gain with the fitness over all candidates, shape (axes,)."""
    if len(tried) < 3:
        return np.zeros(len(axes))
    ranks = _ranks(np.array([one.score.fitness for one in tried]))
    places = np.array([[axis.place(v) for axis, v in zip(axes, one.values, strict=True)] for one in tried])
    found = np.zeros(len(axes))
    for k, column in enumerate(places.T):
        own = _ranks(column)
        if own.std() > 0.0 and ranks.std() > 0.0:
            found[k] = abs(float(np.corrcoef(own, ranks)[0, 1]))
    return found


def most_important_pairs(weights: Array) -> list[tuple[int, int]]:
    """Return the pairs of the most important gains.

    Args:
      weights: Importance, shape (axes,).

    Returns:
      The first with the second and the third with the fourth; of three gains, the first with both others.
    """
    order = [int(k) for k in np.argsort(-weights, kind="stable")]
    if len(order) == 3:
        return [(order[0], order[1]), (order[0], order[2])]
    return [(order[k], order[k + 1]) for k in range(0, min(2 * _PAIRS, len(order)) - 1, 2)]


def _ranks(values: Array) -> Array:
    return np.argsort(np.argsort(values, kind="stable"), kind="stable").astype(float)


def _around(axis: GainAxis, value: float, points: int) -> tuple[float, ...]:
    low, high = max(value / REACH, axis.low), min(value * REACH, axis.high)
    return tuple(float(f"{v:.5g}") for v in np.geomspace(low, high, points))


def _replaced(values: Candidate, a: int, x: float, b: int, y: float) -> Candidate:
    found = list(values)
    found[a], found[b] = x, y
    return tuple(found)
