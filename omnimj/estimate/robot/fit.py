"""Maximum a posteriori estimate of a robot's unknowns by Gauss-Newton over the rows of all runs.

minimise  Σ_rows ψ(W (u(x) + b_run − y)) + Σ x²/s² + Σ b²/s_b²
with y the readings of accelerometer and gyro (its derivative), u their prediction, b the accelerometer's
bias in a run, W the whitening by noise and friction at rest, ψ Huber's loss. Misfit lasts as long as a
manoeuvre: the rows count as many as the autocorrelation of their residuals leaves independent.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from omnimj.estimate.robot.balance import predicted_accelerations, unknown_forces
from omnimj.estimate.robot.blocks import RunRows
from omnimj.estimate.robot.unknowns import Unknowns
from omnimj.signals import Array

HUBER = 3.0
"""Whitened residual from which it counts linearly."""
BIAS_SPREAD = 0.03
"""Standard deviation of the accelerometer's bias in a run, with the tilt of floor and mount [m/s²]."""
_FIRST_NOISE = np.array([0.05, 0.05, 0.3])  # [m/s², m/s², rad/s²]
_ROUNDS, _MOST_ROUNDS, _TOLERANCE = 3, 12, 1e-3
_STEP = 1e-3  # of a prior's deviation, for derivatives
_LONGEST_MEMORY = 500  # rows over which residuals may be correlated
_FADED = 0.05  # autocorrelation at which they are not any more


@dataclass(frozen=True)
class RunSums:
    """Normal equations of one run, its own biases eliminated: what the fit needs of it."""

    name: str
    gram: Array
    """Information on the unknowns, shape (p, p)."""
    slope: Array
    """Jᵀ r, shape (p,)."""
    bias: Array
    """Estimated bias of the accelerometer, shape (2,) [m/s²]."""


@dataclass(frozen=True)
class RobotFit:
    """Estimated unknowns of a robot."""

    unknowns: Unknowns
    x: Array
    """Deviations from nominal, shape (p,)."""
    noise: Array
    """Standard deviation of a row's residual: a_x, a_y [m/s²], ω̇ [rad/s²]."""
    memory: Array
    """Rows per independent one, by channel, shape (3,)."""
    runs: tuple[RunSums, ...]

    @property
    def information(self) -> Array:
        """Information of all runs without the prior, shape (p, p)."""
        return np.sum([run.gram for run in self.runs], axis=0)

    @property
    def precision(self) -> Array:
        """Information of the prior, shape (p,)."""
        return self.unknowns.spread**-2.0

    @property
    def covariance(self) -> Array:
        """Covariance after prior and data if the law were exact, shape (p, p)."""
        return np.asarray(np.linalg.inv(self.information + np.diag(self.precision)), float)


def fit_robot(unknowns: Unknowns, runs: Sequence[RunRows]) -> RobotFit:
    """Estimate the unknowns of a robot."""
    x, noise, memory = np.zeros(len(unknowns.each)), _FIRST_NOISE, np.ones(3)
    sums: tuple[RunSums, ...] = ()
    for round_ in range(_ROUNDS):
        for _ in range(_MOST_ROUNDS):
            sums = tuple(run_sums(unknowns, x, noise * np.sqrt(memory), run) for run in runs)
            step = newton_step(unknowns, x, sums)
            x = x + step
            if np.abs(step / unknowns.spread).max() < (
                _TOLERANCE if round_ == _ROUNDS - 1 else 10 * _TOLERANCE
            ):
                break
        noise, memory = _residual_noise(unknowns, x, sums, runs)
    sums = tuple(run_sums(unknowns, x, noise * np.sqrt(memory), run) for run in runs)
    return RobotFit(unknowns, x, noise, memory, sums)


def newton_step(unknowns: Unknowns, x: Array, sums: Sequence[RunSums]) -> Array:
    """Gauss-Newton step from x, shape (p,)."""
    precision = unknowns.spread**-2.0
    gram = np.sum([one.gram for one in sums], axis=0) + np.diag(precision)
    slope = np.sum([one.slope for one in sums], axis=0) + precision * x
    step = -np.linalg.solve(gram, slope)
    # far steps leave the linear range: no unknown moves further than two of its own deviations at once
    return step / max(1.0, float(np.abs(step / unknowns.spread).max()) / 2.0)


def readings(run: RunRows) -> Array:
    """Accelerations [m/s²] and yaw acceleration [rad/s²] as read, shape (m, 3)."""
    return np.column_stack([run.acceleration, run.yaw_acceleration])


def residuals(unknowns: Unknowns, x: Array, run: RunRows) -> Array:
    """Predicted less measured accelerations without the bias, shape (m, 3), at x of shape (p,)."""
    return predicted_accelerations(unknowns.constants(x), unknowns.errors(x), run) - readings(run)


def _jacobian(unknowns: Unknowns, x: Array, run: RunRows) -> Array:
    """Derivatives of the residuals by differences, shape (m, 3, p)."""
    found, here = np.empty((len(run.time), 3, len(x))), residuals(unknowns, x, run)
    for k, size in enumerate(_STEP * unknowns.spread):
        step = np.zeros(len(x))
        step[k] = size
        found[:, :, k] = (residuals(unknowns, x + step, run) - here) / size
    return found


def _whitening(unknowns: Unknowns, noise: Array, run: RunRows) -> Array:
    """Inverse Cholesky factors of the rows' covariances, shape (m, 3, 3); zero for rows that do not count."""
    cov = unknown_forces(unknowns.nominal.robot, run) + np.diag(noise**2)
    factors = np.linalg.inv(np.linalg.cholesky(cov))
    return np.where((run.good & ~run.still)[:, None, None], factors, 0.0)


def row_whitening(fit: RobotFit, run: RunRows) -> Array:
    """Factors that make the residuals of a row white, shape (m, 3, 3); zero for rows that do not count."""
    return _whitening(fit.unknowns, fit.noise * np.sqrt(fit.memory), run)


def run_sums(unknowns: Unknowns, x: Array, noise: Array, run: RunRows) -> RunSums:
    """Normal equations of one run at x with noise of shape (3,); biases are eliminated (Schur complement)."""
    whiten, p = _whitening(unknowns, noise, run), len(x)
    table = np.empty((len(run.time), 3, p + 3))
    table[:, :, :p] = _jacobian(unknowns, x, run)
    table[:, :, p : p + 2] = np.eye(3)[:, :2]
    table[:, :, p + 2] = residuals(unknowns, x, run)
    table = (whiten @ table).reshape(-1, p + 3)
    bias = np.zeros(2)
    for _ in range(3):  # weights and biases in turn
        rest = table[:, -1] + table[:, p : p + 2] @ bias
        weight = np.minimum(1.0, HUBER / np.maximum(np.abs(rest), 1e-12))
        sums = table.T @ (weight[:, None] * table)
        own = sums[p : p + 2, p : p + 2] + np.eye(2) / BIAS_SPREAD**2
        bias = -np.asarray(np.linalg.solve(own, sums[p : p + 2, -1]), float)
    cross = np.linalg.solve(own, sums[p : p + 2, :]).T
    whole = sums - cross @ sums[p : p + 2, :]
    return RunSums(run.name, whole[:p, :p], whole[:p, -1], bias)


def _residual_noise(
    unknowns: Unknowns, x: Array, sums: Sequence[RunSums], runs: Sequence[RunRows]
) -> tuple[Array, Array]:
    """Noise of each channel and the rows per independent one, where no friction at rest is in play."""
    parts = []
    for one, run in zip(sums, runs, strict=True):
        rest = residuals(unknowns, x, run)
        rest[:, :2] += one.bias
        free = np.trace(unknown_forces(unknowns.nominal.robot, run), axis1=1, axis2=2) == 0.0
        rest[~(free & run.good & ~run.still)] = np.nan
        parts.append(rest)
    everything = np.concatenate(parts)
    if np.isfinite(everything[:, 0]).sum() < 100:
        return _FIRST_NOISE, np.full(3, 10.0)
    noise = 1.4826 * np.nanmedian(np.abs(everything), axis=0)
    return noise, np.array([_memory([part[:, k] for part in parts], 3.0 * noise[k]) for k in range(3)])


def _memory(parts: Sequence[Array], most: float) -> float:
    """Rows per independent one, 1 + 2 Σ ρ_k until the autocorrelation fades; outliers are clipped."""
    clipped = [np.clip(part, -most, most) for part in parts]
    together = np.concatenate(clipped)
    variance, total = float(np.nanmean(together**2)), 1.0
    for lag in range(1, _LONGEST_MEMORY):
        products = [part[:-lag] * part[lag:] for part in clipped if len(part) > lag]
        pairs = np.concatenate(products)
        pairs = pairs[np.isfinite(pairs)]
        if len(pairs) < 100 or pairs.mean() < _FADED * variance:
            break
        total += 2.0 * float(pairs.mean()) / variance
    return total
