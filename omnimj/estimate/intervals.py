"""Noise of block means, effective number of samples, and intervals that hold for coloured noise.

A mismatch is measured − simulated, shape (blocks, channels).
"""

from __future__ import annotations

import itertools
from collections import defaultdict

import numpy as np
from numpy.typing import NDArray
from scipy.stats import t as student

from omnimj.estimate.least_squares import bounded_step, normal_equations
from omnimj.estimate.replay.interface import Replay
from omnimj.estimate.replay.problem import Fit, Problem, huber_weights
from omnimj.signals import Array

LEVEL = 0.90
_FEWEST_CONDITIONS = 4  # below which stretches of the runs are left out instead
_RIDGE = 1e-12  # share of the largest squared column that keeps the equations solvable
_HELD = 0.005  # share of its information that a condition keeps when it is left out
TOLERANCE = 0.002
"""Accuracy expected of the best twin, as a share of a channel's RMS."""


def jackknife_deviations(problem: Problem, fitted: Fit, used: NDArray[np.bool_]) -> tuple[Array, float]:
    """Standard deviation of every parameter, and the factor for a 90 % interval.

    Whole conditions are left out in turn: V = (n − 1)/n Σ_g δ_g δ_gᵀ + H⁻¹ P H⁻¹, where
    δ_g = (H − H_g)⁻¹ s_g is the change of the parameters to first order, H = Jᵀ W² J + P, H_g and
    s_g = J_gᵀ W_g² r_g are the parts of one condition, and P is the prior of the base, whose true values are
    as uncertain as it states. Unlike sums of s_g s_gᵀ, V is not too small with as many parameters as
    conditions (MacKinnon and White 1985), and misfit that repeats within a condition counts once. No δ_g
    leads out of the parameters' bounds: in a direction that the data leave open, or where they press against
    a bound, the changes would otherwise be far larger than what the model file states.

    Returns:
      Shape (parameters,), in the parameters' own units; Student's t for as many conditions.
    """
    weight = huber_weights(problem, fitted.residual, used)
    precision, distance = problem.prior(fitted.x, fitted.effects)
    bounds = problem.steps(fitted.x, fitted.effects)
    whole = normal_equations(fitted.jacobian, fitted.residual, weight)

    def step(sums: Array) -> Array:
        return bounded_step(sums, bounds, (precision, distance), 0.0, _RIDGE)

    parts, best = _conditions(problem, used), step(whole)
    count = len(parts)
    total = np.zeros(len(fitted.x))
    for rows in parts:
        own = normal_equations(fitted.jacobian[rows], fitted.residual.ravel()[rows], weight[rows])
        # what only this condition determines stays within reach of the fit of all
        own[:-1, :-1] *= 1.0 - _HELD
        total += (step(whole - own) - best) ** 2
    inverse = np.linalg.pinv(whole[:-1, :-1] + np.diag(precision), rcond=1e-12, hermitian=True)
    between = total * (count - 1) / count + np.einsum("ij,j,ij->i", inverse, precision, inverse)
    # at least the standard deviation under white noise of the stated size
    spread = np.sqrt(np.maximum(between, inverse.diagonal()))
    factor = float(student.ppf(0.5 * (1.0 + LEVEL), max(count - 1, 1)))
    return spread * problem.scales(fitted.effects), factor


def _conditions(problem: Problem, used: NDArray[np.bool_]) -> list[NDArray[np.int_]]:
    """Rows of every condition in use; stretches of a few long runs instead."""
    channels = len(problem.replay.channels)
    by_condition: dict[str, list[slice]] = {}
    for segment in problem.replay.segments:
        if used[segment.first : segment.last].any():
            part = slice(segment.first * channels, segment.last * channels)
            by_condition.setdefault(segment.condition, []).append(part)
    if len(by_condition) < _FEWEST_CONDITIONS:
        by_condition = {f"{k}": [part] for k, part in enumerate(_stretches(by_condition))}
    return [np.concatenate([np.arange(p.start, p.stop) for p in parts]) for parts in by_condition.values()]


def _stretches(runs: dict[str, list[slice]]) -> list[slice]:
    parts = [part for run in runs.values() for part in run]
    if len(parts) >= 8:
        return parts
    cut = []
    for part in parts:
        edges = np.linspace(part.start, part.stop, 9).astype(int)
        cut += [slice(a, b) for a, b in itertools.pairwise(edges)]
    return cut


def repeatability(replay: Replay, mismatch: Array) -> Array:
    """RMS difference of repeats of one condition from their mean, per channel; NaN without repeats.

    The differences are taken between mismatches, so that known differences of the inputs cancel: for repeats
    a, b var = Σ (m_a − m_b)²/2n.
    """
    by_condition: dict[tuple[str, int], list] = defaultdict(list)
    seen: dict[tuple[str, str], int] = defaultdict(int)
    for segment in replay.segments:
        turn = seen[segment.condition, segment.run]
        seen[segment.condition, segment.run] += 1
        if segment.is_repeat:
            by_condition[segment.condition, turn].append(segment)
    total, count = np.zeros(mismatch.shape[1]), np.zeros(mismatch.shape[1])
    for repeats in by_condition.values():
        if len(repeats) < 2:
            continue
        length = min(p.last - p.first for p in repeats)
        stack = np.stack([mismatch[p.first : p.first + length] for p in repeats])
        spread = stack - stack.mean(axis=0)
        whole = np.isfinite(spread).all(axis=0)
        total += np.where(whole, (spread**2).sum(axis=0), 0.0).sum(axis=0)
        count += (len(repeats) - 1) * whole.sum(axis=0)
    with np.errstate(invalid="ignore", divide="ignore"):
        return np.sqrt(total / count)


def neighbour_noise(replay: Replay, mismatch: Array) -> Array:
    """Noise from the second differences of neighbouring blocks, per channel.

    For white noise var(m_(k−1) − 2 m_k + m_(k+1)) = 6 σ²; the median is robust to starts and reversals.
    Blocks without any mismatch, where dry friction holds a joint whatever drives it, do not count.
    """
    known = np.where(mismatch == 0.0, np.nan, mismatch)
    bends = [
        known[p.first : p.last - 2] - 2.0 * known[p.first + 1 : p.last - 1] + known[p.first + 2 : p.last]
        for p in replay.segments
        if p.last - p.first > 2
    ]
    if not bends:
        return np.zeros(mismatch.shape[1])
    sizes = np.abs(np.concatenate(bends))
    middle = [np.median(own[np.isfinite(own)]) if np.isfinite(own).any() else 0.0 for own in sizes.T]
    return np.array(middle) / 0.6745 / np.sqrt(6.0)


def block_noise(replay: Replay, mismatch: Array) -> Array:
    """Standard deviation of a block mean, per channel.

    The larger of repeatability and neighbour noise, combined with a small share of the channel's own RMS
    and the known error of the equations on a healthy machine.
    """
    floor = np.nan_to_num(repeatability(replay, mismatch))
    own = np.sqrt(np.nanmean(replay.measured**2, axis=0))
    rough = np.array([channel.equation_error for channel in replay.channels])
    noise = np.hypot(np.maximum(floor, neighbour_noise(replay, mismatch)), np.hypot(TOLERANCE * own, rough))
    return np.where(noise > 0.0, noise, 1.0)


def effective_samples(replay: Replay, whitened: Array) -> float:
    """Effective number of independent samples, N_eff = N/(1 + 2 Σ ρ_k).

    The sum ends where the autocorrelation ρ_k first falls below 0.05.

    Args:
      whitened: Mismatch in units of noise, shape (blocks, channels), 0 where masked.
    """
    total = 0.0
    for c in range(whitened.shape[1]):
        parts = [whitened[p.first : p.last, c] for p in replay.segments]
        energy = sum(float(part @ part) for part in parts)
        count = sum(np.count_nonzero(part) for part in parts)
        if energy <= 0.0:
            total += count
            continue
        time, longest = 1.0, max(len(part) for part in parts)
        for lag in range(1, longest):
            together = sum(float(part[:-lag] @ part[lag:]) for part in parts if len(part) > lag)
            if together < 0.05 * energy:
                break
            time += 2.0 * together / energy
        total += count / time
    return total


def at_least(covariance: Array, least: Array) -> Array:
    """The covariance, shape (p, p), no smaller than another in any direction: few groups agree by chance."""
    root = np.linalg.cholesky(least)
    inverse = np.linalg.inv(root)
    ratios, vectors = np.linalg.eigh(inverse @ covariance @ inverse.T)
    turned = root @ vectors
    return turned * np.maximum(ratios, 1.0) @ turned.T


def finite_rms(values: Array, without: float = float("nan")) -> float:
    """√(mean of squares) of the finite values of an array of any shape; a given number without any."""
    counted = values[np.isfinite(values)]
    return float(np.sqrt(np.mean(counted**2))) if len(counted) else without


def channel_rms(mismatch: Array) -> Array:
    """√(mean of squares) over known blocks, (blocks, channels) → (channels,); NaN where all are masked."""
    known = np.isfinite(mismatch)
    squares = np.where(known, mismatch, 0.0) ** 2
    with np.errstate(invalid="ignore"):
        return np.sqrt(squares.sum(axis=0) / known.sum(axis=0))
