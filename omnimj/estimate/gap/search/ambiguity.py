"""Models that the data cannot distinguish, because the remaining misfit hides their difference."""

from __future__ import annotations

import numpy as np
from scipy.stats import t as student

from omnimj.estimate.gap.search.candidates import (
    CLEAR,
    FittedCandidate,
    has_shape_at_bound,
    information_score,
)
from omnimj.estimate.gap.search.cross_validation import TrainingSplit, paired_t
from omnimj.estimate.replay.problem import Fit, Problem, huber_weights
from omnimj.signals import Array

_SURE = 0.95  # one-sided level of the paired test over groups
_LEVEL = 0.90  # share of the draws that the difference of two models must exceed
_DRAWS = 400


def ambiguity_set(
    problem: Problem, tried: list[FittedCandidate], effective_share: float, split: TrainingSplit
) -> tuple[FittedCandidate, ...]:
    """Candidates that the first does not beat: in likelihood, over groups, and by `is_distinguishable`.

    Args:
      problem: The data and the scale.
      tried: Candidates in one place of the model, the best first.
      effective_share: Independent samples over all samples.
      split: Training blocks, groups and folds.
    """
    best = tried[0]
    sure = float(student.ppf(_SURE, max(len(best.losses) - 1, 1)))
    rivals = []
    for other in tried[1:]:
        behind = information_score(other, effective_share) - information_score(best, effective_share)
        if other.gain.value <= 0.0:
            continue
        own = other.fit.x[-len(other.candidate.parameters) :]
        if behind > 0.0 and has_shape_at_bound(other.candidate, own):
            continue
        is_beaten = behind > CLEAR and paired_t(other.losses, best.losses) > sure
        if not (is_beaten and is_distinguishable(problem, best.fit, other.fit, split)):
            rivals.append(other)
    return tuple(rivals)


def is_distinguishable(problem: Problem, best: Fit, other: Fit, split: TrainingSplit) -> bool:
    """True if two models' predictions differ by more than the misfit of whole runs would by chance.

    d is the whitened difference of the predictions, less what the better model's own parameters can follow,
    r its misfit. If the other model were true, the better one would lead by |d|² − 2 d·r. The misfit that
    remains is not white: other structure of the machine repeats in every run. So r is drawn anew, whole runs
    in place of others with random signs; the models are distinguishable if |d|² > 2 |d·r| in 90 % of draws.

    Args:
      problem: The data and the scale.
      best: Fit of the better model.
      other: Fit of the other model, its base refitted.
      split: Training blocks and groups, whose whole runs are drawn.
    """
    weight = huber_weights(problem, best.residual, split.used)[:, None]
    jacobian = best.jacobian * weight
    misfit = best.residual.ravel() * weight[:, 0]
    difference = (other.residual - best.residual).ravel() * weight[:, 0]
    precision, _ = problem.prior(best.x, best.effects)
    gram = jacobian.T @ jacobian + np.diag(precision)
    followed = np.linalg.lstsq(gram, jacobian.T @ difference, rcond=1e-10)[0]
    difference = difference - jacobian @ followed
    chance = _resampled_products(difference, misfit, problem, split)
    return float(difference @ difference) > 2.0 * float(np.quantile(np.abs(chance), _LEVEL))


def _resampled_products(difference: Array, misfit: Array, problem: Problem, split: TrainingSplit) -> Array:
    """Products d·r with the misfits of whole groups in place of others, shape (draws,)."""
    channels = len(problem.replay.channels)
    of_row = np.repeat(np.where(split.used, split.groups.of_block, -1), channels)
    parts = [np.flatnonzero(of_row == g) for g in np.unique(of_row[of_row >= 0])]
    count = len(parts)
    products = np.zeros((count, count))
    for i, rows in enumerate(parts):
        for j, donor in enumerate(parts):
            repeated = np.resize(misfit[donor], len(rows))
            products[i, j] = difference[rows] @ repeated
    random = np.random.default_rng(split.seed + 3)
    donors = random.integers(count, size=(_DRAWS, count))
    signs = random.choice((-1.0, 1.0), size=(_DRAWS, count))
    return (signs * products[np.arange(count), donors]).sum(axis=1)
