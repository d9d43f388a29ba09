"""Least-squares problem of one floor, all runs together: output error with a wheel that turns as measured.

The unknowns are the logarithms of the six LuGre parameters and of the rolling radius, common to all runs, and
per run a small deviation of that radius and the accelerometer's bias. Residuals are block means, whitened by
an autoregression. Only the carriage is simulated, driven by the measured wheel speed: its own speed closes
the slip, so the noise of two speeds never meets in a regressor, and motor and gear are not needed.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from omnimj.estimate.identification.runs import CarriageRun, lugre
from omnimj.estimate.least_squares import minimise
from omnimj.physics import carriage
from omnimj.signals import Array

SHARED = 7
"""ln of μ_c, μ_s, V_s, σ0, σ1, σ2 and of the radius scale."""
MU_C, MU_S, V_S, SIGMA_0, SIGMA_1, SIGMA_2, RADIUS_SCALE = range(SHARED)

# weak prior: centre and spread of ln μ_c, ln μ_s/μ_c, ln V_s, ln σ0, ln σ1, ln σ2 and ln of the radius
# scale; it keeps parameters that the runs leave open near usual values
_CENTRE = np.array([np.log(0.1), 0.0, np.log(0.1), np.log(30.0), np.log(0.3), np.log(2.5), 0.0])
_SPREAD = np.array([1.0, 0.5, 2.0, 2.0, 2.0, 1.5, 3e-3])
_SHAPE = np.eye(SHARED)
_SHAPE[MU_S, MU_C] = -1.0

RADIUS_SPREAD = 2e-4
"""Standard deviation of one run's rolling radius about the common one, from the load and place of the
rollers."""
LAGS = 2
"""Order of the autoregression of the residuals."""
_STEP, _RADIUS_STEP = 1e-4, 1e-5
_FIRST_SIGMA = (1e-3, 0.06)  # [m/s, m/s²] of a block mean, before it is estimated from residuals
PRIOR_JACOBIAN: Array = _SHAPE / _SPREAD[:, None]
"""Derivative of `prior_residuals`, shape (SHARED, SHARED)."""
_LONGEST = 1.0  # longest step in a logarithm
_MOST_ROUNDS = 40
_TOLERANCE = 1e-6  # relative change of the cost
_STARTS = (3e-3, 0.05, 0.5)  # [m/s] of V_s: the cost has more than one valley along it


@dataclass(frozen=True)
class Whitening:
    """Noise of the block means: scale and autoregression of each channel."""

    sigma: tuple[float, float]
    """Standard deviation of the innovations: speed [m/s], acceleration [m/s²]."""
    lags: Array
    """Coefficients, shape (2, LAGS)."""

    def __call__(self, residual: Array, channel: int) -> Array:
        """Whiten a residual; missing samples must be 0.

        Args:
          channel: 0 for speed, 1 for acceleration.
        """
        white = residual.copy()
        for lag, share in enumerate(self.lags[channel], start=1):
            white[lag:] -= share * residual[:-lag]
        return white / self.sigma[channel]


FIRST_WHITENING = Whitening(_FIRST_SIGMA, np.zeros((2, LAGS)))


@dataclass(frozen=True)
class RunJacobian:
    """Derivatives of one run's residuals."""

    shared: Array
    """Derivatives with respect to the shared unknowns, shape (n, SHARED)."""
    own: Array
    """Derivative with respect to the run's own radius, shape (n,)."""

    def without_own(self) -> Array:
        """`shared` projected orthogonally to the derivative by the run's own radius, shape (n, SHARED)."""
        return self.shared - np.outer(self.own, self.own @ self.shared) / (self.own @ self.own)


@dataclass(frozen=True)
class FloorProblem:
    """Least-squares problem of one floor: its runs and the noise of their residuals.

    Its unknowns are `shared`, shape (SHARED,), and the deviation of each run's own radius, `own`, (runs,).
    """

    runs: tuple[CarriageRun, ...]
    bias_spread: float
    """Standard deviation of the accelerometer's bias [m/s²]."""
    whitening: Whitening = FIRST_WHITENING

    def simulated(self, shared: Array, own: Array) -> list[Array]:
        """Simulate every run; block means of shape (m, carriage.BLOCK) each."""
        floor = lugre(np.exp(shared[:RADIUS_SCALE]))
        return [
            run.pull(floor, float(np.exp(shared[RADIUS_SCALE] + off)))
            for run, off in zip(self.runs, own, strict=True)
        ]

    def residuals(self, shared: Array, own: Array) -> list[Array]:
        """Whitened residuals of every run, its own radius and bias among them."""
        return [
            self._whitened(run, blocks, off)
            for run, blocks, off in zip(self.runs, self.simulated(shared, own), own, strict=True)
        ]

    def _whitened(self, run: CarriageRun, blocks: Array, off: float) -> Array:
        good = np.isfinite(run.measured)
        with np.errstate(invalid="ignore"):
            raw = np.where(good, blocks[:, : carriage.SLIP] - run.measured, 0.0)
        speed = self.whitening(raw[:, 0], 0)[good[:, 0]]
        felt = self.whitening(raw[:, 1], 1)[good[:, 1]]
        ones = self.whitening(good[:, 1].astype(float), 1)[good[:, 1]]
        bias = (ones @ felt) / (ones @ ones + self.bias_spread**-2)
        return np.concatenate((speed, felt - ones * bias, [bias / self.bias_spread, off / RADIUS_SPREAD]))

    def jacobians(self, shared: Array, own: Array) -> list[RunJacobian]:
        """Central differences of `residuals`, one Jacobian per run."""
        columns = []
        for k in range(SHARED):
            step = np.zeros(SHARED)
            step[k] = _STEP if k != RADIUS_SCALE else _RADIUS_STEP
            high, low = self.residuals(shared + step, own), self.residuals(shared - step, own)
            columns.append([(h - s) / (2.0 * step[k]) for h, s in zip(high, low, strict=True)])
        high, low = (self.residuals(shared, own + sign * _RADIUS_STEP) for sign in (1.0, -1.0))
        by_own = [(h - s) / (2.0 * _RADIUS_STEP) for h, s in zip(high, low, strict=True)]
        return [
            RunJacobian(np.stack([column[k] for column in columns], axis=1), by_own[k])
            for k in range(len(self.runs))
        ]

    def with_whitening_of(self, shared: Array, own: Array) -> FloorProblem:
        """Return the problem with the noise estimated from the residuals of a fit."""
        errors: tuple[list[Array], list[Array]] = ([], [])
        for run, blocks in zip(self.runs, self.simulated(shared, own), strict=True):
            for channel, found in enumerate(errors):
                error = blocks[:, channel] - run.measured[:, channel]
                counted = np.isfinite(error)
                mean = error[counted].mean() if channel and counted.any() else 0.0
                found.append(error - mean)
        shapes = [_autoregression(found) for found in errors]
        return replace(
            self,
            whitening=Whitening(
                (shapes[0][0], shapes[1][0]), np.array([coefficients for _, coefficients in shapes])
            ),
        )


def prior_residuals(shared: Array) -> Array:
    """Residuals of the weak prior in its standard deviations, shape (SHARED,)."""
    return (_SHAPE @ shared - _CENTRE) / _SPREAD


def _autoregression(errors: Sequence[Array]) -> tuple[float, Array]:
    """Scale of the innovations and coefficients, from the runs' pooled autocovariance (Yule and Walker)."""
    moments = np.zeros(LAGS + 1)
    for lag in range(LAGS + 1):
        products = np.concatenate([e[lag:] * e[: len(e) - lag] for e in errors])
        products = products[np.isfinite(products)]
        moments[lag] = products.mean() if len(products) else 0.0
    if moments[0] <= 0.0:
        return _FIRST_SIGMA[0], np.zeros(LAGS)
    table = moments[np.abs(np.subtract.outer(np.arange(LAGS), np.arange(LAGS)))]
    lags = np.linalg.solve(table + 1e-9 * moments[0] * np.eye(LAGS), moments[1:])
    return float(np.sqrt(max(moments[0] - lags @ moments[1:], 1e-6 * moments[0]))), lags


@dataclass(frozen=True)
class FloorFit:
    """Fitted parameters of one floor."""

    problem: FloorProblem
    shared: Array
    """Fitted shared unknowns, shape (SHARED,)."""
    own: Array
    """Deviation of each run's radius, shape (runs,)."""
    residuals: tuple[Array, ...]
    """Whitened residuals of each run, shape (n,) each."""
    cost: float
    """Sum of squares, prior included."""

    @property
    def data_cost(self) -> float:
        """Sum of squares of the runs alone."""
        return float(sum(r @ r for r in self.residuals))


def solve_floor(
    problem: FloorProblem,
    start: Array,
    own: Array | None = None,
    basis: Array | None = None,
) -> FloorFit:
    """Fit the floor from one starting point.

    Args:
      own: Initial deviations of the radius, shape (runs,); zero when None.
      basis: Directions along which the shared unknowns may move, shape (SHARED, p); all when None.
    """
    basis = np.eye(SHARED) if basis is None else basis
    own = np.zeros(len(problem.runs)) if own is None else own
    seen = _SolverView(problem, start, basis)
    first = np.concatenate((np.zeros(basis.shape[1]), own))
    found = minimise(seen, first, rounds=_MOST_ROUNDS, tolerance=_TOLERANCE, longest=_LONGEST, ridge=0.0)
    shared, own = seen.unpack(found.x)
    ends = np.cumsum([len(run.own) for run in found.jacobian])
    residuals = tuple(np.split(found.residual[:-SHARED], ends[:-1]))
    return FloorFit(problem, shared, own, residuals, found.loss)


@dataclass(frozen=True)
class _SolverView:
    """Problem of one floor for `least_squares.minimise`: x = (free shared directions, radius of each run).

    The normal equations have the shape of an arrow: runs share nothing but the shared unknowns. The prior of
    the shared unknowns is part of the residuals.
    """

    problem: FloorProblem
    origin: Array
    """Shared unknowns at x = 0, shape (SHARED,)."""
    basis: Array
    """Directions along which the shared unknowns may move, shape (SHARED, p)."""

    def unpack(self, x: Array) -> tuple[Array, Array]:
        """Shared unknowns, shape (SHARED,), and radius deviations, shape (runs,)."""
        free = self.basis.shape[1]
        return self.origin + self.basis @ x[:free], x[free:]

    def bounds(self) -> tuple[Array, Array]:
        wide = np.full(self.basis.shape[1] + len(self.problem.runs), np.inf)
        return -wide, wide

    def scales(self) -> Array:
        runs = np.full(len(self.problem.runs), RADIUS_SPREAD)
        return np.concatenate((np.ones(self.basis.shape[1]), runs))

    def prior(self, x: Array) -> tuple[Array, Array]:
        return np.zeros(len(x)), np.zeros(len(x))

    def residuals(self, points: Sequence[Array]) -> list[Array]:
        found = []
        for x in points:
            shared, own = self.unpack(x)
            found.append(np.concatenate((*self.problem.residuals(shared, own), prior_residuals(shared))))
        return found

    def loss(self, x: Array, residual: Array) -> float:
        cost = float(residual @ residual)
        return cost if np.isfinite(cost) else np.inf

    def jacobian(self, x: Array, known: list[RunJacobian] | None) -> list[RunJacobian]:
        return self.problem.jacobians(*self.unpack(x))

    def update(
        self, jacobian: list[RunJacobian], residual: Array, moved: Array, step: Array
    ) -> list[RunJacobian]:
        return jacobian

    def normal_equations(self, jacobian: list[RunJacobian], residual: Array) -> Array:
        p = self.basis.shape[1]
        prior, away = PRIOR_JACOBIAN @ self.basis, residual[-SHARED:]
        sums = np.zeros((p + len(jacobian) + 1,) * 2)
        sums[:p, :p], sums[:p, -1] = prior.T @ prior, prior.T @ away
        parts = np.split(residual[:-SHARED], np.cumsum([len(run.own) for run in jacobian])[:-1])
        for k, (run, r) in enumerate(zip(jacobian, parts, strict=True), start=p):
            shared, own = run.shared @ self.basis, run.own * RADIUS_SPREAD
            sums[:p, :p] += shared.T @ shared
            sums[:p, k], sums[k, k] = shared.T @ own, own @ own
            sums[:p, -1] += shared.T @ r
            sums[k, -1] = own @ r
        sums[-1, -1] = residual @ residual
        upper = np.triu_indices(len(sums), 1)
        sums[upper[::-1]] = sums[upper]
        return sums


def solve_multistart(problem: FloorProblem, start: Array) -> FloorFit:
    """Best fit out of several starting values of V_s."""
    fits = []
    for speed in _STARTS:
        begin = start.copy()
        begin[V_S] = np.log(speed)
        fits.append(solve_floor(problem, begin))
    return min(fits, key=lambda fit: fit.cost)


def solve_without_stribeck(fit: FloorFit) -> FloorFit:
    """Fit with μ_s = μ_c, where V_s has no effect."""
    start = fit.shared.copy()
    start[MU_S] = start[MU_C]
    basis = np.delete(np.eye(SHARED), (MU_S, V_S), axis=1)
    basis[MU_S, MU_C] = 1.0
    return solve_floor(fit.problem, start, fit.own, basis)


def solve_with_fixed(fit: FloorFit, index: int, value: float, start: FloorFit) -> FloorFit:
    """Fit with one shared unknown held at a value."""
    shared = start.shared.copy()
    shared[index] = value
    basis = np.delete(np.eye(SHARED), index, axis=1)
    return solve_floor(fit.problem, shared, start.own, basis)
