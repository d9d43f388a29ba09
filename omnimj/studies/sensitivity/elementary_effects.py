"""Elementary effects (Morris 1991): trajectories, μ, μ* and σ with intervals, floor set by noise, ranking.

An elementary effect is the change of a result over the share of its range by which one parameter moved, so it
has the unit of the result: the change across the whole range. μ is their mean, μ* that of their absolute
values (Campolongo, Cariboni and Saltelli 2007), σ their standard deviation, which is large where the
parameter acts nonlinearly or together with others.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np

from omnimj.signals import Array

LEVELS = 4
"""Number p of levels per range: 0, 1/3, 2/3 and 1."""
_JUMP = LEVELS // 2
STEP = _JUMP / (LEVELS - 1)
"""Step Δ = p/(2(p − 1)), with which all levels are visited equally often."""
_DRAWS = 2000
_TAIL = 2.5  # [%] on either side of an interval
_NULL_DRAWS = 20_000
_CHANCE = 0.05  # probability that noise alone puts any parameter of a result above its floor
RANKED, UNSURE, BELOW, NONE, UNKNOWN = "ranked", "unsure", "below the floor", "no effect", "not known"


def trajectory(seed: int, index: int, parameters: int) -> Array:
    """Draw a trajectory of k + 1 points; from each point to the next one parameter moves by ±Δ.

    Order, direction and starting point are random; each parameter moves once.

    Args:
      seed: Seed of the study.
      index: Number of the trajectory, from 0; it does not depend on the number of trajectories.
      parameters: k.

    Returns:
      Places in the ranges, shape (k + 1, k).
    """
    random = np.random.default_rng(np.random.SeedSequence(seed, spawn_key=(index,)))
    rising = random.random(parameters) < 0.5
    levels = random.integers(0, LEVELS - _JUMP, parameters) + np.where(rising, 0, _JUMP)
    points = np.tile(levels, (parameters + 1, 1))
    for k, moved in enumerate(random.permutation(parameters), start=1):
        points[k:, moved] += _JUMP if rising[moved] else -_JUMP
    return points / (LEVELS - 1)


@dataclass(frozen=True)
class EffectStatistics:
    """Effect of one parameter on one result, in the result's unit per range of the parameter."""

    mu: float
    """Mean μ of the elementary effects; NaN without any, like the other statistics."""
    mu_star: float
    """Mean μ* of the absolute values of the elementary effects."""
    low: float
    """Lower 95 % bound of μ*, by bootstrap over trajectories; `high` is the upper one."""
    high: float
    sigma: float
    """Standard deviation σ of the elementary effects; NaN for a single one."""
    count: int
    """Number of elementary effects."""


def elementary_effects(places: Array, results: Array) -> Array:
    """Return (y_{j+1} − y_j)/(x_{j+1} − x_j) of the moved parameters, NaN where a run is missing.

    Args:
      places: x, one parameter moving at a time, shape (k + 1, k).
      results: y, NaN for a missing run, shape (k + 1,).

    Returns:
      Shape (k,).
    """
    moves, changes = np.diff(places, axis=0), np.diff(results)
    found = np.full(places.shape[1], np.nan)
    for move, change in zip(moves, changes, strict=True):
        moved = np.flatnonzero(move)
        if len(moved) == 1:  # an integer may have been rounded back to its value before
            found[moved[0]] = change / move[moved[0]]
    return found


def bootstrap_mu_star(effects: Array, seed: int) -> Array:
    """Return bootstrap samples of μ*, each of r trajectories drawn with replacement.

    Args:
      effects: One row per trajectory, NaN for a missing effect, shape (r, k).
      seed: Seed of the draws; the same for all results, so that they use the same trajectories.

    Returns:
      Shape (draws, k), NaN where a draw has no effect of a parameter.
    """
    random, rows = np.random.default_rng(seed), len(effects)
    counts = random.multinomial(rows, np.full(rows, 1.0 / rows), _DRAWS).astype(float)
    valid = np.isfinite(effects)
    sums, numbers = counts @ np.where(valid, np.abs(effects), 0.0), counts @ valid.astype(float)
    return np.divide(sums, numbers, out=np.full(sums.shape, np.nan), where=numbers > 0.0)


def effect_statistics(effects: Array, draws: Array) -> tuple[EffectStatistics, ...]:
    """Return μ, μ* and σ of every parameter.

    Args:
      effects: Effects of k parameters on r trajectories, shape (r, k), NaN for a missing effect.
      draws: μ* of resampled trajectories, shape (draws, k), from `bootstrap_mu_star`.
    """
    return tuple(_measure(effects[:, i], draws[:, i]) for i in range(effects.shape[1]))


def _measure(effects: Array, draws: Array) -> EffectStatistics:
    found, drawn = effects[np.isfinite(effects)], draws[np.isfinite(draws)]
    if not len(found):
        return EffectStatistics(math.nan, math.nan, math.nan, math.nan, math.nan, 0)
    low, high = np.percentile(drawn, [_TAIL, 100.0 - _TAIL])
    sigma = float(np.std(found, ddof=1)) if len(found) > 1 else math.nan
    sizes = float(np.mean(np.abs(found)))
    return EffectStatistics(float(np.mean(found)), sizes, float(low), float(high), sigma, len(found))


def noise_floor(repeats: Iterable[float], trajectories: int, parameters: int, seed: int) -> float:
    """Return the 95 % quantile of the largest μ* of k parameters without effect.

    The null distribution is that of the mean of r differences |y_a − y_b|/Δ of runs with different noise.

    Args:
      repeats: The result with nominal parameters and different noise; NaN is left out.
      trajectories: r.
      parameters: k.
      seed: Seed of the draws.

    Returns:
      Floor in the unit of the result; 0 if noise has no effect, NaN with fewer than two repeats.
    """
    found = np.array([value for value in repeats if math.isfinite(value)])
    if len(found) < 2:
        return math.nan
    a, b = np.triu_indices(len(found), 1)
    differences = np.abs(found[a] - found[b]) / STEP
    random, means = np.random.default_rng(seed), np.zeros(_NULL_DRAWS)
    for _ in range(trajectories):
        means += differences[random.integers(0, len(differences), _NULL_DRAWS)] / trajectories
    return float(np.quantile(means, (1.0 - _CHANCE) ** (1.0 / max(parameters, 1))))


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
    if found.count == 0 or math.isnan(floor):
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
