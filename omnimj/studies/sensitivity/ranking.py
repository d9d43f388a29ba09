"""Which parameters matter: to one result, and over all results together."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from math import isnan

import numpy as np

from omnimj.signals import Array
from omnimj.studies.sensitivity.elementary_effects import EffectStatistics

RANKED, UNSURE, BELOW, NONE, UNKNOWN = "ranked", "unsure", "below the floor", "no effect", "not known"


@dataclass(frozen=True)
class ResultSensitivity:
    """What the parameters do to one result."""

    name: str
    unit: str
    nominal: float | None
    """With the numbers of the model files and the study's own seed; None where that run has none."""
    noise: float
    """μ* that noise alone does not reach; NaN where that is not known."""
    floor: float
    """μ* that is not ranked: what noise alone reaches, or what nobody could tell."""
    measures: tuple[EffectStatistics, ...]
    """Of every parameter, in their order."""
    draws: Array
    """Bootstrap of μ*, shape (draws, k)."""

    @property
    def verdicts(self) -> tuple[str, ...]:
        """Of every parameter `RANKED`, `UNSURE`, `BELOW`, `NONE` or `UNKNOWN`."""
        return tuple(classify_effect(one, self.floor) for one in self.measures)

    @property
    def ranked(self) -> tuple[int, ...]:
        """The ranked parameters, the largest μ* first."""
        ranked = [i for i, word in enumerate(self.verdicts) if word == RANKED]
        return tuple(sorted(ranked, key=lambda i: -self.measures[i].mu_star))


@dataclass(frozen=True)
class FactorRank:
    """What one parameter is worth over all results."""

    parameter: int
    share: float
    """Mean over the results of μ* as a share of the sum over all parameters, 0 … 1; nothing where it is not
    above the floor."""
    low: float
    """Lower bound of it, 95 %, by bootstrap over trajectories."""
    high: float
    sure: bool
    """Whether it is ranked for any result; otherwise a few trajectories made it, more would tell."""
    most: str
    """The result where its share is largest."""


def classify_effect(found: EffectStatistics, floor: float) -> str:
    """What can be said of a parameter and a result.

    `RANKED`: all of μ*'s interval is above the floor of the result. `UNSURE`: μ* alone is; a few trajectories
    made it, more would tell. `NONE`: exactly nothing happened, ever.
    """
    if found.mu_star == 0.0:
        return NONE
    if found.count == 0 or isnan(floor):
        return UNKNOWN
    if found.mu_star <= floor:
        return BELOW
    return RANKED if found.low > floor else UNSURE


def rank_all(studies: Sequence[ResultSensitivity]) -> tuple[FactorRank, ...]:
    """Parameters that are above the floor of any result, the largest mean share first.

    Results where nothing is have no say.
    """
    heard = [study for study in studies if shares(study).any()]
    if not heard:
        return ()
    each = np.array([shares(study) for study in heard])
    draws = np.mean([_shares(study.draws, study.floor) for study in heard], axis=0)
    low, high = np.percentile(draws, [2.5, 97.5], axis=0)
    mean, sure = each.mean(axis=0), {i for study in heard for i in study.ranked}
    most = [heard[int(place)].name for place in each.argmax(axis=0)]
    found = [
        FactorRank(i, float(mean[i]), float(low[i]), float(high[i]), i in sure, most[i])
        for i in np.flatnonzero(mean > 0.0).tolist()
    ]
    return tuple(sorted(found, key=lambda rank: -rank.share))


def shares(study: ResultSensitivity) -> Array:
    """μ* of every parameter above the floor as a share of the sum over all, 0 for the others, shape (k,)."""
    return _shares(np.array([[one.mu_star for one in study.measures]]), study.floor)[0]


def _shares(mu_star: Array, floor: float) -> Array:
    """Row by row; a row without anything is all zero."""
    known = np.where(np.isfinite(mu_star), mu_star, 0.0)
    kept, sums = np.where(known > floor, known, 0.0), known.sum(axis=1, keepdims=True)
    return np.divide(kept, sums, out=np.zeros_like(kept), where=sums > 0.0)
