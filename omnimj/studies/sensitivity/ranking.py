"""Ranking of parameters, for one result and over all results."""

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
    """Sensitivity of one result to all parameters."""

    name: str
    unit: str
    nominal: float | None
    """Result with nominal parameters and the seed of the study; None if that run has none."""
    noise: float
    """Upper limit of μ* by noise alone; NaN if unknown."""
    floor: float
    """Lower limit of μ* for ranking: the larger of noise and resolution."""
    measures: tuple[EffectStatistics, ...]
    """Statistics per parameter."""
    draws: Array
    """Bootstrap samples of μ*, shape (draws, k)."""

    @property
    def verdicts(self) -> tuple[str, ...]:
        """Class of every parameter: `RANKED`, `UNSURE`, `BELOW`, `NONE` or `UNKNOWN`."""
        return tuple(classify_effect(one, self.floor) for one in self.measures)

    @property
    def ranked(self) -> tuple[int, ...]:
        """Indices of the ranked parameters, the largest μ* first."""
        ranked = [i for i, word in enumerate(self.verdicts) if word == RANKED]
        return tuple(sorted(ranked, key=lambda i: -self.measures[i].mu_star))


@dataclass(frozen=True)
class FactorRank:
    """Rank of one parameter over all results."""

    parameter: int
    share: float
    """Mean over the results of μ* relative to the sum over all parameters, 0 … 1; results in which it is not
    above the floor count as 0."""
    low: float
    """Lower 95 % bound of the share, by bootstrap over trajectories."""
    high: float
    sure: bool
    """True if the parameter is ranked for any result; otherwise more trajectories are needed."""
    most: str
    """Result in which its share is largest."""


def classify_effect(found: EffectStatistics, floor: float) -> str:
    """Classify the effect of a parameter on a result.

    `RANKED`: the interval of μ* is above the floor of the result. `UNSURE`: only μ* itself is; more
    trajectories are needed. `NONE`: every elementary effect is exactly 0.
    """
    if found.mu_star == 0.0:
        return NONE
    if found.count == 0 or isnan(floor):
        return UNKNOWN
    if found.mu_star <= floor:
        return BELOW
    return RANKED if found.low > floor else UNSURE


def rank_all(studies: Sequence[ResultSensitivity]) -> tuple[FactorRank, ...]:
    """Rank the parameters that are above the floor of any result by their mean share.

    Results without such a parameter are left out.
    """
    included = [study for study in studies if shares(study).any()]
    if not included:
        return ()
    each = np.array([shares(study) for study in included])
    draws = np.mean([_shares(study.draws, study.floor) for study in included], axis=0)
    low, high = np.percentile(draws, [2.5, 97.5], axis=0)
    mean, sure = each.mean(axis=0), {i for study in included for i in study.ranked}
    most = [included[int(place)].name for place in each.argmax(axis=0)]
    found = [
        FactorRank(i, float(mean[i]), float(low[i]), float(high[i]), i in sure, most[i])
        for i in np.flatnonzero(mean > 0.0).tolist()
    ]
    return tuple(sorted(found, key=lambda rank: -rank.share))


def shares(study: ResultSensitivity) -> Array:
    """Return μ* of every parameter above the floor relative to the sum over all, else 0, shape (k,)."""
    return _shares(np.array([[one.mu_star for one in study.measures]]), study.floor)[0]


def _shares(mu_star: Array, floor: float) -> Array:
    """Return the shares row by row; a row of zeros stays zero."""
    known = np.where(np.isfinite(mu_star), mu_star, 0.0)
    kept, sums = np.where(known > floor, known, 0.0), known.sum(axis=1, keepdims=True)
    return np.divide(kept, sums, out=np.zeros_like(kept), where=sums > 0.0)
