"""Elementary effects and what they amount to: μ, μ* and σ with intervals, and what noise alone makes of them.

An elementary effect is the change of a result over the share of its range by which one parameter moved, so it
is in the result's unit: the change across the whole range. μ is their mean, μ* that of their sizes
(Campolongo, Cariboni and Saltelli 2007), σ their standard deviation: large where the parameter acts in a
curve, or together with others.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np

from omnimj.signals import Array

# Trajectories through the ranges of all parameters, one parameter at a time (Morris 1991).

LEVELS = 4
"""p: places of a range that are visited, 0, 1/3, 2/3 and 1."""
_JUMP = LEVELS // 2
STEP = _JUMP / (LEVELS - 1)
"""Δ = p/(2(p − 1)): with it every place of a range is visited equally often."""


def trajectory(seed: int, index: int, parameters: int) -> Array:
    """Trajectory number `index`: k + 1 points, from each to the next one parameter moves by ±Δ.

    Which one, which way and from where is drawn; each parameter moves once.

    Args:
      seed: Of the study.
      index: From 0; a trajectory does not depend on how many there are.
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


_DRAWS = 2000
_TAIL = 2.5  # [%] on either side of an interval
_NULL_DRAWS = 20_000
_CHANCE = 0.05  # that noise alone puts any parameter of a result above its floor


@dataclass(frozen=True)
class EffectStatistics:
    """What one parameter does to one result, in the result's unit per range of the parameter."""

    mu: float
    """Mean of the elementary effects; NaN without any, like all that follow."""
    mu_star: float
    """Mean of their sizes."""
    low: float
    """Lower bound of μ*, 95 %, by bootstrap over trajectories."""
    high: float
    sigma: float
    """Their standard deviation; NaN of one."""
    count: int
    """Elementary effects that there are."""


def elementary_effects(places: Array, results: Array) -> Array:
    """(y_{j+1} − y_j)/(x_{j+1} − x_j) of the parameter that moved, NaN where a run is missing.

    Args:
      places: x, one parameter moving at a time, shape (k + 1, k).
      results: y, NaN where there is none, shape (k + 1,).

    Returns:
      Shape (k,).
    """
    moves, changes = np.diff(places, axis=0), np.diff(results)
    found = np.full(places.shape[1], np.nan)
    for move, change in zip(moves, changes, strict=True):
        moved = np.flatnonzero(move)
        if len(moved) == 1:  # a whole number may have been rounded back to where it was
            found[moved[0]] = change / move[moved[0]]
    return found


def bootstrap_mu_star(effects: Array, seed: int) -> Array:
    """μ* of `_BOOTSTRAP_SAMPLES` draws of as many trajectories, with replacement.

    Args:
      effects: One row per trajectory, NaN where there is none, shape (r, k).
      seed: The same seed draws the same trajectories, whatever the result.

    Returns:
      Shape (draws, k), NaN where a draw has no effect of a parameter.
    """
    random, rows = np.random.default_rng(seed), len(effects)
    counts = random.multinomial(rows, np.full(rows, 1.0 / rows), _DRAWS).astype(float)
    valid = np.isfinite(effects)
    sums, numbers = counts @ np.where(valid, np.abs(effects), 0.0), counts @ valid.astype(float)
    return np.divide(sums, numbers, out=np.full(sums.shape, np.nan), where=numbers > 0.0)


def effect_statistics(effects: Array, draws: Array) -> tuple[EffectStatistics, ...]:
    """μ, μ* and σ of every parameter.

    Args:
      effects: Shape (r, k), NaN where there is none.
      draws: From `bootstrap_mu_star`.
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
    """μ* that noise alone does not reach: of r differences |y_a − y_b|/Δ between runs that differ in it only.

    It is the quantile that even the largest of k parameters without any effect stays below, 95 %.

    Args:
      repeats: The result with nominal parameters and different noise; NaN is left out.
      trajectories: r.
      parameters: k.
      seed: Of the draws.

    Returns:
      In the result's unit; 0 where noise changes nothing, NaN with fewer than two repeats.
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
