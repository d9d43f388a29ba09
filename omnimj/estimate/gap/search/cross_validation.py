"""Cross-validation over whole conditions: folds, held-out losses, and gains with their intervals."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from omnimj.effects import Interval
from omnimj.estimate.least_squares import bounded_step, normal_equations
from omnimj.estimate.replay.interface import Replay
from omnimj.estimate.replay.problem import Fit, Problem, huber_weights
from omnimj.signals import Array

_FEWEST_CONDITIONS = 4  # conditions below which a run is cut in time
_TIME_PARTS = 6
_FOLDS = 6
_BOOTSTRAP_SAMPLES = 1000
FOLD_PRIOR = 0.005
"""Share of all runs' information on a parameter that holds it near their fit: what a fold leaves open, such
as a place that only one run passes, stays there."""


@dataclass(frozen=True)
class Groups:
    """Blocks that are held out together: conditions, or stretches of time if there are few conditions."""

    of_block: NDArray[np.int_]
    """Group of every block, shape (blocks,)."""
    names: tuple[str, ...]

    @property
    def count(self) -> int:
        """Number of groups."""
        return len(self.names)


@dataclass(frozen=True)
class TrainingSplit:
    """Training blocks, groups and folds shared by all rounds."""

    used: NDArray[np.bool_]
    """Blocks of the training groups, shape (blocks,)."""
    groups: Groups
    folds: list[NDArray[np.bool_]]
    """Masks of the blocks left out in each fold, shape (blocks,) each."""
    seed: int


def make_groups(replay: Replay) -> Groups:
    """One group per condition; with fewer than four, every condition is cut into six stretches of time."""
    conditions = list(dict.fromkeys(p.condition for p in replay.segments))
    few = len(conditions) < _FEWEST_CONDITIONS
    of_block = np.zeros(len(replay.measured), int)
    names: list[str] = []
    for condition in conditions:
        segments = [p for p in replay.segments if p.condition == condition]
        first = len(names)
        if not few:
            names.append(condition)
            for p in segments:
                of_block[p.first : p.last] = first
            continue
        end = max(float(p.time[-1]) for p in segments) * (1.0 + 1e-9)
        names += [f"{condition}, part {k + 1} of {_TIME_PARTS}" for k in range(_TIME_PARTS)]
        for p in segments:
            # a window belongs to the part that holds its middle; a run of one segment is cut at its blocks
            whole = len(segments) >= 2 * _TIME_PARTS
            at = np.full(p.last - p.first, float(np.median(p.time))) if whole else p.time
            of_block[p.first : p.last] = first + np.minimum(at / end * _TIME_PARTS, _TIME_PARTS - 1).astype(
                int
            )
    return Groups(of_block, tuple(names))


def choose_heldout(groups: Groups, seed: int, names: tuple[str, ...] = ()) -> NDArray[np.bool_]:
    """Mask of groups excluded from every fit: the named, or a quarter drawn by the seed, shape (count,)."""
    out = np.zeros(groups.count, bool)
    if names:
        out[[k for k, name in enumerate(groups.names) if name in names]] = True
        return out
    generator = np.random.default_rng(seed)
    number = max(1, round(0.25 * groups.count))
    out[generator.permutation(groups.count)[:number]] = True
    return out


def make_folds(groups: Groups, train: NDArray[np.bool_], seed: int) -> list[NDArray[np.bool_]]:
    """Masks of the blocks left out in each fold; together they cover the blocks of the training groups.

    Args:
      train: Groups to fit to, shape (count,).

    Returns:
      One mask of shape (blocks,) per fold.
    """
    inside = np.flatnonzero(train)
    order = np.random.default_rng(seed + 1).permutation(inside)
    number = min(_FOLDS, len(order))
    return [np.isin(groups.of_block, order[k::number]) for k in range(number)]


def group_losses(problem: Problem, fitted: Fit, split: TrainingSplit) -> Array:
    """Loss of every training group when its fold is not fitted, to first order, shape (groups,).

    Leaving out a few runs changes the parameters little, so r + J d needs no simulation.
    """
    channels = fitted.residual.shape[1]
    box = problem.steps(fitted.x, fitted.effects)
    prior = problem.prior(fitted.x, fitted.effects)
    weight = huber_weights(problem, fitted.residual, split.used)
    parts = [np.flatnonzero(np.repeat(out, channels)) for out in split.folds]
    flat = fitted.residual.ravel()
    sums = [normal_equations(fitted.jacobian[rows], flat[rows], weight[rows]) for rows in parts]
    total = np.sum(sums, axis=0)
    held = np.zeros_like(total)
    held[np.diag_indices(len(total) - 1)] = FOLD_PRIOR * total.diagonal()[:-1]
    losses = np.full(len(split.used), np.nan)
    for out, rows, own in zip(split.folds, parts, sums, strict=True):
        step = bounded_step(total - own + held, box, prior, 1e-6)
        residual = (flat[rows] + fitted.jacobian[rows] @ step).reshape(-1, channels)
        losses[out] = problem.losses(residual)
    valid = np.isfinite(losses)
    totals = np.bincount(split.groups.of_block[valid], losses[valid]).astype(float)
    return totals[np.bincount(split.groups.of_block[valid]) > 0]


def heldout_gain(before: Array, after: Array) -> Interval:
    """1 − √(Σ after/Σ before) of two models' held-out losses, shape (groups,) each, with a 90 % interval from
    a bootstrap over whole groups.
    """
    value = 1.0 - np.sqrt(after.sum() / before.sum())
    count = len(before)
    times = np.random.default_rng(0).multinomial(count, np.full(count, 1.0 / count), size=_BOOTSTRAP_SAMPLES)
    with np.errstate(invalid="ignore", divide="ignore"):
        sample = 1.0 - np.sqrt((times @ after) / (times @ before))
    low, high = np.nanquantile(sample, (0.05, 0.95))
    return Interval(float(value), float(min(low, value)), float(max(high, value)))


def paired_t(worse: Array, better: Array) -> float:
    """t statistic of the paired difference of two models' held-out losses, shape (groups,) each; large:
    `better` is better.
    """
    difference = worse - better
    spread = float(difference.std(ddof=1)) if len(difference) > 1 else 0.0
    if spread == 0.0:
        return 0.0 if float(difference.sum()) == 0.0 else np.inf * np.sign(float(difference.sum()))
    return float(difference.mean()) / (spread / np.sqrt(len(difference)))
